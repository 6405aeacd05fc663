"""Functions that are traced only where they are needed: rarely taken branches of a condition.

A program that is evaluated by NumPy never needs to know a branch that it does not take. Within a
program the call is a primitive of jax. XLA gets what it stands for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp

from . import jax_internals as internals
from .tree import merge_indices, split_indices

Tree = TypeVar("Tree")


def deferred(function: Callable[..., Tree], like: Tree) -> Callable[..., Tree]:
    """Return a function of pytrees that is traced only when it is evaluated or differentiated.

    Compiling a program that calls it traces it, too.

    Args:
        function: function of pytrees of arrays; it must not close over traced values.
        like: pytree of arrays in the shapes and dtypes of its result.
    """
    split, slots = split_indices(like)
    values, shape = jax.tree.flatten(split)
    shapes = tuple(internals.abstract_argument(x) for x in values)

    def run(*arguments):
        leaves, tree = jax.tree.flatten(split_indices(arguments))

        def flat(*leaves):
            found, _ = split_indices(function(*merge_indices(*tree.unflatten(leaves))))
            pairs = zip(jax.tree.leaves(found), shapes, strict=True)
            return [jnp.asarray(x, own.dtype) for x, own in pairs]

        found = _DEFERRED.bind(*map(internals.as_operand, leaves), function=flat, shapes=shapes)
        return merge_indices(shape.unflatten(found), slots)

    return run


def _evaluate(*leaves, function, shapes):
    """Return the results of a deferred function for known arrays: the value of the primitive."""
    return function(*leaves)


def _evaluate_in_xla(*leaves, function, shapes):
    """Return the results of a deferred function within a program that XLA compiles, a list.

    The function is traced here, and equations that no result needs are left out.
    """
    program = internals.without_unused_equations(jax.make_jaxpr(function)(*leaves))
    return internals.function_of_jaxpr(program)(*leaves)


def _result_shapes(*_, function, shapes):
    """Return the abstract arrays of the results from their known `shapes`, without tracing."""
    return [internals.abstract_array(x) for x in shapes]


def _jvp_rule(primals, tangents, *, function, shapes):
    """Return the results of a deferred function and their tangents, for which it is traced."""
    return internals.value_and_tangents(function, primals, tangents)


def _batch_rule(arguments, axes, *, function, shapes):
    """Return the results of a deferred function mapped by `jax.vmap`, and their batch axes, all 0.

    The mapped function is deferred as well. `axes` are the batch axes of the arguments, None where
    one is not mapped.
    """
    size = next(x.shape[a] for x, a in zip(arguments, axes, strict=True) if a is not None)
    mapped = jax.vmap(function, tuple(axes), axis_size=size)
    more = tuple(jax.ShapeDtypeStruct((size, *x.shape), x.dtype) for x in shapes)
    return _DEFERRED.bind(*arguments, function=mapped, shapes=more), [0] * len(shapes)


def _drop_unused_results(used, count, *, function, shapes):
    """Return parameters of a call without the results that are not `used` (dead code elimination).

    Returns which results remain, which of the `count` arguments remain (all), and the new
    parameters.
    """

    def fewer(*leaves):
        return [x for x, own in zip(function(*leaves), used, strict=True) if own]

    kept = tuple(x for x, own in zip(shapes, used, strict=True) if own)
    return used, [True] * count, {"function": fewer, "shapes": kept}


_DEFERRED = internals.define_primitive(
    "deferred",
    _evaluate,
    _result_shapes,
    _jvp_rule,
    _batch_rule,
    lowered=_evaluate_in_xla,
    multiple_results=True,
    narrow=_drop_unused_results,
)
