"""Run libraries of nonlinear programming: SciPy's SLSQP and trust-constr, and IPOPT.

Each is a function of a problem (`ConstrainedSearch`), the largest number of steps and a
tolerance. None of them is asked whether it has converged: `optimality` verifies the points that it
accepts.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy  # its parts are imported where they are first used

from ..common import checks
from .constrained_search import ConstrainedSearch, RunEnded

_LEAST_TOL = 1e-12  # least tolerance of IPOPT: below, rounding keeps it from ending
_MEMORY = 50  # steps from which IPOPT takes the curvature; with its 6 it needs three times as many
_NO_BOUND = 2e19  # IPOPT takes what is beyond 1e19 for infinite


def run_slsqp(problem: ConstrainedSearch, steps: int, tol: float) -> None:
    """Run SciPy's SLSQP (Kraft 1988), for up to some hundred parameters.

    The result is in `problem.best` and `problem.reached`; `tol` is that of the KKT residual.
    """
    # a change of the loss says nothing of the gradient: in a valley it is small long before
    _call_scipy(problem, "SLSQP", problem.jacobian, {"ftol": tol**3, "maxiter": steps})


def run_trust_constr(problem: ConstrainedSearch, steps: int, tol: float) -> None:
    """Run SciPy's interior-point method trust-constr (Byrd, Hribar and Nocedal 1999).

    The result is in `problem.best` and `problem.reached`; `tol` is that of the KKT residual.
    """

    def jacobian(y):
        # SciPy adds slack variables: a dense Jacobian would be factorized for seconds a step
        return scipy.sparse.csr_matrix(problem.jacobian(y))

    with warnings.catch_warnings():
        # SciPy warns of gradients that have not changed, and leaves them out of its update
        warnings.filterwarnings("ignore", "delta_grad == 0.0")
        options = {"maxiter": steps, "gtol": tol**2, "xtol": tol**2, "barrier_tol": tol}
        _call_scipy(problem, "trust-constr", jacobian, options, hess=scipy.optimize.BFGS())


def _call_scipy(problem, method: Any, jacobian: Any, options: Any, **more: Any) -> None:
    """Call `scipy.optimize.minimize` with the problem's loss, constraints and bounds.

    `method`, `options` and `more` are arguments of it; `jacobian` is that of the constraints.
    """
    limits = scipy.optimize.NonlinearConstraint(
        problem.constraints, -np.inf, 0.0, jac=jacobian, hess=scipy.optimize.BFGS()
    )
    scipy.optimize.minimize(
        problem.loss,
        problem.scaled_start,
        jac=problem.gradient,
        bounds=scipy.optimize.Bounds(problem.lower, problem.upper),
        constraints=[limits] if len(problem.reached.constraints) else [],
        method=method,
        options=options,
        **more,
    )


def run_ipopt(problem: ConstrainedSearch, steps: int, tol: float) -> None:
    """Run the interior-point method IPOPT (Waechter and Biegler 2006), with few evaluations.

    The result is in `problem.best` and `problem.reached`; `tol` is that of the KKT residual. Where
    an analysis fails IPOPT gets NaN, so that it shortens the step.
    """
    import ipyopt

    m, n = len(problem.reached.constraints), len(problem.scaled_start)
    ended = False

    def value_or_nan(function, y):
        """Return a value of the problem; NaN if the analysis fails, or once the run is to end."""
        nonlocal ended
        try:
            return np.nan if problem.evaluate_scaled(y).failed else function(y)
        except RunEnded:
            ended = True
            return np.nan

    def writing(function):
        def filled(y, out):
            out[:] = np.ravel(value_or_nan(function, np.array(y)))
            return out

        return filled

    search = ipyopt.Problem(
        n,
        np.maximum(problem.lower, -_NO_BOUND),
        np.minimum(problem.upper, _NO_BOUND),
        m,
        np.full(m, -_NO_BOUND),
        np.zeros(m),
        tuple(index.ravel() for index in np.indices((m, n))),
        (np.zeros(0, int), np.zeros(0, int)),
        lambda y: value_or_nan(problem.loss, np.array(y)),
        writing(problem.gradient),
        writing(problem.constraints),
        writing(problem.jacobian),
        intermediate_callback=lambda *_: not ended,
        ipopt_options={
            "hessian_approximation": "limited-memory",
            "limited_memory_max_history": _MEMORY,
            "bound_relax_factor": 0.0,
            "print_level": 0,
            "sb": "yes",
            "tol": max(tol**2, _LEAST_TOL),
            "max_iter": steps,
        },
    )
    search.solve(problem.scaled_start.copy())


def nlp_solver_by_name(name: Any) -> Callable[[ConstrainedSearch, int, float], None]:
    """Return the function that runs the optimization library of this name: `run_slsqp` and so on.

    Raises:
        ValueError: there is no such library here, or it is not installed.
    """
    known = {"slsqp": run_slsqp, "trust-constr": run_trust_constr, "ipopt": run_ipopt}
    if name not in known:
        raise ValueError(f"solver = {name!r}: expected one of {', '.join(known)}")
    if name == "ipopt":
        checks.import_library("ipyopt", f"solver = {name!r}", "ipopt")
    return known[name]
