"""The tables of a report on supports: reactions, and global equilibrium."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..analysis import solution as results
from ..model.structure import Structure
from ..model.supports import Fixed
from .states import State
from .table import Cell, Table

_ROUNDING = 1e-9  # of the largest force or moment
_ASLANT = 1e-9  # cosine from which a held direction has a component


def reactions(
    structure: Structure,
    state: results.State,
    fixed: Fixed,
    states: Mapping[str, State],
    several: bool,
) -> Table:
    """Reactions at the end, and the largest resultant over cases or phases with its case.

    The table has all nodes that are held at the end or in one of these states. A component that no
    support holds has no value. The text leaves the largest out unless there are `several` states.
    """
    values = np.asarray(state.reactions, float)
    held = _held(structure, fixed)
    ever = np.any([held, *(_held(structure, other.fixed) for other in states.values())], axis=0)
    columns, units = ["node", "Rx", "Ry", "Rz", "R"], ["", "N", "N", "N", "N"]
    turning = state.reaction_moments is not None and bool(ever[:, 3:].any())
    if turning:
        values = np.hstack([values, np.asarray(state.reaction_moments, float)])
        columns, units = [*columns, "Mx", "My", "Mz"], [*units, "N m", "N m", "N m"]
    columns, units = [*columns, "largest R", "in"], [*units, "N", ""]
    # a support that has turned along with its node may push along other axes, too
    held[:, : values.shape[1]] |= np.abs(values) > _least(values)
    names = list(states)
    sizes = np.array([np.linalg.norm(np.asarray(s.reactions), axis=1) for s in states.values()])
    rows: list[list[Cell]] = []
    for k in np.flatnonzero(ever.any(axis=1)):
        cells = [float(v) if h else None for v, h in zip(values[k], held[k], strict=False)]
        size = float(np.linalg.norm(values[k, :3])) if held[k, :3].any() else None
        worst = int(sizes[:, k].argmax()) if names else None
        row: list[Cell] = [int(k), *cells[:3], size, *cells[3:]]
        row += [None, None] if worst is None else [float(sizes[worst, k]), names[worst]]
        rows.append(row)
    title = f"Reactions: forces {'and moments ' if turning else ''}of the supports on the structure"
    notes = []
    if any(None in row[1:4] for row in rows):
        notes.append("no value: no support holds it at the end")
    governing = 4 if not names else len(columns) - 2
    details = () if several else (len(columns) - 2, len(columns) - 1)
    return Table(title, tuple(columns), tuple(units), rows, tuple(notes), governing, details)


def _held(structure, fixed):
    """Components along x, y, z of forces and moments that supports hold, [n_node, 6] bool."""
    held = np.zeros((structure.n_node, 6), bool)
    array = fixed.array[: structure.n_node]
    held[:, : array.shape[1]] = array
    held[:, 3:] &= structure.rotating()[:, None]
    if fixed.axes is None:
        return held
    over = np.abs(fixed.axes.array[: structure.n_node]) > _ASLANT  # [n_node, direction, component]
    parts = [(held[:, part, None] & over).any(axis=1) for part in (slice(3), slice(3, 6))]
    return np.hstack(parts)


def _least(values):
    """Sizes up to which components [n_node, 3 or 6] are rounding."""
    force = np.abs(values[:, :3]).max(initial=0.0)
    moment = max(np.abs(values[:, 3:]).max(initial=0.0), force)
    return _ROUNDING * np.array([force] * 3 + [moment] * 3)[: values.shape[1]]


def equilibrium(structure: Structure, state: results.State) -> Table:
    """Sums of loads and reactions; also of moments about the origin if all forces are at nodes."""
    load, reactions = np.asarray(state.load, float), np.asarray(state.reactions, float)
    rows = [
        ["loads", *load.sum(0).tolist()],
        ["reactions", *reactions.sum(0).tolist()],
        ["sum of forces", *(load + reactions).sum(0).tolist()],
    ]
    units = ["", "N", "N", "N"]
    notes = []
    size = np.abs(load).sum() + np.abs(reactions).sum()
    apart = np.abs((load + reactions).sum(0)).max()
    notes.append(
        f"forces out of balance: {apart:.1e} N, {apart / size if size else 0.0:.1e} of all forces"
    )
    if not any(group.shaped_by_load and not group.slides for group in structure.groups):
        moment = np.cross(np.asarray(state.positions, float), load + reactions).sum(0)
        span = np.ptp(np.asarray(structure.nodes, float), axis=0).max()
        apart = np.abs(moment).max()
        share = apart / (size * span) if size else 0.0
        notes.append(
            f"moments about the origin out of balance: {apart:.1e} N m, {share:.1e} of all forces "
            "times the extent"
        )
    else:
        notes.append("moments not summed: beams and catenaries carry loads between their nodes")
    columns = ("of", "x", "y", "z")
    return Table("Global equilibrium", columns, tuple(units), rows, tuple(notes))
