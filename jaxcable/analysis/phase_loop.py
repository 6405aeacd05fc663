"""The compiled core of an analysis: its phases one after the other in one `lax.scan`."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common import status
from ..common.progress import report_increment
from ..common.tree import cast_floats, copy_with, entry, merge_indices, pytree, select_tree
from ..common.types import Array, Bool, Int
from ..equilibrium.newton import Newton
from ..linear.sparse import FactorRecord
from ..mechanics.element_output import ElementOutput, evaluate_output
from ..mechanics.restart_state import RestartState, with_loads_until
from ..numerics import implicit, scaled
from ..numerics.single_kernel import as_single_kernel
from ..programs.program_calls import as_program
from .one_phase import run_phase
from .phase_results import PhaseResult, PhaseResults
from .preparation import complete_input, traced_input_status
from .results import map_element_fields, result_fields
from .solution import Solution
from .states import LastConvergedIncrement, make_state, system_at_last_converged


@functools.partial(as_program, static=("differentiate_path", "listen", "bundles", "alone"))
def analyse(without_indices, arrays, method, code, differentiate_path, listen, bundles, alone):
    """Run the analysis as one compiled program.

    Args:
        without_indices, arrays, method, code, bundles: as in `PreparedAnalysis`.
        differentiate_path: as in `solve`.
        listen: function that is called after each increment, or None.
        alone: whether no other program contains this one (set by `as_program`).

    Returns:
        `Solution`, whose results of elements are lists over groups, and `ConvergedPoints`.
    """
    through = functools.partial(_scan_phases, differentiate_path, listen, bundles)
    pattern = without_indices[-1].dof_map.pattern
    # a program of its own hands over as many results as there are; one function gains nothing
    whole = listen is None and not alone
    if whole and pattern is not None and pattern.solver.fused:
        through = as_single_kernel(through)
    return through(without_indices, arrays, method, code)


def recall_solution(without_indices, arrays, method, code, points, bundles):
    """Return the results of a solved analysis, to be differentiated: no increment is solved again.

    Args:
        without_indices, arrays, method, code, bundles: as for `analyse`.
        points: `ConvergedPoints` of the analysis.

    Returns:
        `Solution` with derivatives of the ends of phases; paths and log are zeros.
    """
    return _scan_phases(False, None, bundles, without_indices, arrays, method, code, points)[0]


def _scan_phases(
    differentiate_path, listen, bundles, without_indices, arrays, method, code, points=None
):
    """Solve the phases one after the other in one `lax.scan`: return `Solution`, `ConvergedPoints`.

    Arguments are those of `analyse`. If `points`, the `ConvergedPoints` of an analysis, are given,
    nothing is solved: only derivatives are wanted, and paths and logs are zeros.
    """
    parameters = merge_indices(without_indices, arrays)
    structure_ok, codes = traced_input_status(parameters, method)
    nodes, groups, restart, schedule = complete_input(parameters, bundles)
    # unsound input has no state: block its gradient so that a batch is not polluted with NaN
    sound = _is_tree_finite((nodes, groups)) & structure_ok
    frame = implicit.stop_gradient_unless(sound, (nodes, groups))
    loads, (counts, factors) = restart.loads, schedule.steps
    counts, factors = jnp.asarray(counts, jnp.int32), jnp.asarray(factors, nodes.dtype)
    teller = None if listen is None else _increment_reporter(listen, len(schedule))
    touched = implicit.gradient_probe(parameters)

    def phase(run, scanned):
        data, verdict, *steps, known = scanned
        data = schedule.complete(data)
        code = status.first_failure(run.code, verdict)
        before = with_loads_until(run.restart, loads, data.number)
        sane = sound & _is_tree_finite((before, data)) & (code == status.OK)
        problem = implicit.stop_gradient_unless(sane, (nodes, groups, before, data))
        same = schedule.phases.dof_map is None
        factored = run.factored if same else linear.with_unusable_factor(run.factored)
        tell = None if teller is None else functools.partial(teller, data.number, steps[0])
        fresh = run.reached.number < 0
        given = method, code, differentiate_path, factored, run.last_output, fresh, tell, known
        done = run_phase(problem, before, steps, *given)
        code, restart = done.code, done.restart
        path = copy_with(done.path, displacement=done.path.displacement[:, : schedule.n_node])
        reached = run.reached.updated(data, done.factor)
        end = make_state(frame, restart, done.point, reached, schedule, done.last_output)
        begin = done.begin.motion[: schedule.n_node, :3], [s.memory for s in done.begin.states]
        seen = None if run.last_output is None else lax.stop_gradient(done.last_output)
        after = _LoopState(
            *(code, done.stable, restart.with_factors_alone(), done.factored, reached, seen)
        )
        return after, (end, code, begin, path, done.log, done.points)

    evaluates = isinstance(method, Newton) and points is None
    run = _state_before_first_phase(frame, restart, schedule, code, evaluates)
    if points is not None:  # else the derivative needs all intermediate results of a phase
        phase = jax.checkpoint(phase, prevent_cse=False)
    run, (ends, codes, begins, paths, log, points) = lax.scan(
        phase, run, (schedule.phases, codes, counts, factors, points)
    )
    # of the last phase with a converged increment; before the first one there is no derivative
    end = entry(ends, jnp.maximum(run.reached.number, 0))
    fresh = copy_with(end, **implicit.with_nan_derivative(result_fields(end), touched))
    last = _nan_results_unless(sound, select_tree(run.reached.number >= 0, end, fresh), touched)
    moved_before, memories = begins
    ends = _phase_results(ends, memories, sound & (codes == status.OK), touched)
    if not differentiate_path and isinstance(method, Newton):
        paths = implicit.with_nan_derivative(paths, touched)
    known = [stack.up_to_phase(run.reached.number) for stack in _loads_on_groups(parameters)]
    pairs = zip(run.restart.loads, known, strict=True)
    loads = [copy_with(own, load=jax.tree.leaves(stack.load)) for own, stack in pairs]
    restart = copy_with(run.restart, states=bundles.split(run.restart.states), loads=loads)
    ends, paths = _split_bundles(bundles, ends, axis=1), _split_bundles(bundles, paths, axis=2)
    watched = isinstance(method, Newton) and method.watch
    solution = Solution(
        status=run.code,
        stable=run.stable,
        last=copy_with(_split_bundles(bundles, last), restart=restart),
        phases=PhaseResults(ends, moved_before, paths, log, schedule.increments, watched),
        **implicit.nan_unless_probed(sound & (run.code == status.OK), result_fields(end), touched),
    )
    return _split_bundles(bundles, solution), points


def _state_before_first_phase(frame, restart, schedule, code, evaluates):
    """Return the `_LoopState` with which the loop over the phases begins.

    `frame` is (nodes, groups); `evaluates` says whether factors and outputs of elements are handed
    from phase to phase.
    """
    reached = LastConvergedIncrement.before_first_increment(schedule, frame[0].dtype)
    factored = last_output = None
    if evaluates:
        factored = linear.no_factored_matrix(schedule.dof_map.pattern, frame[0].dtype)
        last_output = _zeros_like_result(
            lambda: evaluate_output(
                system_at_last_converged(frame, restart, reached, schedule), restart.motion
            )
        )
    start = restart.with_factors_alone()
    return _LoopState(code, jnp.zeros((), bool), start, factored, reached, last_output)


def _zeros_like_result(function):
    """Return a pytree of zeros in shapes and dtypes of ``function()``, which is not evaluated."""
    return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(function))


def _loads_on_groups(parameters):
    """Return a list of all element loads, of `start` and the phases, on the user's groups.

    `parameters` are (nodes, groups, `RestartState` or None, `Schedule`).
    """
    nodes, _, restart, schedule = parameters
    loads = [*(() if restart is None else restart.loads), *schedule.loads]
    return cast_floats(loads, jnp.asarray(nodes).dtype)


def _split_bundles(bundles, part, axis=0):
    """Split results of bundles (groups evaluated as one) into those of the user's groups.

    `part` are the results, `axis` is that of the elements in their arrays.
    """
    if bundles.are_groups:
        return part
    return map_element_fields(part, lambda values: bundles.split(values, axis))


@pytree
class _LoopState:
    """State of the loop over the phases between two phases.

    Attributes:
        code, stable: status so far, and whether the end of the last phase is stable.
        restart: `RestartState`, with the factors of its loads alone.
        factored: the last matrix that a sparse solve has factorised, see
            `linear.solve_reusing_factor`.
        reached: `states.LastConvergedIncrement`.
        last_output: `ElementOutput` of the last converged increment, without derivatives.
    """

    code: Int[Array, ""]
    stable: Bool[Array, ""]
    restart: RestartState
    factored: FactorRecord | None
    reached: LastConvergedIncrement
    last_output: ElementOutput | None


def _phase_results(ends, memories, ok, touched):
    """Return the results of all phases, a `PhaseResult` without path; NaN in phases not `ok`.

    Args:
        ends: the `State` at the end of each phase, stacked.
        memories: history variables where each begins, an item for each group.
        ok: whether it and all before it have converged, [n_phase] bool.
        touched: as for `_nan_results_unless`.
    """
    results = result_fields(_nan_results_unless(ok, ends, touched))
    began = None if all(memory is None for memory in memories) else memories
    return PhaseResult(status=None, stable=None, path=None, began=began, **results)


def _nan_results_unless(ok, end, touched):
    """Return the `State` `end` with NaN results unless `ok`, a scalar or [n_phase] of all phases.

    `touched` is a zero that knows whether a derivative is taken (`implicit.gradient_probe`).
    """
    return copy_with(end, **implicit.nan_unless_probed(ok, result_fields(end), touched))


def _increment_reporter(listen, phases):
    """Return the function that `run_phase` calls after each increment, which reports to `listen`.

    It takes (phase, number of its increments, load factor, `IncrementOutcome`); `phases` is the
    number of phases.
    """

    def news(number, count, factor, outcome):
        traced = {
            "phase": number + 1,
            "count": count,
            "number": jnp.round(factor * count).astype(jnp.int32),
            "load_factor": factor,
            "iterations": outcome.steps,
            "residual": outcome.residual,
            "relative_residual": scaled.relative_residual(outcome.residual, outcome.scale),
            "status": outcome.code,
        }
        report_increment(listen, phases, lax.stop_gradient(traced))

    return news


def _is_tree_finite(tree):
    """Return whether every float in a pytree is finite, scalar bool."""
    floats = [x for x in jax.tree.leaves(tree) if jnp.issubdtype(x.dtype, jnp.floating)]
    # one test of the joined array compiles faster than one for each of many small arrays
    return jnp.all(jnp.isfinite(jnp.concatenate([x.reshape(-1) for x in floats])))
