"""Topology of a structure: what must agree if one structure's results serve for another one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from ..common.checks import numpy_or_jax
from ..common.tree import Indices, computed_once
from ..common.types import ArrayLike, Bool
from ..elements.element import Element, Result
from .supports import FixedDofs


class GroupTopology(NamedTuple):
    """Topology of one element group: its class, links, results and other static data.

    Attributes:
        name: key in the elements as text.
        kind: name of its class.
        links: node numbers of its elements, `Indices` [n_elem, n_end].
        face: positions in `links` around the face of an element, a tuple, or None.
        outline: positions in `links` along which pictures draw an element, a tuple, or None.
        results: results of its elements, a tuple of `elements.element.Result`.
        hinges: `Indices` of ends that rotate independently of their nodes, or None.
        inner_unknowns: indices of its inner unknowns, and how many rows of motion they take.
        memory_shapes: shapes of the history variables of its law, as text; "None" without any.
    """

    name: str
    kind: str
    links: Indices
    face: tuple[int, ...] | None
    outline: tuple[int, ...] | None
    results: tuple[Result, ...]
    hinges: Indices | None
    inner_unknowns: tuple[tuple[tuple[int, int], ...], int]
    memory_shapes: str


class Topology(NamedTuple):
    """Topology of a whole structure, by which a `State` knows which structure it belongs to.

    Attributes:
        parts: one `GroupTopology` per group.
        rigid: pairs of nodes of rigid links, (reference, dependent), `Indices` [n, 2], or None.
        supports: degrees of freedom that the supports of the structure hold, `FixedDofs`.
        n_node: number of nodes.
    """

    parts: tuple[GroupTopology, ...]
    rigid: Indices | None
    supports: FixedDofs
    n_node: int


def nodes_with_elements(
    groups: Sequence[Element | GroupTopology],
    n_node: int,
    rigid: Indices | None = None,
    chosen: Sequence[Bool[ArrayLike, " n_elem"]] | None = None,
) -> Bool[np.ndarray, " n_node"]:
    """Return which nodes are ends of elements, [n_node] bool; traced if `chosen` is.

    Args:
        groups: element groups, or the parts of a `Topology`.
        n_node: number of nodes.
        rigid: rigid links, [n, 2], both nodes of which count as ends; or None.
        chosen: which elements count, per group [n_elem] bool; None: all.
    """
    root = np.arange(n_node)
    if rigid is not None:
        root[rigid.array[:, 1]] = rigid.array[:, 0]
    pack = numpy_or_jax(chosen)
    found = pack.zeros(n_node, bool)
    for group, which in zip(groups, chosen or [True] * len(groups), strict=True):
        ends = root[group.links.array]
        over = pack.broadcast_to(pack.reshape(pack.asarray(which), (-1, 1)), ends.shape)
        if pack is np:
            found[ends[over]] = True
        else:
            found = found.at[ends].max(over)
    return found[root]


@computed_once
def topology_of(structure):
    """Return the `Topology` of a `Structure`, computed once."""
    parts = tuple(
        GroupTopology(
            name,
            type(group).__name__,
            group.links,
            group.face,
            group.outline,
            group.results,
            group.hinges,
            (tuple(group.inner_unknowns), group.n_inner_row),
            str(jax.tree.map(lambda x: x.shape, jax.eval_shape(group.initial_memory))),
        )
        for name, group in structure.named_groups()
    )
    supports = structure.fixed(structure.supports)
    return Topology(parts, structure.rigid, supports, structure.n_node)


def require_same_topology(structure, there, name):
    """Raise ValueError unless a structure has the topology that a state was computed with.

    Args:
        structure: `Structure`.
        there: `Topology` of the state, or None if it is not known.
        name: name of the argument that is the state, for the message.
    """
    if there is None:
        return
    here = topology_of(structure)
    if here == there:
        return
    if here.n_node != there.n_node:
        raise ValueError(
            f"{name}: belongs to a structure of {there.n_node} nodes; this structure has "
            f"{here.n_node}"
        )
    names = [[part.name for part in topology.parts] for topology in (here, there)]
    if names[0] != names[1]:
        lists = [", ".join(keys) if any(keys) else "one without a name" for keys in names]
        raise ValueError(
            f"{name}: element groups: {lists[0]} in this structure, and {lists[1]} there"
        )
    for ours, theirs in zip(here.parts, there.parts, strict=True):
        if ours != theirs:
            raise ValueError(f"{name}: elements{ours.name}: {_describe_difference(ours, theirs)}")
    if here.rigid != there.rigid:
        raise ValueError(f"{name}: rigid: has other pairs of nodes than this structure")
    if (here.supports.array != there.supports.array).any():
        node = int(np.argwhere(here.supports.array != there.supports.array)[0][0])
        raise ValueError(
            f"{name}: supports: this structure holds node {node} otherwise; supports that change "
            "go into a phase: Phase(supports=...)"
        )
    if here.supports.axes != there.supports.axes:
        raise ValueError(
            f"{name}: supports: this structure holds nodes along other directions; supports that "
            "change go into a phase: Phase(supports=...)"
        )


def _describe_difference(part, other):
    """Return in words how one `GroupTopology` differs from another, for a message.

    `part` is that of this structure, `other` that of the state.
    """
    if part.kind != other.kind:
        return f"is made of {part.kind} in this structure, and of {other.kind} there"
    here, there = part.links.array, other.links.array
    if len(here) != len(there):
        return f"has {len(here)} elements in this structure, and {len(there)} there"
    if here.shape != there.shape:
        return (
            f"its elements have {here.shape[1]} nodes in this structure, and {there.shape[1]} there"
        )
    apart = (here != there).any(axis=1)
    if apart.any():
        k = int(apart.argmax())
        return f"links[{k}] is {here[k].tolist()} in this structure, and {there[k].tolist()} there"
    if part.hinges != other.hinges:
        return "hinges: other ends are hinged in this structure than there"
    if part.inner_unknowns != other.inner_unknowns:
        return "its beams have other inner unknowns (joints, or sections that are not linear)"
    return "its law has other history variables than there"
