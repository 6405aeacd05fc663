"""Arrays that are joined outside of programs: known ones by NumPy, traced ones by a program.

Where jax takes derivatives outside of `jax.jit`, it would compile each operation with them alone.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import is_on_host
from ..common.types import Array, ArrayLike, Float, Int
from .program_calls import as_program

_T = TypeVar("_T")


def stack_trees(trees: Sequence[_T]) -> _T:
    """Stack the leaves of pytrees of one structure along a new first axis.

    By NumPy, unless a leaf is traced.
    """

    def stack(*leaves):
        traced = any(isinstance(x, jax.core.Tracer) for x in leaves)
        return _stack(leaves) if traced else np.array([np.asarray(x) for x in leaves])

    if type(trees[0]) is np.ndarray:
        return stack(*trees)
    return jax.tree.map(stack, *trees)


def concatenate(arrays: Sequence[ArrayLike]) -> ArrayLike:
    """Concatenate along the first axis, by NumPy unless an array is traced or on another device."""
    if all(isinstance(x, np.ndarray) or is_on_host(x) for x in arrays):
        return np.concatenate([np.asarray(x) for x in arrays])
    return _concatenate(list(arrays))


@as_program
def _concatenate(arrays):
    """Return arrays concatenated along the first axis."""
    return jnp.concatenate([jnp.asarray(x) for x in arrays])


@as_program
def _stack(leaves):
    """Return arrays stacked along a new first axis."""
    return jnp.stack(leaves)


@functools.partial(as_program, static=("shape", "dtype"))
def add_to_zeros(
    parts: Sequence[tuple[Float[ArrayLike, "... k"], int]],
    rows: Int[ArrayLike, " n"],
    *,
    shape: tuple[int, ...],
    dtype: Any,
) -> Float[Array, " ..."]:
    """Return an array of zeros to some of whose rows values are added.

    Args:
        parts: pairs of values, [k] or [n, k], and the index of the first column that they are added
            to.
        rows: row for each of the n values, [n]; repeated rows sum up.
        shape, dtype: of the result, (n_row, n_column).
    """
    total = jnp.zeros(shape, dtype)
    for values, first in parts:
        width = jnp.shape(values)[-1]
        values = jnp.broadcast_to(jnp.asarray(values, dtype), (len(rows), width))
        total = total.at[rows[:, None], first + jnp.arange(width)].add(values)
    return total


@functools.partial(as_program, static=("shape",))
def broadcast(value: Float[ArrayLike, ""], *, shape: tuple[int, ...]) -> Float[Array, " ..."]:
    """Return an array of a shape with one value everywhere."""
    return jnp.broadcast_to(value, shape)
