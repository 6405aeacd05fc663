"""The tables of a report on axial forces of elements and groups, with their envelope."""

from __future__ import annotations

import collections
from typing import Any

import numpy as np

from ..analysis.results import StateResults
from ..common.negligible import NEGLIGIBLE
from ..common.types import Float
from ..design import utilization
from ..elements import Beams
from ..elements.abilities import Hanging
from ..model.result_parts import present_elements, values_per_group
from ..model.structure import Structure
from .columns import concatenate_groups, element_columns, envelope_columns, states_heading
from .states import ReportedAnalysis
from .table import Column, Table, columns_of_rows, make_table

BUCKLING = (
    "force / strength in compression: buckling is not checked here, see stiffness.buckling_factor"
)
_FORCE, _LOWEST, _HIGHEST, _USED, _MOST = 4, 5, 7, 9, 10  # columns of the table


def axial_force_table(of: ReportedAnalysis) -> Table:
    """Return the table of axial force, force / strength and envelope of every element.

    Forces are the largest along each element, `peak_tension`, in N.
    """
    structure, names = of.structure, list(of.envelope)
    kept = [k for k, own in enumerate(peak_forces(structure, of.state)) if own is not None]
    force, over = of.values(
        lambda result: concatenate_groups(structure, peak_forces(structure, result), kept)
    )
    ratio, ratios = of.values(lambda result: _utilizations(structure, result, kept))
    ratio = np.where(np.isnan(force), np.nan, ratio)
    rated = np.isfinite([ratio, *ratios]).any(axis=0)
    known = bool(rated.any())
    hidden = () if of.several else ("lowest", "highest", "most used", "in")
    extremes = [
        envelope_columns(name, "N", over, names, sign, hidden=hidden, heading=heading)
        for name, sign, heading in (("lowest", -1, "min. force"), ("highest", 1, "max. force"))
    ]
    most = envelope_columns(
        *("most used", "-", ratios, names, 1),
        hidden=("in", *hidden),
        heading="max. force / strength",
        governs=known,
    )
    columns = [
        *element_columns(structure, kept),
        Column("force", "N", force, "final force", governs=not known),
        *(column for pair in extremes for column in pair),
        Column("used", "-", ratio, "force / strength"),
        *most,
    ]
    notes = _strength_notes(structure, kept, rated, np.vstack([force, over]))
    if np.isnan(force).any():
        notes.append("no final force: the element is not active in the final state")
    if any(isinstance(group, Hanging) for group in structure.groups):
        notes.append("force of a catenary: the larger of the tensions at its two ends")
    if any(isinstance(structure.groups[k], Beams) for k in kept):
        notes.append(
            "beams: along the chord (mean force plus half of the axial line load); table N has the "
            "axial force along each beam"
        )
    title = "Axial forces (largest along each element), tension positive"
    return make_table(title + "; envelope" * of.several, columns, notes)


def _utilizations(structure, result, kept):
    """Return force / strength of all elements of the groups `kept`, [n]; NaN without a strength.

    `result` is a state of the analysis, and `kept` are indices of groups.
    """
    try:
        used = values_per_group(structure, utilization(structure, result))
    except ValueError:  # no group has a strength
        used = [None] * len(structure.groups)
    return concatenate_groups(structure, used, kept)


def _strength_notes(structure, kept, rated, forces):
    """Return the notes on force / strength, a list: its definition, and limits of its use.

    It does not cover buckling, if elements with a strength are compressed, and bending, if the
    structure has beams. Without any strength a single note says so.

    Args:
        structure: `Structure`.
        kept: indices of the groups in the table.
        rated: whether each element has a strength in any state, [n].
        forces: axial forces of the elements in the table, [n_state, n], N.
    """
    if not rated.any():
        return ["no group has a strength"]
    notes = ["strength: the breaking force, characteristic, without partial factors"]
    pressed = (forces < -NEGLIGIBLE * np.nanmax(np.abs(forces), initial=0.0)).any(axis=0)
    groups = [structure.groups[k] for k in kept]
    bears_pressure = np.repeat([not g.tension_only for g in groups], [len(g.links) for g in groups])
    if (pressed & rated & bears_pressure).any():
        notes.append(BUCKLING)
    if structure.space.rotates:
        notes.append("force / strength of beams: axial force only; for bending see the stresses")
    return notes


def group_tables(table: Table) -> dict[str, Table]:
    """Return {"groups": `Table`}: extreme forces and largest force / strength of each group.

    The dict is empty for a single group. `table` is the `axial_force_table`: its envelope counts
    where it has one, otherwise its final force.
    """
    parts: dict[Any, list[Any]] = {}
    for row in table.rows:
        parts.setdefault(row[0], []).append(row)
    if len(parts) < 2:
        return {}

    def extreme(own, column, otherwise, choose):
        """Return the extreme value in a column, its element and state; or three times None."""
        values = [(_first_known(row, column, otherwise), row[1], row[column + 1]) for row in own]
        known = [item for item in values if item[0] is not None]
        return choose(known, key=lambda item: item[0]) if known else (None,) * 3

    rows = [
        [
            *(label, len(own)),
            *extreme(own, _LOWEST, _FORCE, min),
            *extreme(own, _HIGHEST, _FORCE, max),
            *extreme(own, _MOST, _USED, max)[:2],
        ]
        for label, own in parts.items()
    ]
    named = {str(row[k]) for row in table.rows for k in (_LOWEST + 1, _HIGHEST + 1) if row[k]}
    element, state = ("of", "", "element"), ("in", "", states_heading([*named]))
    columns = columns_of_rows(
        rows,
        *("group", "elements"),
        *(("lowest", "N", "min. force"), element, state),
        *(("highest", "N", "max. force"), element, state),
        *(("most used", "-", "max. force / strength"), element),
    )
    if all(row[4] is None for row in rows):
        columns = [column._replace(detail=column.name == "in") for column in columns]
    title = "Groups: smallest and largest axial force, tension positive"
    return {"groups": make_table(title, columns)}


def exceeded_strength_sentence(table: Table) -> str | None:
    """Return a sentence on elements whose force exceeds their strength; None if there are none.

    `table` is the `axial_force_table` of all elements.
    """
    pairs = [(_first_known(row, _MOST, _USED) or 0.0, row) for row in table.rows]
    over = [(used, row) for used, row in pairs if used > 1.0]
    if not over:
        return None
    of_each, labels = collections.Counter(row[0] for _, row in over), [row[0] for row in table.rows]
    named = [f"{k or 'elements'}: {n} of {labels.count(k)}" for k, n in of_each.items()]
    most, worst = max(over, key=lambda pair: pair[0])
    where = f"{worst[0]}, element {worst[1]}".removeprefix(", ")
    when = f", {worst[_MOST + 1]}" if worst[_MOST] is not None else ""
    return (
        f"STRENGTH EXCEEDED: {len(over)} element{'s' * (len(over) > 1)} above the breaking force "
        f"({', '.join(named)}); largest force / strength {most:.3g} ({where}{when})"
    )


def _first_known(row, column, otherwise):
    """Return the cell of a row in a column; if that is None, the cell in the column `otherwise`.

    Columns are indices.
    """
    return row[otherwise] if row[column] is None else row[column]


def peak_forces(
    structure: Structure, state: StateResults
) -> list[Float[np.ndarray, " n_elem"] | None]:
    """Return the largest axial force along each element of a state, N, a list over groups.

    Items are arrays [n_elem], or None for a group without forces. Inactive elements have NaN.
    """
    forces = values_per_group(structure, state.peak_tension)
    masks = present_elements(structure, state.present)
    pairs = zip(forces, masks, strict=True)
    return [None if x is None else np.where(present, x, np.nan) for x, present in pairs]
