"""Signs and the eigenvalue nearest to zero of a stiffness: whether a state is stable, and where
it ceases to be.

Dense matrices get all eigenvalues. Sparse ones are factorised without pivoting on the host, which
tells the signs (Sylvester's law of inertia), and the eigenvalue nearest to zero is found by inverse
Lanczos iteration (ARPACK).
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
_ROUNDING = 4  # times n eps of the largest eigenvalue: a negative one below that is none


def spectrum(matrix, loose):
    """Number of negative eigenvalues, and the one nearest to zero; not differentiable.

    Of an unsymmetric matrix its symmetric part counts: positive definite, it is stable also under
    loads without potential.

    Args:
        matrix: [n, n].
        loose: unknowns with empty rows and columns, left out, [n] bool.

    Returns:
        number int32, eigenvalue, unit eigenvector [n]; NaN for these two where they were not found.
    """
    matrix = lax.stop_gradient(matrix)
    if isinstance(matrix, Sparse) and matrix.pattern.solver != "dense":
        return _on_host(matrix, loose)
    full = matrix.dense() if isinstance(matrix, Sparse) else matrix
    full = 0.5 * (full + full.T)
    largest = jnp.max(jnp.abs(jnp.diagonal(full)), initial=0.0)
    # a loose unknown gets a stiffness that is the least interesting one
    own = jnp.where(loose, largest, 0.0)
    apart = jnp.where(loose[:, None] | loose[None, :], 0.0, full) + jnp.diag(own)
    sound = jnp.all(jnp.isfinite(apart))
    one = jnp.eye(len(apart), dtype=apart.dtype)
    values, vectors = jnp.linalg.eigh(jnp.where(sound, apart, one))
    limit = _ROUNDING * len(values) * jnp.finfo(values.dtype).eps * jnp.max(jnp.abs(values))
    nearest = jnp.argmin(jnp.abs(values))
    nan = jnp.where(sound, 1.0, jnp.nan).astype(values.dtype)
    number = jnp.sum(values < -limit).astype(jnp.int32)
    return number, values[nearest] * nan, vectors[:, nearest] * nan


def _on_host(matrix, loose):
    p = matrix.pattern
    shapes = (
        jax.ShapeDtypeStruct((), jnp.int32),
        jax.ShapeDtypeStruct((), matrix.values.dtype),
        jax.ShapeDtypeStruct(loose.shape, matrix.values.dtype),
    )
    function = _analyser(p.symmetric)
    return sparse._call(function, shapes, p.indptr, p.indices, matrix.values, loose)


@functools.cache
def _analyser(symmetric):
    def function(indptr, indices, values, loose):
        batch = np.broadcast_shapes(values.shape[:-1], loose.shape[:-1])
        rows = sparse._rows(values, batch).astype(np.float64), sparse._rows(loose, batch)
        first = [array.reshape(-1, array.shape[-1])[0] for array in (indptr, indices)]
        found = [_analyse(symmetric, *first, *pair) for pair in zip(*rows, strict=True)]
        number, value, vector = (np.array(column) for column in zip(*found, strict=True))
        return number.reshape(batch), value.reshape(batch), vector.reshape(*batch, -1)

    return function


def _analyse(symmetric, indptr, indices, values, loose):
    """`spectrum` of one matrix in compressed rows."""
    import scipy.sparse.linalg as sla  # slow to import

    n = len(indptr) - 1
    nothing = np.int32(0), np.nan, np.full(n, np.nan)
    stored = sp.csr_matrix((values, indices, indptr), (n, n))
    whole = stored + sp.triu(stored, 1).T if symmetric else 0.5 * (stored + stored.T)
    keep = np.flatnonzero(~loose)
    whole = whole.tocsc()[:, keep][keep]
    if not np.isfinite(whole.data).all() or len(keep) == 0:
        return nothing
    full = np.zeros(n)
    if len(keep) <= _FEW:  # Lanczos needs room
        values, vectors = np.linalg.eigh(whole.toarray())
        limit = _ROUNDING * len(keep) * np.finfo(float).eps * np.abs(values).max()
        nearest = np.abs(values).argmin()
        full[keep] = vectors[:, nearest]
        return np.int32((values < -limit).sum()), values[nearest], full
    lu = _unpivoted(whole)
    if lu is None:  # singular to the last digit: a nudge of its rounding
        size = np.finfo(float).eps * np.abs(whole.diagonal()).max()
        lu = _unpivoted(whole + sp.diags_array(np.full(len(keep), size), format="csc"))
    if lu is None:
        return nothing
    number = int((lu.U.diagonal() < 0).sum())
    start = np.random.default_rng(0).standard_normal(len(keep))  # no symmetry of its own
    inverse = sla.LinearOperator(whole.shape, lu.solve, dtype=float)
    try:
        value, vector = sla.eigsh(whole, k=1, sigma=0.0, OPinv=inverse, v0=start)
    except sla.ArpackNoConvergence:
        return np.int32(number), np.nan, np.full(n, np.nan)
    full[keep] = vector[:, 0]
    return np.int32(number), value[0], full


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
