"""Sparsity patterns, sparse matrices on them, and their assembly from element matrices.

A pattern is found once per structure, on the host; a matrix is a list of values on it. The
contributions of the elements are sorted by their targets when the pattern is found, so that
assembly is a gather and a sorted sum.
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

_WIDEST = 40  # half-bandwidth up to which batches of small systems are solved as banded systems


@pytree(static=("size", "symmetric", "solver"))
class Pattern:
    """Sparsity of a square matrix in compressed rows, and where element entries are added.

    Attributes:
        source: entries of element matrices that are added, as positions among all entries of all
            element matrices one after the other, [n_part].
        target: the value that each of these entries is added to, ascending, [n_part].
        indptr, indices: compressed rows, [n + 1], [n_value]; columns ascending.
        diagonal: positions of the diagonal among the values, [n].
        digest: 128 bits that stand for `indptr` and `indices`, [4] uint32.
        order: unknowns in an order of small bandwidth b, [n]; None if `symmetric` is False or b is
            too large.
        band: positions of the values of ``A[order][:, order]``, by columns from the diagonal down,
            [n, b + 1]; n_value for a zero.
        table: positions of the values of the dense matrix, [n, n], likewise; None unless the solver
            is one on the device.
        size: n.
        symmetric: whether only the upper triangle is stored.
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
        numbers: for every group of elements the unknowns of the rows of its matrices, NumPy
            [n_elem, d]; `size` or more for a row that is left out.
        size: number of unknowns n.
        symmetric: whether to store the upper triangle only.
        name: name of a solver, or None to choose one.
        exchanges_rows: whether the solver must exchange rows.
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
    # every unknown belongs to an element, so that all of the diagonal is there
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
    with jax.ensure_compile_time_eval():  # concrete arrays, also when a caller is being traced
        placed: list[Any] = [None if a is None else jax.device_put(a) for a in (*arrays, table)]
    return Pattern(*placed, size, symmetric, solver)  # type: ignore[call-arg]  # nine arrays


def _band(rows, columns, size):
    """`Pattern.order` and `.band` of an upper triangle; (None, None) if the band is too wide."""
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
    """A sparse matrix: values on a pattern.

    Attributes:
        values: entries in the order of the pattern, [n_value].
        pattern: `Pattern`.
    """

    values: Float[Array, " n_value"]
    pattern: Pattern

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return self.pattern.size, self.pattern.size

    def diagonal(self) -> Float[Array, " n"]:
        """The diagonal, [n]."""
        return self.values[self.pattern.diagonal]

    def plus_diagonal(self, shift: Float[ArrayLike, ""]) -> Sparse:
        """This matrix with `shift`, a scalar, added to its diagonal."""
        at = self.values.at[self.pattern.diagonal]
        values = at.add(shift, indices_are_sorted=True, unique_indices=True)
        return copy(self, values=values)

    def plus_entry(self, place: Int[ArrayLike, ""], value: Float[ArrayLike, ""]) -> Sparse:
        """This matrix with `value` added to entry `place` of its diagonal."""
        return copy(self, values=self.values.at[self.pattern.diagonal[place]].add(value))

    def held_at(self, held: Bool[Array, " n"], stiffness: Float[Array, ""]) -> Sparse:
        """This matrix with rows and columns `held`, [n] bool, empty but for a `stiffness`."""
        touched = held[self._rows()] | held[self.pattern.indices]
        values = jnp.where(touched, 0.0, self.values)
        diagonal = jnp.where(held, stiffness, values[self.pattern.diagonal])
        return copy(self, values=values.at[self.pattern.diagonal].set(diagonal))

    def or_identity(self, valid: Bool[ArrayLike, ""]) -> Sparse:
        """This matrix if `valid`, else the identity."""
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
        number: number of unknowns; a row with this number is left out.
        pattern: `Pattern` of the same unknowns for a `Sparse` result; None for a dense one,
            [number, number].
    """
    if pattern is None:
        matrix = jnp.zeros((number, number), parts[0][0].dtype)
        for blocks, rows in parts:
            # rows that are left out are out of range: "drop" ignores them
            matrix = matrix.at[rows[:, :, None], rows[:, None, :]].add(blocks, mode="drop")
        return matrix
    flat = [blocks.reshape(-1) for blocks, _ in parts]
    entries = flat[0] if len(flat) == 1 else jnp.concatenate(flat)
    # the barrier keeps XLA from computing an element matrix again for every entry that is gathered
    entries = jax.lax.optimization_barrier(entries)
    n_value = pattern.indices.shape[0]
    values = jnp.zeros(n_value, entries.dtype)
    values = values.at[pattern.target].add(entries[pattern.source], indices_are_sorted=True)
    return Sparse(values, pattern)
