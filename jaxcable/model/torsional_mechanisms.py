"""Torsional mechanisms: straight lines of beams that can rotate freely about their own axis.

A mast on a ball joint with guys at its axis can rotate about it: no force, no strain and no node's
position depends on this rotation, but the tangent is singular. Such lines are found on the host,
from the geometry, and named in a warning. The analysis restrains one node of each line softly if
the rotation is indeed without stiffness (`RotatingNodes.stabilize_torsional_mechanisms`).
Equilibrium is not affected: under a torque about the line none exists.

Where a saddle rotates with a node of the line, the cable on it may resist the rotation
(`rotating_saddles.resists_spin`), but only while it is taut: such lines are found, too, because a
slack cable leaves the tangent singular, and there is no warning.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy import sparse

from ..common import checks
from ..common.tree import Indices
from ..common.types import ArrayLike, Bool, Float, Int
from ..elements.abilities import Bending
from ..elements.rotating_saddles import resists_spin

_LINE_TOLERANCE = (
    1e-9  # distance from a line, over the length of the piece, that counts as rounding
)


class TorsionalMechanisms:
    """Straight lines of beams that nothing restrains in torsion; static data.

    Attributes:
        rows: rows of motion (nodes, hinged ends) that rotate with a line of beams, [m], NumPy.
        piece: index of the line of beams that each row belongs to, [m], NumPy.
        ends: two nodes on each line of beams, [n_piece, 2], NumPy.
    """

    def __init__(
        self,
        rows: Int[ArrayLike, " m"],
        piece: Int[ArrayLike, " m"],
        ends: Int[ArrayLike, "n_piece 2"],
    ):
        self.rows, self.piece = np.array(rows, np.int32), np.array(piece, np.int32)
        self.ends = np.array(ends, np.int32).reshape(-1, 2)
        self._key = tuple(Indices(a) for a in (self.rows, self.piece, self.ends))

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TorsionalMechanisms) and self._key == other._key


def find_torsional_mechanisms(
    structure: Any, fixed: Bool[np.ndarray, "n_node 6"], axes: Float[np.ndarray, "n_node 3 3"]
) -> TorsionalMechanisms | None:
    """Find lines of beams that can rotate freely about their axis; None if there are none.

    Args:
        structure: `Structure` with beams.
        fixed: True where supports hold a degree of freedom of a node, [n_node, 6], NumPy.
        axes: directions of these degrees of freedom, [n_node, 3, 3], one in each row of a matrix.
    """
    nodes = checks.array_if_known(structure.nodes)
    if nodes is None:
        return None  # with traced nodes it is not known which pieces are straight
    rows, piece, ends = [], [], []
    for members, turning in _torsion_chains(structure):
        line = _common_line(nodes, members)
        if line is None or _is_rotation_restrained(structure, nodes, turning, line, fixed, axes):
            continue
        rows += turning
        piece += [len(ends)] * len(turning)
        ends.append(line[1])
    return TorsionalMechanisms(rows, piece, ends) if ends else None


def _torsion_chains(structure):
    """Generate the chains of beams of a structure that transmit torsion to each other.

    For each chain: nodes of its beams, [k, 2], and the rows of motion (nodes, hinged ends) that
    rotate with it, a list. Chains with elastic hinges are left out: their rotation would be part of
    the spin.
    """
    _, groups = structure.motion_rows()
    n_node = structure.n_node
    pairs, joined, hinge_rows, wide = [], [], [], []
    for given, group in zip(structure.groups, groups, strict=True):
        if not isinstance(group, Bending):
            continue
        links = given.links.array
        loose = given.hinged_ends()
        loose = np.zeros(links.shape, bool) if loose is None else loose
        pairs.append(links)
        joined.append(~loose)
        hinge_rows.append(np.where(loose, group.links.array[:, :2], -1))
        # the angle of a joint would be part of the spin: such pieces are left out
        released = np.zeros(len(links), bool)
        if given.springs is not None:
            released = given.hinges.array[:, :, 0].any(axis=1)
        wide.append(released)
    if not pairs:
        return
    pairs, joined, hinge_rows, wide = (np.concatenate(v) for v in (pairs, joined, hinge_rows, wide))
    element = n_node + np.arange(len(pairs))
    graph = sparse.coo_array(
        (np.ones(joined.sum()), (np.repeat(element, 2).reshape(-1, 2)[joined], pairs[joined])),
        shape=(n_node + len(pairs),) * 2,
    )
    part = sparse.csgraph.connected_components(graph, directed=False)[1]
    for number in np.unique(part[n_node:]):
        members = np.flatnonzero(part[n_node:] == number)
        if wide[members].any():
            continue
        hinged = hinge_rows[members]
        yield pairs[members], [*np.flatnonzero(part[:n_node] == number), *hinged[hinged >= 0]]


def _common_line(nodes, members):
    """Return (direction, (node, node)) of the line that all beams lie on; None if there is none.

    `nodes` are positions, [n_node, 3], m, and `members` the nodes of the beams, [k, 2].
    """
    places = nodes[members]
    first, second = members[0]
    along = nodes[second] - nodes[first]
    along = along / np.linalg.norm(along)
    off = places - nodes[first]
    off = off - (off @ along)[..., None] * along
    extent = np.ptp((places - nodes[first]) @ along)
    if not np.abs(off).max() <= _LINE_TOLERANCE * extent:
        return None
    return along, (first, second)


def _is_rotation_restrained(structure, nodes, turning, line, fixed, axes):
    """Return whether a support, another element or a rigid link keeps beams from spinning.

    Args:
        structure: `Structure`.
        nodes: positions, [n_node, 3], m.
        turning: rows of motion that rotate with the beams.
        line: direction of the beams and two nodes on it, as of `_common_line`.
        fixed, axes: as of `find_torsional_mechanisms`.
    """
    along, (first, _) = line
    turning = np.array([row for row in turning if row < structure.n_node], int)
    for group in structure.groups:
        rotates = group.rotates and not isinstance(group, Bending)
        if rotates and np.isin(group.links.array, turning).any():
            return True
    spin = np.abs(axes[turning] @ along)  # component of each direction along the line
    if (fixed[turning, 3:] & (spin > 1e-9)).any():
        return True
    if structure.rigid is None:
        return False
    carried = structure.rigid.array[np.isin(structure.rigid.array[:, 0], turning), 1]
    off = nodes[carried] - nodes[first]
    off = off - (off @ along)[:, None] * along
    return bool((np.abs(off) > _LINE_TOLERANCE * np.abs(nodes).max()).any())


def warn_of_torsional_mechanisms(structure: Any, fixed: Any, label: str = "supports") -> None:
    """Warn (`InputWarning`) of each line of beams that can rotate freely about its axis.

    Args:
        structure: `Structure`.
        fixed: `supports.FixedDofs`, with its `mechanisms`.
        label: the supports as a user writes them, such as "phases[0].supports".
    """
    for sentence, remedy in describe_torsional_mechanisms(structure, fixed):
        checks.warn_user(f"{label}: {sentence}{'' if sentence.endswith('?') else ';'} {remedy}")


def describe_torsional_mechanisms(structure: Any, fixed: Any) -> Iterator[tuple[str, str]]:
    """Generate pairs of sentences for each line of beams that can spin: which one, and the remedy.

    Arguments as of `warn_of_torsional_mechanisms`.
    """
    mechanisms = fixed.mechanisms
    if mechanisms is None:
        return
    nodes: Any = checks.array_if_known(structure.nodes)  # known, because mechanisms were found
    held = fixed.array[:, :3].any(axis=1)
    for number, (first, second) in enumerate(mechanisms.ends.tolist()):
        turning = mechanisms.rows[mechanisms.piece == number]
        turning = turning[turning < structure.n_node]
        along = nodes[second] - nodes[first]
        along = along / np.linalg.norm(along)
        spinning = turning
        if structure.rigid is not None:
            first_of_links, carried = structure.rigid.array.T
            spinning = np.append(turning, carried[np.isin(first_of_links, turning)])
        if any(resists_spin(group, nodes, spinning, along) for group in structure.groups):
            continue
        along = np.round(along, 6) + 0.0
        where = f"node {turning[0]} can spin about its line"
        if len(turning) > 1:
            where = f"nodes {turning.min()} to {turning.max()} can spin about their line"
        if not len(turning):
            where = f"the beam from node {first} to {second} can spin about its line"
        hint = ""
        if not held[[*turning, first, second]].any():
            hint = f", and none of them is supported: is a support missing, such as node {first}?"
        yield (
            f"{where}, along {along.tolist()}: nothing holds this rotation{hint}",
            f'to hold it, add restrained([{first}], about="x", axes={along.tolist()}), or in a '
            f'scene file, in supports, "chosen": [{first}], {_restraint_in_scene_file(along)}',
        )


def _restraint_in_scene_file(along):
    """Return the fields "held" and "axes" of a scene file that hold the rotation about a direction.

    `along` is its unit vector, [3].
    """
    held, axes = [False] * 6, ""
    if np.abs(along).max() == 1.0:
        held[3 + int(np.abs(along).argmax())] = True
    else:
        across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        across /= np.linalg.norm(across)
        matrix = np.stack([along, across, np.cross(along, across)])
        held[3] = True
        axes = f', "axes": {json.dumps([(matrix.round(6) + 0.0).tolist()])}'
    return f'"held": {json.dumps([held])}{axes}'
