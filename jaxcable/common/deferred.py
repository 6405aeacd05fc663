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
    """Return a function of pytrees that is traced when it is evaluated, compiled or differentiated.

    Args:
        function: it must not close over traced values; their indices may be traced.
        like: a pytree of arrays in the shapes and dtypes of its result.
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
    """Return the results: the value of the primitive."""
    return function(*leaves)


def _compile(*leaves, function, shapes):
    """Return the results for XLA, without equations that no result needs."""
    program = internals.without_unused_equations(jax.make_jaxpr(function)(*leaves))
    return internals.function_of_jaxpr(program)(*leaves)


def _shapes(*_, function, shapes):
    """Shape rule of the primitive."""
    return [internals.abstract_array(x) for x in shapes]


def _jvp(primals, tangents, *, function, shapes):
    """Forward derivative: that of the function, which is traced."""
    return internals.differentiate_moving(function, primals, tangents)


def _batch(arguments, axes, *, function, shapes):
    """Rule for `jax.vmap`: the mapped function, deferred."""
    size = next(x.shape[a] for x, a in zip(arguments, axes, strict=True) if a is not None)
    mapped = jax.vmap(function, tuple(axes), axis_size=size)
    more = tuple(jax.ShapeDtypeStruct((size, *x.shape), x.dtype) for x in shapes)
    return _DEFERRED.bind(*arguments, function=mapped, shapes=more), [0] * len(shapes)


def _narrow(used, count, *, function, shapes):
    """Leave out results that are not used."""

    def fewer(*leaves):
        return [x for x, own in zip(function(*leaves), used, strict=True) if own]

    kept = tuple(x for x, own in zip(shapes, used, strict=True) if own)
    return used, [True] * count, {"function": fewer, "shapes": kept}


_DEFERRED = internals.define_primitive(
    "deferred",
    _evaluate,
    _shapes,
    _jvp,
    _batch,
    lowered=_compile,
    multiple_results=True,
    narrow=_narrow,
)
