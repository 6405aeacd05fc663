"""What the compiled core is given: phases checked, numbered and taken apart on the host."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np

from . import _check, plausibility, spins, status
from ._rules import kept, rules_of
from ._tree import copy, thaw
from .equilibrium import Newton
from .freedoms import number_freedoms
from .incremental import Incremental
from .loads import NodalLoads, SupportMovement, as_list
from .phases import Phase, keeps_rules
from .ramp import PhaseData, follows, unloaded
from .solution import Solution, State
from .structure import Structure, place_rules
from .topology import require_same


def prepare(structure, phases, method, start, earlier=0):
    """Check the arguments of an analysis and take topology apart from numbers.

    Args:
        structure, phases, method, start: those of `solve`.
        earlier: number of phases that are solved already.

    Returns:
        thawed, arrays: nodes, groups, carry and data of the phases, as `thaw` splits them.
        method: `Newton` or `Incremental`.
        code: status that `start` ended with.
        fixed: freedoms held before the first phase and in each phase, a tuple of `Fixed`.

    Raises:
        ValueError: wrong input, naming argument, index and rule.
    """
    phases = as_phases(structure, phases)
    method = Newton() if method is None else method
    if not isinstance(method, Newton | Incremental):
        raise ValueError(f"method: expected Newton or Incremental, got {_no_method(method)}")
    plausibility.precision(structure.nodes)
    if isinstance(method, Incremental) and method.stiffness == "secant":
        for k, group in enumerate(structure.groups):
            if getattr(group, "secant", None) is None:
                raise ValueError(
                    f'stiffness = "secant": group {k} ({type(group).__name__}) has no secant '
                    'stiffness; use "tangent"'
                )
    carry, code, fixed = _begin(structure, start)
    rows, groups = structure.rows()
    links = tuple((group.links, group.n_freedom, group.inner) for group in groups)
    held = _support_sets(structure, phases, fixed)
    followers = [] if carry is None else [load for load, _ in carry.element_loads if follows(load)]

    def numbered(fixed):
        pressed = [(own, 3, ()) for load in followers for own in load.touches(groups)]
        solver = method.linear_solver
        return number_freedoms(
            fixed, rows, (*links, *pressed), solver, not followers, structure.rigid
        )

    nodes = structure.nodes if rows is None else structure.nodes[rows.node]

    sets, data = held[:1], []
    for number, (phase, fixed) in enumerate(zip(phases, held[1:], strict=True), earlier):
        loads = as_list(phase.loads)
        for load in loads:
            load.check(structure)
        movements = [load for load in loads if isinstance(load, SupportMovement)]
        for movement in movements:
            movement.check_supported(fixed)
        kinds = NodalLoads | SupportMovement
        own = [
            load.among(structure) if hasattr(load, "among") else load
            for load in loads
            if not isinstance(load, kinds)
        ]
        followers += [load for load in own if follows(load)]
        if followers and getattr(method, "stiffness", None) == "secant":
            raise ValueError('stiffness = "secant": not with loads that follow; use "tangent"')
        freedoms = numbered(fixed)
        inputs = phase.inputs(structure)
        nodal = [load for load in loads if isinstance(load, NodalLoads)]
        alone = not (own or movements or any(inputs)) and phase.supports is None
        plausibility.loading(number, nodal, fixed.array, groups, alone)
        if not (own or movements):
            plausibility.held(number, fixed.array, groups)
        data.append(
            PhaseData(
                inputs=inputs,
                nodal_loads=nodal,
                element_loads=own,
                movements=movements,
                freedoms=freedoms,
                freedoms_before=None
                if fixed == sets[-1]
                else number_freedoms(sets[-1], rows, rigid=structure.rigid),
                increments=int(phase.increments),
                other_pattern=bool(data) and freedoms is not data[-1].freedoms,
            )
        )
        sets.append(fixed)
    thawed, arrays = thaw((nodes, groups, carry, data))
    return thawed, arrays, method, code, tuple(sets)


def may_warn(groups, carry, data):
    """Whether a tangent that is not definite says that a state is unstable, and can happen.

    It cannot where the energy is convex (`System.convex`), and does not under nodal moments and
    following loads, which make it unsymmetric.
    """
    if all(group.tension_only and group.rising for group in groups):
        return False
    loads = [] if carry is None else [load for load, _ in carry.element_loads]
    loads += [load for phase in data for load in phase.element_loads]
    moments = [load.moments for phase in data for load in phase.nodal_loads]
    before = None if carry is None else _check.concrete(carry.nodal_load)
    turned = before is not None and bool(np.any(before[:, 3:]))
    return not (turned or any(map(follows, loads)) or any(m is not None for m in moments))


def _support_sets(structure, phases, fixed):
    """`Fixed` before the first phase and in each; all with directions if one has some."""
    sets = [fixed]
    for phase in phases:
        sets.append(sets[-1] if phase.supports is None else structure.fixed(phase.supports))
        if phase.supports is not None and structure.turning:
            spins.warn(structure, sets[-1].spins)
    if all(own.axes is None for own in sets):
        return sets
    sets = [own.directed() for own in sets]
    for before, after in itertools.pairwise(sets):
        for part in range(0, before.array.shape[1], 3):
            held = [own.array[:, part : part + 3] for own in (before, after)]
            in_part = [own.any(axis=1) & ~own.all(axis=1) for own in held]
            apart = np.abs(before.axes.array - after.axes.array).max(axis=(1, 2)) > 1e-9
            turned = in_part[0] & in_part[1] & apart
            if turned.any():
                raise ValueError(
                    f"supports of node {int(turned.argmax())}: held in part along other directions "
                    "than in the phase before; free it, or hold all of it, in a phase between"
                )
    return sets


def as_phases(structure, phases):
    """The phases of an analysis as a list; ValueError if these are no structure and no phases."""
    if isinstance(structure, tuple) and structure and isinstance(structure[0], Structure):
        raise ValueError("structure: got a scene; unpack it: solve(*scene)")
    if not isinstance(structure, Structure):
        kind = _check.kind(structure, "Structure(nodes, elements, supports)")
        raise ValueError(f"structure: expected a Structure, got {kind}")
    if phases is None:
        raise ValueError("phases: missing; give a list such as [Phase(pretension=200.0)]")
    if not isinstance(phases, Phase | list | tuple):
        hint = "; loads go into a phase: [Phase(loads=...)]" if hasattr(phases, "scaled") else ""
        raise ValueError(f"phases: expected a list of Phase, got {type(phases).__name__}{hint}")
    phases = [phases] if isinstance(phases, Phase) else list(phases)
    for k, phase in enumerate(phases):
        if not isinstance(phase, Phase):
            hint = "; loads go into a phase: Phase(loads=...)" if hasattr(phase, "scaled") else ""
            kind = _check.kind(phase, "Phase(...)")
            raise ValueError(f"phases[{k}]: expected a Phase, got {kind}{hint}")
    if not phases:
        raise ValueError("phases: an analysis needs at least one phase")
    return phases


def _no_method(method):
    """What was given for a method, in words, and where it belongs."""
    if isinstance(method, Phase):
        return "Phase; phases go into one list: solve(structure, [first, second])"
    if isinstance(method, Solution | State):
        return f"{type(method).__name__}; an earlier solution goes by name: start=..."
    return _check.kind(method, "Newton()")


def ready(parameters):
    """Nodes, groups, carry and data to compute with, from those that were handed over.

    Floats are as exact as the nodes. The iteration may pass through where the curve of a law has
    ended (the answer may not): laws go on there.
    """
    nodes, groups, carry, data = parameters
    dtype = jnp.asarray(nodes).dtype
    nodes, groups, carry, data = jax.tree.map(
        lambda x: x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x,
        jax.tree.map(jnp.asarray, parameters),
    )
    if carry is None:
        carry = unloaded(nodes, groups)
    if carry.bearing is None and carry.motion.shape[1] > 3 and data[0].freedoms.axes is not None:
        carry = copy(carry, bearing=carry.motion[:, 3:])
    groups = [group.continued() if group.breaks else group for group in groups]
    return nodes, groups, carry, data


def verdicts(parameters, *others):
    """What rules say of numbers that nothing could be refused of, because they were traced.

    Args:
        parameters: nodes, groups, carry and data, as they were handed over.
        others: method and settings.

    Returns:
        own: whether the numbers of the structure keep their rules, scalar bool.
        codes: INVALID_INPUT or OK, one a phase: of its numbers, of the structure and of `others`.
    """
    nodes, groups, _, data = parameters
    own = kept([*rules_of(groups), *(r for group in groups for r in place_rules(nodes, group))])
    common = own & kept(rules_of(others))
    codes = [
        jnp.where(common & keeps_rules(phase, groups), status.OK, status.INVALID_INPUT)
        for phase in data
    ]
    return own, [code.astype(jnp.int32) for code in codes]


def _begin(structure, start):
    """Carry, status and supported freedoms that the analysis starts from."""
    if start is None:
        return None, jnp.int32(status.OK), structure.fixed(structure.supports)
    if isinstance(start, Solution):
        code, last = start.status, start.last
    elif isinstance(start, State):
        code, last = jnp.int32(status.OK), start
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
    return _warm(structure, last.carry), code, fixed


def _warm(structure, carry):
    """A carry whose groups that expand all know how warm they are; some expand only since then."""
    states = [
        copy(state, warmth=jnp.ones_like(state.rest_length))
        if state.warmth is None and getattr(group, "expansion", None) is not None
        else state
        for group, state in zip(structure.groups, carry.states, strict=True)
    ]
    return copy(carry, states=states)
