"""The tables of a report on section forces of beams: one for each force."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from ..common.types import Float
from ..elements import Beams
from ..elements.element import SECTION_FORCES
from ..model.parts import first_and_last, groups_by_name, per_group, there
from ..model.structure import Structure
from . import extremes
from .columns import envelope, of_elements
from .extremes import Extremes
from .states import State
from .table import Column, Table, tabled

_TITLES = {
    "N": "N, axial force: tension positive",
    "Vy": "Vy, shear force along y",
    "Vz": "Vz, shear force along z",
    "T": "T, torsional moment",
    "My": "My, bending moment about y: positive where the side of +z is in tension",
    "Mz": "Mz, bending moment about z: positive where the side of -y is in tension",
}
_NOTHING = 1e-9  # of the largest force, or moment: what is nowhere more is left out
_SHEARS = ("Vy", "Vz")


def internal_forces(
    structure: Structure, end: State, states: Mapping[str, State], kind: str
) -> dict[str, Table]:
    """Section forces of all beams at the end, and their envelope, a dict from force to `Table`.

    Forces that are zero in all beams and states have no table; without beams there is none at all.

    Args:
        structure: `Structure`.
        end: the state whose values are given.
        states: the states of the envelope; empty if there is nothing but the end.
        kind: what they are, in words: "ends of phases", "cases".
    """
    beams = [k for k, group in enumerate(structure.groups) if isinstance(group, Beams)]
    if not beams:
        return {}
    parts = [_values(structure, beams, state) for state in (end, *states.values())]
    least = _least(structure, parts)
    labels = [label for label, _ in groups_by_name(structure)]
    found: dict[str, Table] = {}
    zero = []
    for number, (name, nothing) in enumerate(zip(SECTION_FORCES.components, least, strict=True)):
        kept = [
            k
            for k in beams
            if any((np.abs(part[k][0][..., number]) > nothing).any() for part in parts)
        ]
        if not kept:
            zero.append(name)
            continue
        idle = ", ".join(labels[k] for k in beams if k not in kept)
        notes = (f"{idle}: zero everywhere",) if idle else ()
        here, *others = (
            Extremes(*map(np.concatenate, zip(*(part[k][1][name] for k in kept), strict=True)))
            for part in parts
        )
        values = np.concatenate([parts[0][k][0][:, [0, -1], number] for k in kept])
        columns = [
            *of_elements(structure, kept),
            *_columns(name, values, here, others, list(states), nothing),
        ]
        if states:  # the nodes are in other tables
            columns[2:4] = (column._replace(detail=True) for column in columns[2:4])
        found[name] = tabled(_TITLES[name], columns, notes)
    if found:
        first = next(iter(found))
        notes = (*_notes(zero, parts, kind if states else None), *found[first].notes)
        found[first] = dataclasses.replace(found[first], notes=notes)
    return found


def _values(structure, beams, state):
    """Section forces of every group of beams in a state, a dict from the number of the group.

    Returns:
        For each the values at its places, [n_elem, n_point, 6], NaN for elements that are not
        there, and `Extremes` [n_elem] by name of the force.
    """
    result, found = state.result, {}
    forces, present = per_group(structure, result.section_forces), there(structure, result.present)
    for k in beams:
        values = np.where(present[k][:, None, None], np.asarray(forces[k], float), np.nan)
        ends = np.asarray(result.positions, float)[first_and_last(structure.groups[k])]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[:, None]
        found[k] = values, _along(values, length)
    return found


def _along(
    values: Float[np.ndarray, "n_elem n_point 6"], length: Float[np.ndarray, "n_elem 1"]
) -> dict[str, Extremes]:
    """Extremes along elements, by name of the force.

    Between its places a moment is the polynomial whose slopes there are the shear forces, ``My' =
    Vz`` and ``Mz' = -Vy``, of degree 5 for three places, and shear forces are its slopes. This is
    exact under uniform loads, and has what an axial force adds on a deflection up to degree 4,
    which is all of it to the second order of the slopes.
    """
    forces = dict(zip(SECTION_FORCES.components, np.moveaxis(values, -1, 0), strict=True))
    found = {}
    for name in ("N", "T"):
        places, value, slope = extremes.interpolation(values.shape[1], False)
        shape = extremes.cubics(forces[name] @ value, forces[name] @ slope, places)
        found[name] = extremes.along(shape, places)
    for moment, shear, sign in (("My", "Vz", 1), ("Mz", "Vy", -1)):
        places, value, slope = extremes.interpolation(values.shape[1], True)
        data = np.hstack([forces[moment], sign * length * forces[shear]])
        shape = extremes.cubics(data @ value, data @ slope, places)
        found[moment] = extremes.along(shape, places)
        slopes = sign * extremes.derivatives(shape, places) / length[..., None]
        found[shear] = extremes.along(slopes, places)
    return found


def _least(structure, parts):
    """Sizes up to which forces are rounding, [6], N and N m."""
    every = [values.reshape(-1, 6) for part in parts for values, _ in part.values()]
    sizes = np.nanmax(np.abs(np.concatenate(every)), axis=0, initial=0.0)
    extent = np.ptp(np.asarray(structure.nodes, float), axis=0).max()
    force = sizes[:3].max()
    return _NOTHING * np.repeat([force, max(sizes[3:].max(), force * extent)], 3)


def _columns(name, values, here, others, states, nothing):
    """The columns of one force.

    Args:
        name: of the force.
        values: at the first and the last node at the end, [n, 2].
        here, others: `Extremes` along the elements at the end, and in the states of the envelope.
        states: names of these states.
        nothing: states that differ by this have the same extreme.
    """
    unit = "N" if name == "N" or name in _SHEARS else "N m"
    found = [
        Column("at first", unit, values[:, 0]),
        Column("at last", unit, values[:, 1]),
        Column("lowest", unit, here.low, governs=not states),
        Column("at", "-", here.low_at),
        Column("highest", unit, here.high, governs=not states),
        Column("at", "-", here.high_at),
    ]
    for head, sign, of in (("min", -1, "low"), ("max", 1, "high")) if states else ():
        extreme, at = (np.array([getattr(x, end) for x in others]) for end in (of, f"{of}_at"))
        most, place, state = envelope(head, unit, extreme, states, sign, [("at", "-", at)], nothing)
        found += [most._replace(governs=True), place._replace(detail=True), state]
    return found


def _notes(zero, parts, kind):
    """Sentences on all tables of section forces; `kind` is None if there is no envelope."""
    notes = [
        "section forces act from the part beyond a place on the part before it, along the axes of "
        "the section",
        "at: part of the element from its first node, from 0 to 1; none where the force is the "
        "same all along",
        "extremes: exact under uniform loads, but for 1e-4 where elements bend by some 1e-2 rad",
    ]
    if kind is not None:
        notes.append(f"lowest, highest: along the element at the end; min, max: over all {kind}")
    if zero:
        notes.append(f"{', '.join(zero)}: zero everywhere")
    if any(np.isnan(values[:, 0, 0]).any() for values, _ in parts[0].values()):
        notes.append("no values: the element is not there")
    return tuple(notes)
