"""Number of negative eigenvalues of a stiffness, and its eigenvalue nearest to zero: stability.

Dense matrices: all eigenvalues are computed. Sparse matrices are factorised without pivoting on the
host; the signs of the pivots are those of the eigenvalues (Sylvester's law of inertia), and the
eigenvalue nearest to zero is found by inverse Lanczos iteration (ARPACK). A matrix that is
symmetric up to rounding is treated as symmetric, whatever the loads (pressure in a closed ring
follows and has a potential). Unsymmetric matrices have complex eigenvalues, which are computed on
the host, and singular values. In large unsymmetric matrices eigenvalues are not counted; only the
sign of the determinant is known.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla
from jax import lax

from ..common import host_calls
from ..common.types import Array, ArrayLike, Bool, Float, Int
from . import host, unbatched
from .pattern import Matrix, SparseMatrix
from .superlu import decompose_lu, decompose_without_pivoting

# Unknowns up to which a sparse matrix is treated as dense: Lanczos's method (ARPACK) works with 20
# vectors, and needs more unknowns than that.
_DENSE_UNKNOWNS = 40
_INVERSE_ITERATIONS = 40  # near a singular matrix two are enough
# Unknowns up to which eigenvalues of an unsymmetric matrix are counted, which takes 0.13 s for 400
# and grows with their third power (NumPy, one core).
_COUNTED_UNKNOWNS = 400
NOT_COUNTED = -1
"""Stands for the number of negative eigenvalues where it is unknown."""
_ROUNDING = 4  # eigenvalues below 4 n eps of the largest count as zero: n eps is their rounding


def inertia_and_nearest_mode(
    matrix: Matrix,
    loose: Bool[Array, " n"],
    general: bool = False,
    strict: Bool[ArrayLike, ""] = False,
) -> tuple[Int[Array, ""], Float[Array, ""], Float[Array, " n"], Float[Array, " n"]]:
    """Count negative eigenvalues, and find the mode with the eigenvalue nearest to zero.

    For an unsymmetric matrix: the number of eigenvalues with negative real part, and the smallest
    singular value (which is zero where the matrix is singular), with the sign of the real part of
    the eigenvalue nearest to zero. With more than 400 unknowns the number is `NOT_COUNTED`, and the
    sign is that of the determinant. Not differentiable.

    Args:
        matrix: [n, n].
        loose: unknowns without stiffness (empty rows and columns), left out, [n] bool.
        general: whether the matrix may be unsymmetric; it is treated as symmetric if it is so.
        strict: whether to count also negative eigenvalues as small as rounding, scalar. This counts
            noise where eigenvalues stay zero along the path, but it is needed near an eigenvalue
            that crosses zero, to know its sign.

    Returns:
        number: number of negative eigenvalues, int32.
        value: the eigenvalue nearest to zero, or signed singular value.
        right, left: its right and left unit vectors, [n]; NaN where they were not found.
    """
    matrix = lax.stop_gradient(matrix)
    if isinstance(matrix, SparseMatrix) and not matrix.pattern.solver.on_device:
        return _spectrum_on_host(matrix, loose, general, strict)
    full = matrix.dense() if isinstance(matrix, SparseMatrix) else matrix
    largest = jnp.max(jnp.abs(jnp.diagonal(full)), initial=0.0)
    # a loose unknown gets the largest stiffness: positive, and far from zero
    filled = jnp.where(loose, largest, 0.0)
    apart = jnp.where(loose[:, None] | loose[None, :], 0.0, full) + jnp.diag(filled)
    sound = jnp.all(jnp.isfinite(apart))
    nan = jnp.where(sound, 1.0, jnp.nan).astype(full.dtype)
    one = jnp.eye(len(apart), dtype=apart.dtype)
    apart = jnp.where(sound, apart, one)
    sure = jnp.where(strict, 0.0, _ROUNDING * len(apart) * jnp.finfo(apart.dtype).eps)
    sure = sure.astype(apart.dtype)
    if general:
        found = lax.cond(
            is_symmetric(apart), _spectrum_of_symmetric, _spectrum_of_unsymmetric, apart, sure
        )
    else:
        found = _spectrum_of_symmetric(apart, sure)
    number, value, right, left = found
    return number, value * nan, right * nan, left * nan


@jax.jit
def is_symmetric(matrix: Float[Array, "n n"]) -> Bool[Array, ""]:
    """Return whether a tangent stiffness [n, n] is symmetric up to rounding; True if it has NaN."""
    size = jnp.sqrt(jnp.abs(jnp.diagonal(matrix)))
    # sums of many rotations lose digits, as do squares of their angles: more than a few eps
    tol = jnp.finfo(matrix.dtype).eps ** (2 / 3)
    return ~jnp.any(jnp.abs(matrix - matrix.T) > tol * jnp.outer(size, size))


def _spectrum_of_symmetric(matrix, sure):
    """Return (number of negative eigenvalues, the one nearest to zero, its vector twice).

    Args:
        matrix: dense and symmetric, [n, n].
        sure: eigenvalues below this part of the largest count as zero.
    """
    values, vectors = unbatched.eigh(0.5 * (matrix + matrix.T))
    nearest = jnp.argmin(jnp.abs(values))
    number = jnp.sum(values < -sure * jnp.max(jnp.abs(values))).astype(jnp.int32)
    vector = vectors[:, nearest]
    return number, values[nearest], vector, vector


def _spectrum_of_unsymmetric(matrix, sure):
    """Return (number of negative eigenvalues, smallest singular value, right and left vector).

    `matrix` is dense; the value has the sign of the eigenvalue nearest to zero. Real parts below
    `sure` of the largest eigenvalue count as zero.
    """
    left, values, right = unbatched.svd(matrix)
    if len(matrix) > _COUNTED_UNKNOWNS:
        count, sign = jnp.int32(NOT_COUNTED), unbatched.slogdet(matrix)[0]
    else:
        out = jax.ShapeDtypeStruct((), jnp.int32), jax.ShapeDtypeStruct((), matrix.dtype)
        count, sign = host_calls.call_on_host([make_negative_eigenvalue_counter], out, matrix, sure)
    return count, sign * values[-1], right[-1], left[:, -1]


@host_calls.register_host_function_family
def make_negative_eigenvalue_counter():
    """Return the NumPy function that counts negative eigenvalues of dense unsymmetric matrices."""
    return _count_negative_eigenvalues


def _count_negative_eigenvalues(matrix, sure):
    """Count eigenvalues with negative real part, and find the sign of the one nearest to zero.

    Takes matrices [..., n, n]; real parts below `sure` of the largest absolute value count as zero.
    Returns numbers, and signs as 1.0 or -1.0, both [...].
    """
    values = np.linalg.eigvals(matrix)
    size = np.abs(values)
    limit = np.asarray(sure)[..., None] * size.max(axis=-1, keepdims=True)
    number = (values.real < -limit).sum(axis=-1)
    nearest = np.take_along_axis(values, size.argmin(axis=-1)[..., None], axis=-1)[..., 0]
    return number.astype(np.int32), np.where(nearest.real < 0, -1.0, 1.0)


def _spectrum_on_host(matrix, loose, general, strict):
    """Return inertia and nearest mode of a sparse matrix, on the host, by NumPy.

    Arguments and results are those of `inertia_and_nearest_mode`.
    """
    p = matrix.pattern
    of_scalar = (jax.ShapeDtypeStruct((), dtype) for dtype in (jnp.int32, matrix.values.dtype))
    of_vector = jax.ShapeDtypeStruct(loose.shape, matrix.values.dtype)
    stored = "symmetric" if p.symmetric else "general"
    return host_calls.call_on_host(
        (make_spectrum_finder, stored, "may be unsymmetric" if general else "is symmetric"),
        (*of_scalar, of_vector, of_vector),
        *(p.indptr, p.indices, matrix.values, loose, jnp.asarray(strict)),
    )


@host_calls.register_host_function_family
def make_spectrum_finder(stored, kind):
    """Return the NumPy function that counts negative eigenvalues and finds modes in a batch.

    `stored` is "symmetric" (only the upper triangle) or "general", `kind` "is symmetric" or "may be
    unsymmetric".
    """
    symmetric, general = stored == "symmetric", kind == "may be unsymmetric"

    def function(indptr, indices, values, loose, strict):
        batch, (own, held, *rest) = host.flatten_batch((values, loose), (strict,))
        rows = own.astype(np.float64), held, *rest
        apart = np.finfo(values.dtype).eps ** (2 / 3) if general else None
        matrix = host.take_first_case(indptr, indices)
        found = [
            _spectrum_of_sparse_case(symmetric, apart, *matrix, *case)
            for case in zip(*rows, strict=True)
        ]
        number, value, *vectors = (np.array(column) for column in zip(*found, strict=True))
        right, left = (vector.reshape(*batch, -1) for vector in vectors)
        return number.reshape(batch), value.reshape(batch), right, left

    return function


def _spectrum_of_sparse_case(symmetric, apart, indptr, indices, values, loose, strict):
    """Count negative eigenvalues of a matrix in compressed rows, and find its mode nearest to zero.

    With `symmetric` only the upper triangle is stored; `apart` is the tolerance for symmetry, None
    if that is known. Returns (number, eigenvalue or singular value, right and left vector).
    """
    n = len(indptr) - 1
    whole = host.full_scipy_matrix(values, indices, indptr, symmetric)
    keep = np.flatnonzero(~loose)
    whole = whole.tocsc()[:, keep][keep]
    nothing = np.int32(0), np.nan, np.full(n, np.nan), np.full(n, np.nan)
    if not np.isfinite(whole.data).all() or len(keep) == 0:
        return nothing
    unsymmetric = apart is not None and not is_sparse_symmetric(whole, apart)
    sure = 0.0 if strict else _ROUNDING * np.finfo(float).eps
    if unsymmetric:
        found = _spectrum_of_sparse_unsymmetric(whole, sure)
    else:
        found = _spectrum_of_sparse_symmetric(0.5 * (whole + whole.T), sure)
    if found is None:
        return nothing
    number, value, *vectors = found
    right, left = np.zeros(n), np.zeros(n)
    right[keep], left[keep] = vectors
    return np.int32(number), value, right, left


def _spectrum_of_sparse_symmetric(matrix, sure):
    """Return (number of negative eigenvalues, the one nearest to zero, its vector twice), or None.

    `sure` is the part of the largest stiffness below which eigenvalues count as zero. None means
    that the SciPy matrix cannot be factorised.
    """
    n = matrix.shape[0]
    eps = np.finfo(float).eps
    if n <= _DENSE_UNKNOWNS:  # Lanczos needs more unknowns than vectors
        values, vectors = np.linalg.eigh(matrix.toarray())
        nearest = np.abs(values).argmin()
        number = (values < -sure * n * np.abs(values).max()).sum()
        return number, values[nearest], vectors[:, nearest], vectors[:, nearest]
    size = np.abs(matrix.diagonal()).max()
    lu = decompose_without_pivoting(matrix)
    if lu is None:  # exactly singular: shift it by its rounding
        lu = decompose_without_pivoting(
            matrix + sp.diags_array(np.full(n, eps * size), format="csc")
        )
    if lu is None:
        return None
    number = (lu.U.diagonal() < -sure * size).sum()
    start = np.random.default_rng(0).standard_normal(n)  # a vector without symmetry
    inverse = sla.LinearOperator(matrix.shape, lu.solve, dtype=float)
    try:
        value, vector = sla.eigsh(matrix, k=1, sigma=0.0, OPinv=inverse, v0=start)
    except sla.ArpackNoConvergence:
        return number, np.nan, np.full(n, np.nan), np.full(n, np.nan)
    return number, value[0], vector[:, 0], vector[:, 0]


def is_sparse_symmetric(matrix: Any, tol: float) -> bool:
    """Return whether a SciPy matrix is symmetric up to `tol` times the roots of its diagonal."""
    size = np.sqrt(np.abs(matrix.diagonal()))
    apart = abs(matrix - matrix.T).tocoo()
    return not (apart.data > tol * size[apart.row] * size[apart.col]).any()


def _spectrum_of_sparse_unsymmetric(matrix, sure):
    """Return (number of negative eigenvalues, smallest singular value, right and left vector).

    None if the SciPy matrix is singular. Real parts of eigenvalues below n `sure` of the largest
    count as zero.
    """
    n = matrix.shape[0]
    counted = (
        _count_negative_eigenvalues(matrix.toarray(), n * sure) if n <= _COUNTED_UNKNOWNS else None
    )
    if n <= _DENSE_UNKNOWNS:
        left, values, right = np.linalg.svd(matrix.toarray())
        return counted[0], counted[1] * values[-1], right[-1], left[:, -1]
    lu = decompose_lu(matrix)
    if lu is None:
        return None
    if counted is None:
        sign = (
            np.prod(np.sign(lu.U.diagonal()))
            * _permutation_sign(lu.perm_r)
            * _permutation_sign(lu.perm_c)
        )
        counted = NOT_COUNTED, sign
    right = np.random.default_rng(0).standard_normal(n)
    for _ in range(
        _INVERSE_ITERATIONS
    ):  # inverse iteration with the transposed matrix and the matrix
        left = lu.solve(right, "T")
        left /= np.linalg.norm(left)
        right = lu.solve(left)
        value = 1 / np.linalg.norm(right)
        right *= value
    return counted[0], counted[1] * value, right, left


def _permutation_sign(permutation):
    """Return 1 for an even permutation, -1 for an odd one."""
    seen, sign = np.zeros(len(permutation), bool), 1
    for start in range(len(permutation)):
        length = 0
        while not seen[start]:
            seen[start] = True
            start, length = permutation[start], length + 1
        sign *= -1 if length and length % 2 == 0 else 1
    return sign
