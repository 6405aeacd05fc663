"""Cholesky's method for one matrix of small bandwidth, inside of the compiled program.

The part of the matrix in work is a window [b + 1, b + 1] that moves down the diagonal: XLA keeps it
in cache and computes on it with vector registers. No library is called, so that a loop around it
can become one function (`common.fusion`); `banded` has figures of this way and of the two others.

Storage of matrices as in `banded`: ``band[k, i] = A[k + i, k]``, [n, b + 1]; that of factors
likewise, ``A = L L^T``. Nothing here is differentiable by itself.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import lax

from ..common.fusion import are_loops_fused
from ..common.tree import pytree
from ..common.types import Array, Bool, Float
from . import solver
from .direct import OnDeviceFactor, are_pivots_significant, diagonal_scale
from .pattern import SparseMatrix


class RollingCholesky(solver.Solver):
    """Linear solver by banded Cholesky factors inside of a compiled program with fused loops.

    It is not for matrices that may be indefinite: their factors need exchanges of rows.
    """

    name = "rolling"
    offered = False
    on_device = True
    definite = True
    fused = True

    def is_suitable_for(self, n: int, banded: bool) -> bool:
        """Tell whether the bandwidth of a matrix is small (`banded`) and XLA fuses loops."""
        return banded and are_loops_fused()

    def solve_definite(
        self, matrix: SparseMatrix, rhs: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
        """Solve with a banded matrix: return x, [n], and whether it is positive definite."""
        factor, x = factorize_and_solve(matrix.banded(), rhs[matrix.pattern.order])
        pivots = factor[:, 0]
        return x[matrix.pattern.place], jnp.all((pivots > 0) & jnp.isfinite(pivots))

    def factorize(self, matrix: SparseMatrix, loose: Bool[Array, " n"]) -> BandFactor:
        """Return the banded Cholesky factor of a matrix, without the unknowns `loose`, [n] bool.

        A matrix that is not positive definite counts as singular.
        """
        matrix = matrix.hold_unknowns(loose, jnp.ones((), matrix.values.dtype))
        size = diagonal_scale(matrix.diagonal())
        scaled = matrix.divide_rows_and_columns(size)
        factor, _ = factorize_and_solve(scaled.banded(), jnp.zeros_like(size))
        regular = are_pivots_significant(factor[:, 0] ** 2)  # the pivots of LU
        return BandFactor(factor, size, loose, regular, scaled)


@pytree
class BandFactor(OnDeviceFactor):
    """Cholesky factor of a banded matrix scaled to unit diagonal; made by `RollingCholesky`.

    Attributes:
        factor: lower band of the scaled matrix's factor, in the order of the pattern, [n, b + 1].
        size: what rows and columns were divided by, [n].
        loose: unknowns that were left out, [n] bool.
        regular: whether the matrix is positive definite, scalar bool.
        scaled: the matrix, scaled to unit diagonal.
        replaced: whether the object stands for the factor of the identity instead, scalar bool.
    """

    factor: Float[Array, "n b+1"]
    size: Float[Array, " n"]
    loose: Bool[Array, " n"]
    regular: Bool[Array, ""]
    scaled: SparseMatrix
    replaced: Bool[Array, ""] | None = None

    def solve_scaled(self, b: Float[Array, " n"], transposed: bool) -> Float[Array, " n"]:
        """Solve with the scaled matrix, which is symmetric; return the solution [n]."""
        p = self.scaled.pattern
        return solve_with_factor(self.factor, b[p.order])[p.place]

    def multiply_scaled(self, x: Float[Array, " n"], transposed: bool) -> Float[Array, " n"]:
        """Multiply the scaled matrix, which is symmetric, by a vector; return the product [n]."""
        p = self.scaled.pattern
        return multiply_by_vector(self.scaled.banded(), x[p.order])[p.place]


def factorize_and_solve(
    band: Float[Array, "n b+1"], rhs: Float[Array, " n"]
) -> tuple[Float[Array, "n b+1"], Float[Array, " n"]]:
    """Factorise a banded matrix by Cholesky's method, and solve for one right side.

    Args:
        band: lower band of the matrix A, ``band[k, i] = A[k + i, k]``, [n, b + 1].
        rhs: right side, [n].

    Returns:
        Factor L in the same storage, and the solution [n]. If A is not positive definite, they have
        NaN or infinities: a pivot ``factor[:, 0]`` is then no positive number.
    """
    n, width = band.shape
    band = jnp.pad(band, ((0, width + 2), (0, 0)))
    rhs = jnp.pad(rhs, (0, 2 * width))
    # the first window has A[i, c] in row c, zero before the diagonal; of later ones the last column
    # is read from the band
    away = jnp.arange(width)[None, :] - jnp.arange(width)[:, None]
    first = jnp.take_along_axis(band[:width], jnp.maximum(away, 0), axis=1)
    first = jnp.where(away >= 0, first, 0.0)
    entering = (width - 1 - jnp.arange(width))[:, None]

    def forward(k, carry):
        factor, y, window, side = carry
        scale = lax.rsqrt(window[0, 0])
        column, value = window[0] * scale, side[0] * scale
        factor = lax.dynamic_update_slice(factor, column[None], (k, 0))
        y = lax.dynamic_update_slice(y, value[None], (k,))
        rest = window[1:, 1:] - column[1:, None] * column[None, 1:]
        rows = lax.dynamic_slice(band, (k + 1, 0), (width, width))
        last = jnp.take_along_axis(rows, entering, axis=1)
        window = jnp.concatenate([jnp.pad(rest, ((0, 1), (0, 0))), last], axis=1)
        after = lax.dynamic_slice(rhs, (k + width,), (1,))
        side = jnp.concatenate([side[1:] - column[1:] * value, after])
        return factor, y, window, side

    zero = jnp.zeros((n, width), band.dtype), jnp.zeros(n + width, band.dtype)
    factor, y, _, _ = lax.fori_loop(0, n, forward, (*zero, first, rhs[:width]))
    return factor, _back_substitute(factor, y)


def solve_with_factor(factor: Float[Array, "n b+1"], rhs: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return the solution, [n], for a right side [n], with a factor of `factorize_and_solve`."""
    n, width = factor.shape
    rhs = jnp.pad(rhs, (0, 2 * width))

    def forward(k, carry):
        y, side = carry
        column = lax.dynamic_index_in_dim(factor, k, keepdims=False)
        value = side[0] / column[0]
        y = lax.dynamic_update_slice(y, value[None], (k,))
        after = lax.dynamic_slice(rhs, (k + width,), (1,))
        return y, jnp.concatenate([side[1:] - column[1:] * value, after])

    y = jnp.zeros(n + width, rhs.dtype)
    y, _ = lax.fori_loop(0, n, forward, (y, rhs[:width]))
    return _back_substitute(factor, y)


def multiply_by_vector(band: Float[Array, "n b+1"], x: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return the product, [n], of a symmetric banded matrix and a vector x, [n].

    `band` is the lower band, ``band[k, i] = A[k + i, k]``, [n, b + 1].
    """
    n, width = band.shape
    x = jnp.pad(x, (width, width))
    here, away = width + jnp.arange(n)[:, None], jnp.arange(width)[None, :]
    left = jnp.pad(band, ((width, 0), (0, 0)))[here - away, away] * x[here - away]
    return jnp.sum(band * x[here + away], axis=1) + jnp.sum(left[:, 1:], axis=1)


def _back_substitute(factor, y):
    """Solve ``L^T x = y`` for x, [n], with the Cholesky factor L of a matrix of bandwidth b.

    `factor` is its lower band, ``factor[k, i] = L[k + i, k]``, [n, b + 1]; `y` has b + 1 zeros
    after its n numbers.
    """
    n, width = factor.shape

    def backward(count, x):
        k = n - 1 - count
        column = lax.dynamic_index_in_dim(factor, k, keepdims=False)
        after = jnp.sum(column[1:] * lax.dynamic_slice(x, (k + 1,), (width - 1,)))
        value = (lax.dynamic_slice(y, (k,), (1,)) - after) / column[:1]
        return lax.dynamic_update_slice(x, value, (k,))

    return lax.fori_loop(0, n, backward, jnp.zeros_like(y))[:n]
