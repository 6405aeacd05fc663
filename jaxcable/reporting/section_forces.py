"""The tables of a report on section forces of beams: one for each force."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from ..common.negligible import NEGLIGIBLE
from ..common.types import Float
from ..elements import Beams
from ..elements.abilities import POINT_LOADS
from ..elements.bending import gauss_lobatto
from ..elements.element import SECTION_FORCES
from ..model.result_parts import end_nodes, named_groups_of, present_elements, values_per_group
from ..results.interpolation import (
    acting_point_loads,
    forces_between_point_loads,
    forces_of_point_loads,
    interpolate_section_forces,
)
from . import extremes
from .columns import element_columns, envelope_columns
from .extremes import Extremes
from .states import ReportedAnalysis
from .table import Column, Table, make_table

_TITLES = {
    "N": "N, axial force: tension positive",
    "Vy": "Vy, shear force along y",
    "Vz": "Vz, shear force along z",
    "T": "T, torsional moment",
    "My": "My, bending moment about y: positive where the side of +z is in tension",
    "Mz": "Mz, bending moment about z: positive where the side of -y is in tension",
}
_UNITS = dict.fromkeys(("N", "Vy", "Vz"), "N") | dict.fromkeys(("T", "My", "Mz"), "N m")
_NOTES = (
    "sign convention: N > 0 is tension; forces and moments act along the axes of the section, "
    "on the part of the element at its start node, from the part at its end node",
    "x/L: position from the start node, 0 to 1; blank where the force is constant",
    "extremes: exact for uniform and concentrated loads; error about 1e-4 at element rotations "
    "of 0.01 rad",
)


class _GroupForces(NamedTuple):
    """Section forces of a group of beams in a state; elements that are not active have NaN.

    Attributes:
        ends: values at both ends, [n_elem, 2, 6], N and N m.
        extremes: `Extremes` [n_elem] along the elements, by name of the force.
        largest: largest size of each force, [6]; 0 without active elements.
    """

    ends: Float[np.ndarray, "n_elem 2 6"]
    extremes: dict[str, Extremes]
    largest: Float[np.ndarray, " 6"]


def section_force_tables(of: ReportedAnalysis) -> dict[str, Table]:
    """Return the section forces of all beams in the final state, and their envelope.

    Returns:
        A dict from the force, such as "My", to its `Table`. Forces that are zero in all beams and
        states have no table; without beams the dict is empty.
    """
    structure, states = of.structure, list(of.envelope) if of.several else []
    beams = [k for k, group in enumerate(structure.groups) if isinstance(group, Beams)]
    if not beams:
        return {}
    results = of.state, *(of.envelope[name].result for name in states)
    parts = [{k: _group_forces(structure, k, result) for k in beams} for result in results]
    limits = _rounding_limits(structure, parts)
    labels = [label for label, _ in named_groups_of(structure)]
    tables: dict[str, Table] = {}
    zero = []
    for index, (name, rounding) in enumerate(zip(SECTION_FORCES.components, limits, strict=True)):
        kept = [k for k in beams if any(part[k].largest[index] > rounding for part in parts)]
        if not kept:
            zero.append(name)
            continue
        without = ", ".join(labels[k] for k in beams if k not in kept)
        ends = np.concatenate([parts[0][k].ends[..., index] for k in kept])
        final, *others = (
            _join_extremes([part[k].extremes[name] for k in kept], rounding) for part in parts
        )
        columns = [
            *element_columns(structure, kept),
            *_section_force_columns(_UNITS[name], ends, final, others, states, rounding),
        ]
        if states:  # the nodes are in other tables
            columns[2:4] = (column._replace(detail=True) for column in columns[2:4])
        left_out = [f"{without}: zero everywhere"] if without else []
        tables[name] = make_table(_TITLES[name], columns, left_out)
    if tables:
        first, notes = next(iter(tables)), list(_NOTES)
        if states:
            notes.append(
                "min, max: along the element in the final state; envelope: over all "
                f"{of.name_of_states}"
            )
        if zero:
            notes.append(f"{', '.join(zero)}: zero everywhere")
        if any(np.isnan(forces.ends).any() for forces in parts[0].values()):
            notes.append("no values: the element is not active in the final state")
        tables[first] = dataclasses.replace(tables[first], notes=(*notes, *tables[first].notes))
    return tables


def _group_forces(structure, k, result):
    """Return the `_GroupForces` of the group with index `k` in a state, `result`."""
    forces = values_per_group(structure, result.section_forces)[k]
    present = present_elements(structure, result.present)[k]
    values = np.where(present[:, None, None], np.asarray(forces, float), np.nan)
    ends = np.asarray(result.positions, float)[end_nodes(structure.groups[k])]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    loads = values_per_group(structure, (result.results or {}).get(POINT_LOADS.name))[k]
    if loads is not None:
        loads = acting_point_loads(np.asarray(loads, float))
    found = _extremes_along(values, length, loads)
    largest = np.nanmax(np.abs(values.reshape(-1, 6)), axis=0, initial=0.0)
    if loads is not None:  # a force may act between two loads alone
        between = np.array([[found[n].low, found[n].high] for n in SECTION_FORCES.components])
        largest = np.fmax(largest, np.nanmax(np.abs(between), axis=(1, 2), initial=0.0))
    return _GroupForces(values[:, [0, -1]], found, largest)


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
    places, slope = extremes.fine_places_and_slope_matrix(count)
    if loads is not None:
        values = values - forces_of_point_loads(loads, length, gauss_lobatto(count)[0][None])
    forces = interpolate_section_forces(values, length, places)
    by_name = dict(zip(SECTION_FORCES.components, np.moveaxis(forces, -1, 0), strict=True))
    slopes = dict(zip(("N", "T"), np.moveaxis(values[..., [0, 3]], -1, 0) @ slope, strict=True))
    slopes["My"], slopes["Mz"] = length[:, None] * by_name["Vz"], -length[:, None] * by_name["Vy"]
    cubics = {
        name: extremes.hermite_cubic_coefficients(by_name[name], change, places)
        for name, change in slopes.items()
    }
    for moment, shear, sign in (("My", "Vz", 1), ("Mz", "Vy", -1)):
        change = extremes.cubic_derivatives(cubics[moment], places)
        cubics[shear] = sign * change / length[:, None, None]
    ends = places
    if loads is not None:
        ends = extremes.merge_piece_ends(places, loads[..., 0])
        starts, stops = forces_between_point_loads(loads, length, ends)
        for index, name in enumerate(SECTION_FORCES.components):
            pieces = extremes.split_cubics(cubics[name], places, ends)
            cubics[name] = extremes.add_linear_terms(pieces, starts[..., index], stops[..., index])
    return {name: extremes.polynomial_extremes(x, ends) for name, x in cubics.items()}


def _rounding_limits(structure, parts):
    """Return the magnitudes up to which N, Vy, Vz, T, My, Mz are rounding errors, [6], N and N m.

    `parts` has a dict of `_GroupForces` by index of the group for each state.
    """
    sizes = np.max([forces.largest for part in parts for forces in part.values()], axis=0)
    extent = np.ptp(np.asarray(structure.nodes, float), axis=0).max()
    force = sizes[:3].max()
    return NEGLIGIBLE * np.repeat([force, max(sizes[3:].max(), force * extent)], 3)


def _join_extremes(parts, rounding):
    """Return the `Extremes` of several groups as one, [n], one group after the other.

    Places are NaN where a force varies along an element by no more than `rounding`.
    """
    found = Extremes(*map(np.concatenate, zip(*parts, strict=True)))
    same = found.high - found.low <= rounding
    low_at, high_at = (np.where(same, np.nan, at) for at in (found.low_at, found.high_at))
    return found._replace(low_at=low_at, high_at=high_at)


def _section_force_columns(unit, ends, final, others, states, rounding):
    """Return the columns of one section force, a list of `Column`.

    They are the values at both ends, then minimum and maximum along the elements and their places;
    with `states` also the envelope: the extremes over the states, their places, and the states.

    Args:
        unit: "N" or "N m".
        ends: values at the start and the end node in the final state, [n, 2].
        final: `Extremes` along the n elements in the final state.
        others: list of the `Extremes` in each state of the envelope.
        states: names of these states; empty without an envelope.
        rounding: of states whose extremes differ by at most this the first one governs.
    """
    columns = [
        Column("at first", unit, ends[:, 0], "at start"),
        Column("at last", unit, ends[:, 1], "at end"),
        Column("lowest", unit, final.low, "min", governs=not states),
        Column("at", "-", final.low_at, "x/L"),
        Column("highest", unit, final.high, "max", governs=not states),
        Column("at", "-", final.high_at, "x/L"),
    ]
    for word, sign, side in (("min", -1, "low"), ("max", 1, "high")) if states else ():
        extreme, at = (np.array([getattr(x, k) for x in others]) for k in (side, f"{side}_at"))
        columns += envelope_columns(
            *(word, unit, extreme, states, sign, [("at", "-", at)]),
            rounding=rounding,
            hidden=("at",),
            heading=f"envelope {word}",
            governs=True,
        )
    return columns
