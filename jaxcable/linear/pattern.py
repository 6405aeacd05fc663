"""Sparsity patterns, sparse matrices on them, and their assembly from element matrices.

A pattern is found once per structure, on the host; a matrix is a list of values on it. Which
entries of element matrices add up to a value is found with the pattern, so that assembly gathers.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..common.tree import copy_with, pytree, unsigned_indices
from ..common.types import Array, ArrayLike, Bool, Float, Int
from .assembly_map import AssemblyMap, append_zero, make_assembly_map
from .solver import Solver, choose_solver

# Half-bandwidth up to which batches of small systems are solved as banded systems: the work grows
# with its square, and so does the program (`banded` has figures).
_WIDEST_BAND = 40


@pytree(static=("size", "paired", "symmetric", "solver"))
class Pattern:
    """Sparsity pattern of a square matrix, and which entries of element matrices add up to a value.

    Attributes:
        sums: assembly map from the entries of all element matrices, one after the other, to the
            values of the matrix.
        indptr, indices: compressed rows, [n + 1], [n_value]; columns ascending.
        diagonal: positions of the diagonal among the values, [n].
        rows: row of every value, [n_value].
        digest: 128 bits that stand for `indptr` and `indices`, [4] uint32.
        order: unknowns in an order of small bandwidth b, [n]; None if b is too large.
        place: position of every unknown in `order`, [n], or None.
        band: positions among the values of ``A[order][:, order]``, by columns from the diagonal
            down, [n, b + 1]; n_value for a zero. None if `order` is.
        upper_band: likewise by rows from the diagonal to the right, [n, b + 1]; None if `order` is,
            or if `symmetric`.
        table: positions among the values of the entries of the dense matrix, [n, n], n_value for a
            zero; None unless the solver needs it.
        opposite: True for values that are minus their sum, [n_value]; None if none is.
        size: n.
        paired: for every group of elements whether its matrices are ``[[B, -B], [-B, B]]``, of
            which only B [3, 3] is read; then `sums` begin with B of all elements, by its entries.
        symmetric: whether only the upper triangle is stored.
        solver: the linear solver for matrices on this pattern.
    """

    sums: AssemblyMap
    indptr: Int[Array, " n+1"]
    indices: Int[Array, " n_value"]
    diagonal: Int[Array, " n"]
    rows: Int[Array, " n_value"]
    digest: Int[Array, " 4"]
    order: Int[Array, " n"] | None = None
    place: Int[Array, " n"] | None = None
    band: Int[Array, "n b+1"] | None = None
    upper_band: Int[Array, "n b+1"] | None = None
    table: Int[Array, "n n"] | None = None
    opposite: Bool[Array, " n_value"] | None = None
    size: int = 0
    paired: tuple[bool, ...] = ()
    symmetric: bool = False
    solver: Solver = None  # type: ignore[assignment]  # `make_pattern` chooses one


def make_pattern(
    numbers: Iterable[Int[np.ndarray, "n_elem d"]],
    size: int,
    symmetric: bool,
    name: str | None = None,
    exchanges_rows: bool = False,
    definite: bool = False,
    paired: Sequence[bool] = (),
) -> Pattern:
    """Make the sparsity pattern of a matrix that is assembled from element matrices.

    Args:
        numbers: for every group of elements the unknowns of the rows of its matrices, NumPy
            [n_elem, d]; `size` or more for a row that is left out.
        size: number of unknowns n.
        symmetric: whether to store the upper triangle only.
        name: name of a linear solver, or None to choose one.
        exchanges_rows: whether the solver must exchange rows.
        definite: whether all matrices are known to be positive semidefinite.
        paired: for every group whether its matrices are ``[[B, -B], [-B, B]]``; empty if none are.
            Where two groups join the same unknowns with different signs, this is not used.
    """
    numbers = list(numbers)
    key, source, opposite, m = _list_matrix_entries(numbers, size, symmetric, paired)
    entries, target = np.unique(key, return_inverse=True)
    some, all_ = np.zeros(len(entries), bool), np.ones(len(entries), bool)
    np.logical_or.at(some, target, opposite)
    np.logical_and.at(all_, target, opposite)
    if (some != all_).any():
        return make_pattern(numbers, size, symmetric, name, exchanges_rows, definite)
    row, indices = (entries // size).astype(np.int32), (entries % size).astype(np.int32)
    band = _band_positions(row, indices, size, symmetric)
    banded = symmetric and band[0] is not None
    solver = choose_solver(size, banded, name, exchanges_rows, definite)
    indptr = np.searchsorted(row, np.arange(size + 1)).astype(np.int32)
    diagonal = np.searchsorted(entries, np.arange(size, dtype=np.int64) * (size + 1))
    assert (row[diagonal] == indices[diagonal]).all()  # every unknown belongs to an element
    digest = hashlib.blake2b(indptr.tobytes() + indices.tobytes(), digest_size=16).digest()
    solver.begin_loading_library()
    whole = solver.on_device and not solver.definite
    table = _dense_positions(row, indices, size, symmetric) if whole else None
    arrays = indptr, indices, unsigned_indices(diagonal), row, np.frombuffer(digest, np.uint32)
    arrays = *arrays, *band, table, some if some.any() else None
    with jax.ensure_compile_time_eval():  # concrete arrays, also when a caller is being traced
        found = make_assembly_map(np.searchsorted(entries, key), len(entries), source, m)
        sums = jax.tree.map(jax.device_put, found)
        placed: list[Any] = [None if a is None else jax.device_put(a) for a in arrays]
    fields: list[Any] = [sums, *placed, size, tuple(paired), symmetric, solver]
    return Pattern(*fields)


def _list_matrix_entries(numbers, size, symmetric, paired):
    """List all entries of element matrices that are added to the matrix.

    `numbers`, [n_elem, d] for each group, are the unknowns of the rows of element matrices.

    Returns:
        key: row times `size` plus column of the value that each entry is added to.
        source: position of each entry among the numbers that `assemble_matrix` reads.
        opposite: whether each is minus the number at this position.
        count: how many numbers `assemble_matrix` reads.
    """
    keys, sources, signs, m = [], [], [], 0
    for k, number in enumerate(numbers):
        n_elem, d = number.shape
        row = np.repeat(number, d, axis=1).ravel()
        column = np.tile(number, (1, d)).ravel()
        keep = (row < size) & (column < size)
        if symmetric:
            keep &= column >= row
        if k < len(paired) and paired[k]:
            at, element = np.arange(6) % 3, np.arange(n_elem)[:, None, None]
            where = (3 * at[:, None] + at) * n_elem + element
            end = np.arange(6) // 3
            minus = np.broadcast_to(end[:, None] != end, where.shape).ravel()
            where, count = where.ravel(), 9 * n_elem
        else:
            where, count = np.arange(n_elem * d * d), n_elem * d * d
            minus = np.zeros(count, bool)
        keys.append((row.astype(np.int64) * size + column)[keep])
        sources.append(m + where[keep])
        signs.append(minus[keep])
        m += count
    return *(np.concatenate(parts) for parts in (keys, sources, signs)), m


def _band_positions(rows, columns, size, symmetric):
    """Return `order`, `place`, `band`, `upper_band` of a `Pattern`; None if the band is too wide.

    `rows` and `columns` are those of the values, [n_value], of a matrix of this `size`. Where
    only the upper triangle is stored (`symmetric`), there is no `upper_band`.
    """
    if size > _WIDEST_BAND**2:
        return (None,) * 4
    order, place = narrow_band_order(_symmetric_matrix(rows, columns, size))
    row, column = place[rows], place[columns]
    width = int(np.max(np.abs(row - column), initial=0)) + 1
    if width > _WIDEST_BAND + 1:
        return (None,) * 4
    bands, low = np.full((2, size, width), len(rows), np.int32), np.minimum(row, column)
    above = (row < column) & (not symmetric)
    bands[above.astype(int), low, np.abs(row - column)] = np.arange(len(rows))
    bands[1, :, 0] = bands[0, :, 0]
    placed = order, place.astype(np.int32), bands[0], None if symmetric else bands[1]
    return tuple(None if array is None else unsigned_indices(array) for array in placed)


def _symmetric_matrix(rows, columns, size):
    """Return a symmetric SciPy matrix [size, size] with entries at `rows`, `columns`."""
    upper = sp.csr_matrix((np.ones(len(rows)), (rows, columns)), (size, size))
    return upper + upper.T


def narrow_band_order(matrix: Any) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Order the unknowns of a symmetric SciPy matrix for a small bandwidth (Cuthill-McKee).

    Returns:
        The unknowns in this order, and the position of every unknown in it, both [n].
    """
    order = reverse_cuthill_mckee(matrix, symmetric_mode=True)
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return order, place


def _dense_positions(rows, columns, size, symmetric):
    """Return the position among the values of every entry of the dense matrix, [n, n].

    It is the number of values where an entry is zero. `rows` and `columns` are those of the
    values.
    """
    table = np.full((size, size), len(rows), np.uint32)
    table[rows, columns] = np.arange(len(rows))
    if symmetric:
        table[columns, rows] = table[rows, columns]
    return table


@pytree
class SparseMatrix:
    """A sparse square matrix, stored as the values on a sparsity pattern.

    Attributes:
        values: entries in the order of the pattern, [n_value].
        pattern: the sparsity pattern.
    """

    values: Float[Array, " n_value"]
    pattern: Pattern

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and number of columns, (n, n)."""
        return self.pattern.size, self.pattern.size

    def diagonal(self) -> Float[Array, " n"]:
        """Return the diagonal of this matrix, [n]."""
        return self.values[self.pattern.diagonal]

    def add_to_diagonal(self, shift: Float[ArrayLike, ""]) -> SparseMatrix:
        """Return this matrix with `shift`, a scalar, added to its diagonal."""
        return copy_with(
            self, values=jnp.where(self._is_diagonal, self.values + shift, self.values)
        )

    def add_to_diagonal_entry(
        self, place: Int[ArrayLike, ""], value: Float[ArrayLike, ""]
    ) -> SparseMatrix:
        """Return this matrix with `value` added to its diagonal entry with the index `place`."""
        here = jnp.arange(len(self.values)) == self.pattern.diagonal[place]
        return copy_with(self, values=jnp.where(here, self.values + value, self.values))

    def hold_unknowns(self, held: Bool[Array, " n"], stiffness: Float[Array, ""]) -> SparseMatrix:
        """Return this matrix with zero rows and columns for the unknowns `held`, [n] bool.

        Their diagonal entries become `stiffness`, a scalar.
        """
        touched = held[self.pattern.rows] | held[self.pattern.indices]
        left = jnp.where(self._is_diagonal, stiffness, 0.0)
        return copy_with(self, values=jnp.where(touched, left, self.values))

    def divide_rows_and_columns(self, size: Float[Array, " n"]) -> SparseMatrix:
        """Return this matrix with entry (i, j) divided by ``size[i] size[j]``, for `size` [n]."""
        p = self.pattern
        return copy_with(self, values=self.values / size[p.rows] / size[p.indices])

    def identity_unless(self, valid: Bool[ArrayLike, ""]) -> SparseMatrix:
        """Return this matrix if the scalar `valid` is true, else the identity on its pattern."""
        one = self._is_diagonal.astype(self.values.dtype)
        return copy_with(self, values=jnp.where(valid, self.values, one))

    def dense(self) -> Float[Array, "n n"]:
        """Return this matrix as a dense array, [n, n]."""
        if self.pattern.table is not None:
            return append_zero(self.values)[self.pattern.table]
        rows, columns = self.pattern.rows, self.pattern.indices
        full = (
            jnp.zeros(self.shape, self.values.dtype)
            .at[rows, columns]
            .set(self.values, indices_are_sorted=True, unique_indices=True)
        )
        if self.pattern.symmetric:
            full = full.at[columns, rows].set(self.values, unique_indices=True)
        return full

    def banded(self) -> Float[Array, "n b+1"]:
        """Return the lower band, [n, b + 1], of this matrix in the order ``pattern.order``.

        It is that of the symmetric part, if both triangles are stored.
        """
        values = append_zero(self.values)
        lower = values[self.pattern.band]
        if self.pattern.upper_band is None:
            return lower
        return 0.5 * (lower + values[self.pattern.upper_band])

    @property
    def _is_diagonal(self):
        """Mask that is True for the values on the diagonal, [n_value]."""
        return self.pattern.rows == self.pattern.indices

    def __matmul__(self, v: Float[Array, " n"]) -> Float[Array, " n"]:
        """Multiply by a vector [n]."""
        p, rows = self.pattern, self.pattern.rows
        product = jnp.zeros_like(v).at[rows].add(self.values * v[p.indices])
        if not p.symmetric:
            return product
        product = product.at[p.indices].add(self.values * v[rows])
        return product - self.diagonal() * v


Matrix: TypeAlias = 'Float[Array, "n n"] | SparseMatrix'
"""A square matrix."""


def assemble_matrix(
    parts: Sequence[tuple[Float[Array, "n_elem d d"], Int[Array, "n_elem d"]]],
    number: int,
    pattern: Pattern | None,
) -> Matrix:
    """Assemble a square matrix from the matrices of all elements.

    Args:
        parts: list of (element matrices [n_elem, d, d], indices of their unknowns [n_elem, d]).
        number: number of unknowns; element rows and columns with this index are left out.
        pattern: `Pattern` made with the same indices, for a `SparseMatrix` as a result; None for a
            dense one, [number, number].
    """
    if pattern is None:
        matrix = jnp.zeros((number, number), parts[0][0].dtype)
        for blocks, rows in parts:
            # rows that are left out are out of range: "drop" ignores them
            matrix = matrix.at[rows[:, :, None], rows[:, None, :]].add(blocks, mode="drop")
        return matrix
    flat = []
    for k, (blocks, _) in enumerate(parts):
        if k < len(pattern.paired) and pattern.paired[k]:
            blocks = jnp.moveaxis(blocks[:, 3:, 3:], 0, -1)
        flat.append(blocks.reshape(-1))
    entries = flat[0] if len(flat) == 1 else jnp.concatenate(flat)
    # the barrier keeps XLA from computing an element matrix again for every entry that is gathered
    entries = jax.lax.optimization_barrier(entries)
    values = pattern.sums(entries)
    if pattern.opposite is not None:
        values = jnp.where(pattern.opposite, -values, values)
    return SparseMatrix(values, pattern)
