"""The tables of a report on axial forces of elements and groups, with their envelope."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..analysis.results import Results
from ..common.negligible import NEGLIGIBLE
from ..common.types import Float
from ..design import utilization
from ..elements import Beams
from ..elements.abilities import Sagging
from ..model.result_parts import present_elements, values_per_group
from ..model.structure import Structure
from .columns import (
    concatenate_groups,
    concatenate_groups_of_states,
    element_columns,
    envelope_columns,
    states_heading,
)
from .states import EnvelopeState
from .table import Column, Table, make_table

BUCKLING = (
    "utilization in compression: force / strength; buckling is not checked here, see "
    "stiffness.buckling_factor"
)


def axial_force_table(
    structure: Structure, state: Results, states: Mapping[str, EnvelopeState], several: bool
) -> Table:
    """Return the table of axial force, utilization and envelope of every element.

    Forces are the largest along each element, `peak_tension`.

    Args:
        structure: `Structure`.
        state: the final state.
        states: the states of the envelope, by name.
        several: whether the text shows the envelope.
    """
    names, now = list(states), peak_forces(structure, state)
    each = [peak_forces(structure, other.result) for other in states.values()]
    kept = [k for k, own in enumerate(now) if own is not None]  # groups with axial forces
    used: list[Any]
    envelope: list[Any]
    results = (state, *(other.result for other in states.values()))
    try:
        used, *envelope = (values_per_group(structure, utilization(structure, x)) for x in results)
    except ValueError:  # no group has a strength
        used, *envelope = ([None] * len(now) for _ in results)
    force = concatenate_groups(structure, now, kept)
    over = concatenate_groups_of_states(structure, each, kept)
    ratio = np.where(np.isnan(force), np.nan, concatenate_groups(structure, used, kept))
    ratios = concatenate_groups_of_states(structure, envelope, kept)
    most, when = envelope_columns("most used", "-", ratios, names, 1, heading="max. utilization")
    known = bool(np.isfinite([ratio, np.asarray(most.values)]).any())
    extremes = [
        *envelope_columns("lowest", "N", over, names, -1, heading="min. force"),
        *envelope_columns("highest", "N", over, names, 1, heading="max. force"),
    ]
    columns = [
        *element_columns(structure, kept),
        Column("force", "N", force, governs=not known, heading="final force"),
        *(column._replace(detail=not several) for column in extremes),
        Column("used", "-", ratio, heading="utilization"),
        most._replace(governs=known, detail=not several),
        when._replace(detail=True),
    ]
    notes = _strength_notes(structure, used, kept, known, np.vstack([force, over]))
    if np.isnan(force).any():
        notes.append("no final force: the element is not active in the final state")
    if any(isinstance(group, Sagging) for group in structure.groups):
        notes.append("force of a catenary: the larger of the tensions at its two ends")
    if any(isinstance(structure.groups[k], Beams) for k in kept):
        notes.append(
            "beams: along the chord (mean force plus half of the axial line load); table N has the "
            "axial force along each beam"
        )
    title = f"Axial forces (largest along each element), tension positive{'; envelope' * several}"
    return make_table(title, columns, notes)


def _strength_notes(structure, used, kept, known, forces):
    """Return the notes on utilization, a list: how it is defined, and what it leaves out.

    It leaves out buckling, if elements with a strength are compressed, and bending, if the
    structure has beams. Without any strength a single note says so.

    Args:
        structure: `Structure`.
        used: utilization of every group, [n_elem]; None for a group without strength.
        kept: indices of the groups in the table.
        known: whether any element has a strength.
        forces: axial forces of the elements in the table, [n_state, n], N.
    """
    if not known:
        return ["no group has a strength: no utilization"]
    notes = ["utilization: force / breaking force (characteristic strength, no partial factors)"]
    pressed = (forces < -NEGLIGIBLE * np.nanmax(np.abs(forces), initial=0.0)).any(axis=0)
    pairs = zip(structure.groups, used, strict=True)
    judged = [None if x is None else np.full(len(x), not g.tension_only) for g, x in pairs]
    if (pressed & (concatenate_groups(structure, judged, kept) > 0)).any():
        notes.append(BUCKLING)
    if structure.space.rotates:
        notes.append("utilization of beams: axial force only; for bending see the stresses")
    return notes


def group_tables(table: Table) -> dict[str, Table]:
    """Return the extreme forces and the largest utilization of every group, {"groups": `Table`}.

    Args:
        table: the `axial_force_table`. Its envelope counts where it has one, otherwise its final
            force.

    Returns:
        A dict with this table; empty for a single group.
    """
    parts: dict[Any, list[Any]] = {}
    for row in table.rows:
        parts.setdefault(row[0], []).append(row)
    if len(parts) < 2:
        return {}
    rows = []
    for label, own in parts.items():
        low = [
            (x, row[1], row[6]) for row in own if (x := _first_not_none(row[5], row[4])) is not None
        ]
        high = [
            (x, row[1], row[8]) for row in own if (x := _first_not_none(row[7], row[4])) is not None
        ]
        used = [(x, row[1]) for row in own if (x := _first_not_none(row[10], row[9])) is not None]
        row = [label, len(own)]
        row += [*min(low, key=_first_item), *max(high, key=_first_item)] if low else [None] * 6
        rows.append([*row, *(max(used, key=_first_item) if used else [None] * 2)])
    names = ("group", "elements", "lowest", "of", "in", "highest", "of", "in", "most used", "of")
    units = {"lowest": "N", "highest": "N", "most used": "-"}
    headings = {"of": "element", "in": states_heading(_governing_state_names(table))}
    headings |= {"lowest": "min. force", "highest": "max. force", "most used": "max. utilization"}
    columns = [
        Column(name, units.get(name, ""), values, heading=headings.get(name, ""))
        for name, values in zip(names, zip(*rows, strict=True), strict=True)
    ]
    if all(value is None for value in columns[4].values):
        columns = [column._replace(detail=column.name == "in") for column in columns]
    title = "Groups: smallest and largest axial force, tension positive"
    return {"groups": make_table(title, columns)}


def exceeded_strength_sentence(table: Table) -> str | None:
    """Return a sentence on elements whose force exceeds their strength; None if there are none.

    Args:
        table: the `axial_force_table` of all elements.
    """
    used = table.columns.index("most used")
    over = [row for row in table.rows if (_first_not_none(row[used], row[used - 1]) or 0.0) > 1.0]
    if not over:
        return None
    counts: dict[Any, int] = {}
    for row in over:
        counts[row[0]] = counts.get(row[0], 0) + 1
    labels = [row[0] for row in table.rows]
    named = [f"{k or 'elements'}: {n} of {labels.count(k)}" for k, n in counts.items()]
    worst = max(over, key=lambda row: _first_not_none(row[used], row[used - 1]))
    most = _first_not_none(worst[used], worst[used - 1])
    where = f"{worst[0]}, element {worst[1]}".removeprefix(", ")
    when = f", {worst[used + 1]}" if worst[used] is not None else ""
    elements = "1 element" if len(over) == 1 else f"{len(over)} elements"
    return (
        f"STRENGTH EXCEEDED: {elements} above the breaking force ({', '.join(named)}); largest "
        f"utilization {most:.3g} ({where}{when})"
    )


def _governing_state_names(table):
    """Return the names of the states in which elements have their extreme forces, a set."""
    return {row[k] for row in table.rows for k in (6, 8) if row[k] is not None}


def _first_not_none(value, otherwise):
    """Return `value`, or `otherwise` if the value is None."""
    return otherwise if value is None else value


def _first_item(item):
    """Return the first item of a tuple, by which tuples are compared."""
    return item[0]


def peak_forces(structure: Structure, state: Results) -> list[Float[np.ndarray, " n_elem"] | None]:
    """Return the largest force along each element, N: a list of [n_elem] for every group, or None.

    Inactive elements have NaN.
    """
    parts = (
        values_per_group(structure, state.peak_tension),
        present_elements(structure, state.present),
    )
    return [
        None if force is None else np.where(present, force, np.nan)
        for force, present in zip(*parts, strict=True)
    ]
