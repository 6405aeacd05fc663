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

_MOST_COLUMNS = 16  # numbers that a row of a table adds at most; where more meet, sums are summed
_NO_ROW = 2**32 - 1  # a position past every end


@pytree
class AssemblyMap:
    """Sum rows of an array, such as end forces at nodes; a hub, where many meet, in parts.

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
        """Return the sums of rows of `source`, [m, ...]."""
        if self.target is None:
            return self._sum_by_tables(source)
        return linear_map(_sum_rows, _copy_sums_to_rows, source, self)

    def apply_transpose(self, sums: Float[Array, "n ..."]) -> Float[Array, "m ..."]:
        """Apply the transpose: return for every row the number at its sum, [m, ...]."""
        return linear_map(_copy_sums_to_rows, _sum_rows, sums, self)

    def _sum_by_tables(self, source):
        # XLA would compute the rows anew for each of their uses, but not what it concatenates
        """Sum the rows of an array, table by table."""
        rows = jnp.concatenate([source, jnp.zeros_like(source[:1])])
        sums, below = [], rows
        for k, table in enumerate(self.tables):
            parts = _rows_at(below, table) if k == 0 else _rows_at_or_zero(below, table)
            below = jnp.sum(parts, axis=1, dtype=source.dtype)
            sums.append(below)
        if self.place is None:
            return below
        return _rows_at(jnp.concatenate([rows, *sums]) if sums else rows, self.place)


def make_assembly_map(
    target: Int[np.ndarray, " k"],
    n: int,
    source: Int[np.ndarray, " k"] | None = None,
    m: int | None = None,
) -> AssemblyMap:
    """Make the `AssemblyMap` that adds row ``source[k]`` of an array to the sum ``target[k]``.

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
    width = _best_table_width(np.bincount(owner, minlength=n))
    tables, first = [], m + 1
    while True:  # what has one member has its place, the others are summed
        alone = np.bincount(owner, minlength=n) <= 1
        single = alone[owner]
        place[owner[single]] = member[single] + (0 if not tables else first)
        member, owner = member[~single], owner[~single]
        if not len(owner):
            break
        table, owner = _partial_sums(member, owner, width)
        first += 0 if not tables else len(tables[-1])
        tables.append(np.where(table < 0, _NO_ROW if tables else m, table).astype(np.uint32))
        member = np.arange(len(table))
    last = len(tables) > 0 and np.array_equal(place, first + np.arange(n))
    return AssemblyMap(tables, None if last else place.astype(np.uint32), of_rows)


def _sum_rows(rows, gathering):
    """Return the sums of rows; as a function for `linear_map`."""
    return gathering._sum_by_tables(rows)


def _copy_sums_to_rows(sums, gathering):
    """Return for every row the number at its sum; as a function for `linear_map`."""
    if not len(sums):  # nothing is free
        return jnp.zeros((len(gathering.target), *sums.shape[1:]), sums.dtype)
    return _rows_at_or_zero(sums, gathering.target)


def append_zero(values: Float[Array, "n ..."]) -> Float[Array, "n+1 ..."]:
    """Append a zero to an array, at the position that stands for nothing."""
    zero = jnp.zeros((), values.dtype)
    return lax.pad(values, zero, [(0, 1, 0)] + [(0, 0, 0)] * (values.ndim - 1))


def _partial_sums(member, owner, width):
    """Return a table of partial sums, of up to `width` rows of one owner each, and their owners.

    Args:
        member: what is added, positions of rows.
        owner: the sum that each belongs to, ascending.
        width: number of columns of the table; -1 in it stands for nothing.
    """
    first = np.append(True, owner[1:] != owner[:-1])
    begin = np.maximum.accumulate(np.where(first, np.arange(len(owner)), 0))
    column = (np.arange(len(owner)) - begin) % width
    opens = first | (column == 0)
    row = np.cumsum(opens) - 1
    table = np.full((row[-1] + 1, width), -1)
    table[row, column] = member
    return table, owner[opens]


def _best_table_width(count):
    """Return the width with which tables read least, for sums of `count` rows."""

    def read(width):
        left, total = count[count > 1], 0
        while len(left):
            left = -(-left // width)
            total += width * left.sum() + count.sum()  # a table, and a pass over what it reads
            left = left[left > 1]
        return total

    return min(range(2, min(max(count.max(initial=0), 2), _MOST_COLUMNS) + 1), key=read)


def _rows_at(array, positions):
    """Return rows of an array; any row at positions past its end."""
    return jnp.asarray(array).at[positions].get(mode="clip")


def _rows_at_or_zero(array, positions):
    """Return rows of an array; zero at positions past its end."""
    rows = _rows_at(array, positions)
    return jnp.where(_mask_of_rows(positions < len(array), rows), rows, jnp.zeros((), rows.dtype))


def _mask_of_rows(mask, rows):
    """Reshape a mask of positions so that it broadcasts over the entries of rows."""
    return mask.reshape(*mask.shape, *(1,) * (rows.ndim - mask.ndim))
