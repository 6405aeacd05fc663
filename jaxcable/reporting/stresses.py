"""The tables of a report on stresses of fibres: at the end, and over all converged increments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..analysis.solution import Solution
from ..elements import Beams
from ..model.parts import groups_by_name
from ..model.structure import Structure
from ..sections import Section
from .columns import envelope, of_elements
from .fibres import instants, stressed
from .table import Column, Table, tabled

_WHERE = (("at", "-"), ("y", "m"), ("z", "m"))
"""Name and unit of the columns that say where a stress is: along the element, in the section."""


def stresses(
    structure: Structure,
    solution: Solution,
    cases: Mapping[str, Solution] | None,
    phases: Sequence[str],
) -> dict[str, Table]:
    """Stresses of fibres in the last converged state, and their envelope, a dict of `Table`.

    Groups that have a stiffness only have no stresses; if all are such, there is no table.

    Args:
        structure: `Structure`.
        solution: `Solution`.
        cases: cases that have converged, by name; None for an envelope over the phases.
        phases: names of all phases, for that envelope.
    """
    if not stressed(structure, solution):
        return {}
    reached = int(solution.last.phase) + 1  # number of phases of which an increment has converged
    if cases is None:
        every = instants(structure, solution, phases[:reached])
        end = every[-1:]
    else:
        end = instants(structure, solution, ["end"] * reached, max(reached - 1, 0))[-1:]
        parts = [
            instants(structure, case, [name] * len(case.phases)) for name, case in cases.items()
        ]
        every = [instant for part in parts for instant in part]
    if not end:  # no increment has converged, or elements tell strains alone
        return {}
    found = {"stresses": _at_end(structure, end[0])}
    if len(every) > 1 or cases:
        kind = "phases" if cases is None else "cases"
        found["stress_envelope"] = _envelope(structure, every, kind)
    return found


def _at_end(structure, end):
    """The table of the last converged state."""
    low, high, used = end.stresses
    known = bool(np.isfinite(used).any())
    columns = of_elements(structure, end.groups)[:2]
    for head, found in (("lowest", low), ("highest", high)):
        columns.append(Column(head, "Pa", found[0], governs=not known))
        columns += [Column(*place, x) for place, x in zip(_WHERE, found[1:], strict=True)]
    gone = bool(np.isnan(low[0]).any())
    columns.append(Column("used", "-", used, governs=known))
    notes = _notes(structure, end, known, gone)
    return tabled("Stresses of fibres at the end, tension positive", columns, notes)


def _envelope(structure, every, kind):
    """The table of the extremes over `every` instant, of "phases" or "cases"."""
    names = [instant.name for instant in every]
    low, high, used = (np.stack(x, axis=-2) for x in zip(*(i.stresses for i in every), strict=True))
    most, state = envelope("used", "-", used, names, 1)
    known = bool(np.isfinite(most.values).any())
    columns = of_elements(structure, every[0].groups)[:2]
    for head, found, sign in (("lowest", low, -1), ("highest", high, 1)):
        beside = [(*place, x) for place, x in zip(_WHERE, found[1:], strict=True)]
        extreme, at, *others = envelope(head, "Pa", found[0], names, sign, beside)
        columns += [extreme._replace(governs=not known), at._replace(detail=True), *others]
    columns += [most._replace(governs=known), state._replace(detail=True)]
    return tabled(f"Stresses of fibres over all converged increments of all {kind}", columns)


def _notes(structure, end, known, gone):
    """Sentences on stresses.

    Args:
        structure: `Structure`.
        end: the `Instant` that is told.
        known: whether any law has a strength.
        gone: whether any element is not there.
    """
    notes = []
    beams = [
        (label, group) for label, group in groups_by_name(structure) if isinstance(group, Beams)
    ]
    if beams:
        notes.append("at: part of the element from its first node; y, z: point of the section")
    other = [(label, group.section) for label, group in beams if not group.section.is_elastic]
    if other:
        reach = [f"{100 * _reach(section):.2g} % ({label or 'beams'})" for label, section in other]
        notes.append(
            "of laws that are not linear: at centres of fibres, integration points; edges are "
            f"further out by {', '.join(reach)}"
        )
    if known:
        notes.append("used: stress over the strength of the law of the fibre, the largest share")
    labels = enumerate(label for label, _ in groups_by_name(structure))
    without = [label for k, label in labels if k not in end.groups]
    if without:
        notes.append(f"{', '.join(without)}: a stiffness only, no stress")
    if gone:
        notes.append("no stress: the element is not there")
    return tuple(notes)


def _reach(section: Section) -> float:
    """How much further the edge of a section is than its outermost fibre; 0 if unknown."""
    if section.points is None:
        return 0.0
    points, fibres = np.asarray(section.points, float), np.stack([section.y, section.z], axis=1)
    edge, outermost = np.abs(points).max(axis=0), np.abs(fibres).max(axis=0)
    wide = outermost > 0
    return float((edge[wide] / outermost[wide]).max(initial=1.0)) - 1.0
