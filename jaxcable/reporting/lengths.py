"""The lengths of a report: of all elements, and of the cables that run through them."""

from __future__ import annotations

import itertools

import numpy as np

from ..common.types import Float, Int
from ..elements import Cables, SlidingCables
from ..model.result_parts import end_nodes, named_groups_of, values_per_group
from .columns import concatenate_groups, element_columns
from .states import ReportedAnalysis
from .table import Column, Table, columns_of_rows, make_table

# Cosine between two elements at a node up to which one cable runs through them. The direction
# changes by 60 degrees then: more than at any clamp of a net, less than at the corner of a
# triangle, where cables end.
_THROUGH = -0.5
_REFERENCE = "unstressed lengths at the reference temperature (before the first phase)"
_ADDED = "; of added elements at the temperature of the phase that added them"


def cutting_list_table(of: ReportedAnalysis) -> Table:
    """Return the unstressed lengths of all elements, at the temperature before the first phase.

    Elements that a phase has added have seen only changes of temperature since then. Where cables
    run through several elements (see `cable_tables`), there are also the number of the cable in its
    group, and the unstressed length along it up to the start and the end node of the element: the
    positions of clamp marks.
    """
    structure = of.structure
    lengths, chained = _lengths_and_chains(structure, of.solution)
    kept = [k for k, length in enumerate(lengths) if length is not None]
    marks = [np.full((len(group.links), 3), np.nan) for group in structure.groups]
    notes = [_reference_temperature_sentence(of.solution)]
    if not all(isinstance(structure.groups[k], Cables) for k in kept):
        notes.append("beams and bars: length between nodes, without connections")
    for k, (label, _) in enumerate(named_groups_of(structure)):
        for number, (elements, turned) in enumerate(chained[k]):
            along = np.cumsum([0.0, *lengths[k][elements]])
            span = np.column_stack([along[:-1], along[1:]])
            marks[k][elements, 0] = number
            marks[k][elements, 1:] = np.where(turned[:, None], span[:, ::-1], span)
        if k in kept:
            pieces = f"{len(lengths[k])} piece{'s' * (len(lengths[k]) != 1)}"
            whole = of.units.text(np.sum(lengths[k]), "m", ".3f")
            notes.append(f"{label or 'all'}: {pieces}, {whole} in total")
    length = Column("unstressed length", "m", concatenate_groups(structure, lengths, kept))
    columns = [*element_columns(structure, kept), length]
    if any(len(elements) > 1 for found in chained for elements, _ in found):
        cable, start, end = np.concatenate([marks[k] for k in kept]).T
        columns += [
            Column("cable", "", [None if np.isnan(x) else int(x) for x in cable]),
            Column("from", "m", start, "start position"),
            Column("to", "m", end, "end position"),
        ]
        notes.append(
            "start and end position: of the nodes along the unstressed cable (clamp marks)"
        )
    return make_table("Cutting list: fabrication lengths", columns, notes)


def cable_tables(of: ReportedAnalysis) -> dict[str, Table]:
    """Return the unstressed lengths of whole cables, chains of elements: {"cables": `Table`}.

    A cable runs through a node from one element to another of its group if its direction changes by
    60 degrees at most; of several pairs at a node the straightest come first. The dict is empty
    where every cable is a single element.
    """
    rows = []
    parts = _lengths_and_chains(of.structure, of.solution)
    for (label, group), length, found in zip(named_groups_of(of.structure), *parts, strict=True):
        for k, (elements, turned) in enumerate(found):
            ends = end_nodes(group)[elements]
            nodes = np.where(turned[:, None], ends[:, ::-1], ends)
            total = float(length[elements].sum())
            rows.append((label, k, len(elements), int(nodes[0, 0]), int(nodes[-1, 1]), total))
    if all(row[2] == 1 for row in rows):
        return {}
    columns = columns_of_rows(
        rows,
        *("group", "cable", "elements", ("first", "", "start node"), ("last", "", "end node")),
        ("unstressed length", "m"),
    )
    notes = (
        _reference_temperature_sentence(of.solution),
        "a cable: consecutive elements of a group whose direction changes by less than 60 degrees",
    )
    return {"cables": make_table("Whole cables: fabrication lengths", columns, notes)}


def _reference_temperature_sentence(solution):
    """Return a note on the temperature for which unstressed lengths are given.

    It mentions elements that a phase has added, if there are any.
    """
    states = solution.last.restart.states
    added = any(state.present is not None and state.thermal_stretch is not None for state in states)
    return _REFERENCE + _ADDED if added else _REFERENCE


def _lengths_and_chains(structure, solution):
    """Return for each group its unstressed lengths, [n_elem] m or None, and its `cable_chains`.

    Both are lists; lengths are at the temperature before the first phase. Groups that are no cables
    have no chains.
    """
    lengths = values_per_group(structure, solution.last.rest_length)
    positions, chained = np.asarray(solution.last.positions, float), []
    states = solution.last.restart.states
    for k, (group, state) in enumerate(zip(structure.groups, states, strict=True)):
        runs = isinstance(group, Cables) and not isinstance(group, SlidingCables)
        chained.append(cable_chains(end_nodes(group), positions) if runs else [])
        if lengths[k] is not None and state.thermal_stretch is not None:
            lengths[k] = lengths[k] / np.asarray(state.thermal_stretch)
    return lengths, chained


def cable_chains(
    ends: Int[np.ndarray, "n_elem 2"], positions: Float[np.ndarray, "n_node 3"]
) -> list[tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]]:
    """Find the chains of elements that make up each cable of a group.

    Args:
        ends: first and last node of every element, [n_elem, 2].
        positions: positions of the nodes, [n_node, 3], m.

    Returns:
        For each cable the indices of its elements in order, and whether each runs against the
        cable, so that its end node comes first; two arrays [n]. A cable begins at the end on the
        side of the start node of its element with the lowest index; a closed one begins with that
        element.
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
        pairs = [p for p in itertools.combinations(range(len(here)), 2) if cosine[p] <= _THROUGH]
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
