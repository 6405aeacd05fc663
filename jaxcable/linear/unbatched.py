"""LAPACK, called for one matrix at a time: a batch of `jax.vmap` becomes a loop in the program.

On CPUs jaxlib 0.10 shares the matrices of a batched call out to the threads of XLA, and waits for
them on one of these threads (``ParallelBatchMap`` in its ``cpu/lapack_kernels.cc``; since 0.11 the
call does all of its work itself). As many such calls at the same time as there are threads, in one
program or in several, wait for each other for ever. A call for one matrix never waits.

The loop costs nothing: 256 matrices of 12, 60 and 120 unknowns are factorised and solved in 0.37,
8.2 and 34 ms, and by batched calls in 0.32, 7.2 and 57 ms (jaxlib 0.10.2, 2 cores). On accelerators
calls stay batched.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jax import lax

from ..common.types import Array, ArrayLike, Float, Int


def one_at_a_time(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a function so that `jax.vmap` maps it by a loop on CPUs.

    The function is not to be differentiated in reverse (`cholesky`, `eigh` and `solve_triangular`
    below are differentiable).

    Args:
        function: of arrays, with a pytree of arrays as its result; it calls LAPACK.
    """
    mapped = jax.custom_batching.custom_vmap(function)

    @mapped.def_vmap
    def loop(axis_size, in_batched, *arguments):
        if not any(in_batched):  # their tangents alone are: second derivatives of `lstsq`
            results = function(*arguments)
            return results, jax.tree.map(lambda _: False, results)
        batch = [x for x, batched in zip(arguments, in_batched, strict=True) if batched]

        def case(own):
            own = iter(own)
            pairs = zip(arguments, in_batched, strict=True)
            return mapped(*(next(own) if batched else x for x, batched in pairs))

        if jax.default_backend() == "cpu":
            results = lax.map(case, batch)
        else:
            results = jax.vmap(function, [0 if b else None for b in in_batched])(*arguments)
        return results, jax.tree.map(lambda _: True, results)

    return mapped


# functions of arrays alone: the named arguments of jax's would be taken for more of them
_cholesky = one_at_a_time(lambda matrix: jnp.linalg.cholesky(matrix))
_eigh = one_at_a_time(lambda matrix: tuple(jnp.linalg.eigh(matrix)))
_raw_lu = one_at_a_time(lambda matrix: jsl.lu_factor(matrix))
cho_solve = one_at_a_time(lambda factor, rhs: jsl.cho_solve((factor, True), rhs))
eigvalsh = one_at_a_time(lambda matrix: jnp.linalg.eigvalsh(matrix))
qr = one_at_a_time(lambda matrix: tuple(jnp.linalg.qr(matrix)))
slogdet = one_at_a_time(lambda matrix: tuple(jnp.linalg.slogdet(matrix)))
svd = one_at_a_time(lambda matrix: tuple(jnp.linalg.svd(matrix)))
_thin_svd = one_at_a_time(lambda matrix: tuple(jnp.linalg.svd(matrix, full_matrices=False)))


@functools.cache
def _triangular_solver(lower, transposed, unit_diagonal=False):
    """Return a function that solves with a triangle; a unit diagonal is not stored (L of LU)."""

    def solve(factor, rhs):
        options = {"lower": lower, "unit_diagonal": unit_diagonal}
        return jsl.solve_triangular(factor, rhs, trans=int(transposed), **options)

    return one_at_a_time(solve)


@jax.custom_jvp
def cholesky(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Return the lower Cholesky factor of a symmetric matrix; NaN if it is not definite."""
    return _cholesky(matrix)


@cholesky.defjvp
def _cholesky_jvp(primals, tangents):
    """Differentiate: ``dL = L tril(L^-1 dA L^-T)``, half of the diagonal (Murray 2016, eq. 8)."""
    factor = cholesky(*primals)
    change = 0.5 * (tangents[0] + tangents[0].T)
    half = solve_triangular(factor, change)
    whole = solve_triangular(factor, half.T)
    return factor, factor @ (jnp.tril(whole) - 0.5 * jnp.diag(jnp.diagonal(whole)))


@jax.custom_jvp
def eigh(matrix: Float[Array, "n n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Return the eigenvalues, ascending, and eigenvectors (columns) of a symmetric matrix.

    Derivatives of the vectors of equal eigenvalues are not finite: they have none.
    """
    return _eigh(matrix)


@eigh.defjvp
def _eigh_jvp(primals, tangents):
    """Differentiate eigenvalues and eigenvectors.

    ``dw_i = v_i.dA v_i`` and ``dv_i = sum_j v_j (v_j.dA v_i) / (w_i - w_j)``, j not i.
    """
    values, vectors = eigh(*primals)
    change = vectors.T @ (0.5 * (tangents[0] + tangents[0].T)) @ vectors
    one = jnp.eye(len(values), dtype=values.dtype)
    inverse_gaps = 1 / (values[None, :] - values[:, None] + one) - one
    return (values, vectors), (jnp.diagonal(change), vectors @ (inverse_gaps * change))


def solve_triangular(
    factor: Float[Array, "n n"],
    rhs: Float[Array, "n ..."],
    lower: bool = True,
    transposed: bool = False,
) -> Float[Array, "n ..."]:
    """Solve with a triangular matrix, or its transpose, for right sides [n] or [n, m]."""
    triangle = jnp.tril(factor) if lower else jnp.triu(factor)
    held = lax.stop_gradient(factor)

    def product(x):
        return (triangle.T if transposed else triangle) @ x

    def solved(_, b):
        return _triangular_solver(lower, transposed)(held, b)

    def adjoint(_, b):
        return _triangular_solver(lower, not transposed)(held, b)

    return lax.custom_linear_solve(product, rhs, solved, adjoint)


def lu_factor(matrix: Float[Array, "n n"]) -> tuple[Float[Array, "n n"], Int[Array, " n"]]:
    """Return the LU factors of a matrix in one array, and the order of its rows; no derivative."""
    lu, pivot = _raw_lu(lax.stop_gradient(matrix))
    return lu, lax.linalg.lu_pivots_to_permutation(pivot, len(matrix))


def lu_solve(
    lu: Float[Array, "n n"], order: Int[Array, " n"], rhs: Float[Array, " n"], transposed: bool
) -> Float[Array, " n"]:
    """Solve with the factors of `lu_factor`, or with those of the transpose; no derivative."""
    if transposed:
        x = _triangular_solver(True, True, True)(lu, _triangular_solver(False, True)(lu, rhs))
        return jnp.zeros_like(x).at[order].set(x, unique_indices=True)
    return _triangular_solver(False, False)(
        lu, _triangular_solver(True, False, True)(lu, rhs[order])
    )


def lstsq(
    matrix: Float[Array, "m n"],
    rhs: Float[Array, " m"],
    rcond: Float[ArrayLike, ""] | None = None,
) -> Float[Array, " n"]:
    """Solve by least squares: return the shortest x of least ``|A x - b|``; NaN if `rcond` is NaN.

    Args:
        matrix: A, [m, n].
        rhs: b, [m].
        rcond: singular values below this part of the largest one count as zero; None for
            max(m, n) eps.
    """
    if rcond is None:
        rcond = max(matrix.shape) * jnp.finfo(matrix.dtype).eps
    return _lstsq_by_svd(matrix, rhs, jnp.asarray(rcond, matrix.dtype))


@jax.custom_jvp
def _lstsq_by_svd(matrix, rhs, rcond):
    """Multiply by the pseudo-inverse of a matrix, from its singular values."""
    left, size, right = _thin_svd(matrix)
    counts = ~(size <= rcond * jnp.max(size, initial=0.0))
    inverse = jnp.where(counts, 1 / jnp.where(counts, size, 1.0), 0.0)
    return right.T @ (jnp.where(jnp.isnan(rcond), jnp.nan, inverse) * (left.T @ rhs))


@_lstsq_by_svd.defjvp
def _lstsq_by_svd_jvp(primals, tangents):
    """Differentiate a pseudo-inverse of constant rank (Golub and Pereyra 1973, eq. 4.12)."""
    (matrix, rhs, rcond), (matrix_dot, rhs_dot, _) = primals, tangents

    def inverse(v):
        return _lstsq_by_svd(matrix, v, rcond)

    def inverse_transposed(v):
        return _lstsq_by_svd(matrix.T, v, rcond)

    x = inverse(rhs)
    change = inverse(rhs_dot - matrix_dot @ x)
    change += inverse(inverse_transposed(matrix_dot.T @ (rhs - matrix @ x)))
    outside = matrix_dot.T @ inverse_transposed(x)  # of the row space, where x has to follow it
    return x, change + outside - inverse(matrix @ outside)
