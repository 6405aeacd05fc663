"""The lengths of a report: of all elements, and of the cables that run through them."""

from __future__ import annotations

import itertools

import numpy as np

from ..analysis import solution as results
from ..common.types import Float, Int
from ..elements import Cables, SlidingCables
from ..model.parts import first_and_last, groups_by_name, per_group
from ..model.structure import Structure
from .columns import joined, of_elements
from .table import Column, Table, tabled

_STRAIGHT = -0.5  # cosine between two elements at a node up to which a cable runs through: 60 deg
_WARMTH = "at the temperature before the first phase"
_ADDED = "; elements that were added, at that of the phase which added them"


def cutting_list(structure: Structure, solution: results.Solution) -> Table:
    """Unstressed lengths of all elements, at the temperature before the first phase.

    Elements that a phase has added have seen only changes of temperature since then.

    Where cables run through several elements (see `cables`), these tell the number of their cable
    in the group, and its unstressed length up to their first and last node: where its clamps are to
    be marked.
    """
    lengths, chained = _lengths(structure, solution)
    kept = [k for k, length in enumerate(lengths) if length is not None]
    marks = [np.full((len(group.links), 3), np.nan) for group in structure.groups]
    notes = [_reference(solution)]
    for k, (label, _) in enumerate(groups_by_name(structure)):
        for number, (elements, turned) in enumerate(chained[k]):
            along = np.cumsum([0.0, *lengths[k][elements]])
            span = np.column_stack([along[:-1], along[1:]])
            marks[k][elements, 0] = number
            marks[k][elements, 1:] = np.where(turned[:, None], span[:, ::-1], span)
        if k in kept:
            pieces, total = len(lengths[k]), np.sum(lengths[k])
            notes.append(f"{label or 'all'}: {pieces} pieces, {total:.3f} m in total")
    length = Column("unstressed length", "m", joined(structure, lengths, kept))
    columns = [*of_elements(structure, kept), length]
    if any(len(elements) > 1 for found in chained for elements, _ in found):
        cable, *ends = np.concatenate([marks[k] for k in kept]).T
        columns.append(Column("cable", "", [None if np.isnan(x) else int(x) for x in cable]))
        columns += [Column(head, "m", x) for head, x in zip(("from", "to"), ends, strict=True)]
        notes.append("from, to: where the first and last node are along the cable")
    return tabled("Cutting list", columns, notes)


def cables(structure: Structure, solution: results.Solution) -> dict[str, Table]:
    """Unstressed lengths of whole cables, each a chain of elements of its group: ``cables``.

    There is no such table where every cable is a single element.

    A cable runs through a node from one element to another of its group if they turn by 60 degrees
    at most; of several pairs at a node the straightest come first.
    """
    rows = []
    groups = zip(groups_by_name(structure), *_lengths(structure, solution), strict=True)
    for (label, group), length, found in groups:
        ends = first_and_last(group)
        for k, (elements, turned) in enumerate(found):
            nodes = np.where(turned[:, None], ends[elements][:, ::-1], ends[elements])
            total = float(length[elements].sum())
            rows.append((label, k, len(elements), int(nodes[0, 0]), int(nodes[-1, 1]), total))
    if all(row[2] == 1 for row in rows):
        return {}
    heads = ("group", "cable", "elements", "first", "last", "unstressed length")
    columns = [
        Column(head, "m" if head == heads[-1] else "", values)
        for head, values in zip(heads, zip(*rows, strict=True), strict=True)
    ]
    notes = (
        _reference(solution),
        "a cable: elements of a group that go on from node to node within 60 degrees",
    )
    return {"cables": tabled("Cables", columns, notes)}


def _reference(solution):
    """At which temperature the lengths are, in words."""
    states = solution.last.carry.states
    added = any(state.present is not None and state.warmth is not None for state in states)
    return _WARMTH + _ADDED if added else _WARMTH


def _lengths(structure, solution):
    """Lengths [n_elem] of every group, or None, and its `chains`; two lists."""
    lengths = per_group(structure, solution.last.rest_length)
    positions, chained = np.asarray(solution.last.positions, float), []
    states = solution.last.carry.states
    for k, (group, state) in enumerate(zip(structure.groups, states, strict=True)):
        runs = isinstance(group, Cables) and not isinstance(group, SlidingCables)
        chained.append(chains(first_and_last(group), positions) if runs else [])
        if lengths[k] is not None and state.warmth is not None:
            lengths[k] = lengths[k] / np.asarray(state.warmth)
    return lengths, chained


def chains(
    ends: Int[np.ndarray, "n_elem 2"], positions: Float[np.ndarray, "n_node 3"]
) -> list[tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]]:
    """Elements that follow each other along cables.

    Args:
        ends: first and last node of every element, [n_elem, 2].
        positions: of the nodes, m.

    Returns:
        For each cable its elements in order, and whether each is turned, so that its last node
        comes first; two arrays [n]. A cable begins with its element of the lowest number, at an end
        if it has one.
    """
    chord = positions[ends[:, 1]] - positions[ends[:, 0]]
    chord = chord / np.maximum(np.linalg.norm(chord, axis=1, keepdims=True), 1e-300)
    meeting: dict[int, list[tuple[int, int]]] = {}
    for k, pair in enumerate(ends.tolist()):
        for side, node in enumerate(pair):
            meeting.setdefault(node, []).append((k, side))
    beyond: dict[tuple[int, int], tuple[int, int]] = {}  # element and end that follow an end
    for here in meeting.values():
        out = np.array([chord[k] if side == 0 else -chord[k] for k, side in here])
        cosine = out @ out.T
        pairs = [p for p in itertools.combinations(range(len(here)), 2) if cosine[p] <= _STRAIGHT]
        for a, b in sorted(pairs, key=lambda p: cosine[p]):
            if here[a] not in beyond and here[b] not in beyond:
                beyond[here[a]], beyond[here[b]] = here[b], here[a]
    found, used = [], np.zeros(len(ends), bool)
    for start in range(len(ends)):
        if used[start]:
            continue
        at = start, 0
        while at in beyond and beyond[at][0] != start:  # back to where the cable begins
            k, side = beyond[at]
            at = k, 1 - side
        if at in beyond:  # closed: it begins here
            at = start, 0
        elements, turned = [], []
        while not used[at[0]]:
            used[at[0]] = True
            elements.append(at[0])
            turned.append(at[1] == 1)
            leave = at[0], 1 - at[1]
            if leave not in beyond:
                break
            at = beyond[leave]
        found.append((np.array(elements), np.array(turned)))
    return found
