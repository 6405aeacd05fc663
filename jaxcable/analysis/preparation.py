"""From the arguments of `solve` to those of the compiled core: checks, numbering, schedule."""

from __future__ import annotations

import contextlib
import functools
import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks, status
from ..common.fusion import are_loops_fused
from ..common.rules import are_rules_kept, collect_rules
from ..common.tree import cast_floats, computed_once, copy_with, split_indices
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..elements.abilities import Secant
from ..elements.element import Element
from ..elements.prestress import Prestressed
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..loads import SelfWeight, as_list
from ..loads.load import Acting, Moving, OnNodes
from ..loads.varying import apart, at_peak
from ..mechanics import load_stacks
from ..mechanics.bundles import Bundles
from ..mechanics.carry import Carry, unloaded
from ..mechanics.load_stacks import LoadStack, continued
from ..model import plausibility, spins
from ..model.structure import Structure, place_rules
from ..model.supports import Fixed
from ..model.topology import require_same
from ..spaces import space_of
from ..spaces.dof_map import make_dof_map, with_assembly
from .absent import loads_that_never_act, require_present
from .phases import Phase, as_phases
from .presence import attached_of, presence_of
from .prestress_rules import keeps_rules
from .schedule import Schedule, numbering, on_rows, stated
from .solution import Solution, State

Frame: TypeAlias = "tuple[Float[Array, 'n_row 3'], list[Element], Carry | None, Schedule]"
"""Nodes, groups, carry and schedule."""


class Prepared(NamedTuple):
    """An analysis, checked and ready for the compiled core.

    Attributes:
        thawed, arrays: nodes, groups, carry and `Schedule`, as `split_indices` splits them.
        method: `Newton` or `Incremental`.
        code: status of `start`.
        fixed: freedoms held before the first phase and in each phase, a tuple of `Fixed`.
        loads: element loads of `start`, then those of the phases, list of `LoadStack`.
        bundles: which groups are evaluated together.
        n_free: number of unknowns.
        may_warn: whether a state can be unstable and an indefinite tangent proves it. Not where the
            energy is convex (`System.always_convex`): the tangent is never indefinite. Not under
            nodal moments and following loads, and with elements that are not `symmetric`: the
            tangent is unsymmetric and proves nothing.
    """

    thawed: Frame
    arrays: list[np.ndarray]
    method: Newton | Incremental
    code: Int[ArrayLike, ""]
    fixed: tuple[Fixed, ...]
    loads: list[LoadStack]
    bundles: Bundles
    n_free: int
    may_warn: bool


def prepare(
    structure: Structure,
    phases: Phase | Sequence[Phase] | None,
    method: Newton | Incremental | None,
    start: Solution | State | None,
    earlier: int = 0,
    to_end: bool = False,
) -> Prepared:
    """Check the arguments of an analysis and separate topology from numbers: `Prepared`.

    Args:
        structure, phases, method, start: as for `solve`.
        earlier: number of phases solved before, by which warnings number the phases.
        to_end: whether only equilibria are sought: then the tangent of a net is never indefinite.

    Raises:
        ValueError: wrong input, naming argument, index and rule.
    """
    phases = as_phases(structure, phases)
    method = _method(structure, method)
    plausibility.precision(structure.nodes)
    carry, code, fixed = _begin(structure, start)
    rows, groups = structure.rows()
    bundles = _bundles(structure)
    sets = _support_sets(structure, phases, fixed)
    loads = [
        _loads(structure, phase, held, f"phases[{earlier + k}]")
        for k, (phase, held) in enumerate(zip(phases, sets[1:], strict=True))
    ]
    nodal, movements, along = ([kinds[k] for kinds in loads] for k in range(3))
    statements = []
    for k, phase in enumerate(phases):
        with _named(f"phases[{earlier + k}]."):
            statements.append(phase.statements(structure))
    stacks = load_stacks.stacks(along)
    everything = [*([] if carry is None else carry.loads), *stacks]
    bundled = bundles.groups(groups)
    convex = to_end and isinstance(method, Newton) and _always_convex(bundled, everything)
    numbered = _numbered(structure, method, everything, bundled, bundles, convex)
    presence = presence_of(structure, phases, None if carry is None else carry.states, earlier)
    idle = attached = None
    if presence is not None:
        presence = require_present(structure, phases, statements, presence, earlier)
        loads_that_never_act(_alone(along), presence, earlier)
        presence, attached = presence.bundled(bundles), attached_of(phases)
        idle = presence.idle(structure, bundled)
    for k, phase in enumerate(phases):
        moving = along[k] or movements[k]
        alone = not (moving or any(statements[k])) and phase.supports is None
        mask = sets[k + 1].array
        waits = None if idle is None or isinstance(idle, jax.core.Tracer) else idle[k + 1]
        peaks = [at_peak(*pair) for pair in nodal[k]]
        plausibility.loading(earlier + k, peaks, mask, groups, alone, waits)
        if not moving:
            plausibility.nothing_free(earlier + k, mask, groups)
    if any(phase.loads is not None or phase.sag is not None for phase in phases):
        weighed = any(isinstance(stack.load, SelfWeight) for stack in everything)
        plausibility.weights(structure.named_groups(), weighed)
    dof_map, changes, before = numbering(sets, numbered, idle)
    together = statements if bundles.plain else [bundles.statements(each) for each in statements]
    nodes = structure.nodes if rows is None else structure.nodes[rows.node_of_row]
    shape, dtype = (len(nodes), structure.space.n_freedom), jnp.result_type(nodes)
    schedule = Schedule(
        number=np.arange(len(phases), dtype=np.int32),
        statements=stated(together, bundled),
        added_load=on_rows(nodal, "nodal_forces", shape, dtype),
        moved=on_rows(movements, "steps", shape, dtype),
        dof_map=dof_map,
        changes=changes,
        before=before,
        loads=stacks,
        increments=tuple(int(phase.increments) for phase in phases),
        n_node=structure.n_node,
        present=None if presence is None else presence.present,
        first=None if presence is None else presence.first,
        attached=attached,
        sound=None if presence is None else presence.sound,
    )
    thawed, arrays = split_indices((nodes, bundled, carry, schedule))
    warns = _may_warn(bundled, carry, everything, _alone(nodal))
    count = len(dof_map.free)
    return Prepared(thawed, arrays, method, code, tuple(sets), everything, bundles, count, warns)


@functools.cache
def _usual_method():
    return Newton()


def _method(structure, method):
    """The method of an analysis, checked; `Newton` by default."""
    method = _usual_method() if method is None else method
    if not isinstance(method, Newton | Incremental):
        raise ValueError(f"method: expected Newton or Incremental, got {_no_method(method)}")
    if isinstance(method, Incremental) and method.stiffness == "secant":
        for where, group in structure.named_groups():
            if not isinstance(group, Secant):
                raise ValueError(
                    f'stiffness = "secant": elements{where} ({type(group).__name__}) has no secant '
                    'stiffness (ability `Secant`); use "tangent"'
                )
    return method


@computed_once
def _bundles(structure):
    """The `Bundles` of a structure; they do not depend on its numbers."""
    return Bundles.of(structure.rows()[1])


@contextlib.contextmanager
def _named(where):
    """Put `where` in front of the message of a ValueError."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{where}{error}") from None


def _loads(structure, phase, fixed, where):
    """Loads of a phase, checked: lists of nodal loads, movements of supports, element loads.

    The lists are of pairs of a load and its amplitude (`loads.varying.apart`).
    """
    found = [], [], []
    for j, given in enumerate(as_list(phase.loads)):
        label = f"{where}.loads[{j}]"
        with _named(f"{label}: "):
            given.check(structure)
            load, amplitude = apart(given, label, phase.increments)
            if isinstance(load, Moving):
                load.check_supported(fixed)
            if isinstance(load, Acting):
                load = load.among(structure)
        for pairs, kind in zip(found, (OnNodes, Moving, Acting), strict=True):
            if isinstance(load, kind):
                pairs.append((load, amplitude))
    return found


def _alone(loads):
    """Loads of every phase without their amplitudes, a list of lists."""
    return [[load for load, _ in pairs] for pairs in loads]


def _numbered(structure, method, stacks, groups, bundles, convex):
    """A function from a `Fixed` to the numbering of the unknowns that it leaves, `Freedoms`."""
    (rows, _), space = structure.rows(), structure.space
    followers = [stack for stack in stacks if stack.follows]
    if followers and isinstance(method, Incremental) and method.stiffness == "secant":
        raise ValueError('stiffness = "secant": not with loads that follow; use "tangent"')
    links = tuple((group.links, group.n_freedom, group.inner) for group in groups)
    pressed = tuple(
        (nodes, 3, ()) for stack in followers for nodes in stack.touches(groups, bundles)
    )

    straight = are_loops_fused() and not space.rotates
    symmetric = space.symmetric and not followers and all(group.symmetric for group in groups)

    def number(fixed):
        paired = tuple(straight and group.paired and fixed.axes is None for group in groups)
        solver = method.linear_solver
        coupled = (*links, *pressed)
        settings = solver, symmetric, structure.rigid, space, convex, paired
        found = make_dof_map(fixed, rows, coupled, *settings)
        ends = tuple(group.links for group in groups)
        return (
            with_assembly(found, ends, rows is None and not space.rotates)
            if are_loops_fused()
            else found
        )

    return number


def _may_warn(groups, carry, stacks, nodal):
    """See `Prepared.may_warn`."""
    if _always_convex(groups, stacks) or not all(group.symmetric for group in groups):
        return False
    rotate = any(group.rotates for group in groups)
    moments = rotate and any(load.has_moments for of_phase in nodal for load in of_phase)
    before = None if carry is None else checks.array_if_known(carry.nodal_load)
    moments_before = before is not None and bool(np.any(before[:, 3:]))
    following = any(stack.follows for stack in stacks)
    return not (moments_before or following or moments)


def _always_convex(groups, stacks):
    """Whether the energy is known to be convex: cables, and no loads that slide along or follow."""
    tension_only = all(g.tension_only and g.monotone and g.symmetric for g in groups)
    slides = stacks and any(group.slides for group in groups)
    return tension_only and not slides and not any(stack.follows for stack in stacks)


def _support_sets(structure, phases, fixed):
    """`Fixed` before the first phase and in each; all with directions if any of them has some."""
    sets = [fixed]
    for phase in phases:
        sets.append(sets[-1] if phase.supports is None else structure.fixed(phase.supports))
        if phase.supports is not None and structure.space.rotates:
            spins.warn(structure, sets[-1].spins)
    if all(fixed.axes is None for fixed in sets):
        return sets
    sets = [fixed.directed() for fixed in sets]
    for before, after in itertools.pairwise(sets):
        for part in range(0, before.array.shape[1], 3):
            held = [fixed.array[:, part : part + 3] for fixed in (before, after)]
            in_part = [mask.any(axis=1) & ~mask.all(axis=1) for mask in held]
            apart = np.abs(before.axes.array - after.axes.array).max(axis=(1, 2)) > 1e-9
            turned = in_part[0] & in_part[1] & apart
            if turned.any():
                raise ValueError(
                    f"supports of node {int(turned.argmax())}: held in part along other directions "
                    "than in the phase before; free it, or hold all of it, in a phase between"
                )
    return sets


def _no_method(method):
    """What was given instead of a method, in words, and where it belongs."""
    if isinstance(method, Phase):
        return "Phase; phases go into one list: solve(structure, [first, second])"
    if isinstance(method, Solution | State):
        return f"{type(method).__name__}; an earlier solution goes by name: start=..."
    return checks.describe_type(method, "Newton()")


def in_precision_of(nodes: Float[ArrayLike, "n_row 3"], tree: PyTree[Any]) -> PyTree[Any]:
    """A tree with all floats in the dtype of the nodes."""
    return cast_floats(tree, jnp.asarray(nodes).dtype)


def ready(parameters: Frame, bundles: Bundles) -> Frame:
    """Nodes, groups, carry and schedule to compute with, from those of `Prepared`.

    All of them are of bundles of groups. Laws are extended beyond the ends of their curves: the
    iteration may pass there (a result may not).
    """
    nodes, groups, carry, schedule = in_precision_of(parameters[0], parameters)
    dtype = nodes.dtype
    if carry is None:
        carry = unloaded(nodes, groups)
    else:
        carry = copy_with(carry, states=_warm(groups, bundles, carry.states))
    if schedule.first is not None:
        parts = zip(groups, carry.states, schedule.first, strict=True)
        states = [group.partly(state, jnp.asarray(first)) for group, state, first in parts]
        carry = copy_with(carry, states=states)
    if carry.support_rotation is None and schedule.dof_map.axes is not None:
        carry = copy_with(carry, support_rotation=space_of(groups).rotations(carry.motion))
    begun = nodes + carry.motion[:, :3]
    loads = [*carry.loads, *schedule.loads]
    loads = loads if bundles.plain else [stack.bundled(bundles) for stack in loads]
    carry = copy_with(
        carry,
        loads=loads,
        amounts=[*carry.amounts, *(stack.idle(begun, dtype) for stack in schedule.loads)],
    )
    groups = [group.extrapolated() for group in groups]
    return nodes, groups, carry, schedule


def _warm(groups, bundles, states):
    """States of bundles from those of their groups, with a `warmth` in all that expand.

    A state has none yet if its group has got its `expansion` since, or if only another group of its
    bundle expands.
    """
    found = list(states)
    for group, members in zip(groups, bundles.members, strict=True):
        if group.expansion is not None or any(states[k].warmth is not None for k in members):
            for k in members:
                if states[k].warmth is None and isinstance(group, Prestressed):
                    found[k] = copy_with(states[k], warmth=jnp.ones_like(states[k].rest_length))
    return bundles.together(found)


def verdicts(parameters: Frame, *others: Any) -> tuple[Bool[Array, ""], Int[Array, " n_phase"]]:
    """Whether traced numbers keep their rules (known numbers that do not were refused before).

    Args:
        parameters: nodes, groups, carry and schedule, as in `Prepared`.
        others: method and settings.

    Returns:
        structure_ok: whether the numbers of the structure keep their rules, scalar bool.
        codes: OK if the numbers of a phase, of the structure and of `others` keep their rules, else
            INVALID_INPUT, [n_phase].
    """
    nodes, groups, _, schedule = parameters
    structure_ok = are_rules_kept(
        [*collect_rules(groups), *(r for group in groups for r in place_rules(nodes, group))]
    )
    good = jnp.broadcast_to(structure_ok & are_rules_kept(collect_rules(others)), len(schedule))
    if schedule.sound is not None:
        good = good & schedule.sound
    if jax.tree.leaves(schedule.statements):
        good = good & jax.vmap(lambda own: keeps_rules(own, groups, nodes))(schedule.statements)
    for added in (schedule.added_load, schedule.moved):
        if added is not None and added.amplitude is not None:
            good = good & jax.vmap(lambda own: are_rules_kept(own.rules()))(added.amplitude)
    for stack in schedule.loads:
        broken = jnp.zeros(len(schedule), jnp.int32).at[stack.phase].add(~stack.keeps_rules())
        good = good & (broken == 0)
    return structure_ok, jnp.where(good, status.OK, status.INVALID_INPUT).astype(jnp.int32)


def _begin(structure, start):
    """Carry, status and held freedoms (`Fixed`) that the analysis starts from."""
    if start is None:
        return None, np.int32(status.OK), structure.fixed(structure.supports)
    if isinstance(start, Solution):
        code, last = start.status, start.last
    elif isinstance(start, State):
        code, last = np.int32(status.OK), start
    else:
        raise ValueError(f"start: expected a Solution, got {type(start).__name__}")
    require_same(structure, last.topology, "start")
    fixed = last.fixed[-1]
    if isinstance(start, State) and any(f != fixed for f in last.fixed):
        if isinstance(last.phase, jax.core.Tracer):
            raise ValueError(
                "start: which supports a traced .last had is not known; use the solution itself"
            )
        fixed = last.fixed[int(last.phase) + 1]
    carry = copy_with(last.carry, loads=[continued(stack) for stack in last.carry.loads])
    return carry, code, fixed
