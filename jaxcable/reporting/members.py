"""The tables of a report on elements: axial forces with their envelope, what elements tell."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..design import utilisation
from ..elements.abilities import Sagging
from ..elements.element import PRESENT
from ..model.parts import columns, first_and_last, groups_by_name, per_group, there
from .table import Cell, Table

BUCKLING = (
    "utilisation in compression is force over strength, buckling is not in it: see "
    "stiffness.buckling_factor"
)
_ROUNDING = 1e-9  # compression over the largest force up to which it is rounding


def members(structure, state, states, several):
    """Force, utilisation and envelope of every element, by the largest force along it.

    The text leaves the envelope out unless there are `several` states.
    """
    try:
        used = per_group(structure, utilisation(structure, state))
        most = {name: per_group(structure, utilisation(structure, s)) for name, s in states.items()}
    except ValueError:  # no group has a strength
        used, most = [None] * len(structure.groups), {}
    now = _forces(structure, state)
    each = {name: _forces(structure, s) for name, s in states.items()}
    names, rows = list(each), []
    for number, (label, group) in enumerate(groups_by_name(structure)):
        if now[number] is None:  # a group without axial forces
            continue
        force = np.array([each[name][number] for name in names])
        share = [most[n][number] for n in names if n in most and most[n][number] is not None]
        for k, ends in enumerate(first_and_last(group).tolist()):
            here = np.isfinite(now[number][k])
            row = [label, k, *ends, float(now[number][k]) if here else None]
            if names and np.isfinite(force[:, k]).any():
                low, high = int(np.nanargmin(force[:, k])), int(np.nanargmax(force[:, k]))
                row += [float(force[low, k]), names[low], float(force[high, k]), names[high]]
            else:
                row += [None] * 4
            row.append(float(used[number][k]) if here and used[number] is not None else None)
            row.append(max(float(s[k]) for s in share) if share else None)
            rows.append(row)
    heads = ("group", "element", "first", "last", "force", "lowest", "in", "highest", "in ")
    columns = (*heads, "used", "most used")
    units = ("", "", "", "", "N", "N", "", "N", "", "-", "-")
    known = any(value is not None for row in rows for value in row[-2:])
    notes = [] if known else ["no group has a strength: no utilisation"]
    if any(row[4] is None for row in rows):
        notes.append("no force: the element is not there")
    if any(isinstance(group, Sagging) for group in structure.groups):
        notes.append("force of a catenary: the larger of the tensions at its two ends")
    if _compressed(structure, used, now, *each.values()):
        notes.append(BUCKLING)
    if known and structure.space.rotates:
        notes.append(
            "utilisation of beams is that of their axial force alone: see stresses of fibres"
        )
    details = () if several else (5, 6, 7, 8, 10)
    title = f"Forces, tension positive{', and their envelope' if several else ''}"
    return Table(
        title, columns, units, rows, tuple(notes), governing=10 if known else 4, details=details
    )


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
    rows: list[list[Cell]] = []
    for label, members in parts.items():
        low = [(x, row[1], row[6]) for row in members if (x := _first(row[5], row[4])) is not None]
        high = [(x, row[1], row[8]) for row in members if (x := _first(row[7], row[4])) is not None]
        used = [(x, row[1]) for row in members if (x := _first(row[10], row[9])) is not None]
        row = [label, len(members)]
        row += [*min(low, key=_size), *max(high, key=_size)] if low else [None] * 6
        rows.append([*row, *(max(used, key=_size) if used else [None] * 2)])
    columns = ("group", "elements", "lowest", "of", "in", "highest", "of ", "in ")
    units = ("", "", "N", "", "", "N", "", "", "-", "")
    title = "Groups: lowest and highest force, tension positive"
    several = any(row[4] is not None for row in rows)
    details = () if several else (4, 7)
    return {"groups": Table(title, (*columns, "most used", "of  "), units, rows, (), None, details)}


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


def _compressed(structure, used, *forces):
    """Whether compression is compared with strength in any state.

    Args:
        structure: `Structure`.
        used: utilisation, a list with an item per group.
        forces: forces of every state, lists with an item per group.
    """
    sizes = [np.nanmax(np.abs(f), initial=0.0) for state in forces for f in state if f is not None]
    largest = max(sizes, default=0.0)
    return any(
        share is not None
        and force is not None
        and not group.tension_only
        and (force < -_ROUNDING * largest).any()
        for state in forces
        for group, share, force in zip(structure.groups, used, state, strict=True)
    )


def others(structure, state):
    """Tables of other results than forces along elements, a dict by name of the result.

    A result is included if elements tell one number, or one for each component.
    """
    found = {}
    for name, value in (state.results or {}).items():
        if name == PRESENT.name:  # the tables of forces leave out what is not there
            continue
        told = columns(structure.groups, {name: value})
        rows = []
        for number, (label, group) in enumerate(groups_by_name(structure)):
            parts = [column.values[number] for column in told]
            if not parts or parts[0] is None:
                continue
            for k, ends in enumerate(first_and_last(group).tolist()):
                rows.append([label, k, *ends, *(float(part[k]) for part in parts)])
        if rows:
            heads = [column.label.removeprefix(name).strip() or name for column in told]
            units = ("", "", "", "", *(column.unit for column in told))
            title = name.replace("_", " ").capitalize()
            names = ("group", "element", "first", "last", *heads)
            found[name] = Table(title, names, units, rows, governing=4)
    return found
