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
from .extremes import Extremes
from .states import State
from .table import Cell, Table

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
    beams = [
        (number, label, group)
        for number, (label, group) in enumerate(groups_by_name(structure))
        if isinstance(group, Beams)
    ]
    if not beams:
        return {}
    parts = [_values(structure, beams, state) for state in (end, *states.values())]
    least = _least(structure, parts)
    found, zero = {}, []
    for name, nothing in zip(SECTION_FORCES.components, least, strict=True):
        rows, idle = [], []
        for beam, (_, label, group) in enumerate(beams):
            values = [part[beam].values[..., _column(name)] for part in parts]
            if not any(np.nanmax(np.abs(v), initial=0.0) > nothing for v in values):
                idle.append(label)
                continue
            here, *envelope = (part[beam].of[name] for part in parts)
            for k, ends in enumerate(first_and_last(group).tolist()):
                row = [label, k, *ends, *_cells(values[0][k, 0], values[0][k, -1])]
                row += _cells(*(extreme[k] for extreme in here))
                row += _enveloped(envelope, k, list(states), nothing) if states else []
                rows.append(row)
        if rows:
            notes = (f"{', '.join(idle)}: zero everywhere",) if idle else ()
            found[name] = _table(name, rows, notes, bool(states))
        else:
            zero.append(name)
    if found:
        first = next(iter(found))
        notes = (*_notes(zero, parts, kind if states else None), *found[first].notes)
        found[first] = dataclasses.replace(found[first], notes=notes)
    return found


class _Part:
    """Section forces of a group in a state.

    Attributes:
        values: at its places, [n_elem, n_point, 6]; NaN for elements that are not there.
        of: `Extremes` [n_elem] by name of the force.
    """

    def __init__(self, group, forces, positions, present):
        self.values = np.where(present[:, None, None], np.asarray(forces, float), np.nan)
        first, last = np.asarray(positions, float)[group.links.array[:, :2]].transpose(1, 0, 2)
        length = np.linalg.norm(last - first, axis=1)[:, None]
        self.of = _along(self.values, length)


def _values(structure, beams, state):
    """The `_Part` of every group of beams in a state, a list."""
    forces = per_group(structure, state.section_forces)
    present = there(structure, state.present)
    return [_Part(group, forces[k], state.positions, present[k]) for k, _, group in beams]


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
    every = np.concatenate([part.values.reshape(-1, 6) for state in parts for part in state])
    sizes = np.nanmax(np.abs(every), axis=0, initial=0.0)
    extent = np.ptp(np.asarray(structure.nodes, float), axis=0).max()
    force = sizes[:3].max()
    return _NOTHING * np.repeat([force, max(sizes[3:].max(), force * extent)], 3)


def _column(name):
    return SECTION_FORCES.components.index(name)


def _cells(*values: float) -> list[Cell]:
    """Numbers as cells, None for NaN."""
    return [float(value) if np.isfinite(value) else None for value in values]


def _enveloped(parts, k, names, nothing):
    """Cells of the envelope of element k over its `Extremes` in the states `names`.

    Of states that differ by `nothing` the first one governs.
    """
    low, high = (np.array([getattr(part, of)[k] for part in parts]) for of in ("low", "high"))
    if not np.isfinite(low).any():
        return [None] * 6
    least = int(np.argmax(low <= np.nanmin(low) + nothing))
    most = int(np.argmax(high >= np.nanmax(high) - nothing))
    return [
        *_cells(low[least], parts[least].low_at[k]),
        names[least],
        *_cells(high[most], parts[most].high_at[k]),
        names[most],
    ]


def _table(name, rows, notes, several):
    """The table of one force."""
    unit = "N" if name == "N" or name in _SHEARS else "N m"
    columns = ["group", "element", "first", "last", "at first", "at last"]
    columns += ["lowest", "at", "highest", "at "]
    units = ["", "", "", "", unit, unit, unit, "-", unit, "-"]
    if several:
        columns += ["min", "at  ", "in", "max", "at   ", "in "]
        units += [unit, "-", "", unit, "-", ""]
    return Table(
        _TITLES[name],
        tuple(columns),
        tuple(units),
        rows,
        notes,
        governing=(10, 13) if several else (6, 8),
        details=(2, 3, 11, 14) if several else (),
    )


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
    if any(np.isnan(part.values[:, 0, 0]).any() for part in parts[0]):
        notes.append("no values: the element is not there")
    return tuple(notes)
