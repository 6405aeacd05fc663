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
    """Apply a linear function, ``function(x, given)``, whose transpose is ``transpose(y, given)``.

    Args:
        function, transpose: functions of an array and of `given`.
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


def _evaluate_map(x, *leaves, pair):
    """Evaluate the function of the pair (function, transpose)."""
    return pair[0](x, *leaves)


def _result_shape(x, *leaves, pair):
    """Return shape and dtype of the result."""
    return internals.abstract_array(jax.eval_shape(pair[0], x, *leaves))


def _map_jvp(primals, tangents, *, pair):
    """Apply the map to the tangent: rule of the forward derivative."""
    found, change = _MAP.bind(*primals, pair=pair), tangents[0]
    if internals.is_zero_tangent(change):
        return found, internals.zero_tangent(found)
    return found, _MAP.bind(change, *primals[1:], pair=pair)


def _map_transpose(back, x, *leaves, pair):
    """Apply the pair in the other order to the cotangent: rule of the transpose."""
    nothing = [None] * len(leaves)
    if internals.is_zero_tangent(back):
        return [None, *nothing]
    return [_MAP.bind(back, *leaves, pair=pair[::-1]), *nothing]


def _map_batch_rule(arguments, axes, *, pair):
    """Map both functions of the pair over a batch: rule for `jax.vmap`."""
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
    "linear_map", _evaluate_map, _result_shape, _map_jvp, _map_batch_rule, _map_transpose
)
