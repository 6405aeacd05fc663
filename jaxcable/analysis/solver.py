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
from ..mechanics.carry import Carry, knowing
from ..mechanics.reading import Reading, read
from ..model import plausibility
from ..model.structure import Structure
from ..numerics import implicit, scaled
from ..numerics.single_kernel import as_single_kernel
from .one_phase import run_phase
from .phase_results import PhaseResult, PhaseResults
from .phases import Phase
from .preparation import in_precision_of, prepare, ready, verdicts
from .results import common_fields, per_element
from .solution import Solution, State
from .states import Reached, arranged, state_of, system_of


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
    core = task.thawed, task.arrays, task.method, task.code
    static = {"differentiate_path": differentiate_path, "listen": listen, "bundles": task.bundles}
    solution = _analyse(*core, **static, size=task.n_free)
    if task.may_warn:  # only then: the check waits until the numbers have been computed
        plausibility.stability(solution)
    return arranged(structure, solution, task)


@functools.partial(jit_program, static=("differentiate_path", "listen", "bundles", "alone"))
def _analyse(thawed, arrays, method, code, differentiate_path, listen, bundles, alone):
    """The compiled core. Results of elements are lists over groups."""
    through = functools.partial(_through, differentiate_path, listen, bundles)
    pattern = thawed[-1].dof_map.pattern
    # a program of its own hands over as many results as there are; one function gains nothing
    whole = listen is None and not alone
    if whole and pattern is not None and pattern.solver.fused:
        through = as_single_kernel(through)
    return through(thawed, arrays, method, code)


def analysed(thawed, arrays, method, code, bundles):
    """The compiled core as a part of another program, with derivatives of the ends of phases."""
    given = {"differentiate_path": False, "listen": None, "bundles": bundles}
    return _analyse(thawed, arrays, method, code, **given, size=0)


def _through(differentiate_path, listen, bundles, thawed, arrays, method, code):
    """The phases of an analysis, in one loop."""
    parameters = merge_indices(thawed, arrays)
    structure_ok, codes = verdicts(parameters, method)
    nodes, groups, carry, schedule = ready(parameters, bundles)
    # unsound input has no state: block its gradient so that a batch is not polluted with NaN
    sound = _finite((nodes, groups)) & structure_ok
    frame = implicit.stop_gradient_unless(sound, (nodes, groups))
    loads, counts = carry.loads, jnp.asarray(schedule.increments, jnp.int32)
    factors = jnp.asarray(schedule.factors, nodes.dtype)
    teller = None if listen is None else _teller(listen, len(schedule))
    touched = implicit.gradient_probe(parameters)

    def phase(run, scanned):
        arrays_of_phase, verdict, *steps = scanned
        data = schedule.of(arrays_of_phase)
        code = status.first_failure(run.code, verdict)
        before = knowing(run.carry, loads, data.number)
        sane = sound & _finite((before, data)) & (code == status.OK)
        problem = implicit.stop_gradient_unless(sane, (nodes, groups, before, data))
        factored = run.factored if schedule.changes is None else linear.without_factor(run.factored)
        tell = None if teller is None else functools.partial(teller, data.number, steps[0])
        fresh = run.reached.number < 0
        given = method, code, differentiate_path, factored, run.seen, fresh, tell
        done = run_phase(problem, before, steps, *given)
        code, carry = done.code, done.carry
        path = copy_with(done.path, displacement=done.path.displacement[:, : schedule.n_node])
        reached = run.reached.after(data, done.factor)
        end = state_of(frame, carry, done.point, reached, schedule, done.seen)
        end = _unless(sound, end, touched)
        moved = end.displacement - done.begin.motion[: schedule.n_node, :3]
        result = _unless(code == status.OK, copy_with(end, displacement=moved), touched)
        began = [state.memory for state in done.begin.states]
        began = None if all(memory is None for memory in began) else began
        given = {"status": None, "stable": None, "path": None, "began": began}
        result = PhaseResult(**given, **common_fields(result))
        left = copy_with(carry, loads=None)
        run = _Run(code, done.stable, left, end, done.factored, reached, done.seen)
        return run, (result, path, done.log)

    start, reached = copy_with(carry, loads=None), Reached.none(schedule, nodes.dtype)
    end = _blank(lambda: state_of(frame, carry, (carry.motion, None), reached, schedule))
    factored = seen = None
    if isinstance(method, Newton):
        factored = linear.no_factored_matrix(schedule.dof_map.pattern, nodes.dtype)
        seen = _blank(lambda: read(system_of(frame, carry, reached, schedule), carry.motion))
    run = _Run(code, jnp.zeros((), bool), start, end, factored, reached, seen)
    run, (ends, paths, log) = lax.scan(phase, run, (schedule.rows, codes, counts, factors))
    if not differentiate_path and isinstance(method, Newton):
        paths = implicit.with_nan_derivative(paths, touched)
    known = [stack.until(run.reached.number) for stack in _all_loads(parameters)]
    states = bundles.apart(run.carry.states)
    carry = copy_with(
        run.carry, states=states, loads=[jax.tree.leaves(stack.load) for stack in known]
    )
    ends, paths = _apart(bundles, ends, axis=1), _apart(bundles, paths, axis=2)
    watched = isinstance(method, Newton) and method.watch
    solution = Solution(
        status=run.code,
        stable=run.stable,
        last=copy_with(_apart(bundles, run.end), carry=carry),
        phases=PhaseResults(ends, paths, log, schedule.increments, watched),
        **implicit.nan_unless_probed(run.code == status.OK, common_fields(run.end), touched),
    )
    return _apart(bundles, solution)


def _blank(function):
    """Zeros in the shape of a function's result, which is not computed."""
    return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(function))


def _all_loads(parameters):
    """Element loads of `start` and of all phases on the user's groups, list of `LoadStack`."""
    nodes, _, carry, schedule = parameters
    return in_precision_of(nodes, [*(() if carry is None else carry.loads), *schedule.loads])


def _apart(bundles, part, axis=0):
    """Results of bundles as those of their groups; `axis` is that of the elements."""
    if bundles.plain:
        return part
    return per_element(part, lambda values: bundles.apart(values, axis))


@pytree
class _Run:
    """What the loop over the phases hands from one phase to the next.

    Attributes:
        code, stable: status so far, and whether the end of the last phase is stable.
        carry: `Carry`, without the loads, which do not change.
        end: the `State` that belongs to `carry`.
        factored: the last matrix that a sparse solve has factorised, see
            `linear.solve_reusing_factor`.
        reached: `states.Reached`.
        seen: `Reading` of the last converged increment.
    """

    code: Int[Array, ""]
    stable: Bool[Array, ""]
    carry: Carry
    end: State
    factored: FactoredMatrix | None
    reached: Reached
    seen: Reading | None


def _unless(ok, end, touched):
    """A `State` whose results are NaN unless `ok`."""
    return copy_with(end, **implicit.nan_unless_probed(ok, common_fields(end), touched))


def _teller(listen, phases):
    """The function `report_progress` of `newton.solve_increments`, which reports increments to the listener."""

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


def _finite(tree):
    """Whether every float in `tree` is finite."""
    floats = [x for x in jax.tree.leaves(tree) if jnp.issubdtype(x.dtype, jnp.floating)]
    # one test of the joined array compiles faster than one for each of many small arrays
    return jnp.all(jnp.isfinite(jnp.concatenate([x.reshape(-1) for x in floats])))
