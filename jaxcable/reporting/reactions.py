"""The tables of a report on supports: reactions, and global equilibrium."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..analysis import solution as results
from ..model.structure import Structure
from ..model.supports import Fixed
from .columns import envelope
from .states import State
from .table import Column, Table, tabled

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
    values, held = np.asarray(state.reactions, float), _held(structure, fixed)
    ever = np.any([held, *(_held(structure, other.fixed) for other in states.values())], axis=0)
    turning = state.reaction_moments is not None and bool(ever[:, 3:].any())
    if turning:
        values = np.hstack([values, np.asarray(state.reaction_moments, float)])
    # a support that has turned along with its node may push along other axes, too
    held[:, : values.shape[1]] |= np.abs(values) > _least(values)
    nodes = np.flatnonzero(ever.any(axis=1))
    parts = np.where(held[:, : values.shape[1]], values, np.nan)[nodes].T
    size = np.where(held[:, :3].any(axis=1), np.linalg.norm(values[:, :3], axis=1), np.nan)[nodes]
    every = [np.linalg.norm(other.result.reactions, axis=1)[nodes] for other in states.values()]
    sizes = np.array(every).reshape(len(every), len(nodes))
    largest, case = envelope("largest R", "N", sizes, list(states), 1)
    columns = [
        Column("node", "", nodes),
        *(Column(f"R{axis}", "N", part) for axis, part in zip("xyz", parts[:3], strict=True)),
        Column("R", "N", size, governs=not states),
        *(Column(f"M{axis}", "N m", part) for axis, part in zip("xyz", parts[3:], strict=False)),
        largest._replace(governs=bool(states), detail=not several),
        case._replace(detail=not several),
    ]
    title = f"Reactions: forces {'and moments ' if turning else ''}of the supports on the structure"
    unheld = bool(np.isnan(parts[:3]).any())
    return tabled(title, columns, ["no value: no support holds it at the end"] if unheld else [])


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
    sums = np.transpose([part.sum(0) for part in (load, reactions, load + reactions)])
    columns = [Column("of", "", ["loads", "reactions", "sum of forces"])]
    columns += [Column(axis, "N", part) for axis, part in zip("xyz", sums, strict=True)]
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
    return tabled("Global equilibrium", columns, notes)
