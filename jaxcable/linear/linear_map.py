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
    leaves, tree = jax.tree.flatten(given)

    def of_leaves(function):
        return lambda x, *leaves: function(x, tree.unflatten(leaves))

    both = of_leaves(function), of_leaves(transpose)
    return _MAP.bind(x, *map(jnp.asarray, leaves), map_and_transpose=both)


# The rules of the primitive take x and `integers`, the arrays in `given` one by one; and the pair
# of functions `map_and_transpose`, both called as ``f(x, *integers)``.


def _evaluate_linear_map(x, *integers, map_and_transpose):
    """Return the value of the map at x; arguments of this and the other rules as said above."""
    return map_and_transpose[0](x, *integers)


def _linear_map_shape(x, *integers, map_and_transpose):
    """Return shape and dtype of the value of the map at x, for tracing."""
    return internals.abstract_array(jax.eval_shape(map_and_transpose[0], x, *integers))


def _linear_map_jvp(primals, tangents, *, map_and_transpose):
    """Forward derivative: return the value, and the map applied to the tangent of x.

    `primals` and `tangents` are those of x, then of the integers, whose tangents are ignored.
    """
    found, change = _MAP.bind(*primals, map_and_transpose=map_and_transpose), tangents[0]
    if internals.is_zero_tangent(change):
        return found, internals.zero_tangent(found)
    return found, _MAP.bind(change, *primals[1:], map_and_transpose=map_and_transpose)


def _linear_map_transpose(back, x, *integers, map_and_transpose):
    """Transpose rule: return the cotangent of x for that of the value, `back`, and None for others.

    It is the transpose applied to `back`: the primitive with its two functions exchanged.
    """
    nothing = [None] * len(integers)
    if internals.is_zero_tangent(back):
        return [None, *nothing]
    return [_MAP.bind(back, *integers, map_and_transpose=map_and_transpose[::-1]), *nothing]


def _linear_map_batch_rule(arguments, axes, *, map_and_transpose):
    """Rule for `jax.vmap`: return the values of a batch, and their batch axis, which is 0.

    `arguments` are x and the integers, `axes` the batch axis of each, or None.
    """
    moved = [
        x if axis is None else jnp.moveaxis(x, axis, 0)
        for x, axis in zip(arguments, axes, strict=True)
    ]
    over = [None if axis is None else 0 for axis in axes]
    size = next(len(x) for x, axis in zip(moved, over, strict=True) if axis == 0)
    if over[0] is None:
        moved[0], over[0] = jnp.broadcast_to(moved[0], (size, *moved[0].shape)), 0
    both = tuple(jax.vmap(each, over) for each in map_and_transpose)
    return _MAP.bind(*moved, map_and_transpose=both), 0


_MAP = internals.define_primitive(
    "linear_map",
    _evaluate_linear_map,
    _linear_map_shape,
    _linear_map_jvp,
    _linear_map_batch_rule,
    _linear_map_transpose,
)
