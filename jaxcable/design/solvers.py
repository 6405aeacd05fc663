"""Libraries that minimise a loss subject to constraints: SciPy's SLSQP and trust-constr, IPOPT.

Each is a function of a problem (`trials.Scaled`, `trials.Elastic`), a start, the largest number of
steps, a tolerance of the loss and a function that is called after every step, which says whether to
end. It returns the point where the library has ended; whether that is a minimum is judged elsewhere
(`optimality`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import optimize

from .trials import Elastic, Scaled

_FINEST = 1e-12  # least tolerance of IPOPT
_NO_BOUND = 2e19  # what IPOPT takes for infinite, from 1e19 on


class _EndError(Exception):
    """The search is to end: the point is good, or the analysis has failed where it would go on."""


def slsqp(
    problem: Scaled | Elastic,
    start: np.ndarray,
    steps: int,
    tol: float,
    after: Callable[[np.ndarray], bool],
) -> np.ndarray:
    """Minimise by SciPy's SLSQP (Kraft 1988): dense, for up to some hundred parameters."""
    reached = start

    def slopes(y):
        # its line search has shortened the step ten times: it would go on from here
        if problem.point(y).failed:
            raise _EndError
        return problem.at(y)

    def note(y):
        nonlocal reached
        reached = np.array(y)
        if after(reached):
            raise _EndError

    limits = {
        "type": "ineq",
        "fun": lambda y: -problem.at(y)[2],
        "jac": lambda y: -slopes(y)[3],
    }
    try:
        end = optimize.minimize(
            lambda y: problem.at(y)[0],
            start,
            jac=lambda y: slopes(y)[1],
            bounds=optimize.Bounds(problem.lower, problem.upper),
            constraints=[limits] if len(problem.at(start)[2]) else [],
            method="SLSQP",
            callback=note,
            options={"ftol": tol, "maxiter": steps},
        )
    except _EndError:
        return reached
    return end.x


def trust_constr(
    problem: Scaled | Elastic,
    start: np.ndarray,
    steps: int,
    tol: float,
    after: Callable[[np.ndarray], bool],
) -> np.ndarray:
    """Minimise by SciPy's trust-constr (Byrd, Hribar, Nocedal 1999): interior points, dense."""
    limits = optimize.NonlinearConstraint(
        lambda y: problem.at(y)[2],
        -np.inf,
        0.0,
        jac=lambda y: problem.at(y)[3],
        hess=optimize.BFGS(),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of gradients that have not changed
        end = optimize.minimize(
            lambda y: problem.at(y)[0],
            start,
            jac=lambda y: problem.at(y)[1],
            hess=optimize.BFGS(),
            bounds=optimize.Bounds(problem.lower, problem.upper),
            constraints=[limits] if len(problem.at(start)[2]) else [],
            method="trust-constr",
            callback=lambda y, _: after(np.array(y)),
            options={
                "maxiter": steps,
                "gtol": tol,
                "xtol": tol,
                "barrier_tol": tol,
            },
        )
    return end.x


def ipopt(
    problem: Scaled | Elastic,
    start: np.ndarray,
    steps: int,
    tol: float,
    after: Callable[[np.ndarray], bool],
) -> np.ndarray:
    """Minimise by IPOPT (Waechter, Biegler 2006): interior points, for many limits.

    A failed analysis is NaN here: IPOPT takes that for an error of the evaluation, and shortens the
    step, in its restoration of feasibility, too.
    """
    import ipyopt

    _, _, constraints, jacobian = problem.at(start)
    m, n = jacobian.shape
    reached = start

    def put(which, shape):
        def filled(y, out):
            failed = problem.point(np.array(y)).failed
            out[:] = np.nan if failed else problem.at(np.array(y))[which].reshape(shape)
            return out

        return filled

    def loss(y):
        nonlocal reached
        reached = np.array(y)
        return np.nan if problem.point(reached).failed else problem.at(reached)[0]

    def note(*_):
        return not after(reached)

    rows, columns = (index.ravel() for index in np.indices((m, n)))
    nothing = np.zeros(0, int), np.zeros(0, int)
    search = ipyopt.Problem(
        n,
        np.maximum(problem.lower, -_NO_BOUND),
        np.minimum(problem.upper, _NO_BOUND),
        m,
        np.full(m, -_NO_BOUND),
        np.zeros(m),
        (rows, columns),
        nothing,
        loss,
        put(1, n),
        put(2, m),
        put(3, m * n),
        intermediate_callback=note,
        ipopt_options={
            "hessian_approximation": "limited-memory",
            "bound_relax_factor": 0.0,
            "print_level": 0,
            "sb": "yes",
            "tol": max(tol, _FINEST),
            "max_iter": steps,
        },
    )
    end, _, _ = search.solve(start.copy())
    return np.asarray(end)


def solver_named(name: Any) -> Callable[..., np.ndarray]:
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
