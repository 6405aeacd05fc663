"""From the arguments of `solve` to those of the compiled core: checks, numbering, schedule."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks, status
from ..common.fusion import are_loops_fused
from ..common.rules import are_rules_kept, collect_rules
from ..common.tree import cast_floats, computed_once, copy_with, split_indices
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..elements.element import Element
from ..elements.element_state import OwnState
from ..elements.prestress import Prestressed
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..loads import SelfWeight
from ..loads.varying import scale_to_peak
from ..mechanics import load_stacks
from ..mechanics.bundles import Bundles
from ..mechanics.load_ramp import PhaseData
from ..mechanics.load_stacks import LoadStack, acting_from_start
from ..mechanics.restart_state import RestartState, initial_restart_state
from ..model import phase_plausibility, plausibility
from ..model.structure import Structure, position_rules
from ..model.supports import FixedDofs
from ..model.topology import require_same_topology
from ..programs.program_calls import as_program
from ..spaces import space_class
from ..spaces.dof_map import make_dof_map, with_assembly_maps
from .absent_elements import refuse_absent_elements, warn_of_idle_loads
from .activation import attached_placement_mask, make_activation
from .phase_checks import (
    check_loads,
    check_method,
    check_supports,
    loads_of_all_phases,
    refuse_secant_with_followers,
    warn_of_free_ends,
    without_amplitudes,
)
from .phase_inputs import depends_on_weight, end_tensions_as_jacking
from .phases import Phase, as_phases
from .prestress_rules import phase_inputs_keep_rules
from .schedule import Schedule, number_unknowns_by_phase, stack_nodal_loads, stack_phase_inputs
from .solution import Solution, State

AnalysisInput: TypeAlias = (
    "tuple[Float[Array, 'n_row 3'], list[Element], RestartState | None, Schedule]"
)
"""Nodes, groups, restart state and schedule."""


class PreparedAnalysis(NamedTuple):
    """The input of an analysis, checked and ready for the compiled program.

    Attributes:
        without_indices, arrays: nodes, groups, `RestartState` and `Schedule`, as `split_indices`
            splits them.
        method: `Newton` or `Incremental`.
        code: status of `start`.
        fixed: degrees of freedom held before the first phase and in each phase, `FixedDofs`.
        loads: element loads of `start`, then those of the phases, list of `LoadStack`.
        bundles: which groups are evaluated together.
        n_unknown: number of unknowns.
        warns_if_unstable: whether a state can be unstable and an indefinite tangent proves it. Not
            where the energy is convex (`System.always_convex`): the tangent is never indefinite.
            Not under nodal moments and follower loads, and with elements that are not `symmetric`:
            the tangent is unsymmetric and proves nothing.
    """

    without_indices: AnalysisInput
    arrays: list[np.ndarray]
    method: Newton | Incremental
    code: Int[ArrayLike, ""]
    fixed: tuple[FixedDofs, ...]
    loads: list[LoadStack]
    bundles: Bundles
    n_unknown: int
    warns_if_unstable: bool


def prepare(
    structure: Structure,
    phases: Phase | Sequence[Phase] | None,
    method: Newton | Incremental | None,
    start: Solution | State | None,
    earlier: int = 0,
    to_end: bool = False,
    coupled: tuple[Any, ...] = (),
    symmetric: bool = True,
    in_motion: bool = False,
) -> PreparedAnalysis:
    """Check the arguments of an analysis, and separate topology from numbers.

    Args:
        structure, phases, method, start: as for `solve`.
        earlier: number of phases solved before, by which warnings number the phases.
        to_end: whether only equilibria are sought: then the tangent of a net is never indefinite.
        coupled: unknowns that further forces, such as inertia, couple: triples like those of
            `make_dof_map`, for places in the sparsity pattern.
        symmetric: whether the tangent is symmetric if elements and loads are.
        in_motion: whether inertia acts, so that a cable with a free end may have tension.

    Returns:
        `PreparedAnalysis`.

    Raises:
        ValueError: wrong input, naming argument, index and rule.
    """
    phases = as_phases(structure, phases)
    method = check_method(structure, method)
    plausibility.warn_of_lost_precision(structure.nodes)
    restart, code, fixed = _starting_point(structure, start)
    rows, groups = structure.motion_rows()
    bundles = _make_bundles(structure)
    sets = check_supports(structure, phases, fixed, earlier)
    loads = [
        check_loads(structure, phase, held, f"phases[{earlier + k}]")
        for k, (phase, held) in enumerate(zip(phases, sets[1:], strict=True))
    ]
    nodal, movements, along = ([kinds[k] for kinds in loads] for k in range(3))
    inputs = [phase.inputs(structure, f"phases[{earlier + k}].") for k, phase in enumerate(phases)]
    stated = stack_phase_inputs([end_tensions_as_jacking(structure, x) for x in inputs], bundles)
    stacks = load_stacks.stack_loads(along)
    everything = [*([] if restart is None else restart.loads), *stacks]
    followed = restart is not None and any(stack.follows for stack in restart.loads)
    refuse_secant_with_followers(method, phases, followed, earlier)
    bundled = bundles.join_groups(groups)
    convex = to_end and isinstance(method, Newton) and _is_always_convex(bundled, everything)
    settings = everything, bundled, bundles, convex, (coupled, symmetric)
    numbered = _numbering_function(structure, method, *settings)
    presence = make_activation(
        structure, phases, None if restart is None else restart.states, earlier
    )
    idle = attached = None
    if presence is not None:
        presence = refuse_absent_elements(structure, phases, inputs, presence, earlier)
        warn_of_idle_loads(without_amplitudes(along), presence, earlier)
        presence, attached = presence.on_bundles(bundles), attached_placement_mask(phases)
        idle = presence.inactive_dofs(structure, bundled)
    _warn_of_unlikely_loads(structure, phases, loads, sets, idle, inputs, earlier)
    if any(depends_on_weight(phase) for phase in phases):
        loads_known = [*loads_of_all_phases(phases), *(stack.load for stack in everything)]
        weighed = any(isinstance(load, SelfWeight) for load in loads_known)
        phase_plausibility.warn_of_unused_weight(structure.named_groups(), weighed)
    if restart is None and not in_motion:
        warn_of_free_ends(structure, phases, sets)
    dof_map, changes, before = number_unknowns_by_phase(sets, numbered, idle)
    nodes = structure.nodes if rows is None else _select_rows(structure.nodes, rows.node_of_row)
    shape, dtype = (len(nodes), structure.space.n_freedom), jnp.result_type(nodes)
    present: Any = None if presence is None else presence.present
    stacked = PhaseData(
        number=np.arange(len(phases), dtype=np.int32),
        inputs=stated,
        added_load=stack_nodal_loads(nodal, "nodal_forces", shape, dtype),
        moved=stack_nodal_loads(movements, "nodal_movements", shape, dtype),
        dof_map=changes,  # type: ignore[arg-type]  # fields of it, see `Schedule`
        dof_map_before=before,  # type: ignore[arg-type]  # likewise
        present=present,
        attached=attached,
    )
    schedule = Schedule(
        *(stacked, dof_map, stacks),
        increments=tuple(int(phase.increments) for phase in phases),
        n_node=structure.n_node,
        present_at_start=None if presence is None else presence.present_at_start,
        is_consistent=None if presence is None else presence.is_consistent,
    )
    without_indices, arrays = split_indices((nodes, bundled, restart, schedule))
    warns = _can_prove_instability(bundled, restart, everything, without_amplitudes(nodal))
    return PreparedAnalysis(
        *(without_indices, arrays, method, code, tuple(sets), everything),
        *(bundles, len(dof_map.free), warns),
    )


@as_program
def _select_rows(nodes, rows):
    """Return ``nodes[rows]``, [n_row, 3], m.

    It is a program, since XLA would compile each operation of its derivative.
    """
    return nodes[rows]


def _warn_of_unlikely_loads(structure, phases, loads, sets, idle, inputs, earlier):
    """Warn of nodal loads that strain elements a lot, and of phases in which nothing can move.

    `loads` are as of `check_loads`, by phase; `sets` and `idle` (or None) are held and inactive
    degrees of freedom before the first phase and in each.
    """
    groups = structure.motion_rows()[1]
    for k, phase in enumerate(phases):
        nodal, movements, along = loads[k]
        moving, mask = along or movements, sets[k + 1].array
        alone = not (moving or any(inputs[k])) and phase.supports is None
        waits = None if idle is None or isinstance(idle, jax.core.Tracer) else idle[k + 1]
        peaks = [scale_to_peak(*pair) for pair in nodal]
        phase_plausibility.warn_of_nodal_loads(earlier + k, peaks, mask, groups, alone, waits)
        if not moving:
            phase_plausibility.warn_if_all_nodes_held(earlier + k, mask, groups)
        if phase.loads is not None and phase.increments == 1:
            given = structure.groups, inputs[k]
            phase_plausibility.warn_of_cables_paid_out(earlier + k, *given)


@computed_once
def _make_bundles(structure):
    """Return which groups of a structure are evaluated together; numbers do not matter."""
    return Bundles.from_groups(structure.motion_rows()[1])


def _numbering_function(structure, method, stacks, groups, bundles, convex, further):
    """Return a function from `FixedDofs` to the `DofMap` that numbers the unknowns.

    `stacks` are all element loads, `groups` are joined to `bundles`; `convex` says whether the
    tangent is never indefinite; `further` are `coupled` and `symmetric` of `prepare`.
    """
    further, all_symmetric = further
    (rows, _), space = structure.motion_rows(), structure.space
    followers = [stack for stack in stacks if stack.follows]
    links = tuple((group.links, group.n_freedom, group.inner_unknowns) for group in groups)
    pressed = tuple(
        (nodes, 3, ()) for stack in followers for nodes in stack.coupled_nodes(groups, bundles)
    )

    straight = are_loops_fused() and not space.rotates and not further
    symmetric = space.symmetric and not followers and all(group.symmetric for group in groups)
    symmetric = symmetric and all_symmetric

    def number(fixed):
        paired = tuple(straight and group.paired and fixed.axes is None for group in groups)
        solver = method.linear_solver
        coupled = (*links, *pressed, *further)
        settings = solver, symmetric, structure.rigid, space, convex, paired
        found = make_dof_map(fixed, rows, coupled, *settings)
        ends = tuple(group.links for group in groups)
        return (
            with_assembly_maps(found, ends, rows is None and not space.rotates)
            if are_loops_fused()
            else found
        )

    return number


def _can_prove_instability(groups, restart, stacks, nodal):
    """Return whether the tangent can be indefinite and is symmetric, which proves instability.

    `restart` is the `RestartState` at the start or None, `stacks` are all element loads, `nodal`
    the nodal loads of every phase.
    """
    if _is_always_convex(groups, stacks) or not all(group.symmetric for group in groups):
        return False
    rotate = any(group.rotates for group in groups)
    moments = rotate and any(load.has_moments for of_phase in nodal for load in of_phase)
    before = None if restart is None else checks.array_if_known(restart.nodal_load)
    moments_before = before is not None and bool(np.any(before[:, 3:]))
    following = any(stack.follows or stack.load.has_moments for stack in stacks)
    return not (moments_before or following or moments)


def _is_always_convex(groups, stacks):
    """Return whether all elements are cables, and no load slides or follows (convex energy)."""
    tension_only = all(g.tension_only and g.monotone and g.symmetric for g in groups)
    slides = stacks and any(group.slides for group in groups)
    return tension_only and not slides and not any(stack.follows for stack in stacks)


def complete_input(parameters: AnalysisInput, bundles: Bundles) -> AnalysisInput:
    """Complete the input of a `PreparedAnalysis` inside of the compiled program.

    Floats get the dtype of the nodes; the restart state gets the loads of all phases, not yet
    acting, and what it lacks. Laws are extrapolated beyond the ends of their curves: the iteration
    may pass there (a result may not). Groups are joined to bundles.

    Returns:
        Nodes, groups, `RestartState`, `Schedule`.
    """
    nodes, groups, restart, schedule = cast_floats(parameters, jnp.asarray(parameters[0]).dtype)
    if restart is None:
        restart = initial_restart_state(nodes, groups)
    else:
        restart = copy_with(restart, states=_join_states(groups, bundles, restart.states))
    if schedule.present_at_start is not None:
        parts = zip(groups, restart.states, schedule.present_at_start, strict=True)
        states = [group.with_activation(state, jnp.asarray(first)) for group, state, first in parts]
        restart = copy_with(restart, states=states)
    if restart.support_rotation is None and schedule.dof_map.axes is not None:
        restart = copy_with(restart, support_rotation=space_class(groups).rotations(restart.motion))
    begun = nodes + restart.motion[:, :3]
    loads = [*restart.loads, *(stack.before_phases(begun) for stack in schedule.loads)]
    loads = loads if bundles.are_groups else [stack.on_bundles(bundles) for stack in loads]
    restart = copy_with(restart, loads=loads)
    groups = [group.extrapolated() for group in groups]
    return nodes, groups, restart, schedule


def _join_states(
    groups: Sequence[Element], bundles: Bundles, states: Sequence[OwnState]
) -> list[OwnState]:
    """Join element states to bundles, with a `thermal_stretch` where the elements expand.

    A state has none yet if its group has got its `expansion` since, or if only another group of its
    bundle expands.
    """
    found = list(states)
    for group, members in zip(groups, bundles.group_indices, strict=True):
        if group.expansion is not None or any(
            states[k].thermal_stretch is not None for k in members
        ):
            for k in members:
                if states[k].thermal_stretch is None and isinstance(group, Prestressed):
                    length = states[k].rest_length
                    pack = jnp if isinstance(length, jax.core.Tracer) else np
                    found[k] = copy_with(states[k], thermal_stretch=pack.ones_like(length))
    return bundles.join(found)


def traced_input_status(
    parameters: AnalysisInput, *others: Any
) -> tuple[Bool[Array, ""], Int[Array, " n_phase"]]:
    """Return whether traced numbers keep their rules (known ones that do not were refused before).

    Args:
        parameters: nodes, groups, restart state and schedule, as in `PreparedAnalysis`.
        others: method and settings.

    Returns:
        structure_ok: whether the numbers of the structure keep their rules, scalar bool.
        codes: OK if the numbers of a phase, of the structure and of `others` keep their rules, else
            INVALID_INPUT, [n_phase].
    """
    nodes, groups, _, schedule = parameters
    phases = schedule.phases
    structure_ok = are_rules_kept(
        [*collect_rules(groups), *(r for group in groups for r in position_rules(nodes, group))]
    )
    good = jnp.broadcast_to(structure_ok & are_rules_kept(collect_rules(others)), len(schedule))
    if schedule.is_consistent is not None:
        good = good & schedule.is_consistent
    if jax.tree.leaves(phases.inputs):
        keep_rules = jax.vmap(lambda own: phase_inputs_keep_rules(own, groups, nodes))
        good = good & keep_rules(phases.inputs)
    for added in (phases.added_load, phases.moved):
        if added is not None and added.amplitude is not None:
            good = good & jax.vmap(lambda own: are_rules_kept(own.rules()))(added.amplitude)
    for stack in schedule.loads:
        broken = jnp.zeros(len(schedule), jnp.int32).at[stack.phase].add(~stack.keeps_rules())
        good = good & (broken == 0)
    return structure_ok, jnp.where(good, status.OK, status.INVALID_INPUT).astype(jnp.int32)


def _starting_point(structure, start):
    """Return what the analysis starts from: `RestartState` (or None), status, `FixedDofs`.

    `start` is the argument of `solve`.
    """
    if start is None:
        return None, np.int32(status.OK), structure.fixed(structure.supports)
    if isinstance(start, Solution):
        code, last = start.status, start.last
    elif isinstance(start, State):
        code, last = np.int32(status.OK), start
    else:
        raise ValueError(f"start: expected a Solution, got {type(start).__name__}")
    require_same_topology(structure, last.topology, "start")
    fixed = last.fixed[-1]
    if isinstance(start, State) and any(f != fixed for f in last.fixed):
        if isinstance(last.phase, jax.core.Tracer):
            raise ValueError(
                "start: the supports of a traced state (solution.last) are not known; give the "
                "solution itself"
            )
        fixed = last.fixed[int(last.phase) + 1]
    restart = copy_with(
        last.restart, loads=[acting_from_start(stack) for stack in last.restart.loads]
    )
    return restart, code, fixed
