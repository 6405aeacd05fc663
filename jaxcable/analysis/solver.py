"""`solve`: the phases of an analysis one after the other, each in increments by `lax.scan`."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common import status
from ..common.compilation import jit_program
from ..common.progress import Increment, as_listener, report_progress
from ..common.tree import copy_with, merge_indices, pytree
from ..common.types import Array, Bool, Int
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..linear.sparse import FactoredMatrix
from ..mechanics.element_output import ElementOutput, evaluate_output
from ..mechanics.restart_state import RestartState, with_loads_until
from ..model import plausibility
from ..model.structure import Structure
from ..numerics import implicit, scaled
from ..numerics.single_kernel import as_single_kernel
from .one_phase import run_phase
from .phase_results import PhaseResult, PhaseResults
from .phases import Phase
from .preparation import cast_to_dtype_of, complete_input, prepare, traced_input_status
from .results import map_element_fields, result_fields
from .solution import Solution, State
from .states import LastConvergedIncrement, arrange_solution, make_state, system_at_last


def solve(
    structure: Structure,
    phases: Phase | Sequence[Phase] | None = None,
    method: Newton | Incremental | None = None,
    *,
    start: Solution | State | None = None,
    differentiate_path: bool = False,
    progress: bool | Callable[[Increment], object] | None = None,
) -> Solution:
    """Analyse a structure through its phases.

    A pure function of pytrees: jit, vmap, grad, jvp, jacfwd and hessian work on it. Numbers are
    traced, so that another value does not recompile; another topology or number of increments does.

    Args:
        structure: `Structure`.
        phases: list of `Phase`, or one.
        method: `Newton` (default) or `Incremental`.

    Options:
        start: `Solution` (or its `.last`) of the same structure to continue from; default: the
            initial structure. A failed `Solution` keeps its status and goes nowhere; its `.last`
            can be continued from.
        differentiate_path: with `Newton`, also give derivatives of `phases[k].path.displacement`
            and of the forces on the path (one adjoint system per increment). By default these
            derivatives are NaN; all other results are differentiable in any case.
        progress: True writes a line to stderr every half second during long work (increment,
            iterations, residual); a function is called with a `progress.Increment` after each
            increment. It is compiled in: another function compiles again. Default: nothing.

    Returns:
        `Solution`; look at its `status`, or call `raise_if_failed`.

    Raises:
        ValueError: wrong input, naming argument, index and rule.

    Warns:
        InputWarning: input that is legal and most likely not meant.
        UnstableWarning: a phase ends in an equilibrium that is unstable. There is no warning inside
            of jit, vmap and grad, nor under moments and following loads: look at `stable`.

    Example:
        Two cables, prestressed so that 600 N hang in a 3-4-5 triangle, and the stiffness of the
        node by a derivative (exact: 2 (EA/L0 0.6^2 + N/l 0.8^2) = 14600 N/m):

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
    listen = as_listener(progress)
    task = prepare(structure, phases, method, start, to_end=True)
    core = task.without_indices, task.arrays, task.method, task.code
    static = {"differentiate_path": differentiate_path, "listen": listen, "bundles": task.bundles}
    solution = _analyse(*core, **static, size=task.n_unknown)
    if task.warns_if_unstable:  # only then: the check waits until the numbers have been computed
        plausibility.warn_if_unstable(solution)
    return arrange_solution(structure, solution, task)


@functools.partial(jit_program, static=("differentiate_path", "listen", "bundles", "alone"))
def _analyse(without_indices, arrays, method, code, differentiate_path, listen, bundles, alone):
    """Run the analysis as one compiled program; results of elements are lists over groups.

    Args:
        without_indices, arrays, method, code, bundles: as in `PreparedAnalysis`.
        differentiate_path: as in `solve`.
        listen: function that is called after each increment, or None.
        alone: whether no other program contains this one (set by `jit_program`).
    """
    through = functools.partial(_scan_phases, differentiate_path, listen, bundles)
    pattern = without_indices[-1].dof_map.pattern
    # a program of its own hands over as many results as there are; one function gains nothing
    whole = listen is None and not alone
    if whole and pattern is not None and pattern.solver.fused:
        through = as_single_kernel(through)
    return through(without_indices, arrays, method, code)


def analyse_within_program(without_indices, arrays, method, code, bundles):
    """Run a `PreparedAnalysis` within another program, with derivatives of ends of phases."""
    given = {"differentiate_path": False, "listen": None, "bundles": bundles}
    return _analyse(without_indices, arrays, method, code, **given, size=0)


def _scan_phases(differentiate_path, listen, bundles, without_indices, arrays, method, code):
    """Solve the phases one after the other in one `lax.scan`; arguments are those of `_analyse`."""
    parameters = merge_indices(without_indices, arrays)
    structure_ok, codes = traced_input_status(parameters, method)
    nodes, groups, restart, schedule = complete_input(parameters, bundles)
    # unsound input has no state: block its gradient so that a batch is not polluted with NaN
    sound = _is_tree_finite((nodes, groups)) & structure_ok
    frame = implicit.stop_gradient_unless(sound, (nodes, groups))
    loads, counts = restart.loads, jnp.asarray(schedule.increments, jnp.int32)
    factors = jnp.asarray(schedule.factors, nodes.dtype)
    teller = None if listen is None else _progress_reporter(listen, len(schedule))
    touched = implicit.gradient_probe(parameters)

    def phase(run, scanned):
        arrays_of_phase, verdict, *steps = scanned
        data = schedule.unpack_phase(arrays_of_phase)
        code = status.first_failure(run.code, verdict)
        before = with_loads_until(run.restart, loads, data.number)
        sane = sound & _is_tree_finite((before, data)) & (code == status.OK)
        problem = implicit.stop_gradient_unless(sane, (nodes, groups, before, data))
        factored = run.factored if schedule.changes is None else linear.without_factor(run.factored)
        tell = None if teller is None else functools.partial(teller, data.number, steps[0])
        fresh = run.reached.number < 0
        given = method, code, differentiate_path, factored, run.last_output, fresh, tell
        done = run_phase(problem, before, steps, *given)
        code, restart = done.code, done.restart
        path = copy_with(done.path, displacement=done.path.displacement[:, : schedule.n_node])
        reached = run.reached.updated(data, done.factor)
        end = make_state(frame, restart, done.point, reached, schedule, done.last_output)
        end = _nan_results_unless(sound, end, touched)
        moved = end.displacement - done.begin.motion[: schedule.n_node, :3]
        result = _nan_results_unless(code == status.OK, copy_with(end, displacement=moved), touched)
        began = [state.memory for state in done.begin.states]
        began = None if all(memory is None for memory in began) else began
        given = {"status": None, "stable": None, "path": None, "began": began}
        result = PhaseResult(**given, **result_fields(result))
        left = copy_with(restart, loads=None)
        run = _LoopState(code, done.stable, left, end, done.factored, reached, done.last_output)
        return run, (result, path, done.log)

    start, reached = (
        copy_with(restart, loads=None),
        LastConvergedIncrement.before_first(schedule, nodes.dtype),
    )
    end = _zeros_like_result(
        lambda: make_state(frame, restart, (restart.motion, None), reached, schedule)
    )
    factored = last_output = None
    if isinstance(method, Newton):
        factored = linear.no_factored_matrix(schedule.dof_map.pattern, nodes.dtype)
        last_output = _zeros_like_result(
            lambda: evaluate_output(
                system_at_last(frame, restart, reached, schedule), restart.motion
            )
        )
    run = _LoopState(code, jnp.zeros((), bool), start, end, factored, reached, last_output)
    run, (ends, paths, log) = lax.scan(
        phase, run, (schedule.scanned_arrays, codes, counts, factors)
    )
    if not differentiate_path and isinstance(method, Newton):
        paths = implicit.with_nan_derivative(paths, touched)
    known = [stack.up_to_phase(run.reached.number) for stack in _loads_on_groups(parameters)]
    states = bundles.split(run.restart.states)
    restart = copy_with(
        run.restart, states=states, loads=[jax.tree.leaves(stack.load) for stack in known]
    )
    ends, paths = _split_bundles(bundles, ends, axis=1), _split_bundles(bundles, paths, axis=2)
    watched = isinstance(method, Newton) and method.watch
    solution = Solution(
        status=run.code,
        stable=run.stable,
        last=copy_with(_split_bundles(bundles, run.end), restart=restart),
        phases=PhaseResults(ends, paths, log, schedule.increments, watched),
        **implicit.nan_unless_probed(run.code == status.OK, result_fields(run.end), touched),
    )
    return _split_bundles(bundles, solution)


def _zeros_like_result(function):
    """Return zeros in the shape of the result of ``function()``, which is not computed."""
    return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(function))


def _loads_on_groups(parameters):
    """Return all element loads, of `start` and the phases, on groups as the user has them."""
    nodes, _, restart, schedule = parameters
    return cast_to_dtype_of(nodes, [*(() if restart is None else restart.loads), *schedule.loads])


def _split_bundles(bundles, part, axis=0):
    """Split results of bundles (groups evaluated as one) into those of the user's groups.

    `part` are the results, `axis` is that of the elements in their arrays.
    """
    if bundles.are_groups:
        return part
    return map_element_fields(part, lambda values: bundles.split(values, axis))


@pytree
class _LoopState:
    """What the loop over the phases hands from one phase to the next.

    Attributes:
        code, stable: status so far, and whether the end of the last phase is stable.
        restart: `RestartState`, without the loads, which do not change.
        end: the `State` that belongs to `restart`.
        factored: the last matrix that a sparse solve has factorised, see
            `linear.solve_reusing_factor`.
        reached: `states.LastConvergedIncrement`.
        last_output: `ElementOutput` of the last converged increment.
    """

    code: Int[Array, ""]
    stable: Bool[Array, ""]
    restart: RestartState
    end: State
    factored: FactoredMatrix | None
    reached: LastConvergedIncrement
    last_output: ElementOutput | None


def _nan_results_unless(ok, end, touched):
    """Return the `State` `end` with NaN results unless `ok`.

    `touched` is a zero that knows whether a derivative is taken (`implicit.gradient_probe`).
    """
    return copy_with(end, **implicit.nan_unless_probed(ok, result_fields(end), touched))


def _progress_reporter(listen, phases):
    """Return the function that `newton.solve_increments` calls, which tells `listen`."""

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
        report_progress(listen, Increment, {"phases": phases}, lax.stop_gradient(traced))

    return news


def _is_tree_finite(tree):
    """Return whether every float in a pytree is finite, scalar bool."""
    floats = [x for x in jax.tree.leaves(tree) if jnp.issubdtype(x.dtype, jnp.floating)]
    # one test of the joined array compiles faster than one for each of many small arrays
    return jnp.all(jnp.isfinite(jnp.concatenate([x.reshape(-1) for x in floats])))
