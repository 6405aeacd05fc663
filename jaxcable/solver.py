"""`solve`: the phases of an analysis one after the other, each in increments by `lax.scan`."""

import functools

import jax
import jax.numpy as jnp
from jax import lax

from . import equilibrium, implicit, incremental, status
from ._tree import Indices, copy, emptied, fill, refrozen, thaw
from .equilibrium import Newton
from .incremental import Incremental
from .loads import NodalLoads, SupportMovement, as_list
from .phases import Phase
from .ramp import PhaseData, Ramp, dead_load, follows, make_system, unloaded
from .solution import PER_PHASE, Path, PhaseResult, Solution, State
from .structure import Freedoms, Structure, number_freedoms


def solve(structure, phases, method=None, start=None, differentiate_path=False):
    """Analyse a structure through its phases.

    A pure function of pytrees: jit, vmap, grad, jvp, jacfwd and hessian work on it. Numbers are
    traced, so that changing one does not recompile; topology and the number of increments are not.

    Args:
        structure: `Structure`.
        phases: list of `Phase`.
        method: `Newton` (default) or `Incremental`.
        start: `Solution` (or its `.last`) of the same structure to continue from.
        differentiate_path: with Newton, also give derivatives of `phases[k].path.displacement` and
            `.tension` (one adjoint system per increment); without it those derivatives are NaN.
            All else is differentiable in any case.

    Returns:
        `Solution`; look at its `status`, or call `raise_if_failed`.

    Raises:
        ValueError: wrong input, naming argument, index and rule.
    """
    if not isinstance(structure, Structure):
        raise ValueError(f"structure: expected a Structure, got {type(structure).__name__}")
    phases = [phases] if isinstance(phases, Phase) else list(phases)
    for k, phase in enumerate(phases):
        if not isinstance(phase, Phase):
            raise ValueError(f"phases[{k}]: expected a Phase, got {type(phase).__name__}")
    if not phases:
        raise ValueError("phases: an analysis needs at least one phase")
    method = Newton() if method is None else method
    if not isinstance(method, Newton | Incremental):
        raise ValueError(f"method: expected Newton or Incremental, got {type(method).__name__}")
    if isinstance(method, Incremental) and method.stiffness == "secant":
        for k, group in enumerate(structure.groups):
            if getattr(group, "secant", None) is None:
                raise ValueError(
                    f'stiffness = "secant": group {k} ({type(group).__name__}) has no secant '
                    'stiffness; use "tangent"'
                )
    carry, code, fixed = _begin(structure, start)
    rows, groups = structure.rows()
    links = tuple((group.links, group.n_freedom) for group in groups)
    followers = [] if carry is None else [load for load, _ in carry.element_loads if follows(load)]

    def numbered(fixed):
        pressed = [(own, 3) for load in followers for own in load.touches(groups)]
        return number_freedoms(fixed, rows, (*links, *pressed), method.linear_solver, not followers)

    nodes = structure.nodes if rows is None else structure.nodes[rows.array]

    sets, data = [fixed], []
    for phase in phases:
        if phase.supports is not None:
            fixed = Indices(structure.fixed(phase.supports))
        loads = as_list(phase.loads)
        for load in loads:
            load.check(structure)
        movements = [load for load in loads if isinstance(load, SupportMovement)]
        for movement in movements:
            movement.check_supported(fixed.array)
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
        data.append(
            PhaseData(
                inputs=phase.inputs(structure),
                nodal_loads=[load for load in loads if isinstance(load, NodalLoads)],
                element_loads=own,
                movements=movements,
                freedoms=freedoms,
                freedoms_before=None if fixed == sets[-1] else number_freedoms(sets[-1], rows),
                increments=int(phase.increments),
                other_pattern=bool(data) and freedoms is not data[-1].freedoms,
            )
        )
        sets.append(fixed)
    thawed, arrays = thaw((nodes, groups, carry, data))
    solution = _analyse(thawed, arrays, method, code, differentiate_path)
    last = copy(solution.last, carry=refrozen(solution.last.carry, arrays))
    solution = copy(solution, last=last)
    return _arrange(structure, solution, tuple(sets))


def _begin(structure, start):
    """Carry, status and supported freedoms that the analysis starts from."""
    if start is None:
        return None, jnp.int32(status.OK), Indices(structure.fixed(structure.supports))
    if isinstance(start, Solution):
        code, last = start.status, start.last
    elif isinstance(start, State):
        code, last = jnp.int32(status.OK), start
    else:
        raise ValueError(f"start: expected a Solution, got {type(start).__name__}")
    if last.displacement.shape != structure.nodes.shape:
        raise ValueError(
            f"start: belongs to a structure of {last.displacement.shape[0]} nodes, "
            f"this one has {structure.n_node}"
        )
    if len(last.carry.states) != len(structure.groups):
        raise ValueError("start: belongs to a structure with other element groups")
    rows = structure.rows()[0]
    motion = (
        structure.n_node if rows is None else len(rows),
        7 if structure.turns().any() else 3,
    )
    if last.carry.motion.shape != motion:
        raise ValueError("start: belongs to a structure with other beams or hinges")
    for k, (group, state) in enumerate(zip(structure.groups, last.carry.states, strict=True)):
        shapes = [jax.tree.map(jnp.shape, plastic) for plastic in (group.virgin(), state.plastic)]
        if shapes[0] != shapes[1]:
            raise ValueError(f"start: the law of group {k} remembers other plastic strains")
    fixed = last.fixed[-1]
    if isinstance(start, State) and any(f != fixed for f in last.fixed):
        if isinstance(last.phase, jax.core.Tracer):
            raise ValueError(
                "start: which supports a traced .last had is not known; use the solution itself"
            )
        fixed = last.fixed[int(last.phase) + 1]
    return last.carry, code, fixed


@functools.partial(jax.jit, static_argnames=("differentiate_path",))
def _analyse(thawed, arrays, method, code, differentiate_path):
    """The compiled core: the phases in turn; results per element are lists, one item per group."""
    nodes, groups, carry, data = fill(thawed, arrays)
    parameters = (nodes, groups, carry, data)
    dtype = nodes.dtype
    nodes, groups, carry, data = jax.tree.map(
        lambda x: x.astype(dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x,
        jax.tree.map(jnp.asarray, parameters),
    )
    if carry is None:
        carry = unloaded(nodes, groups)
    # the iteration may pass through where a curve has ended; the answer may not
    groups = [group.continued() if group.breaks else group for group in groups]
    # a state of numbers that are not finite is none: its NaN must not reach what a batch shares
    sound = _finite((nodes, groups))
    frame = implicit.gate(sound, (nodes, groups))
    reached = (
        jnp.int32(-1),
        jnp.zeros((), dtype),
        (data[0].freedoms_before or data[0].freedoms).fixed,
    )
    results, memory = [], None
    for number, phase in enumerate(data):
        problem = (nodes, groups, carry, phase)
        if phase.other_pattern:
            memory = None  # of other matrices
        code, carry, load, factor, path, memory = _run_phase(
            problem, method, code, differentiate_path, memory
        )
        if not differentiate_path and isinstance(method, Newton):
            names = ("displacement", "tension", "strain")
            rows = {n: getattr(path, n) for n in names if getattr(path, n) is not None}
            path = copy(
                path, **{n: implicit.undifferentiated(v, parameters) for n, v in rows.items()}
            )
        now = (jnp.int32(number), factor, phase.freedoms.fixed)
        reached = jax.tree.map(lambda a, b, f=factor: jnp.where(f > 0, a, b), now, reached)
        end = _state(frame, carry, load, *reached)
        began = problem[2].motion[:, :3] if end.rotation is not None else problem[2].motion
        own = copy(end, displacement=end.displacement - began)
        values = _unless(code == status.OK, own, PER_PHASE, parameters)
        results.append(PhaseResult(status=code, path=path, began=_plastic(problem[2]), **values))
    names = (*PER_PHASE, "load")
    slots = [] if thawed[2] is None else thawed[2].element_loads
    added = [(load, None) for phase in thawed[3] for load in phase.element_loads]
    slots = [
        (emptied(load, own), factor)
        for (load, factor), (own, _) in zip(carry.element_loads, [*slots, *added], strict=True)
    ]
    carry = copy(carry, element_loads=slots)
    last = copy(end, carry=carry, **_unless(sound, end, names, parameters))
    final = _unless(code == status.OK, end, names, parameters)
    return Solution(status=code, last=last, phases=tuple(results), **final)


def _unless(ok, end, names, parameters):
    """Results of a state by name, NaN unless `ok`."""
    values = [getattr(end, name) for name in names]
    return dict(zip(names, implicit.nan_unless(ok, values, parameters), strict=True))


def _run_phase(problem, method, code, differentiate_path, memory):
    """One phase: status, carry, load at its end, load factor reached, path, memory of solves."""
    carry, data = problem[2:]
    dtype, n_inc = carry.motion.dtype, data.increments
    factors = jnp.arange(1, n_inc + 1, dtype=dtype) / n_inc
    if isinstance(method, Newton):
        ramp = Ramp.build(*lax.stop_gradient(problem))
        start = ramp.at(factors[0]).unknowns(ramp.begin.motion)
        outcome, memory = equilibrium.march(ramp, start, factors, method, code, memory)
    else:
        ramp = Ramp.build(*implicit.gate(_finite(problem), problem))
        start = ramp.at(factors[0]).unknowns(ramp.begin.motion)
        outcome = incremental.march(ramp, start, factors, method, code)
    good = outcome.code == status.OK
    n_good = jnp.sum(good)
    valid, factor = n_good > 0, (n_good / n_inc).astype(dtype)
    xs, x = outcome.x, outcome.x[-1]  # the point stays where it was when an increment fails
    converges = isinstance(method, Newton)
    if converges:
        ramp = Ramp.build(*implicit.gate(valid, problem))
    if ramp.plastic is not None:
        rows, plastic, x = _follow(ramp, factors, xs, outcome.code, converges)
        carry, load = _end(ramp, factor, x, valid, problem, plastic)
    else:
        if converges:
            tol, worth = equilibrium.adjoint_effort(method, ramp.at(factor), dtype)
            x = implicit.attach(ramp.at(factor), x, valid, memory, tol, worth)
            if differentiate_path:
                attach = jax.vmap(lambda f, x, ok: implicit.attach(ramp.at(f), x, ok))
                xs = attach(factors, xs, good)
        carry, load = _end(ramp, factor, x, valid, problem)
        rows = jax.vmap(lambda f, x: _row(ramp, ramp.at(f), x))(factors, xs)
    path = _path(rows, factors, outcome, good)
    return outcome.code[-1], carry, load, factor, path, memory


def _follow(ramp, factors, xs, codes, converges):
    """Go through the increments of a phase with memory again, to differentiate them.

    Every increment depends on the plastic strains that the one before left, so that the end of the
    phase is not one implicit function, but each increment is. Their points are known by now.
    """

    @jax.checkpoint
    def step(carry, increment):
        plastic, last = carry
        factor, x, code = increment
        ok = code == status.OK
        system = ramp.at(factor, plastic)
        if converges:
            x = implicit.attach(system, x, ok)
        last = jnp.where(ok, x, last)
        return (ramp.settle(system, x, code, plastic), last), _row(ramp, system, x)

    start = (ramp.plastic, lax.stop_gradient(xs[0]))
    (plastic, last), rows = lax.scan(step, start, (factors, xs, codes))
    return rows, plastic, last


def _end(ramp, factor, x, valid, problem, plastic=None):
    """Carry and load at the end of a phase; those before it if it has no good increment."""
    nodes, groups, before, data = problem
    system = ramp.at(factor, plastic)
    after = ramp.leave(factor, system.motion(x), plastic)
    nothing = [
        (jax.tree.map(jnp.zeros_like, load), jnp.zeros_like(factor)) for load in data.element_loads
    ]
    before = copy(before, element_loads=[*before.element_loads, *nothing])
    carry = jax.tree.map(lambda new, old: jnp.where(valid, new, old), after, before)
    return carry, jnp.where(valid, system.load, dead_load(nodes, groups, before))


def _plastic(carry):
    """Plastic strains of a carry, per group, or None."""
    plastic = [state.plastic for state in carry.states]
    return None if all(p is None for p in plastic) else plastic


def _state(frame, carry, load, number, factor, fixed):
    """The `State` that a carry stands for."""
    nodes, groups = frame
    motion = carry.motion
    freedoms = Freedoms(free=None, source=None, number=None, fixed=fixed)
    system = make_system(nodes, groups, carry, None, freedoms, load)
    turns = motion.shape[1] > 3
    displacement = motion[:, :3] if turns else motion
    state = State(
        displacement=displacement,
        positions=nodes + displacement,
        tension=system.tensions(motion),
        rest_length=[state.rest_length for state in carry.states],
        reactions=system.reactions(motion),
        load=system.all_load(motion),
        phase=number,
        load_factor=factor,
        carry=None,
        fixed=None,
    )
    if not turns:
        return state
    return copy(
        state,
        reactions=state.reactions[:, :3],
        load=state.load[:, :3],
        rotation=motion[:, 3:],
        reaction_moments=state.reactions[:, 3:],
        section_forces=system.section_forces(motion),
    )


def _row(ramp, system, x):
    """One increment of a path."""
    motion = system.motion(x)
    n_slack = sum(jnp.sum(slack) for slack in system.slack(motion))
    n_loose = jnp.sum(system.loose_nodes(motion))
    moved = motion - ramp.begin.motion
    if motion.shape[1] > 3:
        moved = moved[:, :3]
    strain = system.strains(motion)
    if all(own is None for own in strain):
        strain = None
    return moved, system.tensions(motion), n_slack, n_loose, strain


def _path(rows, factors, outcome, good):
    """The increments of a phase; NaN where they are not good."""
    displacement, tension, n_slack, n_loose, strain = rows
    nan = jnp.where(good, 1.0, jnp.nan).astype(factors.dtype)
    if strain is not None:
        strain = jax.tree.map(lambda e: e * nan.reshape(-1, *(1,) * (e.ndim - 1)), strain)
    return Path(
        load_factor=factors,
        displacement=displacement * nan[:, None, None],
        tension=[t * nan[:, None] for t in tension],
        status=outcome.code,
        iterations=outcome.steps,
        factorizations=outcome.factorizations,
        residual=outcome.residual,
        relative_residual=outcome.residual / jnp.where(outcome.scale > 0, outcome.scale, 1.0),
        n_slack=jnp.where(good, n_slack, -1).astype(jnp.int32),
        n_loose=jnp.where(good, n_loose, -1).astype(jnp.int32),
        equilibrated=outcome.equilibrated,
        strain=strain,
    )


def _finite(tree):
    """Whether every float in `tree` is finite."""
    floats = [x for x in jax.tree.leaves(tree) if jnp.issubdtype(x.dtype, jnp.floating)]
    return jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in floats]))


def _arrange(structure, solution, fixed):
    """Put lists with an item per group into the shape of the elements, rows onto their nodes."""
    rows = structure.rows()[0]
    n_node = structure.n_node

    def arrange(part, *names):
        present = [name for name in names if getattr(part, name) is not None]
        return copy(part, **{name: structure.arrange(getattr(part, name)) for name in present})

    def fold(part):
        part = arrange(part, "tension", "rest_length", "section_forces")
        if rows is None:
            return part
        one = ("displacement", "positions", "rotation")
        cut = {name: getattr(part, name)[:n_node] for name in one}
        summed = ("reactions", "reaction_moments", "load")  # a hinge passes its force to the node
        for name in (name for name in summed if hasattr(part, name)):
            value = getattr(part, name)
            cut[name] = jnp.zeros_like(value[:n_node]).at[rows.array].add(value)
        return copy(part, **cut)

    phases = []
    for phase in solution.phases:
        path = arrange(phase.path, "tension", "strain")
        if rows is not None:
            path = copy(path, displacement=path.displacement[:, :n_node])
        phases.append(copy(arrange(fold(phase), "began"), path=path))
    last = copy(fold(solution.last), fixed=fixed)
    links = tuple(group.links for group in structure.groups)
    return copy(fold(solution), phases=tuple(phases), last=last, links=links)
