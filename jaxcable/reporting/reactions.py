"""The tables of a report on supports: reactions, and global equilibrium."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..analysis.results import Results
from ..analysis.solution import State
from ..common.negligible import NEGLIGIBLE, vector_text, zero_negligible
from ..common.types import Bool, Float, Int
from ..common.units import SI, Units
from ..elements.spring import SPRING_FORCE, SPRING_MOMENT
from ..model.result_parts import named_groups_of, present_elements, values_per_group
from ..model.structure import Structure
from ..model.supports import FixedDofs
from .columns import envelope_columns
from .states import EnvelopeState
from .table import Column, Table, make_table

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

    It has all nodes that are supported in the final state or in one of `states`, and then all
    springs and bearings on the ground. A component in a direction that is not supported in the
    final state has no value.

    Args:
        structure: `Structure`.
        state: the final state.
        fixed: degrees of freedom that supports fix in the final state.
        states: the states of the envelope, by name.
        several: whether the text shows the largest resultant.
        units: `Units` of the numbers in the notes.
    """
    values, held = np.asarray(state.reactions, float), supported_components(structure, fixed)
    others = [supported_components(structure, other.fixed) for other in states.values()]
    ever = np.any([held, *others], axis=0)
    with_moments = state.reaction_moments is not None and bool(ever[:, 3:].any())
    if with_moments:
        values = np.hstack([values, np.asarray(state.reaction_moments, float)])
    # a skew support that has rotated with its node may push along other axes, too
    held[:, : values.shape[1]] |= np.abs(values) > _rounding_limits(values)
    nodes = np.flatnonzero(ever.any(axis=1))
    parts = np.where(held[:, : values.shape[1]], values, np.nan)[nodes]
    every = [np.asarray(other.result.reactions, float)[nodes] for other in states.values()]
    ground = ground_rows(structure, state)
    count = values.shape[1]
    if len(ground.nodes):
        count = max(count, 6 if np.isfinite(ground.values[:, 3:]).any() else 3)
        parts = np.pad(parts, ((0, 0), (0, count - parts.shape[1])), constant_values=np.nan)
        parts = np.vstack([parts, ground.values[:, :count]])
        also = [ground_rows(structure, other.result).values for other in states.values()]
        every = [np.vstack([a, b[:, :3]]) for a, b in zip(every, also, strict=True)]
    # parts are NaN in a direction in which a spring does not act
    forces = np.nan_to_num(parts[:, :3])
    some = np.isfinite(parts[:, :3]).any(axis=1)
    size = np.where(some, np.linalg.norm(forces, axis=1), np.nan)
    sizes = np.array([np.linalg.norm(other, axis=1) for other in every])
    sizes = sizes.reshape(len(every), len(parts))
    largest, when = envelope_columns("largest R", "N", sizes, list(states), 1, heading="max. R")
    columns = [
        Column("node", "", np.concatenate([nodes, ground.nodes])),
        *(Column(f"R{axis}", "N", part) for axis, part in zip("xyz", parts.T[:3], strict=True)),
        Column("R", "N", size, governs=not states),
        *(Column(f"M{axis}", "N m", part) for axis, part in zip("xyz", parts.T[3:], strict=False)),
        largest._replace(governs=bool(states), detail=not several),
        when._replace(detail=not several),
    ]
    if len(ground.nodes):
        columns.insert(1, Column("by", "", ["support"] * len(nodes) + ground.names))
    title = "Support reactions (on the structure)"
    total = values[:, :3].sum(axis=0) + np.nan_to_num(ground.values[:, :3]).sum(axis=0)
    sizes = np.vstack([np.abs(values[:, :3]), np.nan_to_num(np.abs(ground.values[:, :3]))])
    total = units.from_si(zero_negligible(total, sizes.sum()), "N")
    notes = [f"sum of the forces: {vector_text(total)} {units.name('N')}"]
    if np.isnan(parts[:, :3]).any():
        notes.append("blank: direction not supported in the final state")
    return make_table(title, columns, notes)


def total_reaction(structure: Structure, state: State | Results) -> Float[np.ndarray, " 3"]:
    """Return the sum of all reactions of a state, those of springs on the ground too, N, [3]."""
    forces = ground_rows(structure, state).values[:, :3]
    # NaN only where a spring does not act or is not active: it adds nothing there
    return np.asarray(state.reactions, float).sum(axis=0) + np.nansum(forces, axis=0)


class GroundRows(NamedTuple):
    """Springs and bearings on the ground: nodes [n], names, and forces and moments, [n, 6].

    These are NaN without a spring against rotation, and of an inactive element.
    """

    nodes: Int[np.ndarray, " n"]
    names: list[str]
    values: Float[np.ndarray, "n 6"]


def ground_rows(structure: Structure, state: State | Results) -> GroundRows:
    """Return the `GroundRows` of a state: of all groups that have the result `SPRING_FORCE`."""
    results, present = state.element_results, present_elements(structure, state.present)
    forces, moments = (
        values_per_group(structure, results.get(name))
        for name in (SPRING_FORCE.name, SPRING_MOMENT.name)
    )
    nodes, names, values = [np.zeros(0, int)], [], [np.zeros((0, 6))]
    for k, (label, group) in enumerate(named_groups_of(structure)):
        force, moment = forces[k], moments[k]
        if force is None:
            continue
        both = np.hstack([force, np.full_like(force, np.nan) if moment is None else moment])
        values.append(np.where(present[k][:, None], np.asarray(both, float), np.nan))
        nodes.append(group.links.array[:, 0])
        names += [f"{label or type(group).__name__} {n}" for n in range(len(both))]
    return GroundRows(np.concatenate(nodes), names, np.concatenate(values))


def supported_components(structure: Structure, fixed: FixedDofs) -> Bool[np.ndarray, "n_node 6"]:
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
    return NEGLIGIBLE * np.array([force] * 3 + [moment] * 3)[: values.shape[1]]


def _forces_of_ground(structure, state):
    """Return the forces of springs and bearings on all nodes, [n_node, 3], N; zero without any."""
    total, ground = np.zeros((structure.n_node, 3)), ground_rows(structure, state)
    np.add.at(total, ground.nodes, np.nan_to_num(ground.values[:, :3]))
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
