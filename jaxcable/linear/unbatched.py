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


def vmap_by_loop(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a function so that `jax.vmap` calls it for one case after the other on CPUs.

    On accelerators it is mapped as usual. The result has no reverse-mode derivative.

    Args:
        function: function of arrays that calls LAPACK; it returns a pytree of arrays.
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
_cholesky = vmap_by_loop(lambda matrix: jnp.linalg.cholesky(matrix))
_eigh = vmap_by_loop(lambda matrix: tuple(jnp.linalg.eigh(matrix)))
_raw_lu = vmap_by_loop(lambda matrix: jsl.lu_factor(matrix))
cho_solve = vmap_by_loop(lambda factor, rhs: jsl.cho_solve((factor, True), rhs))
eigvalsh = vmap_by_loop(lambda matrix: jnp.linalg.eigvalsh(matrix))
slogdet = vmap_by_loop(lambda matrix: tuple(jnp.linalg.slogdet(matrix)))
svd = vmap_by_loop(lambda matrix: tuple(jnp.linalg.svd(matrix)))
_thin_svd = vmap_by_loop(lambda matrix: tuple(jnp.linalg.svd(matrix, full_matrices=False)))


@functools.cache
def _triangular_solver(lower, transposed, unit_diagonal=False):
    """Return ``solve(factor, rhs)`` for a lower or upper triangle, or its transpose; cached.

    With `unit_diagonal` the diagonal counts as 1 and need not be stored.
    """

    def solve(factor, rhs):
        options = {"lower": lower, "unit_diagonal": unit_diagonal}
        return jsl.solve_triangular(factor, rhs, trans=int(transposed), **options)

    return vmap_by_loop(solve)


@jax.custom_jvp
def cholesky(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Return the lower Cholesky factor [n, n] of a symmetric matrix; NaN if it is not definite."""
    return _cholesky(matrix)


@cholesky.defjvp
def _cholesky_jvp(primals, tangents):
    """JVP rule: return the factor and its tangent ``dL = L tril(L^-1 dA L^-T)`` for dA symmetrized.

    Half of the diagonal counts in ``tril`` (Murray 2016, eq. 8).
    """
    factor = cholesky(*primals)
    change = 0.5 * (tangents[0] + tangents[0].T)
    half = solve_triangular(factor, change)
    whole = solve_triangular(factor, half.T)
    return factor, factor @ (jnp.tril(whole) - 0.5 * jnp.diag(jnp.diagonal(whole)))


@jax.custom_jvp
def eigh(matrix: Float[Array, "n n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Return the eigenvalues [n], ascending, and unit eigenvectors (columns [n, n]) of a matrix.

    The matrix is symmetric. The vectors of equal eigenvalues have no finite derivatives.
    """
    return _eigh(matrix)


@eigh.defjvp
def _eigh_jvp(primals, tangents):
    """JVP rule of `eigh`: return eigenvalues w and vectors v, and their tangents.

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
    """Solve with a triangle of `factor`, or its transpose, for right sides [n] or [n, m]."""
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
    """Solve with the factors of `lu_factor`, or of the transpose: return x [n]; no derivative."""
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
    """Return the least-squares solution of A x = b that has the smallest norm, [n]; differentiable.

    Args:
        matrix: A, [m, n].
        rhs: b, [m].
        rcond: singular values below this part of the largest one count as zero; None for max(m, n)
            eps. NaN makes the result NaN.
    """
    if rcond is None:
        rcond = max(matrix.shape) * jnp.finfo(matrix.dtype).eps
    return _lstsq_by_svd(matrix, rhs, jnp.asarray(rcond, matrix.dtype))


@jax.custom_jvp
def _lstsq_by_svd(matrix, rhs, rcond):
    """Return pinv(A) `rhs`, [n]; singular values below `rcond` of the largest count as zero."""
    left, size, right = _thin_svd(matrix)
    counts = ~(size <= rcond * jnp.max(size, initial=0.0))
    inverse = jnp.where(counts, 1 / jnp.where(counts, size, 1.0), 0.0)
    return right.T @ (jnp.where(jnp.isnan(rcond), jnp.nan, inverse) * (left.T @ rhs))


@_lstsq_by_svd.defjvp
def _lstsq_by_svd_jvp(primals, tangents):
    """JVP rule of `_lstsq_by_svd`: return x and its tangent for matrices of constant rank.

    Source: Golub and Pereyra 1973, eq. 4.12.
    """
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
