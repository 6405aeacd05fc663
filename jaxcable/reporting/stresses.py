"""The tables of a report on stresses: in the final state, and over all load steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..analysis.solution import Solution
from ..elements import Beams
from ..model.result_parts import named_groups_of
from ..model.structure import Structure
from ..sections import LinearSection, Section
from .columns import element_columns, envelope_columns
from .fibre_stresses import has_stresses, increment_stresses
from .table import Column, Table, make_table

_WHERE = (("at", "-"), ("y", "m"), ("z", "m"))
"""Name and unit of the columns with the place of a stress: along the element, in the section."""
_HEADINGS = {"at": "x/L"}


def stress_tables(
    structure: Structure,
    solution: Solution,
    cases: Mapping[str, Solution] | None,
    phases: Sequence[str],
) -> dict[str, Table]:
    """Return the tables ``stresses``, in the final state, and ``stress_envelope``, a dict.

    Groups that have only a stiffness EA have no stresses; if all are such, there is no table.

    Args:
        structure: `Structure`.
        solution: `Solution`.
        cases: cases that have converged, by name; None for an envelope over the phases.
        phases: names of all phases, for that envelope.
    """
    if not has_stresses(structure, solution):
        return {}
    reached = int(solution.last.phase) + 1  # number of phases with a converged increment
    if cases is None:
        every = increment_stresses(structure, solution, phases[:reached])
        end = every[-1:]
    else:
        end = increment_stresses(structure, solution, ["end"] * reached, max(reached - 1, 0))[-1:]
        parts = [
            increment_stresses(structure, case, [name] * len(case.phases))
            for name, case in cases.items()
        ]
        every = [instant for part in parts for instant in part]
    if not end:  # no increment has converged, or elements have strains alone
        return {}
    found = {"stresses": _final_stress_table(structure, end[0])}
    if len(every) > 1 or cases:
        kind = "phases" if cases is None else "cases"
        found["stress_envelope"] = _stress_envelope_table(structure, every, kind)
    return found


def _final_stress_table(structure, end):
    """Return the table of extreme stresses in the final state, `end`: its `IncrementStresses`."""
    low, high, used = end.stresses
    known = bool(np.isfinite(used).any())
    columns = element_columns(structure, end.groups)[:2]
    for name, heading, found in (("lowest", "min", low), ("highest", "max", high)):
        columns.append(Column(name, "Pa", found[0], governs=not known, heading=heading))
        columns += [
            Column(*place, x, heading=_HEADINGS.get(place[0], ""))
            for place, x in zip(_WHERE, found[1:], strict=True)
        ]
    gone = bool(np.isnan(low[0]).any())
    columns.append(Column("used", "-", used, governs=known, heading="utilization"))
    notes = _stress_notes(structure, end, known, gone)
    return make_table("Stresses in the final state, tension positive", columns, notes)


def _stress_envelope_table(structure, every, kind):
    """Return the table of the extreme stresses over a list `every` of `IncrementStresses`.

    `kind` says what these are taken from: "phases" or "cases".
    """
    names = [instant.name for instant in every]
    low, high, used = (np.stack(x, axis=-2) for x in zip(*(i.stresses for i in every), strict=True))
    most, state = envelope_columns("used", "-", used, names, 1, heading="max. utilization")
    known = bool(np.isfinite(most.values).any())
    columns = element_columns(structure, every[0].groups)[:2]
    for name, heading, found, sign in (("lowest", "min", low, -1), ("highest", "max", high, 1)):
        beside = [(*place, x) for place, x in zip(_WHERE, found[1:], strict=True)]
        extreme, at, *others = envelope_columns(
            name, "Pa", found[0], names, sign, beside, heading=heading
        )
        columns += [extreme._replace(governs=not known), at._replace(detail=True), *others]
    columns += [most._replace(governs=known), state._replace(detail=True)]
    return make_table(f"Stress envelope, all load steps of all {kind}, tension positive", columns)


def _stress_notes(structure, end, known, gone):
    """Return the notes on stresses, a tuple.

    Args:
        structure: `Structure`.
        end: the `IncrementStresses` of the final state.
        known: whether any law has a strength.
        gone: whether any element is not active.
    """
    notes = []
    beams = [
        (label, group) for label, group in named_groups_of(structure) if isinstance(group, Beams)
    ]
    if beams:
        notes.append("x/L: position from the start node, 0 to 1; y, z: point of the section")
    other = [(label, group.section) for label, group in beams if not group.section.is_elastic]
    if other:
        reach = [
            f"{100 * _edge_overhang(section):.2g} % ({label or 'beams'})"
            for label, section in other
        ]
        notes.append(
            "nonlinear laws: stresses at centers of fibres and at integration points; the edge of "
            f"the section is further out by {', '.join(reach)}"
        )
    if known:
        notes.append("utilization: stress / strength of the law of the fibre, the largest")
    without: dict[str, list[str]] = {}
    for k, (label, group) in enumerate(named_groups_of(structure)):
        if k not in end.groups:
            missing = "fibres" if isinstance(group.section, LinearSection) else "area given"
            without.setdefault(missing, []).append(label)
    notes += [f"{', '.join(labels)}: no {what}, so no stress" for what, labels in without.items()]
    if gone:
        notes.append("no stress: the element is not active in the final state")
    return tuple(notes)


def _edge_overhang(section: Section) -> float:
    """Return by how much the edge of a section is further out than its outermost fibre.

    The result is relative to the distance of this fibre from the axis; 0 if the edge is unknown.
    """
    if section.points is None:
        return 0.0
    points, fibres = np.asarray(section.points, float), np.stack([section.y, section.z], axis=1)
    edge, outermost = np.abs(points).max(axis=0), np.abs(fibres).max(axis=0)
    wide = outermost > 0
    return float((edge[wide] / outermost[wide]).max(initial=1.0)) - 1.0
