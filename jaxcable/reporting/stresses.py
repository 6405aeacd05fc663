"""The tables of a report on stresses of fibres: at the end, and over all converged increments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..analysis.solution import Solution
from ..elements import Beams
from ..model.parts import groups_by_name
from ..model.structure import Structure
from ..sections import Section
from .fibres import Points, Stresses, moments, points_of, stressed
from .table import Cell, Table


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
    points = [points_of(group) for group in structure.groups]
    reached = int(solution.last.phase) + 1  # number of phases of which an increment has converged
    if cases is None:
        every = moments(structure, points, solution, phases[:reached])
        end = every[-1:]
    else:
        end = moments(structure, points, solution, ["end"] * reached, max(reached - 1, 0))[-1:]
        parts = [
            moments(structure, points, case, [name] * len(case.phases))
            for name, case in cases.items()
        ]
        every = [moment for part in parts for moment in part]
    if not end:  # no increment has converged: the state is that before all of them
        return {}
    if all(stress is None for stress in end[0].groups):  # elements that tell strains alone
        return {}
    found = {"stresses": _at_end(structure, points, end[0])}
    if len(every) > 1 or cases:
        found["stress_envelope"] = _envelope(
            structure, points, every, "phases" if cases is None else "cases"
        )
    return found


def _rows(structure, moment):
    """Elements that have stresses: (name of group, number of group, element)."""
    for number, (label, group) in enumerate(groups_by_name(structure)):
        if moment.groups[number] is not None:
            for k in range(len(group.links)):
                yield label, number, k


def _fibre(points: Points | None, stress: Stresses, of: str, k: int) -> list[Cell]:
    """Stress of element k, its place along the element and the y and z of its fibre."""
    value, at = (float(getattr(stress, of + end)[k]) for end in ("", "_at"))
    if np.isnan(value):
        return [None] * 4
    fibre = int(getattr(stress, of + "_fibre")[k])
    if fibre < 0 or points is None:
        return [value, _number(at), None, None]
    return [value, _number(at), float(points.y[fibre]), float(points.z[fibre])]


def _number(value: float) -> float | None:
    """A number as a cell, None for NaN."""
    return None if np.isnan(value) else float(value)


def _at_end(structure, points, moment):
    """The table of the last converged state."""
    rows = []
    for label, number, k in _rows(structure, moment):
        stress, place = moment.groups[number], points[number]
        row = [label, k, *_fibre(place, stress, "low", k), *_fibre(place, stress, "high", k)]
        rows.append([*row, _number(stress.used[k])])
    heads = ("lowest", "at", "y", "z", "highest", "at ", "y ", "z ")
    return Table(
        "Stresses of fibres at the end, tension positive",
        ("group", "element", *heads, "used"),
        ("", "", *("Pa", "-", "m", "m") * 2, "-"),
        rows,
        _notes(structure, moment, rows),
        governing=10 if any(row[-1] is not None for row in rows) else (2, 6),
    )


def _envelope(structure, points, every, kind):
    """The table of the extremes over `every` moment, of "phases" or "cases"."""
    names = [moment.name for moment in every]
    rows = []
    for label, number, k in _rows(structure, every[0]):
        parts = [moment.groups[number] for moment in every]
        row: list[Cell] = [label, k]
        for of, argument in (("low", np.nanargmin), ("high", np.nanargmax)):
            values = np.array([getattr(part, of)[k] for part in parts])
            if np.isnan(values).all():
                row += [None] * 5
                continue
            n = int(argument(values))
            row += [*_fibre(points[number], parts[n], of, k), names[n]]
        used = np.array([part.used[k] for part in parts])
        if np.isnan(used).all():
            row += [None] * 2
        else:
            row += [float(np.nanmax(used)), names[int(np.nanargmax(used))]]
        rows.append(row)
    heads = ("lowest", "at", "y", "z", "in")
    columns = (*heads, "highest", *(head + " " for head in heads[1:]), "used", "in  ")
    return Table(
        f"Stresses of fibres over all converged increments of all {kind}",
        ("group", "element", *columns),
        ("", "", *("Pa", "-", "m", "m", "") * 2, "-", ""),
        rows,
        governing=12 if any(row[12] is not None for row in rows) else (2, 7),
        details=(3, 8, 13),
    )


def _notes(structure, moment, rows):
    """Sentences on stresses."""
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
    if any(row[-1] is not None for row in rows):
        notes.append("used: stress over the strength of the law of the fibre, the largest share")
    pairs = zip(groups_by_name(structure), moment.groups, strict=True)
    without = [label for (label, _), stress in pairs if stress is None]
    if without:
        notes.append(f"{', '.join(without)}: a stiffness only, no stress")
    if any(row[2] is None for row in rows):
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
