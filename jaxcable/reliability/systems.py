"""Probability that any of several limit states is violated: bounds to first order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr

from ..common import checks
from ..common.tree import pytree
from ..common.types import Array, Bool, Float
from ..programs.program_calls import as_program
from .first_order_result import FirstOrder
from .quantities import join_by_name

_NODES, _WEIGHTS = (np.asarray(a) for a in np.polynomial.legendre.leggauss(20))
NEVER = 40.0  # index of a limit state that is never violated: a probability of zero
_PIECES = 12  # of the integral for two limit states, shorter towards full correlation


@pytree
class SeriesSystem:
    """Probability that any of several limit states is violated, to first order.

    Attributes:
        low, high: Ditlevsen's bounds (1979), by the probabilities of pairs. They are the same for
            two limit states: the probability of the linearized ones is exact then.
        simple_low, simple_high: the largest probability of one of them, and the sum of all (at
            most 1): bounds that need no correlation (Cornell 1967).
        correlation: correlation of the linearized limit states, ``alpha_j . alpha_k``, [m, m], with
            a row for each design point.
        pairs: probabilities that two of them are violated, [m, m]; on the diagonal those of one.

    Example:
        >>> normal = jc.reliability.Normal(0.0, 1.0)
        >>> found = jc.reliability.first_order(
        ...     lambda x: {"a": 3.0 - x["p"], "b": 3.2 - x["q"]}, {"p": normal, "q": normal}
        ... )
        >>> system = jc.reliability.series_system(found)
        >>> print(found.status, f"{system.low:.6e} {system.high:.6e}")
        [0 0] 2.036108e-03 2.036108e-03
    """

    _shown: ClassVar[str] = "low, high, simple_low, simple_high"

    low: Float[Array, ""]
    high: Float[Array, ""]
    simple_low: Float[Array, ""]
    simple_high: Float[Array, ""]
    correlation: Float[Array, "m m"]
    pairs: Float[Array, "m m"]


def series_system(results: FirstOrder | Sequence[FirstOrder]) -> SeriesSystem:
    """Bound the probability that any of several limit states is violated, to first order.

    Limit states are linearized at their design points: ``beta - alpha . u``, each at all that were
    found: the rows of `correlation` and `pairs` are those of the limit states in turn. What their
    curvature does, `importance_sampling` says.

    Args:
        results: `FirstOrder` of several limit states, or a list of results for the same quantities.

    Returns:
        `SeriesSystem`; NaN if one of the searches has failed. Works under jit and vmap. The
        simple bounds have the derivatives of the indices; the others NaN, since correlations have
        no derivative.

    Raises:
        ValueError: no result of `first_order`, or results for different quantities.

    Example:
        Two limit states of the same quantities, of which either one is failure:

        >>> Normal = jc.reliability.Normal
        >>> found = jc.reliability.first_order(
        ...     lambda x: jnp.stack([x["R"] - x["S"], 29.0 - x["S"]]),
        ...     {"R": Normal(30.0, 3.0), "S": Normal(16.0, 4.0)},
        ... )
        >>> system = jc.reliability.series_system(found)
        >>> bounds = system.simple_low, system.low, system.simple_high
        >>> print(found.status, *(f"{bound:.5f}" for bound in bounds))
        [0 0] 0.00256 0.00284 0.00313
    """
    return union_bounds(*stacked_results(results, "results"))


@as_program
def union_bounds(betas: Float[Array, " m"], alphas: Float[Array, "m n"]) -> SeriesSystem:
    """Return the `SeriesSystem` of m linear limit states ``beta - alpha . u``.

    `betas` are their reliability indices, `alphas` unit vectors.
    """
    # rounding alone can leave this range: rows of `alphas` are unit vectors
    correlation = jnp.clip(alphas @ alphas.T, -1.0, 1.0)
    alone = ndtr(-betas)
    both = _joint_exceedance_probability(betas[:, None], betas[None, :], correlation)
    diagonal = np.eye(len(betas), dtype=bool)
    pairs = jnp.where(diagonal, alone[:, None], both)
    order = jnp.argsort(-alone)  # the bounds are narrower with the largest first
    p, joint = alone[order], pairs[order][:, order]
    earlier = np.tril(np.ones((len(betas), len(betas)), bool), -1)
    rest = jnp.maximum(p - jnp.sum(jnp.where(earlier, joint, 0.0), axis=1), 0.0)
    most = jnp.max(jnp.where(earlier, joint, 0.0), axis=1, initial=0.0)
    return SeriesSystem(
        low=p[0] + jnp.sum(rest[1:]),
        high=jnp.minimum(jnp.sum(p) - jnp.sum(most[1:]), 1.0),
        simple_low=jnp.max(alone),
        simple_high=jnp.minimum(jnp.sum(alone), 1.0),
        correlation=correlation,
        pairs=pairs,
    )


def stacked_results(results: Any, name: str) -> tuple[Float[Array, " m"], Float[Array, "m n"]]:
    """Return the indices and unit vectors of all design points of one or several `FirstOrder`.

    NaN for a limit state whose search has failed.

    Raises ValueError, which names the argument, for something else and for other quantities.
    """
    several = [results] if isinstance(results, FirstOrder) else results
    if not isinstance(several, list | tuple) or not several:
        got = checks.describe_type(results, "first_order(...)")
        raise ValueError(f"{name}: expected the result of first_order, or a list, got {got}")
    betas, alphas = [], []
    for k, one in enumerate(several):
        if not isinstance(one, FirstOrder):
            got = checks.describe_type(one, "first_order(...)")
            raise ValueError(f"{name}[{k}]: expected the result of first_order, got {got}")
        if one.layout != several[0].layout:
            raise ValueError(f"{name}[{k}]: is for other quantities than {name}[0]")
        if one.beta.ndim > (one.limit_states is not None):
            raise ValueError(f"{name}[{k}]: is a batch of shape {one.beta.shape}; give one of it")
        beta = jnp.atleast_2d(one.points.beta)  # [m, k]
        alpha = join_by_name(one.layout, one.points.alpha).reshape(*beta.shape, -1)
        absent = rows_without_point(beta)
        beta = jnp.where(absent, NEVER, beta).ravel()
        alpha = jnp.where(absent[..., None], 0.0, alpha).reshape(len(beta), -1)
        if not isinstance(absent, jax.core.Tracer):
            beta, alpha = (array[~np.asarray(absent).ravel()] for array in (beta, alpha))
        betas.append(beta)
        alphas.append(alpha)
    return jnp.concatenate(betas), jnp.concatenate(alphas)


def rows_without_point(beta: Float[Array, "*m k"]) -> Bool[Array, "*m k"]:
    """Return which further design points have no part in a series system.

    They are those not found (NaN, while the first is a number), and all further ones where the
    origin fails: what survives is the series system there, and that of the nearest is a bound.
    """
    first = beta[..., :1]
    further = jnp.broadcast_to(np.arange(beta.shape[-1]) > 0, beta.shape)
    return further & (jnp.isnan(first) | jnp.isnan(beta) | (first < 0))


def _joint_exceedance_probability(first, second, correlation):
    """Return the probability that two normal variables are above `first` and `second`.

    It is ``Phi(-first) Phi(-second)`` plus the integral of the bivariate density over the
    correlation from 0 (Plackett 1954), with ``r = sin t`` for a smooth integrand, in pieces that
    become shorter towards the end, where a strong correlation makes it steep.
    """
    end = jnp.arcsin(correlation)
    # piece by piece half as long, from 0 to the end
    edges = np.concatenate([1.0 - 0.5 ** np.arange(_PIECES), [1.0]])
    middle, half = (edges[1:] + edges[:-1]) / 2, (edges[1:] - edges[:-1]) / 2
    places = (middle[:, None] + half[:, None] * _NODES).ravel()
    weights = (half[:, None] * _WEIGHTS).ravel()
    t = end[..., None] * places[None, None]
    sine, cosine = jnp.sin(t), jnp.cos(t)
    a, b = first[..., None], second[..., None]
    # a^2 + b^2 - 2 a b sin t, without the difference of large numbers
    square = (a - b) ** 2 / (2 * cosine**2) + a * b / (1 + sine)
    total = jnp.sum(weights[None, None] * jnp.exp(-square), axis=-1) * end / (2 * np.pi)
    return jnp.maximum(ndtr(-first) * ndtr(-second) + total, 0.0)
