"""Where entries of element matrices go in a sparse matrix; found once a structure, on the host.

A tangent is assembled as a list of values on a fixed pattern. The contributions of the elements
are put into the order of their targets beforehand, so that assembly is a gather and a sorted sum.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import copy, places, pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from .solver import Solver, choose

_WIDEST = 40  # half-bandwidth up to which batches of small systems are solved as banded ones


@pytree(static=("size", "symmetric", "solver"))
class Pattern:
    """Sparsity of a square matrix in compressed rows, and the way of element entries into it.

    Attributes:
        source: contributions that count, as positions among all entries of all element matrices
            one after the other, [n_part].
        target: the value that each of them is added to, ascending, [n_part].
        indptr, indices: compressed rows, [n + 1], [n_value]; columns ascending.
        diagonal: positions of the diagonal among the values, [n].
        digest: 128 bits that stand for `indptr` and `indices`, [4] uint32.
        order: unknowns in an order of small bandwidth b, [n]; None if `symmetric` is not so, or b
            is too large.
        band: where the values of ``A[order][:, order]`` are, by columns from the diagonal down,
            [n, b + 1]; n_value for a zero.
        table: where the values of a whole row are, [n, n], likewise; of a solver on the device.
        size: n.
        symmetric: only the upper triangle is stored.
        solver: `solver.Solver`.
    """

    source: Int[Array, " n_part"]
    target: Int[Array, " n_part"]
    indptr: Int[Array, " n+1"]
    indices: Int[Array, " n_value"]
    diagonal: Int[Array, " n"]
    digest: Int[Array, " 4"]
    order: Int[Array, " n"] | None = None
    band: Int[Array, "n b+1"] | None = None
    table: Int[Array, "n n"] | None = None
    size: int = 0
    symmetric: bool = False
    solver: Solver = None  # type: ignore[assignment]  # `make_pattern` chooses one


def make_pattern(
    numbers: Iterable[Int[np.ndarray, "n_elem d"]],
    size: int,
    symmetric: bool,
    name: str | None = None,
    exchanges_rows: bool = False,
) -> Pattern:
    """The pattern that element matrices with the given unknowns fill.

    Args:
        numbers: per group of elements, the unknown of every row of an element matrix, NumPy
            [n_elem, d]; `size` or more for a row that is left out.
        size: number of unknowns n.
        symmetric: store the upper triangle only.
        name: of a solver, or None to choose.
        exchanges_rows: whether the solver has to be able to.
    """
    rows, columns, sources, offset = [], [], [], 0
    for number in numbers:
        n_elem, d = number.shape
        row = np.repeat(number, d, axis=1).ravel()
        column = np.tile(number, (1, d)).ravel()
        keep = (row < size) & (column < size)
        if symmetric:
            keep &= column >= row
        sources.append(offset + np.flatnonzero(keep))
        rows.append(row[keep])
        columns.append(column[keep])
        offset += n_elem * d * d
    key = np.concatenate(rows).astype(np.int64) * size + np.concatenate(columns)
    order = np.argsort(key, kind="stable")
    key = key[order]
    first = np.append(True, key[1:] != key[:-1])
    entries = key[first]
    row, indices = entries // size, entries % size
    indptr = np.searchsorted(row, np.arange(size + 1))
    diagonal = np.searchsorted(entries, np.arange(size, dtype=np.int64) * (size + 1))
    # every unknown is one of some element, whose matrix has its diagonal
    assert np.array_equal(entries[diagonal], np.arange(size, dtype=np.int64) * (size + 1))
    indptr, indices = indptr.astype(np.int32), indices.astype(np.int32)
    digest = hashlib.blake2b(indptr.tobytes() + indices.tobytes(), digest_size=16).digest()
    arrays = (
        places(np.concatenate(sources)[order]),
        places(np.cumsum(first) - 1),
        indptr,
        indices,
        places(diagonal),
        np.frombuffer(digest, np.uint32),
        *(_band(row, indices, size) if symmetric else (None, None)),
    )
    solver = choose(size, arrays[-1] is not None, name, exchanges_rows)
    table = _table(row, indices, size, symmetric) if solver.on_device else None
    with jax.ensure_compile_time_eval():  # arrays, also when a caller is being traced
        placed: list[Any] = [None if a is None else jax.device_put(a) for a in (*arrays, table)]
    return Pattern(*placed, size, symmetric, solver)  # type: ignore[call-arg]  # nine arrays


def _band(rows, columns, size):
    """`Pattern.order` and `.band` for an upper triangle, or None for both."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    if size > _WIDEST**2:
        return None, None
    upper = csr_matrix((np.ones(len(rows)), (rows, columns)), (size, size))
    order = reverse_cuthill_mckee(upper + upper.T, symmetric_mode=True)
    place = np.empty(size, np.int64)
    place[order] = np.arange(size)
    low, high = np.minimum(place[rows], place[columns]), np.maximum(place[rows], place[columns])
    width = int(np.max(high - low, initial=0)) + 1
    if width > _WIDEST + 1:
        return None, None
    band = np.full((size, width), len(rows), np.int32)
    band[low, high - low] = np.arange(len(rows))
    return order.astype(np.int32), band


def _table(rows, columns, size, symmetric):
    """`Pattern.table`."""
    table = np.full((size, size), len(rows), np.uint32)
    table[rows, columns] = np.arange(len(rows))
    if symmetric:
        table[columns, rows] = table[rows, columns]
    return table


@pytree
class Sparse:
    """A matrix: values on a pattern.

    Attributes:
        values: entries in the order of the pattern, [n_value].
        pattern: `Pattern`.
    """

    values: Float[Array, " n_value"]
    pattern: Pattern

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.pattern.size, self.pattern.size

    def diagonal(self) -> Float[Array, " n"]:
        """The diagonal, [n]."""
        return self.values[self.pattern.diagonal]

    def plus_diagonal(self, shift: Float[ArrayLike, ""]) -> Sparse:
        """This matrix and `shift`, a scalar, on its diagonal."""
        at = self.values.at[self.pattern.diagonal]
        values = at.add(shift, indices_are_sorted=True, unique_indices=True)
        return copy(self, values=values)

    def plus_entry(self, place: Int[ArrayLike, ""], value: Float[ArrayLike, ""]) -> Sparse:
        """This matrix and `value` on one place of its diagonal."""
        return copy(self, values=self.values.at[self.pattern.diagonal[place]].add(value))

    def held_at(self, held: Bool[Array, " n"], stiffness: Float[Array, ""]) -> Sparse:
        """This matrix with rows and columns `held`, [n] bool, empty but for the diagonal."""
        touched = held[self._rows()] | held[self.pattern.indices]
        values = jnp.where(touched, 0.0, self.values)
        diagonal = jnp.where(held, stiffness, values[self.pattern.diagonal])
        return copy(self, values=values.at[self.pattern.diagonal].set(diagonal))

    def or_identity(self, valid: Bool[ArrayLike, ""]) -> Sparse:
        """This matrix where `valid`, else the identity."""
        one = jnp.zeros_like(self.values).at[self.pattern.diagonal].set(1.0)
        return copy(self, values=jnp.where(valid, self.values, one))

    def dense(self) -> Float[Array, "n n"]:
        """This matrix as an array [n, n]."""
        if self.pattern.table is not None:
            return jnp.append(self.values, 0.0)[self.pattern.table]
        rows, columns = self._rows(), self.pattern.indices
        full = (
            jnp.zeros(self.shape, self.values.dtype)
            .at[rows, columns]
            .set(self.values, indices_are_sorted=True, unique_indices=True)
        )
        if self.pattern.symmetric:
            full = full.at[columns, rows].set(self.values, unique_indices=True)
        return full

    def banded(self) -> Float[Array, "n b+1"]:
        """Lower band of ``A[order][:, order]`` by columns, [n, b + 1]; see `banded`."""
        return jnp.append(self.values, 0.0)[self.pattern.band]

    def _rows(self):
        """Row of every value, [n_value]."""
        p = self.pattern
        return jnp.repeat(
            jnp.arange(p.size, dtype=jnp.int32),
            jnp.diff(p.indptr),
            total_repeat_length=len(p.indices),
        )

    def __matmul__(self, v: Float[Array, " n"]) -> Float[Array, " n"]:
        """Product with a vector [n]."""
        p, rows = self.pattern, self._rows()
        product = jnp.zeros_like(v).at[rows].add(self.values * v[p.indices])
        if not p.symmetric:
            return product
        product = product.at[p.indices].add(self.values * v[rows])
        return product - self.diagonal() * v


Matrix: TypeAlias = 'Float[Array, "n n"] | Sparse'
"""A square matrix."""


def assemble(
    parts: Sequence[tuple[Float[Array, "n_elem d d"], Int[Array, "n_elem d"]]],
    number: int,
    pattern: Pattern | None,
) -> Matrix:
    """Sum element matrices.

    Args:
        parts: list of (matrices [n_elem, d, d], unknowns of their rows [n_elem, d]).
        number: of unknowns; a row with this number is left out.
        pattern: None for a dense result [number, number], or the `Pattern` made of the same
            unknowns for a `Sparse` one.
    """
    if pattern is None:
        matrix = jnp.zeros((number, number), parts[0][0].dtype)
        for blocks, rows in parts:
            # rows left out are out of range, dropped
            matrix = matrix.at[rows[:, :, None], rows[:, None, :]].add(blocks, mode="drop")
        return matrix
    each = [blocks.reshape(-1) for blocks, _ in parts]
    entries = each[0] if len(each) == 1 else jnp.concatenate(each)
    # computed once, and not again for every entry that is taken from them
    entries = jax.lax.optimization_barrier(entries)
    n_value = pattern.indices.shape[0]
    values = jnp.zeros(n_value, entries.dtype)
    values = values.at[pattern.target].add(entries[pattern.source], indices_are_sorted=True)
    return Sparse(values, pattern)
