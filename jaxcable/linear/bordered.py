"""A matrix with one more row and column: regular where the matrix alone is singular.

    [ K  c ] [x]   [b]
    [ r  d ] [y] = [e]

With K the tangent stiffness and c the derivative of the residual by the load factor, the bordered
matrix stays regular at limit points (Keller 1977). A sparse K is factorised on the host and the
border eliminated by blocks. Where K is nearly singular this loses digits: both parts of
``x = K^-1 b - y K^-1 c`` are large and nearly cancel. The result is improved iteratively by its
residual, which is judged against the sum of the sizes of its terms, ``|K| |x| + |c| |y| + |b|``
(backward error; ``|K x|`` would be too strict where K x vanishes). If the residual does not come
down to the rounding of these terms, as at a singular K, the whole matrix is factorised with row
exchanges.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax import lax

from ..common import host_calls
from ..common.types import Array, ArrayLike, Bool, Float
from . import host, sparse, unbatched
from .direct import are_pivots_significant, diagonal_scale
from .pattern import Matrix, SparseMatrix
from .solver import solver_named
from .superlu import decompose_lu

# Largest residual of a solution, in roundings (eps) of the sizes of its terms: some roundings add
# up in a row, while a solution that has lost digits at a nearly singular K leaves far more.
_LARGEST_RESIDUAL = 64
# Refinements of a solution by blocks before the whole matrix is factorised: each of them gains
# digits, unless K is so nearly singular that no number of them helps.
_MOST_REFINEMENTS = 4


def solve_bordered(
    matrix: Matrix,
    column: Float[Array, " n"],
    row: Float[Array, " n"],
    corner: Float[ArrayLike, ""],
    rhs: Float[Array, " n"],
    last: Float[ArrayLike, ""],
    loose: Bool[Array, " n"],
) -> tuple[Float[Array, " n"], Float[Array, ""], Bool[Array, ""]]:
    """Solve ``K x + c y = b, r.x + d y = e``, a matrix with one more row and column.

    It is regular also at limit points, where K alone is singular; not differentiable.

    Args:
        matrix: K, [n, n].
        column, row: c and r, [n].
        corner: d, scalar.
        rhs: b, [n].
        last: e, scalar.
        loose: unknowns without stiffness (empty rows and columns), which stay zero, [n] bool.

    Returns:
        x [n], y scalar, and whether the bordered matrix is regular to working precision.
    """
    column, row, rhs = (jnp.where(loose, 0.0, v) for v in (column, row, rhs))
    if isinstance(matrix, SparseMatrix) and not matrix.pattern.solver.on_device:
        return _solve_bordered_on_host(matrix, column, row, corner, rhs, last, loose)
    full = matrix.dense() if isinstance(matrix, SparseMatrix) else matrix
    return _solve_bordered_dense(lax.stop_gradient(full), column, row, corner, rhs, last, loose)


def _solve_bordered_dense(matrix, column, row, corner, rhs, last, loose):
    """Solve ``K x + c y = b, r.x + d y = e`` with a dense K, by LU factors of the whole.

    `matrix` is K, `column` c, `row` r, `corner` d, `rhs` b and `last` e; unknowns in `loose`
    [n] stay zero. Returns x [n], y, and whether the matrix is regular.
    """
    n = len(rhs)
    matrix = jnp.where(loose[:, None] | loose[None, :], jnp.eye(n, dtype=matrix.dtype), matrix)
    size = diagonal_scale(jnp.diagonal(matrix))
    # the unknown y and the last equation are scaled, too, so that pivots can be compared
    width, height = _largest_or_one(column / size), jnp.maximum(_largest_or_one(row / size), 0.0)
    height = jnp.maximum(height, jnp.abs(corner) / width)
    bordered = jnp.block(
        [
            [matrix / size[:, None] / size[None, :], (column / size / width)[:, None]],
            [(row / size / height)[None, :], (corner / width / height).reshape(1, 1)],
        ]
    )
    lu, order = unbatched.lu_factor(bordered)
    regular = are_pivots_significant(jnp.abs(jnp.diagonal(lu)))
    solution = unbatched.lu_solve(lu, order, jnp.append(rhs / size, last / height), False)
    return solution[:-1] / size, solution[-1] / width, regular


def _largest_or_one(v):
    """Return the largest absolute entry of a vector, or 1 if all are zero, for a division by it."""
    largest = jnp.max(jnp.abs(v), initial=0.0)
    return jnp.where(largest > 0, largest, 1.0)


def _solve_bordered_on_host(matrix, column, row, corner, rhs, last, loose):
    """Solve ``K x + c y = b, r.x + d y = e`` with a sparse K, by a call of NumPy on the host.

    Arguments and results are those of `_solve_bordered_dense`.
    """
    p = matrix.pattern
    scalar = jax.ShapeDtypeStruct((), rhs.dtype)
    shapes = (jax.ShapeDtypeStruct(rhs.shape, rhs.dtype), scalar, jax.ShapeDtypeStruct((), bool))
    return host_calls.call_on_host(
        (make_bordered_solver, *sparse.solver_and_storage_words(p)),
        shapes,
        *(p.digest, p.indptr, p.indices, lax.stop_gradient(matrix.values), loose),
        *(column, row, rhs, jnp.asarray(corner, rhs.dtype), jnp.asarray(last, rhs.dtype)),
    )


@host_calls.register_host_function_family
def make_bordered_solver(solver, stored):
    """Return the NumPy function that solves the bordered systems of all cases of a batch.

    `solver` is the name of the linear solver for K; `stored` is "symmetric" if only the upper
    triangle of K is stored, else "general".
    """
    solver, symmetric = solver_named(solver), stored == "symmetric"

    def function(digest, indptr, indices, *arrays):
        batch, rows = host.flatten_batch(arrays[:-2], arrays[-2:])
        with host.analyses_lock:
            analysed = host.analysis_of_pattern(
                solver, symmetric, *host.take_first_case(digest, indptr, indices)
            )
            found = [_solve_bordered_case(analysed, *case) for case in zip(*rows, strict=True)]
        x, y, regular = (np.array(part) for part in zip(*found, strict=True))
        return x.reshape(*batch, -1), y.reshape(batch), regular.reshape(batch)

    return function


def _solve_bordered_case(analysed, values, loose, column, row, rhs, corner, last):
    """Solve ``K x + c y = b, r.x + d y = e`` in NumPy, for one case of a batch.

    `analysed` is the `host.AnalysedPattern` of K, `values` are its stored entries, [n_value];
    other arguments as of `_solve_bordered_dense`. Returns x [n], y, and whether the matrix is
    regular; zeros if it is not.
    """
    n = len(rhs)
    nothing = np.zeros(n), 0.0, False
    numbers = (values, column, row, rhs, corner, last)
    values, column, row, rhs, corner, last = (np.asarray(v, float) for v in numbers)
    if not all(np.isfinite(v).all() for v in (values, column, row, rhs, corner, last)):
        return nothing
    entries = host.with_identity_rows(analysed, values, loose)
    stored = analysed.indices, analysed.indptr, analysed.symmetric
    matrix = host.full_scipy_matrix(entries, *stored)
    # unknowns and equations are scaled as in `_solve_bordered_dense`
    size = host.diagonal_scale(entries[analysed.diagonal])
    width = np.abs(column / size).max(initial=0.0) or 1.0
    height = max(np.abs(row / size).max(initial=0.0), abs(corner) / width) or 1.0
    by_size = sp.diags_array(1 / size)
    whole = sp.block_array(
        [
            [by_size @ matrix @ by_size, (column / size / width)[:, None]],
            [(row / size / height)[None], np.array([[corner / width / height]])],
        ],
        format="csc",
    )
    b = np.append(rhs / size, last / height)
    z = _solve_by_block_elimination(analysed.find_or_make_factor(entries, False), whole, b, size)
    if z is None:
        z = _solve_by_whole_lu(whole, b)
    return nothing if z is None else (z[:-1] / size, z[-1] / width, True)


def _solve_by_block_elimination(factor, whole, b, size):
    """Solve a bordered system by block elimination with a `host.HostFactor` of K.

    `whole` is the bordered matrix (SciPy) with rows and columns of K divided by `size`, and `b` its
    right side. Returns the solution [n + 1], or None if its residual stays too large.
    """
    if factor is None:
        return None
    column, row = whole[:-1, [-1]].toarray()[:, 0], whole[[-1], :-1].toarray()[0]
    corner = whole[-1, -1]
    along = size * factor.solve(size * column)
    schur = corner - row @ along
    if not abs(schur) > len(b) * np.finfo(float).eps * (abs(corner) + np.abs(row) @ np.abs(along)):
        return None

    def eliminate(b):
        x = size * factor.solve(size * b[:-1])
        y = (b[-1] - row @ x) / schur
        return np.append(x - y * along, y)

    return _refine_solution(eliminate, whole, b)


def _solve_by_whole_lu(whole, b):
    """Solve with LU factors of the whole bordered matrix `whole` (SciPy), with pivoting, for `b`.

    Returns the solution [n + 1]; None if the matrix is singular to rounding.
    """
    lu = decompose_lu(whole)
    if lu is None:
        return None
    pivots = np.abs(lu.U.diagonal())
    if not pivots.min() > len(b) * np.finfo(float).eps * pivots.max():
        return None
    return _refine_solution(lu.solve, whole, b)


def _refine_solution(solve, whole, b):
    """Solve ``whole z = b`` by `solve`, an approximate inverse of the matrix, and refinement.

    Returns the solution z, or None if its residual does not fall to rounding.
    """
    sizes, z, left = abs(whole), np.zeros_like(b), b
    for _ in range(1 + _MOST_REFINEMENTS):
        z = z + solve(left)
        left = b - whole @ z
        terms = sizes @ np.abs(z) + np.abs(b)
        # forces (N) and the last equation (another unit) are judged separately
        pairs = ((left[:-1], terms[:-1]), (left[-1:], terms[-1:]))
        allowed = _LARGEST_RESIDUAL * np.finfo(float).eps
        if all(np.abs(residual).max() <= allowed * size.max() for residual, size in pairs):
            return z
    return None
