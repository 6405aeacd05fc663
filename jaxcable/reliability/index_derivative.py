"""The derivative of a reliability index, which the design point makes simple: it is stationary."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from ..common.types import Array, Float, Int, PyTree


def attach_derivative(
    function: Callable[..., Float[Array, " m"]],
    number: Int[Array, ""],
    beta: Float[Array, ""],
    u: Float[Array, " n"],
    slope: Float[Array, ""],
    numbers: list[Array],
) -> Float[Array, ""]:
    """Return `beta` with its derivative by `numbers`, that of limit state `number` over its slope.

    Args:
        function: function of u and `numbers` that returns all limit states.
        number: number of the limit state.
        beta, u, slope: index, design point and length of the gradient there.
        numbers: list of arrays.
    """
    u, slope = without_derivative((u, slope), numbers)  # second derivatives are not known

    @jax.custom_jvp
    def attach(number, beta, u, slope, numbers):
        return beta

    @attach.defjvp
    def differentiate(primals, tangents):
        number, _, u, slope, numbers = primals

        def limit_state(numbers):
            return function(u, numbers)[number]

        rate = jax.jvp(limit_state, (numbers,), (tangents[-1],))[1]
        failed = jnp.where(jnp.isnan(slope), jnp.nan, 0.0)  # also by numbers without influence
        return attach(*primals), rate / slope + failed * _sum_of_floats(tangents[-1])

    return attach(number, beta, u, slope, numbers)


def without_derivative(tree: PyTree[Any], numbers: list[Array]) -> PyTree[Any]:
    """Return a pytree of results of `numbers`, whose derivatives by them are NaN."""

    @jax.custom_jvp
    def mark(leaf, numbers):
        return leaf

    @mark.defjvp
    def differentiate(primals, tangents):
        return mark(*primals), jnp.full_like(primals[0], jnp.nan) * _sum_of_floats(tangents[1])

    return jax.tree.map(lambda leaf: mark(leaf, numbers), tree)


def _sum_of_floats(arrays):
    """Return the sum of all entries of those arrays that are floats."""
    floats = [array for array in arrays if jnp.issubdtype(array.dtype, jnp.floating)]
    return sum((jnp.sum(array) for array in floats), jnp.zeros(()))
