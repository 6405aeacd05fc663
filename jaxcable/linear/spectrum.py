"""Signs and the eigenvalue nearest to zero of a stiffness: whether a state is stable, and where
it ceases to be.

Dense matrices get all eigenvalues. Sparse ones are factorised without pivoting on the host, which
tells the signs (Sylvester's law of inertia), and the eigenvalue nearest to zero is found by inverse
Lanczos iteration (ARPACK). Unsymmetric ones have singular values in their place.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax import lax

from . import sparse
from .pattern import Sparse

_FEW = 40  # unknowns that are treated as a dense matrix on the host too
_INVERSE = 40  # inverse iterations; near a singular matrix two are enough
_ROUNDING = 4  # times n eps of the largest eigenvalue: a negative one below that is none


def spectrum(matrix, loose, general=False):
    """Number of negative eigenvalues, and the one nearest to zero; not differentiable.

    Of a general matrix: 1 if its determinant is negative, else 0; the smallest singular value with
    the sign of the determinant; and its two vectors. It passes zero where the matrix is singular.

    Args:
        matrix: [n, n].
        loose: unknowns with empty rows and columns, left out, [n] bool.
        general: whether the matrix is unsymmetric.

    Returns:
        number int32, value, right and left unit vectors [n]; NaN where they were not found.
    """
    matrix = lax.stop_gradient(matrix)
    if isinstance(matrix, Sparse) and matrix.pattern.solver != "dense":
        return _on_host(matrix, loose, general)
    full = matrix.dense() if isinstance(matrix, Sparse) else matrix
    largest = jnp.max(jnp.abs(jnp.diagonal(full)), initial=0.0)
    # a loose unknown gets a stiffness that is the least interesting one
    own = jnp.where(loose, largest, 0.0)
    apart = jnp.where(loose[:, None] | loose[None, :], 0.0, full) + jnp.diag(own)
    sound = jnp.all(jnp.isfinite(apart))
    nan = jnp.where(sound, 1.0, jnp.nan).astype(full.dtype)
    one = jnp.eye(len(apart), dtype=apart.dtype)
    apart = jnp.where(sound, apart, one)
    if general:
        left, values, right = jnp.linalg.svd(apart)
        sign = jnp.linalg.slogdet(apart)[0]
        number = (sign < 0).astype(jnp.int32)
        return number, sign * values[-1] * nan, right[-1] * nan, left[:, -1] * nan
    values, vectors = jnp.linalg.eigh(0.5 * (apart + apart.T))
    limit = _ROUNDING * len(values) * jnp.finfo(values.dtype).eps * jnp.max(jnp.abs(values))
    nearest = jnp.argmin(jnp.abs(values))
    number = jnp.sum(values < -limit).astype(jnp.int32)
    vector = vectors[:, nearest] * nan
    return number, values[nearest] * nan, vector, vector


def _on_host(matrix, loose, general):
    p = matrix.pattern
    shapes = (
        jax.ShapeDtypeStruct((), jnp.int32),
        jax.ShapeDtypeStruct((), matrix.values.dtype),
        jax.ShapeDtypeStruct(loose.shape, matrix.values.dtype),
        jax.ShapeDtypeStruct(loose.shape, matrix.values.dtype),
    )
    function = _analyser(p.symmetric, general)
    return sparse._call(function, shapes, p.indptr, p.indices, matrix.values, loose)


@functools.cache
def _analyser(symmetric, general):
    def function(indptr, indices, values, loose):
        batch = np.broadcast_shapes(values.shape[:-1], loose.shape[:-1])
        rows = sparse._rows(values, batch).astype(np.float64), sparse._rows(loose, batch)
        first = [array.reshape(-1, array.shape[-1])[0] for array in (indptr, indices)]
        found = [_analyse(symmetric, general, *first, *pair) for pair in zip(*rows, strict=True)]
        number, value, *vectors = (np.array(column) for column in zip(*found, strict=True))
        right, left = (vector.reshape(*batch, -1) for vector in vectors)
        return number.reshape(batch), value.reshape(batch), right, left

    return function


def _analyse(symmetric, general, indptr, indices, values, loose):
    """`spectrum` of one matrix in compressed rows."""
    n = len(indptr) - 1
    stored = sp.csr_matrix((values, indices, indptr), (n, n))
    whole = stored + sp.triu(stored, 1).T if symmetric else stored
    keep = np.flatnonzero(~loose)
    whole = whole.tocsc()[:, keep][keep]
    nothing = np.int32(0), np.nan, np.full(n, np.nan), np.full(n, np.nan)
    if not np.isfinite(whole.data).all() or len(keep) == 0:
        return nothing
    found = _signed_singular(whole) if general else _signed_eigenvalue(0.5 * (whole + whole.T))
    if found is None:
        return nothing
    number, value, *vectors = found
    right, left = np.zeros(n), np.zeros(n)
    right[keep], left[keep] = vectors
    return np.int32(number), value, right, left


def _signed_eigenvalue(matrix):
    """Negative eigenvalues, the one nearest to zero and its vector, twice; None if not found."""
    import scipy.sparse.linalg as sla  # slow to import

    n = matrix.shape[0]
    eps = np.finfo(float).eps
    if n <= _FEW:  # Lanczos needs room
        values, vectors = np.linalg.eigh(matrix.toarray())
        nearest = np.abs(values).argmin()
        number = (values < -_ROUNDING * n * eps * np.abs(values).max()).sum()
        return number, values[nearest], vectors[:, nearest], vectors[:, nearest]
    size = np.abs(matrix.diagonal()).max()
    lu = _unpivoted(matrix)
    if lu is None:  # singular to the last digit: a nudge of its rounding
        lu = _unpivoted(matrix + sp.diags_array(np.full(n, eps * size), format="csc"))
    if lu is None:
        return None
    number = (lu.U.diagonal() < -_ROUNDING * eps * size).sum()
    start = np.random.default_rng(0).standard_normal(n)  # no symmetry of its own
    inverse = sla.LinearOperator(matrix.shape, lu.solve, dtype=float)
    try:
        value, vector = sla.eigsh(matrix, k=1, sigma=0.0, OPinv=inverse, v0=start)
    except sla.ArpackNoConvergence:
        return number, np.nan, np.full(n, np.nan), np.full(n, np.nan)
    return number, value[0], vector[:, 0], vector[:, 0]


def _signed_singular(matrix):
    """Whether the determinant is negative, the smallest singular value with its sign, vectors."""
    import scipy.sparse.linalg as sla  # slow to import

    if matrix.shape[0] <= _FEW:
        left, values, right = np.linalg.svd(matrix.toarray())
        sign = np.linalg.slogdet(matrix.toarray())[0]
        return sign < 0, sign * values[-1], right[-1], left[:, -1]
    try:
        lu = sla.splu(matrix)
    except RuntimeError as error:
        if "singular" not in str(error):
            raise
        return None
    sign = np.prod(np.sign(lu.U.diagonal())) * _parity(lu.perm_r) * _parity(lu.perm_c)
    right = np.random.default_rng(0).standard_normal(matrix.shape[0])
    for _ in range(_INVERSE):  # inverse iteration with the matrix and its transpose
        left = lu.solve(right, "T")
        left /= np.linalg.norm(left)
        right = lu.solve(left)
        value = 1 / np.linalg.norm(right)
        right *= value
    return sign < 0, sign * value, right, left


def _parity(permutation):
    """1 for an even permutation, -1 for an odd one."""
    seen, sign = np.zeros(len(permutation), bool), 1
    for start in range(len(permutation)):
        length = 0
        while not seen[start]:
            seen[start] = True
            start, length = permutation[start], length + 1
        sign *= -1 if length and length % 2 == 0 else 1
    return sign


def _unpivoted(matrix):
    """LU factors without pivoting, so that pivots have the signs of eigenvalues; None if none."""
    import scipy.sparse.linalg as sla

    try:
        return sla.splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        if "singular" not in str(error):
            raise
        return None
