"""Minimize a loss subject to inequalities and bounds, by a library whose points are verified."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common import jax_internals as internals
from ..common.progress import Step, as_listener
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..programs.traced_function import trace_function
from .bounds import (
    broadcast_to_params,
    check_call_arguments,
    check_search_arguments,
    flat_vector,
    unflatten_params,
)
from .constrained_search import ConstrainedSearch
from .nlp_solvers import nlp_solver_by_name
from .returned_values import loss_and_status
from .trials import values_and_jacobian


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
        start_status: status of the analysis at the start; NONFINITE if it converges there and loss,
            constraints or a derivative are not finite.
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
    start_status: Int[Array, ""]
    rounds: int
    evaluations: int
    failures: int
    kkt_residual: float


def minimize_subject_to(
    problem: Callable[..., Any],
    params: PyTree[Float[ArrayLike, " ..."]],
    bounds: tuple[PyTree[Any] | None, PyTree[Any] | None] | None = None,
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
    traced = trace_function(functools.partial(_loss_and_constraints, problem, params), start, args)
    evaluate = functools.partial(values_and_jacobian, traced, args)
    wide = jax.tree.map(lambda x: np.asarray(x, float), box)  # libraries take double precision
    search = ConstrainedSearch(evaluate, params, wide, tol, int(steps), listen)
    step = box.typical_sizes(start)
    if scale is not None:
        step = flat_vector(broadcast_to_params(scale, params, "scale", absent=1.0, positive=True))
    end, code, count = search.run_library(solve, np.asarray(step, float), int(rounds))
    multipliers, residual = search.multipliers_and_residual(end)
    return ConstrainedDesign(
        params=internals.as_jax_arrays(unflatten_params(end.x, params)),
        loss=jnp.asarray(end.loss, start.dtype),
        constraints=jnp.asarray(end.constraints, start.dtype),
        multipliers=multipliers,
        status=jnp.int32(code),
        start_status=jnp.int32(search.first.code),
        rounds=count,
        evaluations=search.evaluations,
        failures=search.failures,
        kkt_residual=residual,
    )


def _loss_and_constraints(problem, params, x, args):
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
