"""The tables of a report on section forces of beams: one for each force."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from ..common.negligible import NEGLIGIBLE
from ..common.types import Float
from ..elements import Beams
from ..elements.abilities import POINT_LOADS
from ..elements.bending import gauss_lobatto
from ..elements.element import SECTION_FORCES
from ..model.result_parts import end_nodes, named_groups_of, present_elements, values_per_group
from ..model.structure import Structure
from ..results.interpolation import (
    acting_point_loads,
    forces_of_loads_on_pieces,
    forces_of_point_loads,
    interpolate_section_forces,
)
from . import extremes
from .columns import element_columns, envelope_columns
from .extremes import Extremes
from .states import EnvelopeState
from .table import Column, Table, make_table

_TITLES = {
    "N": "N, axial force: tension positive",
    "Vy": "Vy, shear force along y",
    "Vz": "Vz, shear force along z",
    "T": "T, torsional moment",
    "My": "My, bending moment about y: positive where the side of +z is in tension",
    "Mz": "Mz, bending moment about z: positive where the side of -y is in tension",
}
_SHEARS = ("Vy", "Vz")


def section_force_tables(
    structure: Structure, end: EnvelopeState, states: Mapping[str, EnvelopeState], kind: str
) -> dict[str, Table]:
    """Return the section forces of all beams in the final state, and their envelope.

    Args:
        structure: `Structure`.
        end: the final state.
        states: the states of the envelope, by name; empty if there is only the final state.
        kind: what these states are, in words: "ends of phases", "cases".

    Returns:
        A dict from the force, such as "My", to its `Table`. Forces that are zero in all beams and
        states have no table; without beams the dict is empty.
    """
    beams = [k for k, group in enumerate(structure.groups) if isinstance(group, Beams)]
    if not beams:
        return {}
    parts = [_group_section_forces(structure, beams, state) for state in (end, *states.values())]
    least = _rounding_limits(structure, parts)
    labels = [label for label, _ in named_groups_of(structure)]
    tables: dict[str, Table] = {}
    zero = []
    for index, (name, rounding) in enumerate(zip(SECTION_FORCES.components, least, strict=True)):
        kept = [k for k in beams if any(part[k][2][index] > rounding for part in parts)]
        if not kept:
            zero.append(name)
            continue
        without = ", ".join(labels[k] for k in beams if k not in kept)
        notes = (f"{without}: zero everywhere",) if without else ()
        here, *others = (
            Extremes(*map(np.concatenate, zip(*(part[k][1][name] for k in kept), strict=True)))
            for part in parts
        )
        values = np.concatenate([parts[0][k][0][:, [0, -1], index] for k in kept])
        columns = [
            *element_columns(structure, kept),
            *_section_force_columns(name, values, here, others, list(states), rounding),
        ]
        if states:  # the nodes are in other tables
            columns[2:4] = (column._replace(detail=True) for column in columns[2:4])
        tables[name] = make_table(_TITLES[name], columns, notes)
    if tables:
        first = next(iter(tables))
        notes = (*_section_force_notes(zero, parts, kind if states else None), *tables[first].notes)
        tables[first] = dataclasses.replace(tables[first], notes=notes)
    return tables


def _group_section_forces(structure, beams, state):
    """Return the section forces of every group of beams in a state.

    Args:
        structure: `Structure`.
        beams: indices of the groups of beams.
        state: `EnvelopeState`.

    Returns:
        A dict from the index of each group to a tuple: the values at its points, N and N m,
        [n_elem, n_point, 6], NaN for inactive elements; `Extremes` [n_elem] by force; and the
        largest size of each force, [6].
    """
    result, groups = state.result, {}
    forces, present = (
        values_per_group(structure, result.section_forces),
        present_elements(structure, result.present),
    )
    loads = values_per_group(structure, (result.results or {}).get(POINT_LOADS.name))
    for k in beams:
        values = np.where(present[k][:, None, None], np.asarray(forces[k], float), np.nan)
        ends = np.asarray(result.positions, float)[end_nodes(structure.groups[k])]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        own = None if loads[k] is None else acting_point_loads(np.asarray(loads[k], float))
        found = _extremes_along(values, length, own)
        groups[k] = values, found, _largest_sizes(values, found, own)
    return groups


def _largest_sizes(values, found, loads):
    """Return the largest size of N, Vy, Vz, T, My, Mz in a group, [6]; 0 without active elements.

    It is that at the points, and with concentrated loads also that of the `Extremes` `found`: a
    force may act between two loads alone.
    """
    sizes = np.nanmax(np.abs(values.reshape(-1, 6)), axis=0, initial=0.0)
    if loads is None:
        return sizes
    low_high = np.array([[found[n].low, found[n].high] for n in SECTION_FORCES.components])
    return np.fmax(sizes, np.nanmax(np.abs(low_high), axis=(1, 2), initial=0.0))


def _extremes_along(
    values: Float[np.ndarray, "n_elem n_point 6"],
    length: Float[np.ndarray, " n_elem"],
    loads: Float[np.ndarray, "n_elem n_load 7"] | None,
) -> dict[str, Extremes]:
    """Return the `Extremes` along elements, a dict by name of the section force.

    Between its points a force is what `interpolate_section_forces` makes of it, here by a cubic in
    each of many pieces, and between concentrated loads the lines of `forces_of_point_loads` more.

    Args:
        values: section forces at the points, [n_elem, n_point, 6], N and N m.
        length: lengths of the elements, [n_elem], m.
        loads: `acting_point_loads`, or None.
    """
    count = values.shape[1]
    places, _, slope = extremes.fine_interpolation_matrices(count, False)
    if loads is not None:
        values = values - forces_of_point_loads(loads, length, gauss_lobatto(count)[0][None])
    forces = interpolate_section_forces(values, length, places)
    slopes = dict(zip(("N", "T"), np.moveaxis(values[..., [0, 3]], -1, 0) @ slope, strict=True))
    by_name = dict(zip(SECTION_FORCES.components, np.moveaxis(forces, -1, 0), strict=True))
    slopes["My"], slopes["Mz"] = length[:, None] * by_name["Vz"], -length[:, None] * by_name["Vy"]
    cubics = {
        name: extremes.hermite_cubics(by_name[name], change, places)
        for name, change in slopes.items()
    }
    for moment, shear, sign in (("My", "Vz", 1), ("Mz", "Vy", -1)):
        change = extremes.cubic_derivatives(cubics[moment], places)
        cubics[shear] = sign * change / length[:, None, None]
    if loads is None:
        return {name: extremes.polynomial_extremes(x, places) for name, x in cubics.items()}
    ends = extremes.cut_places(places, loads[..., 0])
    starts, stops = forces_of_loads_on_pieces(loads, length, ends)
    for index, name in enumerate(SECTION_FORCES.components):
        pieces = extremes.cut_cubics(cubics[name], places, ends)
        cubics[name] = extremes.add_lines(pieces, starts[..., index], stops[..., index])
    return {name: extremes.polynomial_extremes(x, ends) for name, x in cubics.items()}


def _rounding_limits(structure, parts):
    """Return the size up to which N, Vy, Vz, T, My, Mz are rounding errors, [6], N and N m.

    `parts` has the `_group_section_forces` of each state.
    """
    sizes = np.max([sizes for part in parts for _, _, sizes in part.values()], axis=0)
    extent = np.ptp(np.asarray(structure.nodes, float), axis=0).max()
    force = sizes[:3].max()
    return NEGLIGIBLE * np.repeat([force, max(sizes[3:].max(), force * extent)], 3)


def _section_force_columns(name, end_values, final_extremes, envelope_extremes, states, rounding):
    """Return the columns of one section force, a list of `Column`.

    They are the values at both ends, then minimum and maximum along the elements and their places;
    with `states` also the envelope: the extremes over the states, their places, and the states.

    Args:
        name: name of the force.
        end_values: at the start and the end node in the final state, [n, 2], N or N m.
        final_extremes: `Extremes` along the n elements in the final state.
        envelope_extremes: list of the `Extremes` in each state of the envelope.
        states: names of these states; empty without an envelope.
        rounding: of states whose extremes differ by at most this the first one governs, N or N m.
    """
    unit = "N" if name == "N" or name in _SHEARS else "N m"
    final_extremes, *envelope_extremes = (
        _without_places_of_rounding(found, rounding)
        for found in (final_extremes, *envelope_extremes)
    )
    columns = [
        Column("at first", unit, end_values[:, 0], heading="at start"),
        Column("at last", unit, end_values[:, 1], heading="at end"),
        Column("lowest", unit, final_extremes.low, governs=not states, heading="min"),
        Column("at", "-", final_extremes.low_at, heading="x/L"),
        Column("highest", unit, final_extremes.high, governs=not states, heading="max"),
        Column("at", "-", final_extremes.high_at, heading="x/L"),
    ]
    for word, sign, of in (("min", -1, "low"), ("max", 1, "high")) if states else ():
        extreme, at = (
            np.array([getattr(x, side) for x in envelope_extremes]) for side in (of, f"{of}_at")
        )
        most, place, when = envelope_columns(
            word, unit, extreme, states, sign, [("at", "-", at)], rounding, f"envelope {word}"
        )
        columns += [most._replace(governs=True), place._replace(detail=True), when]
    return columns


def _without_places_of_rounding(found, rounding):
    """Return `Extremes` without places where a force differs along an element by rounding only."""
    same = found.high - found.low <= rounding
    low_at, high_at = (np.where(same, np.nan, at) for at in (found.low_at, found.high_at))
    return found._replace(low_at=low_at, high_at=high_at)


def _section_force_notes(zero, parts, kind):
    """Return the notes on all tables of section forces, a tuple of sentences.

    `zero` names the forces that are zero everywhere, `parts` has the `_group_section_forces` of
    each state, and `kind` says what the states of the envelope are; None without an envelope.
    """
    notes = [
        "sign convention: N > 0 is tension; forces and moments act along the axes of the section, "
        "on the part of the element at its start node, from the part at its end node",
        "x/L: position from the start node, 0 to 1; blank where the force is constant",
        "extremes: exact for uniform and concentrated loads; error about 1e-4 at element rotations "
        "of 0.01 rad",
    ]
    if kind is not None:
        notes.append(f"min, max: along the element in the final state; envelope: over all {kind}")
    if zero:
        notes.append(f"{', '.join(zero)}: zero everywhere")
    if any(np.isnan(values[:, 0, 0]).any() for values, *_ in parts[0].values()):
        notes.append("no values: the element is not active in the final state")
    return tuple(notes)
