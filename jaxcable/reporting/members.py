"""The tables of a report on axial forces of elements, with their envelope."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..design import utilization
from ..elements.abilities import Sagging
from ..model.parts import per_group, there
from .columns import envelope, joined, joined_each, of_elements
from .table import Column, Table, tabled

BUCKLING = (
    "utilisation in compression is force over strength, buckling is not in it: see "
    "stiffness.buckling_factor"
)
_ROUNDING = 1e-9  # compression over the largest force up to which it is rounding


def members(structure, state, states, several):
    """Force, utilisation and envelope of every element, by the largest force along it.

    The text leaves the envelope out unless there are `several` states.
    """
    names, now = list(states), _forces(structure, state)
    each = [_forces(structure, other.result) for other in states.values()]
    kept = [k for k, own in enumerate(now) if own is not None]  # groups with axial forces
    every = (state, *(other.result for other in states.values()))
    try:
        used, *most = (per_group(structure, utilization(structure, x)) for x in every)
    except ValueError:  # no group has a strength
        used, *most = ([None] * len(now) for _ in every)
    force, over = joined(structure, now, kept), joined_each(structure, each, kept)
    share = np.where(np.isnan(force), np.nan, joined(structure, used, kept))
    largest = envelope("most used", "-", joined_each(structure, most, kept), names, 1)[0]
    known = bool(np.isfinite([share, largest.values]).any())
    extremes = envelope("lowest", "N", over, names, -1) + envelope("highest", "N", over, names, 1)
    shown = [
        *of_elements(structure, kept),
        Column("force", "N", force, governs=not known),
        *(column._replace(detail=not several) for column in extremes),
        Column("used", "-", share),
        largest._replace(governs=known, detail=not several),
    ]
    notes = [] if known else ["no group has a strength: no utilisation"]
    if np.isnan(force).any():
        notes.append("no force: the element is not there")
    if any(isinstance(group, Sagging) for group in structure.groups):
        notes.append("force of a catenary: the larger of the tensions at its two ends")
    pressed = np.vstack([force, over])
    pressed = (pressed < -_ROUNDING * np.nanmax(np.abs(pressed), initial=0.0)).any(axis=0)
    pairs = zip(structure.groups, used, strict=True)
    judged = [None if x is None else np.full(len(x), not g.tension_only) for g, x in pairs]
    if (pressed & (joined(structure, judged, kept) > 0)).any():
        notes.append(BUCKLING)
    if known and structure.space.rotates:
        notes.append(
            "utilisation of beams is that of their axial force alone: see stresses of fibres"
        )
    title = f"Forces, tension positive{', and their envelope' if several else ''}"
    return tabled(title, shown, notes)


def groups(table: Table) -> dict[str, Table]:
    """The lowest and highest force of every group, and its most used element: ``groups``.

    Args:
        table: table of `members`, whose envelope counts where there is one, else its force.

    Returns:
        A dict with the table; empty of a single group.
    """
    parts: dict[Any, list[Any]] = {}
    for row in table.rows:
        parts.setdefault(row[0], []).append(row)
    if len(parts) < 2:
        return {}
    rows = []
    for label, members in parts.items():
        low = [(x, row[1], row[6]) for row in members if (x := _first(row[5], row[4])) is not None]
        high = [(x, row[1], row[8]) for row in members if (x := _first(row[7], row[4])) is not None]
        used = [(x, row[1]) for row in members if (x := _first(row[10], row[9])) is not None]
        row = [label, len(members)]
        row += [*min(low, key=_size), *max(high, key=_size)] if low else [None] * 6
        rows.append([*row, *(max(used, key=_size) if used else [None] * 2)])
    heads = ("group", "elements", "lowest", "of", "in", "highest", "of", "in", "most used", "of")
    units = {"lowest": "N", "highest": "N", "most used": "-"}
    columns = [
        Column(head, units.get(head, ""), values)
        for head, values in zip(heads, zip(*rows, strict=True), strict=True)
    ]
    if all(value is None for value in columns[4].values):
        columns = [column._replace(detail=column.name == "in") for column in columns]
    return {"groups": tabled("Groups: lowest and highest force, tension positive", columns)}


def _first(value, otherwise):
    """The value, or another one if there is none."""
    return otherwise if value is None else value


def _size(item):
    return item[0]


def _forces(structure, state):
    """Largest forces along elements, NaN for those that are not there, a list of [n_elem]."""
    parts = per_group(structure, state.peak_tension), there(structure, state.present)
    return [
        None if force is None else np.where(present, force, np.nan)
        for force, present in zip(*parts, strict=True)
    ]
