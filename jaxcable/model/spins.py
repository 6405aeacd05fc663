"""Spins that nothing holds: straight pieces of beams that may turn about their own line.

A mast on a ball joint with guys at its axis can spin: no force, no strain and no node's place
depends on it, but the tangent is singular. Such pieces are found on the host, from the geometry,
and named in a warning; the analysis holds one of their nodes softly where the spin is without
stiffness indeed (`spaces.RigidNodes.regular`). Equilibrium is not touched: under a torque about
the line there is none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from ..common import checks
from ..common.tree import Indices
from ..common.types import ArrayLike, Bool, Float, Int
from ..elements.abilities import Bending

_STRAIGHT = 1e-9  # of the length of a piece, off its line


class Spins:
    """Free spins of a structure: static metadata.

    Attributes:
        rows: rows of motion that turn with a piece, [m], NumPy.
        piece: the piece that each belongs to, [m], NumPy.
        ends: two nodes on the line of each piece, [n_piece, 2], NumPy.
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
        return isinstance(other, Spins) and self._key == other._key


def free_spins(
    structure: Any, fixed: Bool[np.ndarray, "n_node 6"], axes: Float[np.ndarray, "n_node 3 3"]
) -> Spins | None:
    """`Spins` under given supports, or None.

    Args:
        structure: `Structure` with beams.
        fixed: held freedoms of all nodes, [n_node, 6], NumPy.
        axes: their directions, rows of [n_node, 3, 3].
    """
    nodes = checks.concrete(structure.nodes)
    if nodes is None:
        return None  # where pieces are straight is not known
    rows, piece, ends = [], [], []
    for members, own in _pieces(structure):
        line = _line(nodes, members)
        if line is None or _held(structure, nodes, own, line, fixed, axes):
            continue
        rows += own
        piece += [len(ends)] * len(own)
        ends.append(line[1])
    return Spins(rows, piece, ends) if ends else None


def _pieces(structure):
    """Beams that torsion joins: pairs (node pairs of the elements [k, 2], rows that turn)."""
    _, groups = structure.rows()
    n_node = structure.n_node
    pairs, joined, own_rows, wide = [], [], [], []
    for given, group in zip(structure.groups, groups, strict=True):
        if not isinstance(group, Bending):
            continue
        links = given.links.array
        loose = given.hinged_ends()
        loose = np.zeros(links.shape, bool) if loose is None else loose
        pairs.append(links)
        joined.append(~loose)
        own_rows.append(np.where(loose, group.links.array[:, :2], -1))
        # the angle of a joint belongs to the spin as well: such pieces are left alone
        released = np.zeros(len(links), bool)
        if given.springs is not None:
            released = given.hinges.array[:, :, 0].any(axis=1)
        wide.append(released)
    if not pairs:
        return
    pairs, joined, own_rows, wide = (np.concatenate(v) for v in (pairs, joined, own_rows, wide))
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
        own = own_rows[members]
        yield pairs[members], [*np.flatnonzero(part[:n_node] == number), *own[own >= 0]]


def _line(nodes, members):
    """Direction of the line that all members lie on, and two nodes on it; None if they do not."""
    places = nodes[members]
    first, second = members[0]
    along = nodes[second] - nodes[first]
    along = along / np.linalg.norm(along)
    off = places - nodes[first]
    off = off - (off @ along)[..., None] * along
    extent = np.ptp((places - nodes[first]) @ along)
    if not np.abs(off).max() <= _STRAIGHT * extent:
        return None
    return along, (first, second)


def _held(structure, nodes, own, line, fixed, axes):
    """Whether a support, another kind of element or an arm keeps a piece from spinning."""
    along, (first, _) = line
    own = np.array([row for row in own if row < structure.n_node], int)
    for group in structure.groups:
        turned = group.rotates and not isinstance(group, Bending)
        if turned and np.isin(group.links.array, own).any():
            return True
    spin = np.abs(axes[own] @ along)  # how much each direction has of the line
    if (fixed[own, 3:] & (spin > 1e-9)).any():
        return True
    if structure.rigid is None:
        return False
    carried = structure.rigid.array[np.isin(structure.rigid.array[:, 0], own), 1]
    off = nodes[carried] - nodes[first]
    off = off - (off @ along)[:, None] * along
    return bool((np.abs(off) > _STRAIGHT * np.abs(nodes).max()).any())


def warn(structure: Any, spins: Spins | None) -> None:
    """Issue an `InputWarning` that names each piece."""
    if spins is None:
        return
    nodes: Any = checks.concrete(structure.nodes)  # known, or no spin would be
    for number, (first, second) in enumerate(spins.ends.tolist()):
        own = spins.rows[spins.piece == number]
        own = own[own < structure.n_node]
        along = nodes[second] - nodes[first]
        along = np.round(along / np.linalg.norm(along), 6) + 0.0
        where = f"node {own[0]}" if len(own) == 1 else f"nodes {own.min()} to {own.max()}"
        where = where if len(own) else f"the beam from node {first} to {second}"
        checks.suspect(
            f"supports: {where} can spin about their line, along {along.tolist()}: nothing holds "
            f'that; if it is not meant, hold it: pinned(...) + restrained([{first}], about="x", '
            f"axes={along.tolist()})"
        )
