"""`solve`: the phases of an analysis one after the other, each in increments by `lax.scan`."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence

from ..common import checks
from ..common.progress import Increment, as_listener
from ..common.status import OK, first_failure
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..model import plausibility
from ..model.structure import Structure
from ..programs.program_calls import as_program
from .as_built import topples_under_jacks, with_lengths_as_built
from .phase_loop import analyse
from .phases import Phase
from .preparation import prepare
from .recalled_derivative import arguments_if_known, attach_recalled_derivative
from .solution import Solution, State
from .states import as_user_solution


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
    Outside of jit, the first call of a gradient compiles the derivative only, if the analysis has
    been called before.

    Args:
        structure: `Structure`.
        phases: list of `Phase`, or one.
        method: `Newton` (default) or `Incremental`.

    Options:
        start: `Solution` (or its `.last`) of the same structure to continue from; default: the
            initial structure. Starting from a failed `Solution` returns its failure status; start
            from its `.last` instead, the last converged state.
        differentiate_path: with `Newton`, also give derivatives of `phases[k].path.displacement`
            and of the forces on the path (one adjoint system per increment). By default these
            derivatives are NaN; all other results are differentiable in any case.
        progress: True writes a line to stderr every half second during long work (increment,
            iterations, residual); a function is called with a `progress.Increment` after each
            increment. It is compiled in: another function compiles again.

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
    stated = phases
    phases, found = with_lengths_as_built(structure, stated, method, start, solve)
    # prestress as built has been prepared as it is stated: messages have named that
    with checks.without_warnings() if found is not None else contextlib.nullcontext():
        task = prepare(structure, phases, method, start, to_end=True)
    if found is not None:
        task = task._replace(code=_first_failure(task.code, found))
    core = task.without_indices, task.arrays, task.method, task.code
    iterates = isinstance(task.method, Newton) and not differentiate_path
    known = arguments_if_known(core) if iterates else None
    solution, points = analyse(
        *(known or core),
        differentiate_path=differentiate_path,
        listen=listen,
        bundles=task.bundles,
    )
    if topples_under_jacks(phases, solution, task.fixed[-1]):
        given = structure, stated, method, start
        by_lengths, found = with_lengths_as_built(*given, solve, straight=True)
        if found is not None and int(found) == OK:
            return solve(
                *(structure, by_lengths, method),
                start=start,
                differentiate_path=differentiate_path,
                progress=progress,
            )
    if task.warns_if_unstable:  # only then: the check waits until the numbers have been computed
        plausibility.warn_if_unstable(solution)
    jacked = any(one.jacking is not None or one.end_tension is not None for one in phases)
    plausibility.warn_of_collapse(solution, jacked, task.fixed[-1])
    if known is not None:
        solution = attach_recalled_derivative(solution, core, points, task.bundles)
    return as_user_solution(structure, solution, task)


_first_failure = as_program(first_failure)
