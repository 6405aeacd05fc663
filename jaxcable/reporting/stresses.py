"""The tables of a report on stresses of fibres: at the end, and over all converged increments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..analysis.solution import Path, Solution
from ..common import status
from ..common.types import Bool, Float, Int
from ..elements import Beams
from ..elements.bending import lobatto
from ..elements.element import Element
from ..model.parts import groups_by_name, per_group, there
from ..model.structure import Structure
from ..results import fibre_stress
from . import extremes
from .table import Cell, Table

_SAME = 1e-6  # of the largest stress: fibres whose stresses differ by less have the same


class Stresses(NamedTuple):
    """Extreme stresses of the elements of a group in one increment.

    Attributes:
        low, high: lowest and highest stress of any fibre, [n_elem], Pa; NaN for an element that is
            not there.
        low_at, high_at: where along the element, from 0 to 1, [n_elem]; NaN for bars and cables.
        low_fibre, high_fibre: number of the fibre, [n_elem]; -1 if all have the same stress.
        used: largest stress over the strength of its law, [n_elem]; NaN if no law ends.
    """

    low: Float[np.ndarray, " n_elem"]
    low_at: Float[np.ndarray, " n_elem"]
    low_fibre: Int[np.ndarray, " n_elem"]
    high: Float[np.ndarray, " n_elem"]
    high_at: Float[np.ndarray, " n_elem"]
    high_fibre: Int[np.ndarray, " n_elem"]
    used: Float[np.ndarray, " n_elem"]


class Moment(NamedTuple):
    """One converged increment.

    Attributes:
        name: of its phase or case, with the load factor unless it is the end.
        groups: `Stresses` of every group, or None; a list.
    """

    name: str
    groups: list[Stresses | None]


def stresses(
    structure: Structure, solution: Solution, cases: Mapping[str, Solution] | None
) -> dict[str, Table]:
    """Stresses of fibres in the last converged state, and their envelope, a dict of `Table`.

    Groups that have a stiffness only have no stresses; if all are such, there is no table.

    Args:
        structure: `Structure`.
        solution: `Solution`.
        cases: cases that have converged, by name; None for an envelope over the phases.
    """
    if solution.phases[0].path.strain is None and all(g.area is None for g in structure.groups):
        return {}
    if cases is None:
        every = _moments(structure, solution, [f"phase {k + 1}" for k in range(_reached(solution))])
        end = every[-1:]
    else:
        last = _reached(solution) - 1
        end = _moments(structure, solution, [""] * last + ["end"], from_phase=last)[-1:]
        parts = [_moments(structure, case, [n] * len(case.phases)) for n, case in cases.items()]
        every = [moment for part in parts for moment in part]
    if not end:  # no increment has converged: the state is that before all of them
        return {}
    found = {"stresses": _at_end(structure, end[0])}
    if len(every) > 1 or cases:
        found["stress_envelope"] = _envelope(
            structure, every, "phases" if cases is None else "cases"
        )
    return found


def _reached(solution: Solution) -> int:
    """Number of phases of which an increment has converged."""
    return int(solution.last.phase) + 1


def _moments(structure, solution, names, from_phase=0):
    """The `Moment` of every converged increment of the phases `names`, from one of them on."""
    found = []
    pairs = list(zip(names, solution.phases[: len(names)], strict=True))
    for name, phase in pairs[from_phase:]:
        path = phase.path
        stress = per_group(structure, fibre_stress(structure, phase))
        for k in np.flatnonzero(np.asarray(path.status) == status.OK):
            groups = [
                None if s is None else _extremes(group, s[k], _there(structure, path, k)[number])
                for number, (group, s) in enumerate(zip(structure.groups, stress, strict=True))
            ]
            factor = float(path.load_factor[k])
            found.append(Moment(name if factor == 1 else f"{name}, {factor:.3g}", groups))
    return found


def _there(structure: Structure, path: Path, k: int) -> list[Bool[np.ndarray, " n_elem"]]:
    """Which elements are there in increment k, a list with [n_elem] bool for every group."""
    if path.present is None:
        return there(structure, None)
    return [np.asarray(found)[k] > 0 for found in per_group(structure, path.present)]


def _extremes(group, stress, present):
    """`Stresses` of a group from stresses [n_elem], with axes [n_fibre] or [n_point, n_fibre].

    Along beams of linear laws they are parabolas; of other laws those at the integration points
    count.
    """
    stress = np.asarray(stress, float)
    stress = stress.reshape(len(stress), *(1,) * (3 - stress.ndim), *stress.shape[1:])
    stress = np.where(present[:, None, None], stress, np.nan)
    fibres = np.swapaxes(stress, 1, 2)  # [n_elem, n_fibre, n_point]
    if isinstance(group, Beams):
        places = lobatto(group.points)[0]
        if group.section.is_elastic:
            ends = np.array([0.0, 1.0])
            found = extremes.along(extremes.parabola(fibres, places), ends)
        else:
            found = extremes.among(fibres[:, :, None], places[None])
    else:
        found = extremes.among(fibres[:, :, None], np.full((1, 1), np.nan))
    low, high = (_first(values) for values in (found.low, -found.high))
    each = np.arange(len(stress))
    return Stresses(
        found.low[each, low],
        found.low_at[each, low],
        low,
        found.high[each, high],
        found.high_at[each, high],
        high,
        _used(group, stress),
    )


def _first(values):
    """Number of the first of the smallest values of every line; -1 where all are the same."""
    near = _SAME * np.nanmax(np.abs(values), initial=0.0)
    least = values.min(axis=1, keepdims=True)
    first = (values <= least + near).argmax(axis=1)
    return np.where((values <= least + near).all(axis=1), -1, first)


def _used(group, stress):
    """Largest stress over strength [n_elem] of stresses [n_elem, n_point, n_fibre]; NaN if none."""
    low, high = _limits(group)
    limit = np.where(stress < 0, -low, high)
    known = np.isfinite(limit) & (limit > 0)
    share = np.where(known, np.abs(stress) / np.where(known, limit, 1.0), np.nan)
    share = share.reshape(len(stress), -1)
    some = ~np.isnan(share).all(axis=1)
    return np.where(some, np.nanmax(np.where(some[:, None], share, 0.0), axis=1), np.nan)


def _limits(group):
    """Smallest and largest stress of laws that end: scalars, [n_elem, 1, 1] or [n_fibre], Pa."""
    none = np.array(-np.inf), np.array(np.inf)
    if not group.breaks:
        return none
    if group.section is None:
        if group.area is None:
            return none
        limits = [np.asarray(force) / np.asarray(group.area) for force in group.capacity()]
        return [limit.reshape(-1, 1, 1) for limit in limits]
    pairs = [law.capacity if law.breaks else none for law in group.section.laws]
    return [np.repeat([float(pair[k]) for pair in pairs], group.section.counts) for k in (0, 1)]


def _rows(structure, moment):
    """Elements that have stresses: (name of group, number of group, group, element)."""
    for number, (label, group) in enumerate(groups_by_name(structure)):
        if moment.groups[number] is not None:
            for k in range(len(group.links)):
                yield label, number, group, k


def _fibre(group: Element, stress: Stresses, of: str, k: int) -> list[Cell]:
    """Stress of element k, its place along the element and the y and z of its fibre."""
    value, at = (float(getattr(stress, of + end)[k]) for end in ("", "_at"))
    if np.isnan(value):
        return [None] * 4
    fibre, section = int(getattr(stress, of + "_fibre")[k]), group.section
    known = fibre >= 0 and section is not None
    place = [float(section.y[fibre]), float(section.z[fibre])] if known else [None, None]
    return [value, _number(at), *place]


def _number(value: float) -> float | None:
    """A number as a cell, None for NaN."""
    return None if np.isnan(value) else float(value)


def _at_end(structure, moment):
    """The table of the last converged state."""
    rows = []
    for label, number, group, k in _rows(structure, moment):
        stress = moment.groups[number]
        row = [label, k, *_fibre(group, stress, "low", k), *_fibre(group, stress, "high", k)]
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


def _envelope(structure, moments, kind):
    """The table of the extremes over all moments, of "phases" or "cases"."""
    names = [moment.name for moment in moments]
    rows = []
    for label, number, group, k in _rows(structure, moments[0]):
        parts = [moment.groups[number] for moment in moments]
        row: list[Cell] = [label, k]
        for of, argument in (("low", np.nanargmin), ("high", np.nanargmax)):
            values = np.array([getattr(part, of)[k] for part in parts])
            if np.isnan(values).all():
                row += [None] * 5
                continue
            n = int(argument(values))
            row += [*_fibre(group, parts[n], of, k), names[n]]
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
        details=(3, 8),
    )


def _notes(structure, moment, rows):
    """Sentences on stresses."""
    notes = []
    beams = [
        (label, group) for label, group in groups_by_name(structure) if isinstance(group, Beams)
    ]
    if beams:
        notes.append(
            "at: part of the element from its first node; y, z: centre of the fibre, where its "
            "stress is"
        )
    reach = {label or "the beams": _reach(group.section) for label, group in beams}
    beyond = [f"{100 * r:.2g} % ({label})" for label, r in reach.items() if r is not None and r > 0]
    if beyond:
        notes.append(f"edges of sections are further out than these fibres: {', '.join(beyond)}")
    if any(not group.section.is_elastic for _, group in beams):
        notes.append("of laws that are not linear at integration points only (`points` of Beams)")
    if any(row[-1] is not None for row in rows):
        notes.append("used: stress over the strength of the law of the fibre, the largest share")
    pairs = zip(groups_by_name(structure), moment.groups, strict=True)
    without = [label for (label, _), stress in pairs if stress is None]
    if without:
        notes.append(f"{', '.join(without)}: a stiffness only, no stress")
    if any(row[2] is None for row in rows):
        notes.append("no stress: the element is not there")
    return tuple(notes)


def _reach(section) -> float | None:
    """How much further the edge of a section is than its outermost fibre, relative; or None."""
    if section.points is None:
        return None
    points, axes = np.asarray(section.points, float), (section.y, section.z)
    shares = [
        np.abs(points[:, k]).max() / np.abs(np.asarray(axis)).max() - 1
        for k, axis in enumerate(axes)
        if np.abs(np.asarray(axis)).max() > 0
    ]
    return max(shares, default=0.0)
