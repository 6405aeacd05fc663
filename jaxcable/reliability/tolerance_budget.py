"""Tolerances of inputs, such as cutting lengths, from allowed deviations of results."""

from __future__ import annotations

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from ..common import checks
from ..common.tree import pytree
from ..common.types import ArrayLike, Float, PyTree
from ..design.influence import flat_matrix, propagate_tolerances

_STEPS, _CLOSE = 200, 1e-10


@pytree
class ToleranceBudget:
    """Result of `tolerance_budget`.

    Attributes:
        tolerance: allowed tolerance of every input, a pytree like the inputs; infinite for inputs
            without influence on any limited result.
        deviation: deviation of every result with these tolerances, a pytree like the results; as
            `jaxcable.design.propagate_tolerances` gives it.
        used: this deviation over the allowed one, a pytree like the results, at most 1.
        parts: part of every input in the deviation of every result, [n_of, n_wrt], flattened in the
            order of the pytrees: of the sum of absolute contributions, or of the sum of their
            squares. A row adds up to 1.
        governing: number of the result, flattened, that limits each input most, a pytree like the
            inputs: the one with the largest contribution of this input over the allowed deviation.
        cost: sum of the costs, ``sum_j c_j / t_j``.

    Example:
        >>> matrix = jnp.array([[30e3, 20e3], [20e3, 30e3]])  # N/m, as from `influence`
        >>> allowed = jnp.array([500.0, 500.0])  # N
        >>> budget = jc.reliability.tolerance_budget(matrix, allowed, jnp.zeros(2))
        >>> print(jnp.round(1e3 * budget.tolerance, 3), budget.used.round(9))  # mm
        [13.868 13.868] [1. 1.]
    """

    _shown: ClassVar[str] = "tolerance, used, cost"

    tolerance: PyTree[Float[np.ndarray, " ..."]]
    deviation: PyTree[Float[np.ndarray, " ..."]]
    used: PyTree[Float[np.ndarray, " ..."]]
    parts: Float[np.ndarray, "n_of n_wrt"]
    governing: PyTree[Any]
    cost: float


def tolerance_budget(
    jacobian: PyTree[Float[ArrayLike, " ..."]],
    allowed: PyTree[Float[ArrayLike, " ..."]],
    like: PyTree[Float[ArrayLike, " ..."]],
    *,
    choice: str = "equal",
    adding: str = "random",
    cost: PyTree[Float[ArrayLike, " ..."]] | None = None,
) -> ToleranceBudget:
    """Find tolerances of inputs for which results stay within allowed deviations, to first order.

    The inverse of `jaxcable.design.propagate_tolerances`, for example from allowed deviations of
    tensions to tolerances of cutting lengths. On the host, not to be traced.

    Args:
        jacobian: result of `influence`, a row for each result.
        allowed: allowed deviation of every result, a pytree like the results, or a prefix of it;
            infinite for those that do not matter. In the unit of the results.
        like: any pytree of the shape of the inputs.

    Options:
        choice: which of the many tolerances that keep the limits.

            - "equal": every input may contribute equally much to the result that it affects most,
              as a part of what is allowed: ``t_j = f min_i a_i / |J_ij|``, with the largest factor
              f that keeps all limits. Easy to explain; inputs that hardly matter get large ones.
            - "cheapest": least cost ``sum_j c_j / t_j``, the reciprocal law of machining costs
              (Chase and Greenwood 1988). A convex problem: its minimum is unique. It spends more
              on inputs that several results depend on.
        adding: "random" for independent deviations, whose squares add up: tolerances and allowed
            deviations are standard deviations, or the same multiple of these. "worst" for
            deviations that all are adverse: their absolute values add up.
        cost: c of every input, a pytree like these or a prefix of it, for "cheapest": what the work
            with half of a tolerance costs more. Default 1.

    Returns:
        `ToleranceBudget`.

    Raises:
        ValueError: shapes that do not fit, allowed deviations or costs that are not positive, NaN
            in the matrix, or no input that affects a limited result.

    Example:
        Two cables of which the first is felt twice as much; the cheaper choice gives it more:

        >>> matrix = jnp.array([[40e3, 20e3]])  # N/m, of a force
        >>> for choice in ("equal", "cheapest"):
        ...     budget = jc.reliability.tolerance_budget(
        ...         matrix, jnp.array([100.0]), jnp.zeros(2), choice=choice, adding="worst"
        ...     )
        ...     print(jnp.round(1e3 * budget.tolerance, 3), f"{budget.cost:.0f} {budget.parts[0]}")
        [1.25 2.5 ] 1200 [0.5 0.5]
        [1.464 2.071] 1166 [0.58578644 0.41421356]
    """
    checks.require_one_of(choice, "choice", ("equal", "cheapest"))
    checks.require_one_of(adding, "adding", ("random", "worst"))
    if any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves((jacobian, allowed, cost))):
        raise ValueError("tolerance_budget: is being traced; call it outside of jit and grad")
    inputs, arrange = ravel_pytree(jax.tree.map(lambda x: jnp.zeros(jnp.shape(x)), like))
    matrix = np.abs(np.asarray(flat_matrix(jacobian, like)))
    results = propagate_tolerances(jacobian, arrange(inputs))[0]  # zeros in their shape
    limits = _flat_positive_values(allowed, results, "allowed")
    costs = _flat_positive_values(1.0 if cost is None else cost, like, "cost")
    if np.isnan(matrix).any():
        raise ValueError("jacobian: is NaN, as where the analysis has failed")
    scaled = matrix / limits[:, None]  # contribution of a unit tolerance, over what is allowed
    felt = (scaled > 0).any(axis=0)
    if not felt.any():
        raise ValueError("jacobian: no input affects a result with a finite allowed deviation")
    power = 2 if adding == "random" else 1
    tolerance = np.full(len(costs), np.inf)
    equal = 1.0 / scaled[:, felt].max(axis=0)
    reached = ((scaled[:, felt] * equal) ** power).sum(axis=1).max() ** (1 / power)
    tolerance[felt] = equal / reached
    if choice == "cheapest":
        begin = tolerance[felt]
        share = (scaled[:, felt] * begin) ** power
        tolerance[felt] = begin * _least_cost_factors(share, costs[felt] / begin, power)
    finite = np.where(felt, tolerance, 0.0)
    deviation = propagate_tolerances(jacobian, arrange(jnp.asarray(finite)))[power == 2]
    contribution = (matrix * finite) ** power
    sums = contribution.sum(axis=1, keepdims=True)
    flat, back = ravel_pytree(jax.tree.map(jnp.asarray, deviation))
    return ToleranceBudget(
        tolerance=arrange(jnp.asarray(tolerance)),
        deviation=deviation,
        used=back(flat / jnp.asarray(limits)),
        parts=np.divide(contribution, sums, out=np.zeros_like(matrix), where=sums > 0),
        governing=arrange(jnp.asarray((scaled * finite).argmax(axis=0), float)),
        cost=float((costs[felt] / tolerance[felt]).sum()),
    )


def _flat_positive_values(value, tree, name):
    """Return a number for every entry of a pytree, flattened, from `value`, a prefix of it.

    Raises ValueError, which begins with `name`, for other shapes and for numbers that are not
    positive.
    """
    if isinstance(value, list) and not isinstance(tree, list):
        value = checks.as_floats(value, name)
    try:
        spread = jax.tree.broadcast(value, tree)
    except ValueError:
        raise ValueError(
            f"{name}: expected a number, or a pytree like {jax.tree.structure(tree)}"
        ) from None
    flat = []
    for one, part in zip(jax.tree.leaves(spread), jax.tree.leaves(tree), strict=True):
        one = np.asarray(checks.as_floats(one, name))
        if one.shape not in ((), jnp.shape(part)):
            raise ValueError(f"{name}: expected shape {jnp.shape(part)}, got {one.shape}")
        if not (one > 0).all():
            raise ValueError(f"{name}: must be positive")
        flat.append(np.broadcast_to(one, jnp.shape(part)).ravel())
    return np.concatenate(flat).astype(float)


def _least_cost_factors(share, costs, power):
    """Return the factors of tolerances of least cost, by a primal-dual interior-point method.

    Minimize ``sum_j c_j x_j^(-1/p)`` over x, the power p of the factors, subject to
    ``share x <= 1``; the start, all ones, keeps these limits.
    """
    kept = (share > 0).any(axis=1)
    share, order = share[kept], 1 / power
    costs = costs / costs.sum()
    x = np.full(share.shape[1], 0.9)
    slack = 1 - share @ x
    dual = np.full(len(slack), 1 / len(slack))
    for _ in range(_STEPS):
        gradient = -order * costs * x ** (-order - 1)
        curvature = order * (order + 1) * costs * x ** (-order - 2)
        residual = gradient + share.T @ dual
        gap = slack @ dual
        if max(gap, np.abs(residual * x).max()) <= _CLOSE:
            return x**order
        center = 0.1 * gap / len(slack)
        matrix = np.diag(curvature) + share.T @ (share * (dual / slack)[:, None])
        rhs = -residual - share.T @ (center / slack - dual)
        step = np.linalg.solve(matrix, rhs)
        slack_step = -(share @ step)
        dual_step = center / slack - dual - dual / slack * slack_step
        whole = np.concatenate([x, slack, dual])
        change = np.concatenate([step, slack_step, dual_step])
        falling = change < 0
        length = min(1.0, 0.95 * (whole[falling] / -change[falling]).min(initial=np.inf))
        x, slack, dual = x + length * step, slack + length * slack_step, dual + length * dual_step
    raise ValueError("tolerance_budget: the cheapest tolerances were not found; take 'equal'")
