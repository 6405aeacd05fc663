"""Sums that are gathered: every sum reads what it adds.

A scatter adds each number to its sum, one after the other. Gathers can be done in any order and
need no loop of their own: XLA for CPUs fuses them with what they read, and compiles a loop without
scatters to one function (`common.fusion`). Which numbers belong to a sum is found on the host.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import lax

from ..common.tree import places, pytree
from ..common.types import Array, ArrayLike, Float, Int

_WIDEST = 16  # most numbers that a row of a table adds


@pytree
class Gathering:
    """Sums of rows of an array. A hub, where many rows meet, is summed in parts.

    Attributes:
        tables: positions of the rows that a sum adds, [n_sum, w] each; rows are numbered from those
            of the array on: a row of zeros, and the sums of this and of earlier tables.
        place: positions of the results, [n]; None if they are the sums of the last table.
    """

    tables: list[Int[ArrayLike, "n_sum w"]]
    place: Int[ArrayLike, " n"] | None

    def __call__(self, source: Float[Array, "m ..."]) -> Float[Array, "n ..."]:
        """The sums of rows of `source`, [m, ...]."""
        known = with_zero(source)
        sums = known
        for k, table in enumerate(self.tables):
            if k > 0:
                known = jnp.concatenate([known, sums])
            sums = jnp.sum(_at(known, table), axis=1, dtype=known.dtype)
        if self.place is None:
            return sums
        if self.tables:
            known = jnp.concatenate([known, sums])
        return _at(known, self.place)


def gathering(target: Int[np.ndarray, " m"], n: int) -> Gathering:
    """The `Gathering` that adds row k of an array to the sum ``target[k]``.

    Args:
        target: [m], NumPy; n or more for rows that are not added to any sum.
        n: number of sums; a sum without rows is zero.
    """
    member = np.flatnonzero(target < n)
    member = member[np.argsort(target[member], kind="stable")]
    owner = target[member]
    width = _width(np.bincount(owner, minlength=n))
    known, tables, zero = len(target) + 1, [], len(target)
    whole = False
    while (several := np.bincount(owner, minlength=n) > 1).any():
        kept = ~several[owner]
        table, new_owner = _parts(member[~kept], owner[~kept], width, zero)
        tables.append(places(table.astype(np.int32)))
        whole = len(new_owner) == n and bool(several.all())
        new = known + np.arange(len(table))
        member, owner = np.append(member[kept], new), np.append(owner[kept], new_owner)
        known += len(table)
    if whole:
        return Gathering(tables, None)
    place = np.full(n, zero, np.int32)
    place[owner] = member
    return Gathering(tables, places(place))


def with_zero(values: Float[Array, "n ..."]) -> Float[Array, "n+1 ..."]:
    """An array with zeros after its end, at the position that stands for nothing."""
    zero = jnp.zeros((), values.dtype)
    return lax.pad(values, zero, [(0, 1, 0)] + [(0, 0, 0)] * (values.ndim - 1))


def _parts(member, owner, width, zero):
    """A table of sums of up to `width` members with equal owner, and the owner of each sum."""
    first = np.append(True, owner[1:] != owner[:-1])
    begin = np.maximum.accumulate(np.where(first, np.arange(len(owner)), 0))
    column = (np.arange(len(owner)) - begin) % width
    opens = first | (column == 0)
    row = np.cumsum(opens) - 1
    table = np.full((row[-1] + 1, width), zero)
    table[row, column] = member
    return table, owner[opens]


def _width(count):
    """Width of the tables that read least, for sums of `count` rows."""

    def read(width):
        left, total = count[count > 1], 0
        while len(left):
            left = -(-left // width)
            total += width * left.sum() + count.sum()  # a table, and a copy of what is known
            left = left[left > 1]
        return total

    return min(range(2, min(max(count.max(initial=0), 2), _WIDEST) + 1), key=read)


def _at(array, positions):
    return array.at[positions].get(mode="promise_in_bounds")
