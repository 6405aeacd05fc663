"""The oracle of linear frames: compatibility, equilibrium, and the values of textbooks."""

import numpy as np
import pytest
from oracles.stiffness_method import (
    Member,
    local_axes,
    section_stiffness,
    solve_frame,
)

# Both sides are the same real number: round-off 1e-16 times the condition, at most 1e7, of frames
# of a few members with EA L2 / EI up to 1e4.
EXACT = 1e-9
SECTION = dict(EA=4e8, GJ=3e6, EIy=8e6, EIz=2e6)
X, Y, Z = np.eye(3)


def assert_near(value, expected, tolerance=EXACT):
    """Within the tolerance of the largest expected entry."""
    expected = np.asarray(expected, float)
    assert np.abs(value - expected).max() <= tolerance * np.abs(expected).max()


def held(node, kind, axes=(X, Y, Z)):
    return [(node, axis, kind) for axis in axes]


def clamp(node):
    return held(node, "translation") + held(node, "rotation")


# A frame with all that there is -----------------------------------------------------------------


def general_frame():
    """Nodes, members, supports and loads."""
    rng = np.random.default_rng(3)
    nodes = np.array([[0.0, 0, 0], [0.5, 1, 3], [4, 0.3, 3.5], [4.5, -1, 0], [2, 3, 3]])
    root = rng.normal(size=(3, 3))
    D = 1e6 * (root @ root.T + np.eye(3))  # coupled, symmetric, positive
    members = [
        Member(0, 1, D=D, GJ=2e6, up=(1, 0.2, 0), load=(100, -300, -500)),
        Member(1, 2, **SECTION, joints=((np.inf, 0, 3e5), (1e5, np.inf, 0))),
        Member(3, 2, D=2 * D, GJ=1e6, up=(1, 1, 0), offsets=((0.1, 0.2, 0), (0, -0.1, -0.2))),
        Member(1, 4, **SECTION, offsets=((0, 0.1, 0.1), (0, 0, 0)), load=(0, 50, -900)),
        Member(4, 2, D=D, GJ=2e6, joints=((1e6,) * 3, (np.inf, 1e6, 0)), load=(10, 20, 30)),
        Member(4, 3, EA=1e6, axial=True, load=(5, 0, -40)),
    ]
    supports = [*clamp(0), (3, (1, 2, 3), "translation"), (3, (1, 0, 1), "rotation")]
    return nodes, members, supports, rng.normal(size=(5, 6)) * 1e3


FRAME = general_frame()
FOUND = solve_frame(*FRAME)


@pytest.mark.parametrize("member", range(5))
def test_compatibility_and_signs(member):
    """The section's strains, from the internal forces, integrate to the ends' displacements.

    Between the ends of rigid arms, behind the joints' springs (moment over stiffness). Moments are
    quadratic, hence with the lever arm cubic: two Gauss points are exact.
    """
    nodes, m = FRAME[0], FRAME[1][member]
    ends, arms = [m.first, m.second], np.array(m.offsets)
    axes, L = local_axes(np.diff(nodes[ends] + arms, axis=0)[0], m.up), FOUND.lengths[member]
    u = FOUND.displacements[ends].reshape(2, 2, 3)
    u[:, 0] += np.cross(u[:, 1], arms)
    u = u.reshape(4, 3) @ axes.T
    joints, moments = np.array(m.joints), FOUND.end_forces[member].reshape(4, 3)[[1, 3]]
    u[[1, 3]] -= moments * np.divide(1, joints, out=np.zeros((2, 3)), where=joints > 0)
    assert np.abs(moments[joints == 0]).max(initial=0) <= EXACT * np.abs(moments).max()
    s = (1 + np.array([-1, 1]) / np.sqrt(3)) / 2
    forces = FOUND.internal(member, s)
    D = section_stiffness(m.EA, m.EIy, m.EIz) if m.D is None else m.D
    e0, ky, kz = np.linalg.solve(D, forces[:, [0, 4, 5]].T)
    bends = np.column_stack([forces[:, 3] / m.GJ, ky, kz])
    moved = (e0[:, None] * X + np.cross(bends, ((1 - s) * L)[:, None] * X)).mean(axis=0) * L
    # the rotation behind a released joint is not among the results, nor what it displaces
    known = (joints > 0).all(axis=0)
    if known[1:].all():
        assert_near(u[2] - u[0] - np.cross(u[1], L * X), moved)
    assert_near((u[3] - u[1])[known], L * bends.mean(axis=0)[known])
    if member == 0:  # elongation of the fibre at (y, z) is the integral of e0 + ky z - kz y
        place = np.array([0, 0.3, -0.2])
        ends = u[[0, 2]] + np.cross(u[[1, 3]], place)
        assert_near(ends[1, 0] - ends[0, 0], L * (e0 + ky * place[2] - kz * place[1]).mean())


def test_equilibrium_of_the_whole():
    """Loads and reactions have no resultant, and supports hold."""
    nodes, members, supports, loads = FRAME
    u, on_nodes = FOUND.displacements.reshape(5, 2, 3), (loads + FOUND.reactions).reshape(5, 2, 3)
    for node, vector, kind in supports:
        assert abs(u[node, int(kind == "rotation")] @ vector) <= EXACT * np.abs(u).max()
    on_nodes = on_nodes.reshape(5, 6)
    force = on_nodes[:, :3].sum(axis=0)
    moment = (on_nodes[:, 3:] + np.cross(nodes, on_nodes[:, :3])).sum(axis=0)
    for m, length in zip(members, FOUND.lengths, strict=True):
        ends = nodes[[m.first, m.second]] + np.array(m.offsets)
        force += length * np.array(m.load)
        moment += np.cross(ends.mean(axis=0), length * np.array(m.load))
    scale = np.abs(on_nodes).max()
    assert np.abs(force).max() <= EXACT * scale
    assert np.abs(moment).max() <= EXACT * scale * np.abs(nodes).max()


# Textbook values --------------------------------------------------------------------------------


@pytest.mark.parametrize("plane", [1, 2])
@pytest.mark.parametrize(
    ("kind", "start", "shear"),
    [
        ("simple", 0, 1 / 2),
        ("cantilever", -1 / 2, 1),
        ("propped", -1 / 8, 5 / 8),
        ("clamped", -1 / 12, 1 / 2),
    ],
)
def test_beam_in_a_skew_position(kind, start, shear, plane):
    """Uniform load towards -y or -z, Roark, table 8.1: Mz = M, Vy = -V; My = -M, Vz = -V."""
    nodes, up, q = np.array([[1.0, 2, 3], [3, 1, 5]]), (0.3, 0.5, 1), 700.0
    axes, L = local_axes(nodes[1] - nodes[0], up), 3.0
    member = Member(0, 1, **SECTION, up=up, load=-q * axes[plane])
    supports = [*held(0, "translation", axes), (0, axes[0], "rotation")]
    supports += held(0, "rotation", axes[1:]) if kind != "simple" else []
    supports += held(1, "translation", axes[1:]) if kind != "cantilever" else []
    supports += held(1, "rotation", axes[1:]) if kind == "clamped" else []
    s = np.linspace(0, 1, 7)
    M, V = q * L**2 * (start + shear * s - s**2 / 2), q * L * (shear - s)
    expected = np.zeros((7, 6))
    expected[:, plane] = -V
    expected[:, 6 - plane] = M if plane == 1 else -M
    found = solve_frame(nodes, [member], supports, np.zeros((2, 6)))
    assert_near(found.internal(0, s)[:, :3], expected[:, :3])
    assert_near(found.internal(0, s)[:, 3:], expected[:, 3:])
