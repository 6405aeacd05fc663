"""`solve`: the phases of an analysis one after the other, each in increments by `lax.scan`."""

import functools

import jax
import jax.numpy as jnp
from jax import lax

from . import equilibrium, implicit, incremental, status
from ._tree import Indices, copy, fill, thaw
from .assembly import System
from .equilibrium import Newton
from .incremental import Incremental
from .loads import NodalLoads, as_list
from .phases import Phase
from .ramp import Carry, PhaseData, Ramp, total_load
from .solution import Path, PhaseResult, Solution, State
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
    carry, code, fixed = _begin(structure, start)

    sets, data = [fixed], []
    for phase in phases:
        if phase.supports is not None:
            fixed = Indices(structure.fixed(phase.supports))
        loads = as_list(phase.loads)
        for load in loads:
            load.check(structure)
        data.append(
            PhaseData(
                inputs=phase.inputs(structure),
                nodal_loads=[load for load in loads if isinstance(load, NodalLoads)],
                element_loads=[load for load in loads if not isinstance(load, NodalLoads)],
                freedoms=number_freedoms(fixed),
                freedoms_before=None if fixed == sets[-1] else number_freedoms(sets[-1]),
                increments=int(phase.increments),
            )
        )
        sets.append(fixed)
    thawed, arrays = thaw((structure.nodes, structure.groups, carry, data))
    solution = _analyse(thawed, arrays, method, code, differentiate_path)
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
        states = [group.start(nodes[group.links]) for group in groups]
        carry = Carry(jnp.zeros_like(nodes), states, jnp.zeros_like(nodes), [])
    # a state of numbers that are not finite is none: its NaN must not reach what a batch shares
    sound = _finite((nodes, groups))
    frame = implicit.gate(sound, (nodes, groups))
    reached = (
        jnp.int32(-1),
        jnp.zeros((), dtype),
        (data[0].freedoms_before or data[0].freedoms).fixed,
    )
    results = []
    for number, phase in enumerate(data):
        problem = (nodes, groups, carry, phase)
        code, carry, load, factor, path = _run_phase(problem, method, code, differentiate_path)
        if not differentiate_path and isinstance(method, Newton):
            path = copy(
                path,
                displacement=implicit.undifferentiated(path.displacement, parameters),
                tension=implicit.undifferentiated(path.tension, parameters),
            )
        now = (jnp.int32(number), factor, phase.freedoms.fixed)
        reached = jax.tree.map(lambda a, b, f=factor: jnp.where(f > 0, a, b), now, reached)
        end = _state(frame, carry, load, *reached)
        began = problem[2].displacement
        values = (
            end.displacement - began,
            end.positions,
            end.tension,
            end.rest_length,
            end.reactions,
        )
        ok = code == status.OK
        results.append(PhaseResult(code, *implicit.nan_unless(ok, values, parameters), path))
    names = ("displacement", "positions", "tension", "rest_length", "reactions", "load")
    values = [getattr(end, name) for name in names]
    last = dict(zip(names, implicit.nan_unless(sound, values, parameters), strict=True))
    final = implicit.nan_unless(code == status.OK, values, parameters)
    return Solution(code, *final, copy(end, carry=carry, **last), tuple(results))


def _run_phase(problem, method, code, differentiate_path):
    """One phase: status, carry, load at its end, load factor reached and path."""
    carry, data = problem[2:]
    dtype, n_inc = carry.displacement.dtype, data.increments
    factors = jnp.arange(1, n_inc + 1, dtype=dtype) / n_inc
    if isinstance(method, Newton):
        ramp = Ramp.build(*lax.stop_gradient(problem))
        start = ramp.at(factors[0]).unknowns(ramp.begin.displacement)
        outcome = equilibrium.march(ramp, start, factors, method, code)
    else:
        ramp = Ramp.build(*implicit.gate(_finite(problem), problem))
        start = ramp.at(factors[0]).unknowns(ramp.begin.displacement)
        outcome = incremental.march(ramp, start, factors, method, code)
    good = outcome.code == status.OK
    n_good = jnp.sum(good)
    valid, factor = n_good > 0, (n_good / n_inc).astype(dtype)
    xs, x = outcome.x, outcome.x[-1]  # unknowns stay where they were when an increment fails
    if isinstance(method, Newton):
        ramp = Ramp.build(*implicit.gate(valid, problem))
        x = implicit.attach(ramp.at(factor), x, valid)
        if differentiate_path:
            attach = jax.vmap(lambda f, x, ok: implicit.attach(ramp.at(f), x, ok))
            xs = attach(factors, xs, good)
    carry, load = _end(ramp, factor, x, valid, problem)
    path = _path(ramp, factors, xs, outcome, good)
    return outcome.code[-1], carry, load, factor, path


def _end(ramp, factor, x, valid, problem):
    """Carry and load at the end of a phase; those before it if it has no good increment."""
    nodes, groups, before, data = problem
    system = ramp.at(factor)
    after = ramp.leave(factor, system.displacement(x))
    nothing = [
        (jax.tree.map(jnp.zeros_like, load), jnp.zeros_like(factor)) for load in data.element_loads
    ]
    before = copy(before, element_loads=[*before.element_loads, *nothing])
    carry = jax.tree.map(lambda new, old: jnp.where(valid, new, old), after, before)
    return carry, jnp.where(valid, system.load, total_load(nodes, groups, before))


def _state(frame, carry, load, number, factor, fixed):
    """The `State` that a carry stands for."""
    nodes, groups = frame
    displacement = carry.displacement
    freedoms = Freedoms(free=None, source=None, number=None, fixed=fixed)
    system = System(nodes, groups, carry.states, load, None, freedoms)
    return State(
        displacement=displacement,
        positions=nodes + displacement,
        tension=system.tensions(displacement),
        rest_length=[state.rest_length for state in carry.states],
        reactions=system.reactions(displacement),
        load=load,
        phase=number,
        load_factor=factor,
        carry=None,
        fixed=None,
    )


def _path(ramp, factors, xs, outcome, good):
    """The increments of a phase; NaN where they are not good."""

    def row(factor, x):
        system = ramp.at(factor)
        displacement = system.displacement(x)
        n_slack = sum(jnp.sum(slack) for slack in system.slack(displacement))
        n_loose = jnp.sum(system.loose_nodes(displacement))
        moved = displacement - ramp.begin.displacement
        return moved, system.tensions(displacement), n_slack, n_loose

    displacement, tension, n_slack, n_loose = jax.vmap(row)(factors, xs)
    nan = jnp.where(good, 1.0, jnp.nan).astype(factors.dtype)
    return Path(
        load_factor=factors,
        displacement=displacement * nan[:, None, None],
        tension=[t * nan[:, None] for t in tension],
        status=outcome.code,
        iterations=outcome.steps,
        residual=outcome.residual,
        relative_residual=outcome.residual / jnp.where(outcome.scale > 0, outcome.scale, 1.0),
        n_slack=jnp.where(good, n_slack, -1).astype(jnp.int32),
        n_loose=jnp.where(good, n_loose, -1).astype(jnp.int32),
        equilibrated=outcome.equilibrated,
    )


def _finite(tree):
    """Whether every float in `tree` is finite."""
    floats = [x for x in jax.tree.leaves(tree) if jnp.issubdtype(x.dtype, jnp.floating)]
    return jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in floats]))


def _arrange(structure, solution, fixed):
    """Put lists with an item per group into the shape of the structure's elements."""

    def arrange(part, *names):
        return copy(part, **{name: structure.arrange(getattr(part, name)) for name in names})

    phases = tuple(
        copy(arrange(phase, "tension", "rest_length"), path=arrange(phase.path, "tension"))
        for phase in solution.phases
    )
    last = copy(arrange(solution.last, "tension", "rest_length"), fixed=fixed)
    links = tuple(group.links for group in structure.groups)
    solution = arrange(solution, "tension", "rest_length")
    return copy(solution, phases=phases, last=last, links=links)
