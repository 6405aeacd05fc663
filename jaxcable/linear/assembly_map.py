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
    """Map that sums rows of an array [m, ...] to [n, ...], such as element end forces to nodes.

    It gathers and never scatters. A sum of many rows (a hub of a net) is the sum of partial sums.

    Attributes:
        tables: positions of the rows that a sum adds, [n_sum, w] each: in the first table, of rows
            of the array; in each other, of sums of the table before. A position past the end adds
            zero.
        place: where each result stands, [n], in the list of all rows of the array, one row of
            zeros, and the sums of all tables in turn. None if the results are the sums of the last
            table.
        target: index of the sum that every row is added to, [m]; None if rows are added to several.
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
        """Return for every row the sum that it is added to, [m, ...], or zero: the transpose."""
        return linear_map(_copy_sums_to_rows, _sum_rows, sums, self)

    def _sum_by_tables(self, source):
        """Return the sums [n, ...] of rows of `source`, [m, ...], computed table by table."""
        # XLA would compute the rows anew for each of their uses, but not what it concatenates
        rows = jnp.concatenate([source, jnp.zeros_like(source[:1])])
        sums, below = [], rows
        for k, table in enumerate(self.tables):
            parts = _gather_rows(below, table) if k == 0 else _gather_rows_or_zero(below, table)
            below = jnp.sum(parts, axis=1, dtype=source.dtype)
            sums.append(below)
        if self.place is None:
            return below
        return _gather_rows(jnp.concatenate([rows, *sums]) if sums else rows, self.place)


def make_assembly_map(
    target: Int[np.ndarray, " k"],
    n: int,
    source: Int[np.ndarray, " k"] | None = None,
    m: int | None = None,
) -> AssemblyMap:
    """Make the `AssemblyMap` that adds row ``source[k]`` of an array to the sum ``target[k]``.

    Args:
        target: index of the sum, [k], NumPy; n or more for a row that is not added to any sum.
        n: number of sums; a sum without rows is zero.
        source: index of the row, [k]; a row may be added to several sums. None for rows 0, 1, 2 ...
        m: number of rows of the array, if `source` is given.
    """
    of_rows = None
    if source is None or m is None:
        source, m, of_rows = np.arange(len(target)), len(target), target.astype(np.uint32)
    used = np.flatnonzero(target < n)
    used = used[np.argsort(target[used], kind="stable")]
    member, owner = source[used], target[used]
    place = np.full(n, m)
    count = np.bincount(owner, minlength=n)
    width = _best_table_width(count)
    tables, first = [], m + 1
    while True:  # what has one member has its place, the others are summed
        alone = np.bincount(owner, minlength=n) <= 1
        single = alone[owner]
        place[owner[single]] = member[single] + (0 if not tables else first)
        member, owner = member[~single], owner[~single]
        if not len(owner):
            break
        table, owner = _make_partial_sum_table(member, owner, width)
        first += 0 if not tables else len(tables[-1])
        tables.append(np.where(table < 0, _NO_ROW if tables else m, table).astype(np.uint32))
        member = np.arange(len(owner))
    last = len(tables) > 0 and np.array_equal(place, first + np.arange(n))
    return AssemblyMap(tables, None if last else place.astype(np.uint32), of_rows)


def _sum_rows(rows, assembly_map):
    """Return the sums [n, ...] of rows [m, ...] by an `AssemblyMap`; called by `linear_map`."""
    return assembly_map._sum_by_tables(rows)


def _copy_sums_to_rows(sums, assembly_map):
    """Return for every row the sum it belongs to, [m, ...]: the transpose of `_sum_rows`."""
    if not len(sums):  # nothing is free
        return jnp.zeros((len(assembly_map.target), *sums.shape[1:]), sums.dtype)
    return _gather_rows_or_zero(sums, assembly_map.target)


def append_zero(values: Float[Array, "n ..."]) -> Float[Array, "n+1 ..."]:
    """Append a zero (row) to an array along its first axis; indices past the end refer to it."""
    zero = jnp.zeros((), values.dtype)
    return lax.pad(values, zero, [(0, 1, 0)] + [(0, 0, 0)] * (values.ndim - 1))


def _make_partial_sum_table(member, owner, width):
    """Make a table of partial sums, each of up to `width` rows that belong to the same sum.

    Args:
        member: positions of the rows that are added, [k].
        owner: index of the sum that each belongs to, [k], ascending.
        width: number of columns of the table.

    Returns:
        The table, [n_partial, width], -1 where it adds nothing; the sum that each partial sum
        belongs to, [n_partial].
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
    """Return the table width with which least is read, if `count` rows, [n], are added to sums."""

    def read(width):
        left, total = count[count > 1], 0
        while len(left):
            left = -(-left // width)
            total += width * left.sum() + count.sum()  # a table, and a pass over what it reads
            left = left[left > 1]
        return total

    return min(range(2, min(max(count.max(initial=0), 2), _MOST_COLUMNS) + 1), key=read)


def _gather_rows(array, positions):
    """Return the rows of an array at these positions; past its end, its last row."""
    return jnp.asarray(array).at[positions].get(mode="clip")


def _gather_rows_or_zero(array, positions):
    """Return the rows of an array at these positions; past its end, zeros."""
    rows = _gather_rows(array, positions)
    return jnp.where(
        _append_axes_to_mask(positions < len(array), rows), rows, jnp.zeros((), rows.dtype)
    )


def _append_axes_to_mask(mask, rows):
    """Append axes of length 1 to a mask of rows, so that it broadcasts against `rows`."""
    return mask.reshape(*mask.shape, *(1,) * (rows.ndim - mask.ndim))
