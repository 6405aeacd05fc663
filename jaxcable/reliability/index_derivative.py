"""The derivative of a reliability index, which the design point makes simple: it is stationary."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from ..common.types import Array, Bool, Float, Int, PyTree
from ..numerics.implicit_root import with_deferred_derivative
from .search import Point


def attach_derivative(
    function: Callable[..., Float[Array, " m"]],
    number: Int[Array, ""],
    beta: Float[Array, ""],
    point: Point,
    numbers: list[Array],
) -> Float[Array, ""]:
    """Return `beta` with its derivative by `numbers`, that of the limit state over its slope.

    Args:
        function: function of u and `numbers` that returns all limit states; it is traced once more
            if the derivative is taken.
        number: number of the limit state.
        beta: index, NaN if the search has failed; so is its derivative then.
        point: design point.
        numbers: list of arrays.
    """
    beta, point = lax.stop_gradient((beta, point))

    def limit_state(parameters):
        u, number, numbers = parameters
        return function(u, numbers)[number]

    value = with_deferred_derivative(limit_state, point.value, (point.u, number, numbers))
    slope = without_derivative(point.slope(), numbers)  # so second derivatives are NaN
    change = _over_slope(value - lax.stop_gradient(value), slope)
    failed = jnp.where(jnp.isnan(beta), jnp.nan, 0.0)
    return _with_tangent(beta, failed, numbers) + change


def without_derivative(tree: PyTree[Any], numbers: list[Array]) -> PyTree[Any]:
    """Return a pytree of results of `numbers`, whose derivatives by them are NaN."""
    return jax.tree.map(lambda leaf: _with_tangent(leaf, jnp.nan, numbers), tree)


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
