"""Libraries that minimise a loss subject to constraints: SciPy's SLSQP and trust-constr, IPOPT.

Each is a function of a problem (`trials.Trials`), the largest number of steps and a tolerance. None
of them is asked whether it has converged: `optimality` judges the points that it accepts.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import optimize, sparse

from .trials import RunEnd, Trials

_FINEST = 1e-12  # least tolerance of IPOPT
_MEMORY = 50  # steps from which IPOPT takes the curvature; with its 6 it needs three times as many
_NO_BOUND = 2e19  # what IPOPT takes for infinite, from 1e19 on


def slsqp(problem: Trials, steps: int, tol: float) -> None:
    """Run SciPy's SLSQP (Kraft 1988): dense, for up to some hundred parameters."""
    # a change of the loss says nothing of the gradient: in a valley it is small long before
    _minimized(problem, "SLSQP", problem.jacobian, {"ftol": tol**3, "maxiter": steps})


def trust_constr(problem: Trials, steps: int, tol: float) -> None:
    """Run SciPy's trust-constr (Byrd, Hribar, Nocedal 1999): interior points."""

    def jacobian(y):
        # with the slacks of the limits a dense one is factorized for seconds a step
        return sparse.csr_matrix(problem.jacobian(y))

    with warnings.catch_warnings():
        # of gradients that have not changed: its update leaves them out
        warnings.filterwarnings("ignore", "delta_grad == 0.0")
        options = {"maxiter": steps, "gtol": tol**2, "xtol": tol**2, "barrier_tol": tol}
        _minimized(problem, "trust-constr", jacobian, options, hess=optimize.BFGS())


def _minimized(problem, method: Any, jacobian: Any, options: Any, **more: Any) -> None:
    """Call SciPy's `minimize`."""
    limits = optimize.NonlinearConstraint(
        problem.constraints, -np.inf, 0.0, jac=jacobian, hess=optimize.BFGS()
    )
    optimize.minimize(
        problem.loss,
        problem.start,
        jac=problem.gradient,
        bounds=optimize.Bounds(problem.lower, problem.upper),
        constraints=[limits] if len(problem.reached.constraints) else [],
        method=method,
        options=options,
        **more,
    )


def ipopt(problem: Trials, steps: int, tol: float) -> None:
    """Run IPOPT (Waechter, Biegler 2006): interior points, few evaluations.

    A failed analysis is NaN here: IPOPT shortens the step then, also while it restores feasibility.
    """
    import ipyopt

    m, n = problem.reached.jacobian.shape
    ended = False

    def number(function, y):
        """A value of the problem; NaN where the analysis fails, or once the run is to end."""
        nonlocal ended
        try:
            return np.nan if problem.point(y).failed else function(y)
        except RunEnd:
            ended = True
            return np.nan

    def put(function):
        def filled(y, out):
            out[:] = np.ravel(number(function, np.array(y)))
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
        lambda y: number(problem.loss, np.array(y)),
        put(problem.gradient),
        put(problem.constraints),
        put(problem.jacobian),
        intermediate_callback=lambda *_: not ended,
        ipopt_options={
            "hessian_approximation": "limited-memory",
            "limited_memory_max_history": _MEMORY,
            "bound_relax_factor": 0.0,
            "print_level": 0,
            "sb": "yes",
            "tol": max(tol**2, _FINEST),
            "max_iter": steps,
        },
    )
    search.solve(problem.start.copy())


def solver_named(name: Any) -> Callable[[Trials, int, float], None]:
    """Return the function of a solver by its name.

    Raises:
        ValueError: there is no such solver, or it is not installed.
    """
    known = {"slsqp": slsqp, "trust-constr": trust_constr, "ipopt": ipopt}
    if name not in known:
        raise ValueError(f"solver = {name!r}: expected one of {', '.join(known)}")
    if name == "ipopt":
        try:
            import ipyopt  # noqa: F401
        except ImportError:
            text = "needs ipyopt; pip install 'jaxcable[ipopt]'"
            raise ValueError(f"solver = {name!r}: {text}") from None
    return known[name]
