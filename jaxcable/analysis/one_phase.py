"""One phase: its increments, their results, and the derivative of its end."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from ..common import status
from ..common.tree import copy_with, entry, merge_indices, select_tree, split_indices
from ..common.types import Array, Bool, Float, Int
from ..equilibrium import incremental, newton
from ..equilibrium.newton import Newton
from ..linear.sparse import FactorRecord
from ..mechanics.element_output import ElementOutput, evaluate_output
from ..mechanics.load_ramp import LoadRamp
from ..mechanics.restart_state import RestartState
from ..numerics import implicit
from ..numerics.implicit_root import with_deferred_derivative
from ..spaces import space_class
from ..spaces.translations import append_low_part, drop_low_part, has_low_part
from .phase_results import LOG_COLUMNS, Path
from .results import fields_of_element_results


class ConvergedPoints(NamedTuple):
    """The converged increments of every phase, from which derivatives can be computed later.

    Attributes:
        motions: motions of the last converged increment, [n_phase, 1, n_row, n_motion]; with
            history variables those of all increments, [n_phase, n_inc, n_row, n_motion].
        codes: status after each increment, [n_phase, n_inc].
    """

    motions: Float[Array, "n_phase n_kept n_row n_motion"]
    codes: Int[Array, "n_phase n_inc"]


class PhaseOutcome(NamedTuple):
    """Outcome of one phase; an increment is called good if it has converged.

    Attributes:
        code, stable: status so far, and whether the end of the phase is stable.
        begin: `RestartState` that its increments begin with.
        restart: `RestartState` after the last good increment; the one before the phase if none is
            good.
        point: (motion of `restart`, marks) as `bare` and `marks` of
            `implicit.attach_derivative_with_marks`.
        factor: load factor of the last good increment, 0 if there is none.
        last_output: `ElementOutput` of the last good increment, with derivatives if there is one.
        path: `Path`, results of every increment.
        log: the numbers `LOG_COLUMNS` of every increment, [n_inc, 10].
        factored: the last matrix that a sparse solve has factorised.
        points: `ConvergedPoints` of this phase; None for `Incremental`.
    """

    code: Int[Array, ""]
    stable: Bool[Array, ""]
    begin: RestartState
    restart: RestartState
    point: tuple[Float[Array, "n_row n_motion"], Float[Array, " n_row"] | None]
    factor: Float[Array, ""]
    last_output: ElementOutput | None
    path: Path
    log: Float[Array, "n_inc 10"]
    factored: FactorRecord | None
    points: ConvergedPoints | None


def run_phase(
    problem,
    before,
    steps,
    method,
    code,
    differentiate_path,
    factored,
    last_output,
    is_first,
    report,
    known,
):
    """Solve the increments of one phase; return its `PhaseOutcome`.

    Args:
        problem: nodes, groups, `RestartState` and `PhaseData`, of which `LoadRamp.build` makes the
            phase.
        before: the `RestartState` before the phase.
        steps: (number of its increments, load factors from 0 on, [1 + n_inc]). Factors above 1 are
            those of phases with more increments: nothing is done at them.
        method, code, factored, last_output, is_first, report: see `newton.solve_increments`.
        differentiate_path: whether increments have derivatives, and not only the end.
        known: `ConvergedPoints` of this phase if it has been solved before and only its derivative
            is wanted; the path and the log are then zeros. None: solve it.
    """
    ramp, (count, factors) = LoadRamp.build(*problem), steps
    begin = ramp.start
    live = (factors > 0) & (factors <= 1)
    factors = jnp.minimum(factors, 1)  # later increments repeat the end; results leave them out
    given = (factors, live), method, code
    if isinstance(method, Newton):
        found = _solve_by_newton(
            ramp, count, given, differentiate_path, factored, last_output, is_first, report, known
        )
    else:
        found = _solve_by_incremental_scheme(ramp, count, given, is_first, report)
    ramp, (x, bare, marks), xs, outputs, log, memory, last_output, factored = found
    kept = xs[-1:] if memory is None else xs
    points = ConvergedPoints(*lax.stop_gradient((kept, log[:, 0].astype(jnp.int32))))
    good, live = (log[:, 0] == status.OK) & live[1:], live[1:]
    valid, factor = _any_and_last_converged(good, count, begin.motion.dtype)
    restart, bare = _restart_after_phase(ramp, factor, (x, bare), valid, before, memory)
    path, counts = _make_path(outputs, xs[..., :3], good, good | ~live)
    motion = space_class(ramp.groups).stored_motion(jnp.where(good[:, None, None], xs, jnp.nan))
    path = copy_with(path, motion=motion)
    code, stable = log[-1, 0].astype(jnp.int32), LOG_COLUMNS.index("stable")
    if not isinstance(method, Newton):
        end, here = lax.stop_gradient((ramp.system_at(factor, memory), x))
        judged = newton.is_stable(end, here) & (code == status.OK)
        log = log.at[count - 1, stable].set(judged.astype(log.dtype))
    log = lax.stop_gradient(jnp.concatenate([log, counts.astype(log.dtype)], axis=1))
    stable = jnp.take(log[:, stable], count - 1) > 0
    return PhaseOutcome(
        *(code, stable, begin, restart, (bare, marks), factor, last_output),
        *(path, log, factored, points),
    )


def _solve_by_newton(
    ramp, count, given, differentiate_path, factored, last_output, is_first, report, known
):
    """Solve the increments by Newton's method; the end, or all of them, have derivatives.

    Arguments are those of `run_phase`; `given` is (load factors and whether the phase has them,
    method, status).

    Returns:
        The ramp; the last point as `implicit.attach_derivative_with_marks` returns it; points,
        outputs and log of all increments; history variables at the end; `ElementOutput` of the end;
        what was factored.
    """
    (factors, live), method, _ = given
    frozen = lax.stop_gradient(ramp)
    if known is None:
        found = newton.solve_increments(
            frozen, frozen.start.motion, *given, factored, last_output, is_first, report
        )
        *whole, last_output, memory, factored = found
        xs, log, outputs = jax.tree.map(lambda x: x[1:], whole)
    else:
        xs, log = _recall_increments(known, len(factors) - 1)
        memory = ramp.memory
    factors, good = factors[1:], (log[:, 0] == status.OK) & live[1:]
    valid, factor = _any_and_last_converged(good, count, factors.dtype)
    ramp = implicit.stop_gradient_unless(valid, ramp)
    x = xs[-1]  # the point stays where it was when an increment fails
    if memory is None:
        system, settings = ramp.system_at(factor), ()
        if known is None:
            settings = factored, *newton.adjoint_cg_settings(method, system, factors.dtype)
        else:
            last_output = evaluate_output(*lax.stop_gradient((system, x)))
        *point, results = implicit.attach_derivative_with_marks(
            system, x, valid, *settings, results=last_output.by_name
        )
        last_output = copy_with(last_output, by_name=results)
        if differentiate_path:
            attach = jax.vmap(lambda f, x, ok: implicit.attach_derivative(ramp.system_at(f), x, ok))
            xs = attach(factors, xs, good)
            outputs = jax.vmap(lambda f, x: _evaluate_path_output(ramp.system_at(f), x))(
                factors, xs
            )
    else:
        problem = split_indices((ramp, factors, xs, good))
        if known is None:
            ends = x, memory, last_output.by_name
            x, memory, results = with_deferred_derivative(_replay_to_end, ends, problem)
            last_output = copy_with(last_output, by_name=results)
        else:
            seen, _, memory, x = _replay_increments(ramp, factors, xs, good, True)
            last_output = _entry_of_last_converged(seen, good)
        point = x, x, None
        if differentiate_path:
            seen, xs, *_ = _replay_increments(ramp, factors, xs, good, True)
            outputs = jax.vmap(lambda one: one.increment_results)(seen)
    if known is not None:  # no results of increments are wanted
        outputs = jax.tree.map(
            lambda s: jnp.zeros((len(factors), *s.shape), s.dtype), last_output.increment_results
        )
    return ramp, point, xs, outputs, log, memory, last_output, factored


def _recall_increments(known, count):
    """Return points of all increments of a solved phase, and their log, zero but for the status.

    Args:
        known: `ConvergedPoints` of the phase.
        count: number of increments.
    """
    xs = jnp.broadcast_to(known.motions, (count, *known.motions.shape[1:]))
    columns = len(LOG_COLUMNS) - 2  # without those that `_make_path` counts
    log = jnp.zeros((count, columns), xs.dtype).at[:, 0].set(known.codes.astype(xs.dtype))
    return xs, log


def _solve_by_incremental_scheme(ramp, count, given, is_first, report):
    """Solve the increments by `Incremental`; arguments and results as of `_solve_by_newton`."""
    (factors, live), method, code = given
    increments = factors[1:], live[1:]
    xs, log = incremental.solve_increments(
        ramp, ramp.start.motion, increments, method, code, report
    )
    x, memory = xs[-1], None
    if ramp.memory is None:
        outputs = jax.vmap(lambda f, x: _evaluate_path_output(ramp.system_at(f), x))(
            factors[1:], xs
        )
    else:
        good = (log[:, 0] == status.OK) & live[1:]
        outputs, _, memory, x = _replay_increments(ramp, factors[1:], xs, good, False)
    return ramp, (x, x, None), xs, outputs, log, memory, None, None


def _any_and_last_converged(good, count, dtype):
    """Return whether any increment has converged, and the load factor of the last one that has.

    `good` says which have converged, [n_inc]; the phase has `count` increments.
    """
    n_good = jnp.sum(good)
    return n_good > 0, (n_good / count).astype(dtype)


def _evaluate_path_output(system, x):
    """Return the `ElementOutput` at motion `x` with the results that every increment keeps."""
    return evaluate_output(system, x).increment_results


def _replay_increments(ramp, factors, xs, good, converges):
    """Go again through the increments of a phase with history variables, to differentiate them.

    Every increment depends on the history variables that the increment before has committed: the
    end of the phase is no implicit function of the parameters, but every increment is one. Their
    points are known.

    Args:
        ramp: the phase, a `LoadRamp`.
        factors, xs, good: load factor and point of every increment, and whether it has converged.
        converges: whether points are equilibria, which have an implicit derivative.

    Returns:
        `ElementOutput` and points of all increments (only its `increment_results` unless
        `converges`); history variables and point at the end.
    """

    @jax.checkpoint
    def step(restart, increment):
        memory, last = restart
        factor, x, ok = increment
        system = ramp.system_at(factor, memory)
        if converges:
            seen = evaluate_output(*lax.stop_gradient((system, x)))
            x, _, _, results = implicit.attach_derivative_with_marks(
                system, x, ok, results=seen.by_name
            )
            seen = copy_with(seen, by_name=results)
        else:
            seen = evaluate_output(system, x)
        read = seen if converges else seen.increment_results
        last = jnp.where(ok, x, last)
        memory = ramp.commit_memory(system, x, seen.strains, ok, memory)
        return (memory, last), (read, x)

    start = ramp.memory, lax.stop_gradient(xs[0])
    (memory, last), (outputs, xs) = lax.scan(step, start, (factors, xs, good))
    return outputs, xs, memory, last


def _replay_to_end(problem):
    """Return last point, history variables and element results of a phase by `_replay_increments`.

    `problem` has the ramp, load factors, points and which are good, split by `split_indices`.
    """
    ramp, factors, xs, good = merge_indices(*problem)
    seen, _, memory, last = _replay_increments(ramp, factors, xs, good, True)
    return last, memory, _entry_of_last_converged(seen, good).by_name


def _entry_of_last_converged(stacked, good):
    """Return the entry of the last converged increment of a pytree of arrays [n_inc, ...].

    `good` says which increments have converged, [n_inc] bool; the first entry if none has.
    """
    return entry(stacked, jnp.maximum(jnp.sum(good), 1) - 1)


def _restart_after_phase(ramp, factor, points, valid, before, memory=None):
    """Return the `RestartState` after a phase, and its motion without derivative.

    If no increment has converged (`valid` is False), they are those `before` the phase. `factor` is
    the load factor of the last converged increment, `points` are (motion there with its derivative,
    motion without), `memory` are its history variables or None.
    """
    motion, bare = points
    after = ramp.commit(factor, drop_low_part(motion), memory).with_factors_alone(), bare
    begun = append_low_part(before.motion) if has_low_part(bare) else before.motion
    before = before.with_factors_alone(), begun
    restart, bare = select_tree(valid, after, before)
    return restart.with_loads(ramp.start.loads), bare


def _make_path(outputs, moved, good, finite):
    """Return the `Path` of a phase, and counts of slack elements and nodes, [n_inc, 2].

    Args:
        outputs: `ElementOutput.increment_results` of every increment.
        moved: displacements from the initial nodes, [n_inc, n_row, 3].
        good: which increments have converged, [n_inc]; the counts of others are -1.
        finite: which increments have results, [n_inc]; those of others are NaN.
    """

    def known(x):
        return x * jnp.where(finite, 1.0, jnp.nan).astype(x.dtype).reshape(-1, *(1,) * (x.ndim - 1))

    values = {"displacement": moved, **fields_of_element_results(outputs.by_name)}
    path = Path(*(None,) * len(dataclasses.fields(Path)))
    path = copy_with(path, **jax.tree.map(known, values))
    return path, jnp.where(good[:, None], jnp.stack([outputs.n_slack, outputs.n_loose], axis=1), -1)
