"""The derivative of a reliability index, which the design point makes simple: it is stationary."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from ..common.types import Array, Bool, Float, PyTree
from ..numerics.implicit_root import with_deferred_derivative
from .exploration import PointRows


def with_derivatives_of_indices(
    function: Callable[..., Float[Array, " m"]], rows: PointRows, numbers: list[Array]
) -> Float[Array, "m k"]:
    """Return the indices of design points with their derivatives by `numbers`.

    These are those of the limit states over their slopes. The derivative of an index that is NaN
    since its search has failed is NaN; one of a row without a point has none.

    Args:
        function: function of u and `numbers` that returns all limit states; it is traced once more
            if the derivative is taken.
        rows: design points of all limit states, in arrays with leading axes [m, k].
        numbers: list of arrays.
    """
    absent = jnp.isnan(rows.beta) & ~jnp.isnan(rows.beta[:, :1])
    # there the first point: a NaN would enter the derivatives of others
    beta, slope = (jnp.where(absent, x[:, :1], x) for x in (rows.beta, rows.slope))
    u = jnp.where(absent[..., None], rows.u[:, :1], rows.u)
    m, k, n = u.shape

    def values(parameters):
        u, numbers = parameters
        pairs = jnp.repeat(jnp.arange(m), k), u.reshape(m * k, n)
        return lax.map(lambda pair: function(pair[1], numbers)[pair[0]], pairs).reshape(m, k)

    known = jnp.zeros_like(beta)  # only their change counts
    change = with_deferred_derivative(values, known, (jnp.where(jnp.isnan(u), 0.0, u), numbers))
    slope = without_derivative(slope, numbers)  # so second derivatives are NaN
    failed = jnp.where(jnp.isnan(beta), jnp.nan, 0.0)
    betas = _with_tangent(beta, failed, numbers) + _over_slope(change, slope)
    return jnp.where(absent, jnp.nan, betas)


def without_derivative(tree: PyTree[Any], numbers: list[Array]) -> PyTree[Any]:
    """Return a pytree of results of `numbers`, whose derivatives by them are NaN."""

    def without(leaf):
        is_float = jnp.issubdtype(leaf.dtype, jnp.floating)
        return _with_tangent(leaf, jnp.nan, numbers) if is_float else leaf

    return jax.tree.map(without, tree)


def without_derivative_where(
    condition: Bool[Array, ""], value: Float[Array, ""], numbers: list[Array]
) -> Float[Array, ""]:
    """Return a result of `numbers`, whose derivative becomes NaN if the condition holds."""
    factor = jnp.where(condition, jnp.nan, 0.0)
    bare = lax.stop_gradient(value)
    return _with_tangent(bare, factor, numbers) + (value - bare)


@jax.custom_jvp
def _over_slope(change, slope):
    """Return ``change / slope`` for a change that is zero and has a derivative."""
    return change


@_over_slope.defjvp
def _over_slope_jvp(primals, tangents):
    """Rule of `_over_slope`: the slope has no part in the first derivative."""
    return _over_slope(*primals), tangents[0] / primals[1]


@jax.custom_jvp
def _with_tangent(leaf, factor, numbers):
    """Return `leaf`, whose tangent is `factor` times the sum of those of all floats."""
    return leaf


@_with_tangent.defjvp
def _with_tangent_jvp(primals, tangents):
    """Rule of `_with_tangent`."""
    leaf, factor, _ = primals
    floats = [t for t in tangents[2] if jnp.issubdtype(t.dtype, jnp.floating)]
    total = sum((jnp.sum(t) for t in floats), jnp.zeros(()))
    return _with_tangent(*primals), jnp.full_like(leaf, 1.0) * factor * total
