"""Sums that are gathered: every sum reads what it adds.

A scatter adds each number to its sum, one after the other. Gathers can be done in any order and
need no loop of their own: XLA for CPUs fuses them with what they read, and compiles a loop without
scatters to one function (`common.fusion`). Which numbers belong to a sum is found on the host.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import lax

from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int
from .linear_map import linear_map

_WIDEST = 16  # most numbers that a row of a table adds
_NOTHING = 2**32 - 1  # past every end


@pytree
class Gathering:
    """Sums of rows of an array. A hub, where many rows meet, is summed in parts.

    Attributes:
        tables: the rows that a sum adds, [n_sum, w] each: the first of rows of the array, the
            others of sums of the table before. A position past the end stands for nothing.
        place: the results, [n]: as rows of the array, after these nothing, and then the sums of
            all tables in turn. None if they are the sums of the last table.
        target: the sum that every row is added to, [m]; None if rows are added to several.
    """

    tables: list[Int[ArrayLike, "n_sum w"]]
    place: Int[ArrayLike, " n"] | None
    target: Int[ArrayLike, " m"] | None

    def __call__(self, source: Float[Array, "m ..."]) -> Float[Array, "n ..."]:
        """The sums of rows of `source`, [m, ...]."""
        if self.target is None:
            return self._summed(source)
        return linear_map(_sums, _copies, source, self)

    def spread(self, sums: Float[Array, "n ..."]) -> Float[Array, "m ..."]:
        """For every row the number at its sum, [m, ...]: the transpose."""
        return linear_map(_copies, _sums, sums, self)

    def _summed(self, source):
        # XLA would compute the rows anew for each of their uses, but not what it concatenates
        rows = jnp.concatenate([source, jnp.zeros_like(source[:1])])
        sums, below = [], rows
        for k, table in enumerate(self.tables):
            parts = _at(below, table) if k == 0 else _there(below, table)
            below = jnp.sum(parts, axis=1, dtype=source.dtype)
            sums.append(below)
        if self.place is None:
            return below
        return _at(jnp.concatenate([rows, *sums]) if sums else rows, self.place)


def gathering(
    target: Int[np.ndarray, " k"],
    n: int,
    source: Int[np.ndarray, " k"] | None = None,
    m: int | None = None,
) -> Gathering:
    """The `Gathering` that adds row ``source[k]`` of an array to the sum ``target[k]``.

    Args:
        target: [k], NumPy; n or more for what is not added to any sum.
        n: number of sums; a sum without rows is zero.
        source: [k]; a row may be added to several sums. None for the rows in turn.
        m: number of rows of the array, if `source` is given.
    """
    of_rows = None
    if source is None or m is None:
        source, m, of_rows = np.arange(len(target)), len(target), target.astype(np.uint32)
    used = np.flatnonzero(target < n)
    used = used[np.argsort(target[used], kind="stable")]
    member, owner = source[used], target[used]
    place = np.full(n, m)
    width = _width(np.bincount(owner, minlength=n))
    tables, first = [], m + 1
    while True:  # what has one member has its place, the others are summed
        alone = np.bincount(owner, minlength=n) <= 1
        single = alone[owner]
        place[owner[single]] = member[single] + (0 if not tables else first)
        member, owner = member[~single], owner[~single]
        if not len(owner):
            break
        table, owner = _parts(member, owner, width)
        first += 0 if not tables else len(tables[-1])
        tables.append(np.where(table < 0, _NOTHING if tables else m, table).astype(np.uint32))
        member = np.arange(len(table))
    last = len(tables) > 0 and np.array_equal(place, first + np.arange(n))
    return Gathering(tables, None if last else place.astype(np.uint32), of_rows)


def _sums(rows, gathering):
    return gathering._summed(rows)


def _copies(sums, gathering):
    if not len(sums):  # nothing is free
        return jnp.zeros((len(gathering.target), *sums.shape[1:]), sums.dtype)
    return _there(sums, gathering.target)


def with_zero(values: Float[Array, "n ..."]) -> Float[Array, "n+1 ..."]:
    """An array with zeros after its end, at the position that stands for nothing."""
    zero = jnp.zeros((), values.dtype)
    return lax.pad(values, zero, [(0, 1, 0)] + [(0, 0, 0)] * (values.ndim - 1))


def _parts(member, owner, width):
    """A table of sums of up to `width` members with equal owner, and the owner of each sum.

    Minus one stands for nothing.
    """
    first = np.append(True, owner[1:] != owner[:-1])
    begin = np.maximum.accumulate(np.where(first, np.arange(len(owner)), 0))
    column = (np.arange(len(owner)) - begin) % width
    opens = first | (column == 0)
    row = np.cumsum(opens) - 1
    table = np.full((row[-1] + 1, width), -1)
    table[row, column] = member
    return table, owner[opens]


def _width(count):
    """Width of the tables that read least, for sums of `count` rows."""

    def read(width):
        left, total = count[count > 1], 0
        while len(left):
            left = -(-left // width)
            total += width * left.sum() + count.sum()  # a table, and a pass over what it reads
            left = left[left > 1]
        return total

    return min(range(2, min(max(count.max(initial=0), 2), _WIDEST) + 1), key=read)


def _at(array, positions):
    """Rows of an array; any row where there is none."""
    return jnp.asarray(array).at[positions].get(mode="clip")


def _there(array, positions):
    """Rows of an array, zero where there is none."""
    rows = _at(array, positions)
    return jnp.where(_wide(positions < len(array), rows), rows, jnp.zeros((), rows.dtype))


def _wide(mask, rows):
    """A mask of positions with axes of length 1 for those of rows."""
    return mask.reshape(*mask.shape, *(1,) * (rows.ndim - mask.ndim))
