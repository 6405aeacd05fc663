"""Linear space frames by the direct stiffness method, and closed forms of beams: an oracle.

Plain NumPy and SciPy in float64, first order, Euler-Bernoulli, no shear flexibility, no warping.

Axes of a member: x from its first to its second end, z the component of `up` normal to x,
y = z cross x. Section: strain = e0 + ky z - kz y with ky, kz the derivatives of the rotations
about y, z; N = sum s A, My = sum s A z, Mz = -sum s A y.

Internal forces (N, Vy, Vz, T, My, Mz) are the force and the moment which the part beyond the cut
(towards the second end) exerts on the part before it, in the axes x, y, z. Equilibrium with the
load q per length: N' = -qx, Vy' = -qy, Vz' = -qz, T' = 0, My' = Vz, Mz' = -Vy (' = d/dx = d/ds/L).
With z up, a load downwards and sagging, My < 0: the bottom (z < 0) is stretched.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, null_space, solve

RIGID = ((np.inf,) * 3,) * 2
ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Member:
    """A straight member between two nodes.

    EA [N], GJ, EIy, EIz [N m2]; D [3, 3] in place of EA, EIy, EIz: (e0, ky, kz) -> (N, My, Mz).
    The shear forces act on the axis (no torque by them), also where D is off-centre.
    joints [2, 3]: rotational springs [N m/rad] between each end and its node (or rigid arm), about
    the local x, y, z: inf rigid, 0 released. offsets [2, 3]: rigid arms from node to member end, in
    global components [m]. axial: carries EA only. load [3]: dead load in global components [N/m],
    over the length; an axial member hands half of it to each end.
    """

    first: int
    second: int
    EA: float = 0.0
    GJ: float = 0.0
    EIy: float = 0.0
    EIz: float = 0.0
    up: tuple = (0.0, 0.0, 1.0)
    D: np.ndarray | None = None
    joints: tuple = RIGID
    offsets: tuple = (ZERO, ZERO)
    axial: bool = False
    load: tuple = ZERO


@dataclass(frozen=True, eq=False)
class Solution:
    """Results; global components but for the members' forces, which are local.

    displacements [n, 6]: translations [m], rotations [rad]. reactions [n, 6]: forces and moments
    of the supports upon the structure. end_forces [m, 12]: what the nodes exert on the member's two
    ends, force and moment each, at the member's ends. lengths [m], loads [m, 3] of the members.
    """

    displacements: np.ndarray
    reactions: np.ndarray
    end_forces: np.ndarray
    lengths: np.ndarray
    loads: np.ndarray
    axial: np.ndarray

    def internal(self, member, s):
        """(N, Vy, Vz, T, My, Mz) [..., 6] at s [...] in 0..1; axial members have no moments."""
        x = np.asarray(s, float)[..., None] * self.lengths[member]
        force, moment = np.split(self.end_forces[member, :6], 2)
        q = self.loads[member]
        axis = np.array([1.0, 0.0, 0.0])
        moments = -moment + x * np.cross(axis, force) + x**2 / 2 * np.cross(axis, q)
        return np.concatenate([-force - q * x, moments * (not self.axial[member])], axis=-1)


def local_axes(along, up):
    """Rows x, y, z [3, 3] of a member along the vector `along` [3]."""
    x = np.asarray(along, float) / np.linalg.norm(along)
    z = np.asarray(up, float) - np.dot(up, x) * x
    if np.linalg.norm(z) <= 1e-9 * np.linalg.norm(up):
        raise ValueError("`up` is parallel to the member")
    z = z / np.linalg.norm(z)
    return np.array([x, np.cross(z, x), z])


def section_stiffness(EA, EIy, EIz, y=0.0, z=0.0):
    """D [3, 3] of a section whose centroid lies at (y, z) off the axis (parallel axis theorem)."""
    place = np.array([1.0, z, -y])
    return EA * np.outer(place, place) + np.diag([0.0, EIy, EIz])


def rigid_arm(r):
    """[6, 6]: displacement and rotation at a point -> those at the point displaced by r [3]."""
    x, y, z = r
    arm = np.eye(6)
    arm[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return arm


def _beam(length, D, GJ, q):
    """Stiffness [12, 12] and end forces at rest [12] of a beam, from exact internal forces.

    As a cantilever held at its first end; two Gauss points integrate the cubics exactly.
    """
    flexibility = np.zeros((6, 6))
    flexibility[np.ix_([0, 4, 5], [0, 4, 5])] = np.linalg.inv(D)
    flexibility[3, 3] = 1 / GJ
    lever = np.array([0.0, -q[2], q[1]])  # x cross q
    f, v = np.zeros((6, 6)), np.zeros(6)
    for a in length / 2 * (1 + np.array([-1, 1]) / np.sqrt(3)):  # distance from the second end
        forces = rigid_arm([a, 0, 0]).T  # at the second end -> at the cut
        f += length / 2 * forces.T @ flexibility @ forces
        v += length / 2 * forces.T @ flexibility @ np.r_[q * a, lever * a**2 / 2]
    relative = np.hstack([-rigid_arm([length, 0, 0]), np.eye(6)])
    rest = -relative.T @ np.linalg.solve(f, v)
    rest[:6] -= np.r_[q * length, lever * length**2 / 2]
    return relative.T @ np.linalg.solve(f, relative), rest


def _bar(length, EA, q):
    """Stiffness [12, 12] and end forces at rest [12] of an axial member."""
    k = np.zeros((12, 12))
    k[np.ix_([0, 6], [0, 6])] = EA / length * np.array([[1, -1], [-1, 1]])
    rest = np.zeros(12)
    rest[:3] -= q * length / 2
    rest[6:9] -= q * length / 2
    return k, rest


def _joined(k, rest, joints):
    """Stiffness and end forces at rest with the ends' rotations joined by springs, condensed."""
    springs = np.asarray(joints, float).ravel()
    soft = np.flatnonzero(np.isfinite(springs))
    if springs[0] == 0 == springs[3]:
        raise ValueError("torsion is released at both ends")
    dofs = np.array([3, 4, 5, 9, 10, 11])[soft]
    inner = np.eye(12)[:, dofs]
    ends = np.hstack([np.eye(12) - inner @ inner.T, inner])
    jump = np.hstack([-inner.T, np.eye(len(soft))])
    k, rest = ends.T @ k @ ends + jump.T @ np.diag(springs[soft]) @ jump, ends.T @ rest
    held = np.linalg.solve(k[12:, 12:], np.column_stack([k[12:, :12], rest[12:]]))
    return k[:12, :12] - k[:12, 12:] @ held[:, :12], rest[:12] - k[:12, 12:] @ held[:, 12]


def _element(nodes, member):
    """Stiffness and end forces at rest (local), map from global nodes [12, 12], length, load."""
    arms = np.asarray(member.offsets, float)
    along = nodes[member.second] + arms[1] - nodes[member.first] - arms[0]
    axes, length = local_axes(along, member.up), np.linalg.norm(along)
    q = axes @ np.asarray(member.load, float)
    if member.axial:
        k, rest = _bar(length, member.EA, q)
    else:
        plain = section_stiffness(member.EA, member.EIy, member.EIz)
        D = plain if member.D is None else np.asarray(member.D, float)
        k, rest = _joined(*_beam(length, D, member.GJ, q), member.joints)
    turn = block_diag(axes, axes)
    return k, rest, block_diag(turn @ rigid_arm(arms[0]), turn @ rigid_arm(arms[1])), length, q


def _direction(n, node, vector, kind):
    """[6 n] with the unit vector at the node's translations or rotations."""
    row = np.zeros((n, 6))
    start = {"translation": 0, "rotation": 3}[kind]
    row[node, start : start + 3] = np.asarray(vector, float) / np.linalg.norm(vector)
    return row.ravel()


def solve_frame(nodes, members, supports, loads):
    """Solution of a frame.

    nodes [n, 3]; supports: (node, vector, "translation" | "rotation") each held direction;
    loads [n, 6]: forces and moments. Rotations of nodes that only axial members meet are held. A
    mechanism is refused.
    """
    nodes, loads = np.asarray(nodes, float), np.asarray(loads, float)
    n = len(nodes)
    K, rest, elements = np.zeros((6 * n, 6 * n)), np.zeros(6 * n), []
    for member in members:
        k, p, to_local, length, q = _element(nodes, member)
        dofs = (6 * np.array([[member.first], [member.second]]) + np.arange(6)).ravel()
        K[np.ix_(dofs, dofs)] += to_local.T @ k @ to_local
        rest[dofs] += to_local.T @ p
        elements.append((k, p, to_local, length, q, dofs))
    held = np.array([_direction(n, *support) for support in supports]).reshape(-1, 6 * n)
    idle = [i for i in range(6 * n) if i % 6 > 2 and not K[i].any()]
    if loads.ravel()[idle].any():
        raise ValueError("a moment acts on a node without rotational stiffness")
    free = null_space(np.vstack([held, np.eye(6 * n)[idle]]))
    u = free @ _regular_solve(free.T @ K @ free, free.T @ (loads.ravel() - rest))
    along = np.linalg.lstsq(held.T, K @ u + rest - loads.ravel(), rcond=None)[0]
    return Solution(
        displacements=u.reshape(n, 6),
        reactions=(held.T @ along).reshape(n, 6),
        end_forces=np.array([k @ to @ u[dofs] + p for k, p, to, _, _, dofs in elements]),
        lengths=np.array([element[3] for element in elements]),
        loads=np.array([element[4] for element in elements]),
        axial=np.array([member.axial for member in members]),
    )


def _regular_solve(K, f):
    """K^-1 f of a symmetric matrix scaled to a unit diagonal; refused where singular."""
    scale = np.sqrt(np.abs(np.diag(K)))
    scaled = K / np.outer(scale, scale) if scale.all() else np.zeros_like(K)
    # round-off leaves about 1e-16 in place of a mechanism's zero
    if len(K) and np.abs(np.linalg.eigvalsh(scaled)).min() < 1e-14:
        raise ValueError("the frame is a mechanism")
    return solve(scaled, f / scale, assume_a="sym") / scale
