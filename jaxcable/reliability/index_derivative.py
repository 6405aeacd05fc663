"""The derivative of a reliability index, which the design point makes simple: it is stationary."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.scipy.special import ndtr

from ..common.tree import copy_with
from ..common.types import Array, Float, PyTree
from ..numerics.implicit_root import with_deferred_derivative
from .first_order_result import FirstOrder
from .search import SearchPoint
from .systems import rows_without_point


def attach_index_derivatives(
    function: Callable[..., Float[Array, " m"]],
    found: FirstOrder,
    points: SearchPoint,
    task: PyTree[Any],
) -> FirstOrder:
    """Return a result with the derivatives that it has by the numbers of a task, NaN for others.

    These are those of indices, and of the probability where there is one design point. NaN are all
    those of a limit state whose search has failed.

    Args:
        function: function of the arrays of `task` and u that returns all limit states; it is traced
            once more if the derivative is taken.
        found: result without derivatives.
        points: design points of all limit states, in arrays with leading axes [m, k].
        task: tuple of pytrees.
    """
    shape, *each = found.points.beta.shape, *points.gradient.shape[:2]
    betas = _beta_indices(function, found.points.beta.reshape(each), points, task).reshape(shape)
    several = jnp.sum(~rows_without_point(betas), axis=-1) > 1
    alone = ndtr(-betas[..., 0])
    undefined = jnp.where(several, jnp.nan, 0.0)
    probability = _with_tangent(found.probability, undefined, task)
    bare = jax.tree.map(lambda leaf: _without_derivative(leaf, task), found)
    return copy_with(
        bare,
        beta=betas[..., 0],
        probability=probability + (alone - lax.stop_gradient(alone)),
        points=copy_with(bare.points, beta=betas),
    )


def _beta_indices(function, betas, points, task):
    """Return the reliability indices of all design points, [m, k], with their derivatives.

    These are those of the limit states over their slopes. The index of a row without a point,
    beside others with points, is NaN and has no derivative.
    """
    absent = jnp.isnan(betas) & ~jnp.isnan(betas[:, :1])
    # there the first point: a NaN would enter the derivatives of others
    beta, slope = (
        jnp.where(absent, x[:, :1], x) for x in (betas, jnp.linalg.norm(points.gradient, axis=-1))
    )
    u = jnp.where(absent[..., None], points.u[:, :1], points.u)
    m, k, n = u.shape

    def values(parameters):
        task, u = parameters
        pairs = jnp.repeat(jnp.arange(m), k), u.reshape(m * k, n)
        return lax.map(lambda pair: function(*task, pair[1])[pair[0]], pairs).reshape(m, k)

    known = jnp.zeros_like(beta)  # only their change counts
    change = with_deferred_derivative(values, known, (task, jnp.where(jnp.isnan(u), 0.0, u)))
    slope = _without_derivative(slope, task)  # so second derivatives are NaN
    failed = jnp.where(jnp.isnan(beta), jnp.nan, 0.0)
    betas = _with_tangent(beta, failed, task) + _over_slope(change, slope)
    return jnp.where(absent, jnp.nan, betas)


def _without_derivative(leaf, task):
    """Return a result of a task; a float one has NaN as its derivative by the task."""
    is_float = jnp.issubdtype(leaf.dtype, jnp.floating)
    return _with_tangent(leaf, jnp.nan, task) if is_float else leaf


@jax.custom_jvp
def _over_slope(change, slope):
    """Return ``change / slope`` for a `change` whose value is zero: only its derivative counts."""
    return change


@_over_slope.defjvp
def _over_slope_jvp(primals, tangents):
    """JVP rule of `_over_slope`: tangent of the change over the slope, which counts as constant."""
    return _over_slope(*primals), tangents[0] / primals[1]


@jax.custom_jvp
def _with_tangent(leaf, factor, task):
    """Return `leaf`, whose tangent is `factor` times the sum of those of all floats of a task."""
    return leaf


@_with_tangent.defjvp
def _with_tangent_jvp(primals, tangents):
    """JVP rule of `_with_tangent`: return the leaf, and `factor` times the sum of all tangents.

    Tangents of integers in the task do not count.
    """
    leaf, factor, _ = primals
    floats = [t for t in jax.tree.leaves(tangents[2]) if jnp.issubdtype(t.dtype, jnp.floating)]
    total = sum((jnp.sum(t) for t in floats), jnp.zeros(()))
    return _with_tangent(*primals), jnp.full_like(leaf, 1.0) * factor * total
