"""The tables of a report on supports: reactions, and global equilibrium."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..analysis.solution import State
from ..common.units import SI, Units
from ..elements.spring import SPRING_FORCE
from ..model.result_parts import values_per_group
from ..model.structure import Structure
from ..model.supports import FixedDofs
from .columns import envelope_columns
from .states import EnvelopeState
from .table import Column, Table, make_table

_ROUNDING = 1e-9  # of the largest force or moment, as of `table`
_SKEW = 1e-9  # cosine between a fixed direction and an axis from which it has a component there


def reaction_table(
    structure: Structure,
    state: State,
    fixed: FixedDofs,
    states: Mapping[str, EnvelopeState],
    several: bool,
    units: Units = SI,
) -> Table:
    """Return the table of reactions in the final state, and of the largest resultant at each node.

    It has all nodes that are supported in the final state or in one of `states`. A component in a
    direction that is not supported in the final state has no value.

    Args:
        structure: `Structure`.
        state: the final state.
        fixed: degrees of freedom that supports fix in the final state.
        states: the states of the envelope, by name.
        several: whether the text shows the largest resultant.
        units: `Units` of the numbers in the notes.
    """
    values, held = np.asarray(state.reactions, float), _supported_components(structure, fixed)
    others = [_supported_components(structure, other.fixed) for other in states.values()]
    ever = np.any([held, *others], axis=0)
    with_moments = state.reaction_moments is not None and bool(ever[:, 3:].any())
    if with_moments:
        values = np.hstack([values, np.asarray(state.reaction_moments, float)])
    # a skew support that has rotated with its node may push along other axes, too
    held[:, : values.shape[1]] |= np.abs(values) > _rounding_limits(values)
    nodes = np.flatnonzero(ever.any(axis=1))
    parts = np.where(held[:, : values.shape[1]], values, np.nan)[nodes].T
    size = np.where(held[:, :3].any(axis=1), np.linalg.norm(values[:, :3], axis=1), np.nan)[nodes]
    every = [np.linalg.norm(other.result.reactions, axis=1)[nodes] for other in states.values()]
    sizes = np.array(every).reshape(len(every), len(nodes))
    largest, when = envelope_columns("largest R", "N", sizes, list(states), 1, heading="max. R")
    columns = [
        Column("node", "", nodes),
        *(Column(f"R{axis}", "N", part) for axis, part in zip("xyz", parts[:3], strict=True)),
        Column("R", "N", size, governs=not states),
        *(Column(f"M{axis}", "N m", part) for axis, part in zip("xyz", parts[3:], strict=False)),
        largest._replace(governs=bool(states), detail=not several),
        when._replace(detail=not several),
    ]
    title = "Support reactions (on the structure)"
    blank = bool(np.isnan(parts[:3]).any())
    total = values[:, :3].sum(axis=0)
    total = np.where(np.abs(total) <= _rounding_limits(values)[:3] * len(values), 0.0, total)
    numbers = ", ".join(f"{units.from_si(force, 'N'):.6g}" for force in total.tolist())
    notes = [f"sum of the forces: ({numbers}) {units.name('N')}"]
    notes += ["blank: direction not supported in the final state"] if blank else []
    return make_table(title, columns, notes)


def _supported_components(structure, fixed):
    """Return whether supports take forces (3) and moments (3) along x, y, z, [n_node, 6] bool."""
    held = np.zeros((structure.n_node, 6), bool)
    array = fixed.array[: structure.n_node]
    held[:, : array.shape[1]] = array
    held[:, 3:] &= structure.rotating_nodes()[:, None]
    if fixed.axes is None:
        return held
    over = np.abs(fixed.axes.array[: structure.n_node]) > _SKEW  # [n_node, direction, component]
    parts = [(held[:, part, None] & over).any(axis=1) for part in (slice(3), slice(3, 6))]
    return np.hstack(parts)


def _rounding_limits(values):
    """Return the size up to which reactions are rounding errors, [3 or 6], N and N m.

    `values` are the reactions of all nodes, [n_node, 3 or 6].
    """
    force = np.abs(values[:, :3]).max(initial=0.0)
    moment = max(np.abs(values[:, 3:]).max(initial=0.0), force)
    return _ROUNDING * np.array([force] * 3 + [moment] * 3)[: values.shape[1]]


def _forces_of_ground(structure, state):
    """Return the forces of springs and bearings on all nodes, [n_node, 3], N; zero without any."""
    total = np.zeros((structure.n_node, 3))
    values = state.element_results.get(SPRING_FORCE.name)
    for group, forces in zip(structure.groups, values_per_group(structure, values), strict=True):
        if forces is not None:
            np.add.at(total, group.links.array[:, 0], forces)
    return total


def equilibrium_table(structure: Structure, state: State, units: Units = SI) -> Table:
    """Return the table of the sums of loads and reactions; its notes give the unbalanced force.

    Reactions are those of supports, springs to the ground and bearings.

    Moments about the origin are checked if all loads act at nodes.
    """
    load, reactions = np.asarray(state.load, float), np.asarray(state.reactions, float)
    reactions = reactions + _forces_of_ground(structure, state)
    sums = np.transpose([part.sum(0) for part in (load, reactions, load + reactions)])
    labels = ["loads", "reactions", "sum of forces"]
    columns = [Column("of", "", labels, heading=" ")]
    columns += [Column(axis, "N", part) for axis, part in zip("xyz", sums, strict=True)]
    size = np.abs(load).sum() + np.abs(reactions).sum()
    error = np.abs((load + reactions).sum(0)).max()
    relative = error / size if size else 0.0
    force = units.text(error, "N", ".1e")
    notes = [f"unbalanced force: {force} (relative to the sum of all forces: {relative:.1e})"]
    if not any(group.shaped_by_load and not group.slides for group in structure.groups):
        moment = np.cross(np.asarray(state.positions, float), load + reactions).sum(0)
        span = np.ptp(np.asarray(structure.nodes, float), axis=0).max()
        error = np.abs(moment).max()
        relative = error / (size * span) if size else 0.0
        notes.append(
            f"unbalanced moment about the origin: {units.text(error, 'N m', '.1e')} (relative to "
            f"the sum of all forces times the extent: {relative:.1e})"
        )
    else:
        notes.append("moment equilibrium not checked (beams or catenaries carry line loads)")
    return make_table("Global equilibrium", columns, notes)
