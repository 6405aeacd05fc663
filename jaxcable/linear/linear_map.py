"""Linear functions with a given transpose, as a primitive of jax.

jax transposes a gather to a scatter, which keeps XLA for CPUs from compiling a loop to one function
(`common.fusion`). Where the sums of the transpose can be gathered, too, it is told how.
`jax.custom_derivatives.linear_call` is the same without `jax.vmap` (jax 0.10).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from ..common import jax_internals as internals
from ..common.types import Array, PyTree


def linear_map(
    function: Callable[[Array, PyTree[Any]], Array],
    transpose: Callable[[Array, PyTree[Any]], Array],
    x: Array,
    given: PyTree[Any],
) -> Array:
    """Return ``function(x, given)``, linear in x, with a transpose that is told and not derived.

    Args:
        function: function of an array and of `given`, linear in the array.
        transpose: its transpose, ``transpose(y, given)``, which reverse mode applies.
        x: an array.
        given: a pytree of integers, which have no derivatives.
    """
    if _MAP is None:  # jax transposes it, which is slower
        return function(x, given)
    leaves, tree = jax.tree.flatten(given)

    def of_leaves(function):
        return lambda x, *leaves: function(x, tree.unflatten(leaves))

    pair = of_leaves(function), of_leaves(transpose)
    return _MAP.bind(x, *map(jnp.asarray, leaves), pair=pair)


def _evaluate_linear_map(x, *leaves, pair):
    """Return the value of the primitive: the first function of the `pair` at x and `leaves`.

    `pair` is (function, transpose); `leaves` are the arrays in `given`, without derivatives.
    """
    return pair[0](x, *leaves)


def _linear_map_shape(x, *leaves, pair):
    """Return shape and dtype of the result, for tracing."""
    return internals.abstract_array(jax.eval_shape(pair[0], x, *leaves))


def _linear_map_jvp(primals, tangents, *, pair):
    """Rule for `jax.jvp`: return the value, and the map applied to the tangent of x.

    `primals` are x and the `leaves`, whose tangents are ignored; `pair` is (function, transpose).
    """
    found, change = _MAP.bind(*primals, pair=pair), tangents[0]
    if internals.is_zero_tangent(change):
        return found, internals.zero_tangent(found)
    return found, _MAP.bind(change, *primals[1:], pair=pair)


def _linear_map_transpose(back, x, *leaves, pair):
    """Rule for transposition: return the cotangent of x, and None for each of the `leaves`.

    It is the primitive at the cotangent `back` of the result, with the `pair` in the other order.
    """
    nothing = [None] * len(leaves)
    if internals.is_zero_tangent(back):
        return [None, *nothing]
    return [_MAP.bind(back, *leaves, pair=pair[::-1]), *nothing]


def _linear_map_batch_rule(arguments, axes, *, pair):
    """Rule for `jax.vmap`: apply the primitive to a batch, with both functions mapped over it."""
    moved = [
        x if axis is None else jnp.moveaxis(x, axis, 0)
        for x, axis in zip(arguments, axes, strict=True)
    ]
    over = [None if axis is None else 0 for axis in axes]
    size = next(len(x) for x, axis in zip(moved, over, strict=True) if axis == 0)
    if over[0] is None:
        moved[0], over[0] = jnp.broadcast_to(moved[0], (size, *moved[0].shape)), 0
    return _MAP.bind(*moved, pair=tuple(jax.vmap(each, over) for each in pair)), 0


_MAP = internals.define_primitive(
    "linear_map",
    _evaluate_linear_map,
    _linear_map_shape,
    _linear_map_jvp,
    _linear_map_batch_rule,
    _linear_map_transpose,
)
