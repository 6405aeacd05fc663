"""The tables of a report on supports: reactions, their envelope over cases, and by phase."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..analysis.results import StateResults
from ..common.negligible import NEGLIGIBLE, zero_negligible
from ..common.types import Bool, Float, Int
from ..common.units import SI
from ..elements.friction_state import SADDLE_MOMENT
from ..elements.sliding_catenaries import SlidingCatenaries
from ..elements.spring import SPRING_FORCE, SPRING_MOMENT
from ..model.result_parts import (
    active_nodes,
    named_groups_of,
    present_elements,
    values_per_group,
)
from ..model.structure import Structure
from ..model.supports import FixedDofs
from .columns import envelope_columns, without_blank_rows
from .load_descriptions import range_with_unit
from .states import EnvelopeState, ReportedAnalysis
from .table import Column, Table, make_table

_SKEW = 1e-9  # cosine between a fixed direction and an axis from which it has a component there
_COMPONENTS = {"Rx": "N", "Ry": "N", "Rz": "N", "Mx": "N m", "My": "N m", "Mz": "N m"}


class GroundSpringForces(NamedTuple):
    """Forces and moments of springs and bearings that join nodes to the ground.

    Attributes:
        nodes: node of each spring, [n].
        names: name of each spring: its group and its index there.
        values: forces and moments on the structure, [n, 6], N and N m; NaN for moments of a spring
            without rotational stiffness, and for an inactive one.
    """

    nodes: Int[np.ndarray, " n"]
    names: list[str]
    values: Float[np.ndarray, "n 6"]


def ground_spring_forces(structure: Structure, state: StateResults) -> GroundSpringForces:
    """Return the `GroundSpringForces` of a state, of all groups with the result `SPRING_FORCE`."""
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
    return GroundSpringForces(np.concatenate(nodes), names, np.concatenate(values))


def total_reaction(structure: Structure, state: StateResults) -> Float[np.ndarray, " 3"]:
    """Return the sum of the reactions of supports and of springs on the ground, [3], N."""
    forces = ground_spring_forces(structure, state).values[:, :3]
    # NaN only where a spring does not act or is not active: it adds nothing there
    return np.asarray(state.reactions, float).sum(axis=0) + np.nansum(forces, axis=0)


class _Reactions(NamedTuple):
    """Reactions at all nodes that any of some states supports, then at all springs on the ground.

    Attributes:
        nodes, names: of every place, [n]; the name is that of the spring, or "support".
        on_ground: whether there are springs or bearings on the ground.
        values: [n_state, n, 6], N and N m; NaN in a direction that is not supported in the state.
    """

    nodes: Int[np.ndarray, " n"]
    names: list[str]
    on_ground: bool
    values: Float[np.ndarray, "n_state n 6"]

    def name_columns(self, which: Int[np.ndarray, " m"]) -> list[Column]:
        """Return the columns that name the places with the indices `which`."""
        columns = [Column("node", "", self.nodes[which])]
        by = Column("by", "", [self.names[k] for k in which])
        return [*columns, by] if self.on_ground else columns

    def is_significant(self) -> Bool[np.ndarray, "n 6"]:
        """Return whether a component is above rounding in any state, [n, 6] bool."""
        return (np.abs(self.values) > _rounding_limits(self.values)).any(axis=0)


def _reactions_in_states(structure: Structure, states: Sequence[EnvelopeState]) -> _Reactions:
    """Return the `_Reactions` in some states, of `supported_components` and springs."""
    ever, values = np.zeros(structure.n_node, bool), []
    for result, fixed in states:
        own = np.full((structure.n_node, 6), np.nan)
        own[:, :3] = result.reactions
        if result.reaction_moments is not None:
            own[:, 3:] = result.reaction_moments
        held = (
            supported_components(structure, fixed)
            & active_nodes(structure, result.present)[:, None]
        )
        ever |= held.any(axis=1)
        # a skew support that has rotated with its node may push along other axes, too
        held |= np.abs(own) > _rounding_limits(own)
        values.append(np.where(held, own, np.nan))
    nodes = np.flatnonzero(ever)
    ground = [ground_spring_forces(structure, state.result) for state in states]
    pairs = zip(values, ground, strict=True)
    return _Reactions(
        np.concatenate([nodes, ground[0].nodes]),
        ["support"] * len(nodes) + ground[0].names,
        bool(ground[0].names),
        np.array([np.vstack([own[nodes], rows.values]) for own, rows in pairs]),
    )


def _rounding_limits(values):
    """Return the magnitudes up to which reactions [..., 6] are rounding errors, [6], N and N m."""
    sizes = np.nan_to_num(np.abs(values))  # NaN: not supported, which is no reaction
    force = sizes[..., :3].max(initial=0.0)
    return NEGLIGIBLE * np.repeat([force, max(force, sizes[..., 3:].max(initial=0.0))], 3)


def supported_components(structure: Structure, fixed: FixedDofs) -> Bool[np.ndarray, "n_node 6"]:
    """Return which forces and moments along x, y, z supports can take at nodes, [n_node, 6] bool.

    `fixed` are the degrees of freedom that they hold, perhaps along other directions.
    """
    held = np.zeros((structure.n_node, 6), bool)
    array = fixed.array[: structure.n_node]
    held[:, : array.shape[1]] = array
    held[:, 3:] &= structure.rotating_nodes()[:, None]
    if fixed.axes is None:
        return held
    over = np.abs(fixed.axes.array[: structure.n_node]) > _SKEW  # [n_node, direction, component]
    parts = [(held[:, part, None] & over).any(axis=1) for part in (slice(3), slice(3, 6))]
    return np.hstack(parts)


def reaction_table(of: ReportedAnalysis) -> Table:
    """Return the table of reactions in the final state, and of the largest resultant at each node.

    It has all nodes that are supported in the final state or in one of the envelope, and then all
    springs and bearings on the ground. A component in a direction that is not supported in the
    final state has no value.
    """
    every = _reactions_in_states(of.structure, [of.end, *of.envelope.values()])
    final, names = every.values[0], list(of.envelope)
    # a component is NaN where nothing holds a node: it adds nothing to the size
    sizes = np.linalg.norm(np.nan_to_num(every.values[..., :3]), axis=-1)
    some = np.isfinite(final[:, :3]).any(axis=1)
    count = 6 if np.isfinite(every.values[..., 3:]).any() else 3
    parts = [
        Column(name, unit, values)
        for (name, unit), values in zip(_COMPONENTS.items(), final.T[:count], strict=False)
    ]
    columns = [
        *every.name_columns(np.arange(len(final))),
        *parts[:3],
        Column("R", "N", np.where(some, sizes[0], np.nan), governs=not names),
        *parts[3:],
        *envelope_columns(
            *("largest R", "N", sizes[1:], names, 1),
            hidden=() if of.several else ("largest R", "in"),
            heading="max. R",
            governs=bool(names),
        ),
    ]
    size = np.nansum(np.abs(final[:, :3]))
    total = zero_negligible(total_reaction(of.structure, of.state), size)
    text = range_with_unit(total, "N", None if of.units is SI else of.units, is_vector=True)
    notes = [f"sum of the forces: {text}"]
    if np.isnan(final[:, :3]).any():
        notes.append("blank: direction not supported in the final state")
    return make_table("Support reactions (on the structure)", columns, notes)


def reaction_envelope_table(of: ReportedAnalysis) -> dict[str, Table]:
    """Return the table ``reaction_envelope`` by name, or an empty dict without several cases.

    It has two rows for each component of each support, spring or bearing on the ground that is ever
    larger than rounding: the case in which it is smallest, and that in which it is largest, with
    all components of this case: foundations are designed for all of them at once.
    """
    if of.cases is None or len(of.cases) < 2:
        return {}
    every = _reactions_in_states(of.structure, list(of.envelope.values()))
    # where nothing is left at a support, as after the loss of a cable, its reaction is zero
    known = np.isfinite(every.values).any(axis=0)
    every = every._replace(values=np.where(known, np.nan_to_num(every.values), np.nan))
    pairs = np.argwhere(every.is_significant())
    if not len(pairs):
        return {}
    place, component = np.repeat(pairs, 2, axis=0).T
    sign = np.tile([-1, 1], len(pairs))
    chosen = every.values[:, place]  # [n_state, n_row, 6]
    extreme = np.take_along_axis(chosen, component[None, :, None], axis=2)[..., 0]
    used = np.isfinite(every.values).any(axis=(0, 1))
    beside = [
        (name, unit, chosen[..., k])
        for k, (name, unit) in enumerate(_COMPONENTS.items())
        if used[k]
    ]
    _, *others = envelope_columns("", "", sign * extreme, list(of.envelope), 1, beside)
    names = list(_COMPONENTS)
    words = [
        f"{'min' if s < 0 else 'max'} {names[k]}" for s, k in zip(sign, component, strict=True)
    ]
    columns = [*every.name_columns(place), Column("extreme", "", words), *others]
    title = "Smallest and largest reactions over all cases, with the other components"
    return {"reaction_envelope": make_table(title, columns)}


def reactions_by_phase_table(structure: Structure, phases: Mapping[str, EnvelopeState]) -> Table:
    """Return the table of reactions at the end of each phase by name, with their sums."""
    every = _reactions_in_states(structure, list(phases.values()))
    total = np.full((len(phases), 1, 6), np.nan)  # moments about different places have no sum
    total[:, 0, :3] = [total_reaction(structure, end.result) for end in phases.values()]
    pairs = zip(every.nodes.tolist(), every.names, strict=True)
    places = [node if by == "support" else f"{node}, {by}" for node, by in pairs]
    every = every._replace(values=np.hstack([every.values, total]))
    acts = every.is_significant()
    kept = np.flatnonzero(acts.any(axis=1))
    columns = [
        Column("node", "", [[*places, "sum"][k] for k in kept for _ in phases]),
        Column("phase", "", [*phases] * len(kept)),
        *(
            Column(name, unit, every.values[:, kept, k].T.ravel() + 0.0)
            for k, (name, unit) in enumerate(_COMPONENTS.items())
            if k < 3 or acts[:, k].any()
        ),
    ]
    notes = [
        "sum: of the forces on all supports, springs and bearings",
        "blank, or no row: not supported in this direction, or at all",
    ]
    title = "Reactions at the end of each phase (on the structure)"
    return make_table(title, without_blank_rows(columns), notes)


def equilibrium_table(of: ReportedAnalysis) -> Table:
    """Return the table of the sums of loads and reactions; its notes give the unbalanced force.

    Reactions are those of supports, springs to the ground and bearings. Moments about the origin
    are checked if all loads act at nodes; those of saddles on nodes without rotations count.
    """
    structure, state, units = of.structure, of.state, of.units
    load, reactions = np.asarray(state.load, float), np.array(state.reactions, float)
    ground = ground_spring_forces(structure, state)
    # NaN in directions in which a spring does not act
    np.add.at(reactions, ground.nodes, np.nan_to_num(ground.values[:, :3]))
    sums = np.transpose([part.sum(0) for part in (load, reactions, load + reactions)])
    columns = [Column("of", "", ["loads", "reactions", "sum of forces"], heading=" ")]
    columns += [Column(axis, "N", part) for axis, part in zip("xyz", sums, strict=True)]
    size = np.abs(load).sum() + np.abs(reactions).sum()

    def note(what, error, unit, beside, reference):
        relative = error / reference if size else 0.0
        return f"{what}: {units.text(error, unit, '.1e')} (relative to {beside}: {relative:.1e})"

    error = np.abs((load + reactions).sum(0)).max()
    notes = [note("unbalanced force", error, "N", "the sum of all forces", size)]
    hang = (
        g.shaped_by_load and (not g.slides or isinstance(g, SlidingCatenaries))
        for g in structure.groups
    )
    if not any(hang):
        moment = np.cross(np.asarray(state.positions, float), load + reactions).sum(0)
        moment += np.nansum(ground.values[:, 3:], axis=0)
        if state.reaction_moments is not None:
            moment += np.asarray(state.reaction_moments, float).sum(0)
        held = _moments_held_by_saddles(structure, state)
        moment -= held.sum(0)
        extent = np.ptp(np.asarray(structure.nodes, float), axis=0).max()
        what, beside = (
            "unbalanced moment about the origin",
            "the sum of all forces times the extent",
        )
        notes.append(note(what, np.abs(moment).max(), "N m", beside, size * extent))
        if held.any():
            notes.append("with the moments of saddles on nodes without rotations, which hold them")
    else:
        notes.append("moment equilibrium not checked (beams or catenaries carry line loads)")
    return make_table("Global equilibrium", columns, notes)


def _moments_held_by_saddles(structure, state):
    """Return the moments of cables on saddles whose nodes have no rotations, [n, 3], N m.

    What holds these nodes takes them, but they are in no reaction.
    """
    found, rotating = [np.zeros((0, 3))], structure.rotating_nodes()
    known = values_per_group(structure, state.element_results.get(SADDLE_MOMENT.name))
    for group, moments in zip(structure.groups, known, strict=True):
        if moments is not None:
            found.append(np.asarray(moments, float)[~rotating[group.links.array[:, 1:-1]]])
    return np.concatenate(found)
