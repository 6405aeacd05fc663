"""The tables of a report on stresses: in the final state, and over all load steps."""

from __future__ import annotations

import numpy as np

from ..elements import Beams
from ..model.result_parts import named_groups_of
from ..sections import LinearSection, Section
from .columns import element_columns, envelope_columns
from .fibre_stresses import has_stresses, increment_stresses
from .states import ReportedAnalysis
from .table import Column, Table, make_table

_WHERE = (
    ("at", "-"),
    ("y", "m"),
    ("z", "m"),
)  # place of a stress: along the element, in the section
_SIDES = (("lowest", "min", -1), ("highest", "max", 1))


def stress_tables(of: ReportedAnalysis) -> dict[str, Table]:
    """Return the tables ``stresses``, in the final state, and ``stress_envelope``, a dict.

    Groups that have only a stiffness EA have no stresses; if all are such, there is no table.
    """
    structure, solution = of.structure, of.solution
    if not has_stresses(structure, solution):
        return {}
    reached = int(solution.last.phase) + 1  # number of phases with a converged increment
    if of.cases is None:
        every = end = increment_stresses(structure, solution, of.phase_names[:reached])
    else:
        end = increment_stresses(structure, solution, ["end"] * reached, max(reached - 1, 0))
        every = [
            one
            for name, case in of.cases.items()
            for one in increment_stresses(structure, case, [name] * len(case.phases))
        ]
    if not end:  # no increment has converged, or elements have strains alone
        return {}
    found = {"stresses": _final_stress_table(structure, end[-1])}
    if len(every) > 1 or of.cases:
        found["stress_envelope"] = _stress_envelope_table(structure, every, of.kind)
    return found


def _final_stress_table(structure, end):
    """Return the table of extreme stresses in the final state, `end`: its `IncrementStresses`."""
    low, high, used = end.stresses
    known = bool(np.isfinite(used).any())
    columns = element_columns(structure, end.groups)[:2]
    for (name, heading, _), (stress, at, y, z) in zip(_SIDES, (low, high), strict=True):
        columns += [
            Column(name, "Pa", stress, heading, governs=not known),
            Column("at", "-", at, "x/L"),
            Column("y", "m", y),
            Column("z", "m", z),
        ]
    columns.append(Column("used", "-", used, "stress / strength", governs=known))
    notes = _stress_notes(structure, end.groups, known)
    if np.isnan(low[0]).any():
        notes.append("no stress: the element is not active in the final state")
    return make_table("Stresses in the final state, tension positive", columns, notes)


def _stress_envelope_table(structure, every, kind):
    """Return the table of the extreme stresses over a list `every` of `IncrementStresses`.

    `kind` says what their names are: "phase" or "case".
    """
    names = [one.name for one in every]
    low, high, used = (np.stack(x, axis=-2) for x in zip(*(i.stresses for i in every), strict=True))
    known = bool(np.isfinite(used).any())
    columns = element_columns(structure, every[0].groups)[:2]
    for (name, heading, sign), found in zip(_SIDES, (low, high), strict=True):
        beside = [(*place, x) for place, x in zip(_WHERE, found[1:], strict=True)]
        columns += envelope_columns(
            *(name, "Pa", found[0], names, sign, beside),
            hidden=("at",),
            heading=heading,
            governs=not known,
        )
    most = "used", "-", used, names, 1
    head = "max. stress / strength"
    columns += envelope_columns(*most, hidden=("in",), heading=head, governs=known)
    return make_table(f"Stress envelope, all load steps of all {kind}s, tension positive", columns)


def _stress_notes(structure, groups, known):
    """Return the notes on stresses, a list.

    `groups` are the indices of those in the table; `known` says whether any law has a strength.
    """
    notes, named = [], named_groups_of(structure)
    beams = [(label, group.section) for label, group in named if isinstance(group, Beams)]
    if beams:
        notes.append("x/L: position from the start node, 0 to 1; y, z: point of the section")
    reach = [
        f"{100 * _edge_overhang(section):.2g} % ({label or 'beams'})"
        for label, section in beams
        if not section.is_elastic
    ]
    if reach:
        notes.append(
            "nonlinear laws: stresses at centers of fibres and at integration points; the edge of "
            f"the section is further out by {', '.join(reach)}"
        )
    if known:
        notes.append("stress / strength: with the strength of the law of the fibre, the largest")
    without: dict[str, list[str]] = {}
    for k, (label, group) in enumerate(named):
        if k not in groups:
            missing = "fibres" if isinstance(group.section, LinearSection) else "area given"
            without.setdefault(missing, []).append(label)
    notes += [f"{', '.join(labels)}: no {what}, so no stress" for what, labels in without.items()]
    return notes


def _edge_overhang(section: Section) -> float:
    """Return how much farther out the edge of a section is than its outermost fibre center.

    The result is relative to the distance of this fibre from the axis; 0 if the edge is unknown.
    """
    if section.points is None:
        return 0.0
    points, fibres = np.asarray(section.points, float), np.stack([section.y, section.z], axis=1)
    edge, outermost = np.abs(points).max(axis=0), np.abs(fibres).max(axis=0)
    wide = outermost > 0
    return float((edge[wide] / outermost[wide]).max(initial=1.0)) - 1.0
