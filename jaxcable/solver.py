"""`solve`: the phases of an analysis one after the other, each in increments by `lax.scan`."""

import functools

import jax
import jax.numpy as jnp
from jax import lax

from . import equilibrium, implicit, incremental, plausibility, status
from ._tree import copy, emptied, fill, refrozen
from .equilibrium import Newton
from .preparation import may_warn, prepare, ready, verdicts
from .progress import Increment, listener, tell
from .ramp import Ramp, dead_load
from .results import arranged, row_of, state_of
from .solution import PER_PHASE, Path, PhaseResult, Solution


def solve(structure, phases=None, method=None, start=None, differentiate_path=False, progress=None):
    """Analyse a structure through its phases.

    A pure function of pytrees: jit, vmap, grad, jvp, jacfwd and hessian work on it. Numbers are
    traced, so that changing one does not recompile; topology and the number of increments are not.

    Args:
        structure: `Structure`.
        phases: list of `Phase`.
        method: `Newton` (default) or `Incremental`.
        start: `Solution` (or its `.last`) of the same structure to continue from.
        differentiate_path: with Newton, also give derivatives of `phases[k].path.displacement` and
            of the forces there (one adjoint system per increment); without it those derivatives are
            NaN. All else is differentiable in any case.

        progress: True to have long work say on stderr where it is, a line every half second
            (increment, iterations, residual); or a function of a `progress.Increment`, which is
            called after each. It is compiled in: another function compiles again.

    Returns:
        `Solution`; look at its `status`, or call `raise_if_failed`.

    Raises:
        ValueError: wrong input, naming argument, index and rule.

    Warns:
        InputWarning: input that is legal and most likely not meant.
        UnstableWarning: a phase ends in an equilibrium that is unstable. Inside of jit, vmap and
            grad nothing is said, nor under moments and following loads: look at `stable`.

    Example:
        Two cables, prestressed so that 600 N hang in a 3-4-5 triangle, and how that node gives way
        (tangent stiffness: 2 (EA/L0 0.6^2 + N/l 0.8^2) = 14600 N/m):

        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> def analyse(load):
        ...     loads = jc.NodalLoads([1], load * jnp.array([0.0, 0.0, -1.0]))
        ...     return jc.solve(structure, jc.Phase(pretension=500.0, loads=loads))
        >>> solution = analyse(600.0)
        >>> jc.describe(solution.status)
        'converged'
        >>> print(jnp.round(solution.tension, 6))  # N
        [500. 500.]
        >>> rate = jax.grad(lambda load: analyse(load).displacement[1, 2])(600.0)
        >>> print(f"{1 / rate:.1f} N/m")
        -14600.0 N/m
    """
    listen = listener(progress)
    thawed, arrays, method, code, fixed = prepare(structure, phases, method, start)
    solution = _analyse(thawed, arrays, method, code, differentiate_path, listen)
    if may_warn(*thawed[1:]):  # or else nobody has to wait for the numbers
        plausibility.stability(solution)
    last = copy(solution.last, carry=refrozen(solution.last.carry, arrays))
    solution = copy(solution, last=last)
    return arranged(structure, solution, fixed)


@functools.partial(jax.jit, static_argnames=("differentiate_path", "listen"))
def _analyse(thawed, arrays, method, code, differentiate_path, listen=None):
    """The compiled core: the phases in turn; results per element are lists, one item per group."""
    parameters = fill(thawed, arrays)
    own, codes = verdicts(parameters, method)
    nodes, groups, carry, data = ready(parameters)
    dtype = nodes.dtype
    # a state of numbers that are none is none: its NaN must not reach what a batch shares
    sound = _finite((nodes, groups)) & own
    frame = implicit.gate(sound, (nodes, groups))
    reached = (
        jnp.int32(-1),
        jnp.zeros((), dtype),
        (data[0].freedoms_before or data[0].freedoms).held,
    )
    results, memory = [], None
    for number, phase in enumerate(data):
        problem = (nodes, groups, carry, phase)
        if phase.other_pattern:
            memory = None  # of other matrices
        code = status.first_failure(code, codes[number])
        teller = None if listen is None else _teller(listen, number, data)
        code, stable, carry, load, factor, path, memory = _run_phase(
            problem, method, code, differentiate_path, memory, teller
        )
        if not differentiate_path and isinstance(method, Newton):
            names = ("displacement", "tension", "peak_tension", "strain")
            rows = {n: getattr(path, n) for n in names if getattr(path, n) is not None}
            path = copy(path, **implicit.undifferentiated(rows, parameters))
        now = (jnp.int32(number), factor, phase.freedoms.held)
        reached = jax.tree.map(lambda a, b, f=factor: jnp.where(f > 0, a, b), now, reached)
        end = state_of(frame, carry, load, *reached)
        began = problem[2].motion[:, :3] if end.rotation is not None else problem[2].motion
        own = copy(end, displacement=end.displacement - began)
        values = _unless(code == status.OK, own, PER_PHASE, parameters)
        results.append(
            PhaseResult(status=code, stable=stable, path=path, began=_plastic(problem[2]), **values)
        )
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
    return Solution(status=code, stable=stable, last=last, phases=tuple(results), **final)


def _unless(ok, end, names, parameters):
    """Results of a state by name, NaN unless `ok`."""
    values = [getattr(end, name) for name in names]
    return dict(zip(names, implicit.nan_unless(ok, values, parameters), strict=True))


def _teller(listen, number, data):
    """A function that tells of the increments of a phase."""
    count = data[number].increments
    known = {"phase": number + 1, "phases": len(data), "count": count}

    def news(factor, outcome):
        relative = outcome.residual / jnp.where(outcome.scale > 0, outcome.scale, 1.0)
        traced = {
            "number": jnp.round(factor * count).astype(jnp.int32),
            "load_factor": factor,
            "iterations": outcome.steps,
            "residual": outcome.residual,
            "relative_residual": relative,
            "status": outcome.code,
        }
        tell(listen, Increment, known, lax.stop_gradient(traced))

    return news


def _run_phase(problem, method, code, differentiate_path, memory, teller):
    """One phase: status, stability, carry, load at its end, load factor reached, path, memory."""
    carry, data = problem[2:]
    dtype, n_inc = carry.motion.dtype, data.increments
    factors = jnp.arange(1, n_inc + 1, dtype=dtype) / n_inc
    if isinstance(method, Newton):
        ramp = Ramp.build(*lax.stop_gradient(problem))
        start = ramp.at(factors[0]).unknowns(ramp.begin.motion)
        outcome, memory = equilibrium.march(ramp, start, factors, method, code, memory, teller)
    else:
        ramp = Ramp.build(*implicit.gate(_finite(problem) & (code == status.OK), problem))
        start = ramp.at(factors[0]).unknowns(ramp.begin.motion)
        outcome = incremental.march(ramp, start, factors, method, code, teller)
    good = outcome.code == status.OK
    n_good = jnp.sum(good)
    valid, factor = n_good > 0, (n_good / n_inc).astype(dtype)
    xs, x = outcome.x, outcome.x[-1]  # the point stays where it was when an increment fails
    converges = isinstance(method, Newton)
    if converges:
        ramp = Ramp.build(*implicit.gate(valid, problem))
    plastic = None
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
        rows = jax.vmap(lambda f, x: row_of(ramp, ramp.at(f), x))(factors, xs)
    path = _path(rows, factors, outcome, good)
    stable = outcome.stable[-1]
    if converges and method.watch:
        path = copy(path, stable=outcome.stable)
    elif not (converges or ramp.at(factor).convex):
        end = lax.stop_gradient(ramp.at(factor, plastic))
        stable = equilibrium.is_stable(end, lax.stop_gradient(x)) & good[-1]
    return outcome.code[-1], stable, carry, load, factor, path, memory


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
        return (ramp.settle(system, x, code, plastic), last), row_of(ramp, system, x)

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


def _path(rows, factors, outcome, good):
    """The increments of a phase; NaN where they are not good."""
    displacement, tension, peak, n_slack, n_loose, strain = rows
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
        peak_tension=[None if p is None else p * nan[:, None] for p in peak],
    )


def _finite(tree):
    """Whether every float in `tree` is finite."""
    floats = [x for x in jax.tree.leaves(tree) if jnp.issubdtype(x.dtype, jnp.floating)]
    return jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in floats]))
