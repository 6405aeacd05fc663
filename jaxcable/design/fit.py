"""Nonlinear least squares within bounds: Levenberg-Marquardt on exact Jacobians."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from ..common.progress import Trial
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..programs.traced_function import trace_function
from .bounds import (
    BoxBounds,
    check_call_arguments,
    check_search_arguments,
    flat_vector,
    unflatten_params,
)
from .levenberg import FitHistory, LevenbergMarquardt
from .returned_values import residuals_and_status
from .trials import call_search, unevaluated_point, values_and_jacobian


@pytree
class Fit:
    """Result of `fit`: the parameters of least squared residuals, with residuals and Jacobian.

    Attributes:
        params: parameters found, a pytree like the start.
        residual: flattened residuals at `params`, [n_residual].
        jacobian: derivative of the flattened residuals with respect to the flattened parameters,
            [n_residual, n_param].
        misfit: Euclidean norm of the residuals.
        free: True where no bound blocks the parameter, a pytree like `params`.
        without_influence: True where the residuals do not depend on the parameter, to rounding, a
            pytree like `params`; such a parameter keeps its start value.
        history: `FitHistory`.
        status: 0 if it has converged; `describe` has the texts.
        steps: number of trial points after the start, accepted or not.

    Example:
        >>> strain, force = jnp.array([1e-3, 2e-3, 3e-3]), jnp.array([101.0, 199.0, 301.0])  # -, N
        >>> found = jc.fit(lambda EA: EA * strain - force, jnp.array(5e4))
        >>> print(jc.describe(found.status), jnp.round(found.residual, 2), f"{found.misfit:.3f} N")
        converged [-0.86  1.29 -0.57] 1.648 N
        >>> found.jacobian.shape, bool(found.free)
        ((3, 1), True)
    """

    _shown: ClassVar[str] = "misfit, params, free, without_influence, steps"

    params: PyTree[Float[Array, " ..."]]
    residual: Float[Array, " n_residual"]
    jacobian: Float[Array, "n_residual n_param"]
    misfit: Float[Array, ""]
    free: PyTree[Bool[Array, " ..."]]
    without_influence: PyTree[Bool[Array, " ..."]]
    history: FitHistory
    status: Int[Array, ""]
    steps: Int[Array, ""]


def fit(
    residuals: Callable[..., Any],
    params: PyTree[Float[ArrayLike, " ..."]],
    bounds: tuple[PyTree[Any] | None, PyTree[Any] | None] | None = None,
    *,
    steps: int = 100,
    tol: float | None = None,
    args: tuple[Any, ...] = (),
    progress: bool | Callable[[Trial], Any] | None = None,
) -> Fit:
    """Minimize the sum of squared residuals, within bounds.

    This is the Levenberg-Marquardt method. A step solves ``(J^T J + mu D^2) d = -J^T r`` by a QR
    factorisation of the stacked matrix; ``D`` is the largest norm that each column of J has had, so
    that units of the parameters do not matter (Moré 1978); the damping ``mu`` follows the ratio of
    the decrease to the promised one (Nielsen 1999). The Jacobian is exact, in forward mode if there
    are at most as many parameters as residuals, else in reverse mode.

    Args:
        residuals: function ``residuals(params, *args)`` that returns an array or a pytree of
            arrays, or (residuals, `Solution`), or (residuals, status codes). Divide residuals by
            their standard deviations where these differ.
        params: start, any pytree of floats.
        bounds: (lower, upper), each None, a scalar, an array or a prefix pytree of `params`.

    Options:
        steps: largest number of trial points after the start.
        tol: tolerance of convergence, see below. Default: 1e-6 in float64, 1e-3 in float32.
        args: tuple of further arguments of the residuals; pass here what changes from call to call
            (see `minimize`).
        progress: True to show progress on stderr (trial, misfit); or a function of a
            `progress.Trial`, called at the start and after every trial point. Default
            and False: as for `solve`.

    Returns:
        `Fit`. Works under jit and vmap, as `minimize` does; differentiating it is an error.

    Raises:
        ValueError: residuals that are no floats, lower bounds above upper ones, or a start
            outside of the bounds.

    The status is OK (converged) if, with the undamped step ``d`` of the parameters that are free of
    bounds, one of these holds:

    - Orthogonality: ``|J d| <= tol |r|``, the cosine of the angle between the residuals and the
      columns of J; such a step promises `tol^2` of the squared misfit. (A first step is tried in
      any case.)
    - Parameters: ``|d| <= tol^1.5 |x|`` in every entry, with the norm of its array as ``|x|``.
    - Zero residuals: a misfit of at most `tol^2` of that at the start, and of what the parameters
      contribute to the residuals, ``max_k |J_k| |x_k|``; or of 1e-9 of both, if the last step has
      not reduced it.
    - Rounding: the last step has not been accepted, it has promised and changed less than 1e-9 of
      the squared misfit, and the cosine is at most 0.01.

    If no step is accepted and none of this holds the status is STALLED. So it is if half of the
    last ten trial points are refused and the others lower the squared misfit by less than 1e-4 of
    it: results have kinks there, as where cables go slack. It is OUT_OF_STEPS after `steps` trial
    points. A trial point at which the analysis fails is never accepted: the damping
    grows until a shorter step works.

    A parameter whose column of J is zero or rounding is without influence: it stays where it is,
    and `Fit.without_influence` names it. Rounding is what a change of the parameter by its whole
    size (of its array, or between its bounds) does, if it is less than 4096 eps of the residuals
    and of the largest ``|J_k| |x_k|``. If no parameter has influence at the start the status is
    STALLED; if the misfit has no slope there, and is not zero, STATIONARY: it may be a maximum.

    Source: Moré, The Levenberg-Marquardt algorithm: implementation and theory (1978), and MINPACK
    for the criteria; Bates and Watts, Technometrics 23 (1981), for the cosine.

    Example:
        The axial stiffness of a cable from three measured forces, ``sum(e F) / sum(e^2)``:

        >>> strain, force = jnp.array([1e-3, 2e-3, 3e-3]), jnp.array([101.0, 199.0, 301.0])  # -, N
        >>> found = jc.fit(lambda EA: EA * strain - force, jnp.array(5e4))
        >>> print(f"{jc.describe(found.status)}: {found.params:.1f} N")
        converged: 100142.9 N
    """
    args = check_call_arguments(residuals, args, steps, "residuals")
    params, box, tol = check_search_arguments(params, bounds, tol)
    traced = trace_function(
        functools.partial(_flat_residuals, residuals, params), flat_vector(params), args
    )
    return call_search(_search, (traced, args), (params, box), tol, steps, progress)


def _flat_residuals(residuals, params, x, args):
    """Return the residuals [n_residual] and the status code of a user's function.

    Its parameters, a pytree like `params`, are given as `x` [n]; `args` are its further arguments.
    """
    values, code = residuals_and_status(residuals(unflatten_params(x, params), *args))
    vector = ravel_pytree(values)[0]
    if vector.size == 0 or not jnp.issubdtype(vector.dtype, jnp.floating):
        raise ValueError("residuals: expected arrays of floats")
    return vector.astype(x.dtype), code


def _search(residuals, args, params, box, tol, steps, listen):
    """Return the `Fit` to residuals, a `TracedFunction`, for known numbers; arguments as of `fit`.

    `args` are its further arguments, `box` the `BoxBounds`, `listen` is called with each
    `Trial`.
    """
    evaluate = functools.partial(values_and_jacobian, residuals, args)
    return fit_on_host(evaluate, params, box, tol, steps, listen, residuals.result[0].size)


def fit_on_host(
    evaluate: Callable[[Float[np.ndarray, " n"]], Sequence[Any]],
    params: PyTree[Float[ArrayLike, " ..."]],
    box: BoxBounds,
    tol: Float[ArrayLike, ""],
    steps: int,
    listen: Callable[[Trial], Any] | None,
    count: int = 0,
) -> Fit:
    """Search as `fit` does, for known numbers, and return a `Fit` of arrays of NumPy.

    Args:
        evaluate: function of the flat parameters [n] to the residuals, their Jacobian and the
            status code.
        params, box, tol, steps: as for `fit`, checked.
        listen: function of a `progress.Trial` that is called after every trial point, or None.
        count: number of residuals that are NaN if nothing is evaluated, because what was traced
            is invalid.
    """
    search = LevenbergMarquardt(evaluate, params, box, tol, steps, listen)
    code = search.run_if_valid()
    point: Any = search.current or unevaluated_point(search.start, count, code)
    misfit: Any = np.linalg.norm(point.values)
    whole: Any = np.int32
    blocked, without_influence = search.blocked_and_without_influence(point)
    return Fit(
        params=unflatten_params(point.x, params),
        residual=point.values,
        jacobian=point.jacobian,
        misfit=misfit,
        free=unflatten_params(~blocked, params),
        without_influence=unflatten_params(without_influence, params),
        history=FitHistory(*search.history(True, False, True, False)),
        status=whole(code),
        steps=whole(max(len(search.rows) - 1, 0)),
    )
