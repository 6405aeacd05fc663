"""Minimize a loss subject to inequalities and bounds, by a library whose points are verified."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from ..analysis.solution import Solution
from ..common import checks, status
from ..common import jax_internals as internals
from ..common.progress import Step, as_listener
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..programs.program_calls import as_program
from ..programs.traced_function import trace_function
from .bounds import (
    BoxBounds,
    broadcast_to_params,
    check_call_arguments,
    check_search_arguments,
    flat_vector,
    unflatten_params,
)
from .nlp_solvers import nlp_solver_by_name
from .optimality import solve_kkt_conditions
from .returned_values import loss_and_status
from .trials import RunEnded, ScaledProblem, TrialPoint, values_and_jacobian

_FIRST = 0.1  # part of the first loss that changes are compared with, see `minimum_criteria`
_MAX_TRIALS = 20  # largest number of evaluations per allowed step, so that a library cannot loop
# A run was of use if the KKT residual, or the violation, has fallen to below this part.
_USEFUL = 0.5
_SHORTER = 0.1  # first step of a run over that of the run before it


@pytree
class ConstrainedDesign:
    """Result of `minimize_subject_to`: a minimum of a loss subject to ``constraints <= 0``.

    Attributes:
        params: best parameters found, a pytree like the start: of all points that meet the
            constraints the one of lowest loss; if none does, the one of smallest violation.
        loss: loss at `params`, scalar.
        constraints: constraints at `params`, [n]; all at most 0 if the status is OK.
        multipliers: Lagrange multipliers of the constraints, [n], at least 0: by how much the
            smallest loss would fall, to first order, if a constraint were ``<= 1`` instead of
            ``<= 0``. Zero for a constraint that is not active.
        status: status code; 0 (OK) if all constraints are met and `kkt_residual` is at most `tol`,
            CONSTRAINTS_VIOLATED if one is above 0. `describe` has the texts.
        rounds: number of runs of the optimization library (SciPy or IPOPT).
        evaluations: number of evaluations of loss, constraints and gradients, in all runs.
        failures: number of trial points at which the structural analysis failed.
        kkt_residual: error of the conditions of a minimum (Karush, Kuhn and Tucker) at `params`,
            over the size of the loss; `minimize_subject_to` has the formula.

    Example:
        >>> problem = lambda area: (area, jnp.array([50e3 / (area * 200.0) - 1.0]))
        >>> found = jc.design.minimize_subject_to(problem, jnp.array(400.0), bounds=(10.0, 1000.0))
        >>> print(jc.describe(found.status), bool((found.constraints <= 0).all()))
        converged True
        >>> print(f"{found.multipliers[0]:.0f} mm2")  # saved if c = 1 were allowed, to 1st order
        250 mm2
    """

    _shown: ClassVar[str] = "loss, constraints, params, kkt_residual, evaluations"

    params: PyTree[Float[Array, " ..."]]
    loss: Float[Array, ""]
    constraints: Float[Array, " n"]
    multipliers: Float[np.ndarray, " n"]
    status: Int[Array, ""]
    rounds: int
    evaluations: int
    failures: int
    kkt_residual: float


def minimize_subject_to(
    problem: Callable[
        ...,
        tuple[Float[ArrayLike, ""], Float[ArrayLike, " n"]]
        | tuple[
            Float[ArrayLike, ""], Float[ArrayLike, " n"], PyTree[Solution | Int[ArrayLike, " ..."]]
        ],
    ],
    params: PyTree[Float[ArrayLike, " ..."]],
    bounds: tuple[PyTree[Float[ArrayLike, " ..."]] | None, PyTree[Float[ArrayLike, " ..."]] | None]
    | None = None,
    *,
    solver: str = "slsqp",
    rounds: int = 10,
    steps: int = 300,
    tol: float | None = None,
    args: tuple[Any, ...] = (),
    scale: PyTree[Float[ArrayLike, " ..."]] | None = None,
    progress: bool | Callable[[Step], Any] | None = None,
) -> ConstrainedDesign:
    """Minimize a loss subject to ``constraints <= 0`` and bounds on parameters, by SciPy or IPOPT.

    Args:
        problem: function ``problem(params, *args)`` that returns (loss, constraints) or (loss,
            constraints, `Solution` or status codes). The constraints are dimensionless floats [n],
            scaled so that 1 is a gross violation: ``deflection / limit - 1``.
        params, bounds: as for `minimize`.

    Options:
        solver: "slsqp" of SciPy, the fastest with up to some hundred parameters and some thousand
            constraints; "ipopt" (``pip install 'jaxcable[ipopt]'``), which takes fewer evaluations
            where constraints are many, but longer for each; or "trust-constr" of SciPy.
        rounds: largest number of runs of the library; each begins at the best point so far, with a
            shorter first step. One run is enough where no analysis fails.
        steps: largest number of steps in every run; it takes 20 times as many evaluations at most.
        tol: tolerance of the KKT residual, see below, and of the constraints: where they are
            active they end on the safe side, within ``[-2 tol, 0]``. Default: 1e-6 in float64, 1e-3
            in float32.
        args, progress: as for `minimize`.
        scale: size of a typical change of every parameter, in the forms that a bound can have.
            Default: the size of the parameter itself.

    Returns:
        `ConstrainedDesign`; computed on the host, not to be traced. If no point meets the
        constraints the status is CONSTRAINTS_VIOLATED and `constraints` shows by how much.

    Raises:
        ValueError: as `minimize`; an unknown solver, or one that is not installed.

    Every point that the library accepts is verified here: the status is OK if all constraints are
    at most 0 and the KKT residual is at most `tol`, or STATIONARY if this point is the start and
    the gradient is zero there. The residual is the largest of ``|g_i + sum_j m_j dc_j/dp_i| s`` and
    ``m_j |c_j + tol|`` (and the same terms of bounds), over the size of the loss. Here g is the
    gradient of the loss, c are the constraints, p the parameters, and m the multipliers ``m >= 0``
    with which the residual is smallest. The sizes of the loss and of a parameter, s, are those of
    `minimize`.

    These are conditions of first order: a saddle point meets them, too. A minimum is a local one:
    where there may be several, try several starts. At a trial point where the analysis fails the
    library is given a loss that it does not accept, so that it shortens the step.

    Source: Kraft, A software package for sequential quadratic programming (1988); Byrd, Hribar and
    Nocedal, SIAM J. Optim. 9 (1999); Waechter and Biegler, Math. Program. 106 (2006).

    Example:
        The least area, mm2, that carries 50 kN with at most 200 N/mm2:

        >>> problem = lambda area: (area, jnp.array([50e3 / (area * 200.0) - 1.0]))
        >>> found = jc.design.minimize_subject_to(problem, jnp.array(400.0), bounds=(10.0, 1000.0))
        >>> print(f"{jc.describe(found.status)}: {found.params:.2f} mm2")
        converged: 250.00 mm2
    """
    args = check_call_arguments(problem, args, rounds, "problem", "rounds")
    checks.require_whole_number(steps, "steps")
    params, box, tol = check_search_arguments(params, bounds, tol)
    solve, listen = nlp_solver_by_name(solver), as_listener(progress)
    start = flat_vector(params)
    traced = trace_function(functools.partial(_flat_problem, problem, params), start, args)
    step = box.typical_sizes(start)
    if scale is not None:
        step = flat_vector(broadcast_to_params(scale, params, "scale", absent=1.0, positive=True))

    def evaluate(x):
        return _evaluate(traced, np.asarray(x, start.dtype), args)

    doubles = BoxBounds(*(np.asarray(x, float) for x in (box.lower, box.upper)), box.counts)
    search = _ConstrainedSearch(evaluate, doubles, params, float(tol), int(steps), listen)
    end, code, count = search.run(solve, np.asarray(start, float), step.astype(float), int(rounds))
    multipliers, residual = search.multipliers_and_residual(end)
    return ConstrainedDesign(
        params=internals.as_jax_arrays(unflatten_params(end.x, params)),
        loss=jnp.asarray(end.loss, start.dtype),
        constraints=jnp.asarray(end.constraints, start.dtype),
        multipliers=multipliers,
        status=jnp.int32(code),
        rounds=count,
        evaluations=search.evaluations,
        failures=search.failures,
        kkt_residual=residual,
    )


class _ConstrainedSearch(ScaledProblem):
    """A search that runs an optimization library repeatedly until the KKT conditions hold.

    Every run starts from the best point so far. (KKT: Karush, Kuhn and Tucker.)

    Args:
        evaluate, box, params: as for `ScaledProblem`.
        tol, steps: as for `minimize_subject_to`.
        listen: function of a `progress.Step` that reports progress, or None.
    """

    def __init__(self, evaluate, box, params, tol, steps, listen):
        super().__init__(evaluate, box, params, tol, self.report_accepted_point)
        self.tol, self.steps, self.listen = tol, steps, listen
        self.first = self.number = self.known = 0

    def run(
        self,
        solve: Callable[[ScaledProblem, int, float], None],
        start: Float[np.ndarray, " n"],
        step: Float[np.ndarray, " n"],
        rounds: int,
    ) -> tuple[TrialPoint, int, int]:
        """Run the library at most `rounds` times, first from a start.

        Args:
            solve: function of `nlp_solvers` that runs one library.
            start: parameters, [n].
            step: typical changes of the parameters in the first step, [n].
            rounds: largest number of runs.

        Returns:
            The final point, the status, and the number of runs.
        """
        missing = np.inf
        best = first = self.evaluate_at(start)
        self.first, self.least = abs(best.loss), self.box.typical_sizes(start)
        if best.failed:
            return best, status.BAD_START, 0
        self.report_accepted_point(best)
        for number in range(1, rounds + 1):
            steep = float(np.linalg.norm(best.gradient * step))
            unit = 1 / (steep if steep > 0 else self.loss_size(best))
            self.begin_run(best, step, unit, _MAX_TRIALS * self.steps)
            with contextlib.suppress(RunEnded):
                solve(self, self.steps, self.tol)
            for point in (self.reached, self.best):
                left = self.multipliers_and_residual(point)[1]
                if point.violation <= 0 and left <= self.tol:
                    return point, self._success_status(point, first), number
            before, best = best, self.best
            if best.violation > _USEFUL * before.violation > 0:
                return best, status.CONSTRAINTS_VIOLATED, number
            fallen = before.loss - best.loss > self.tol**2 * self.loss_size(best)
            if not (fallen or left <= _USEFUL * missing or before.violation > 0):
                return best, status.STALLED, number
            missing, step = min(left, missing), _SHORTER * step
        code = status.CONSTRAINTS_VIOLATED if best.violation > 0 else status.OUT_OF_STEPS
        return best, code, rounds

    def _success_status(self, point, first):
        """Return the status for a final point that meets all conditions: OK, or STATIONARY.

        It is STATIONARY if the point is the start `first`, and the gradient there is zero.
        """
        free = (point.x > self.box.lower) & (point.x < self.box.upper)
        blind = not point.gradient[free].any() and free.any() and np.array_equal(point.x, first.x)
        return status.STATIONARY if blind else status.OK

    def multipliers_and_residual(self, point: TrialPoint) -> tuple[np.ndarray, float]:
        """Return the Lagrange multipliers at a point, [m], and its KKT residual over the loss."""
        size = self.typical_sizes(point.x)
        multipliers, residual = solve_kkt_conditions(point, self.box, size, self.tol)
        return multipliers, residual / self.loss_size(point)

    def typical_sizes(self, x: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the sizes of parameters at `x`, [n], at least those at the start."""
        return np.maximum(self.least, self.box.largest_per_array(x))

    def loss_size(self, point: TrialPoint) -> float:
        """Return the size of the loss at a point, positive, which residuals are divided by.

        It is the larger of the present loss and a part of that at the start; if both are zero, the
        change of the loss by a change of one parameter by its typical size.
        """
        size = max(abs(point.loss), _FIRST * self.first)
        return size or float(np.abs(point.gradient * self.typical_sizes(point.x)).max()) or 1.0

    def report_accepted_point(self, point: TrialPoint) -> bool:
        """Report progress at a point that the library has accepted; return whether to end the run.

        It ends if the point meets all constraints and the KKT conditions.
        """
        residual = self.multipliers_and_residual(point)[1]
        if self.listen is not None:
            failures, self.known = self.failures - self.known, self.failures
            self.listen(Step(self.number, self.steps, float(point.loss), residual, failures))
        self.number += 1
        return point.violation <= 0 and residual <= self.tol


def _flat_problem(problem, params, x, args):
    """Return [loss, constraints ...] and the status code of a user's function.

    Its parameters, a pytree like `params`, are given as `x` [n]; `args` are its further arguments.
    """
    returned = problem(unflatten_params(x, params), *args)
    if not isinstance(returned, tuple) or len(returned) not in (2, 3):
        raise ValueError("problem: expected (loss, constraints) or (loss, constraints, solution)")
    value, code = loss_and_status((returned[0], returned[2:]))
    constraints = jnp.asarray(returned[1])
    if constraints.ndim != 1 or not jnp.issubdtype(constraints.dtype, jnp.floating):
        got = f"{constraints.dtype}{list(constraints.shape)}"
        raise ValueError(f"constraints: expected floats [n], got {got}")
    return jnp.append(value, constraints).astype(x.dtype), code


@as_program
def _evaluate(problem, x, args):
    """Return [loss, constraints ...], a `TracedFunction`, with Jacobian and status at `x` [n]."""
    return values_and_jacobian(lambda x: problem(x, args), x, problem.result[0].size)
