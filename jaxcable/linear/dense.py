"""Dense direct solves, each wrapped in `lax.custom_linear_solve`.

The wrapper differentiates the equation ``A x = b`` and not the factorisation, whose derivative
would cost several times the solve itself.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jax import lax

from ..common.tree import pytree
from ..common.types import Array, Bool, Float, Int
from . import solver, unbatched
from .direct import OnDeviceFactor, are_pivots_significant, diagonal_scale

_MOST_UNKNOWNS = 150  # up to which dense matrices are faster (`experiments/benchmark.py scaling`)


class Dense(solver.Solver):
    """Linear solver with dense factors in jax: for some hundred unknowns, and on accelerators."""

    name = "dense"
    on_device = True

    def is_suitable_for(self, n: int, banded: bool) -> bool:
        """Tell whether the number of unknowns n is small enough for dense matrices."""
        return n <= _MOST_UNKNOWNS

    def solve_definite(
        self, matrix: Any, rhs: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
        """Solve with a `SparseMatrix` as a dense one: return x [n], and whether it is definite."""
        return solve_definite(matrix.dense(), rhs)

    def factorize(self, matrix: Any, loose: Bool[Array, " n"]) -> DenseFactor:
        """Factorise a `SparseMatrix` as a dense matrix, without the unknowns `loose`, [n] bool."""
        return factorize(matrix.dense(), loose)


def diagonal(matrix: Float[Array, "n n"]) -> Float[Array, " n"]:
    """Return the diagonal, [n], by a strided slice (cheaper than the gather of `jnp.diagonal`)."""
    n = len(matrix)
    return matrix.reshape(-1)[:: n + 1]


def solve_definite(
    matrix: Float[Array, "n n"], rhs: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
    """Solve with a dense symmetric positive definite matrix by its Cholesky factor; differentiable.

    Args:
        matrix: symmetric, [n, n].
        rhs: right side, [n].

    Returns:
        Solution [n], and whether the matrix is (numerically) positive definite; if not, the
        solution is meaningless.
    """
    factor = unbatched.cholesky(lax.stop_gradient(matrix))
    pivots = diagonal(factor)
    definite = jnp.all(jnp.isfinite(pivots)) & jnp.all(pivots > 0)

    def back_substitute(_, b):
        return unbatched.cho_solve(factor, b)

    x = lax.custom_linear_solve(lambda v: matrix @ v, rhs, solve=back_substitute, symmetric=True)
    return x, definite


@pytree
class DenseFactor(OnDeviceFactor):
    """LU factors of a dense matrix that was scaled to unit diagonal; made by `factorize`.

    Attributes:
        lu, order: LU factors of the scaled matrix in one array, [n, n], and the order of its rows.
        size: what rows and columns were divided by, [n].
        loose: unknowns that were left out, [n] bool.
        regular: whether the matrix is regular, scalar bool.
        scaled: the matrix, scaled to unit diagonal, [n, n].
        replaced: whether the object stands for the factor of the identity instead, scalar bool.
    """

    lu: Float[Array, "n n"]
    order: Int[Array, " n"]
    size: Float[Array, " n"]
    loose: Bool[Array, " n"]
    regular: Bool[Array, ""]
    scaled: Float[Array, "n n"]
    replaced: Bool[Array, ""] | None = None

    def solve_scaled(self, b: Float[Array, " n"], transposed: bool) -> Float[Array, " n"]:
        """Solve with the scaled matrix, or with its transpose; return the solution [n]."""
        return unbatched.lu_solve(self.lu, self.order, b, transposed)

    def multiply_scaled(self, x: Float[Array, " n"], transposed: bool) -> Float[Array, " n"]:
        """Multiply the scaled matrix, or its transpose, by a vector; return the product [n]."""
        return (self.scaled.T if transposed else self.scaled) @ x


def factorize(matrix: Float[Array, "n n"], loose: Bool[Array, " n"] | None = None) -> DenseFactor:
    """Factorise a dense general matrix [n, n] by LU, without the unknowns `loose`, [n] bool.

    The matrix counts as singular if a pivot, after scaling to unit diagonal, is below n eps times
    the largest. Because of the scaling a stiffness of 1e-12 of the others still counts.
    """
    n = matrix.shape[0]
    matrix = lax.stop_gradient(matrix)
    if loose is None:
        loose = jnp.zeros(n, bool)
    matrix = jnp.where(loose[:, None] | loose[None, :], jnp.eye(n, dtype=matrix.dtype), matrix)
    size = diagonal_scale(diagonal(matrix))
    scaled = matrix / size[:, None] / size[None, :]
    lu, order = unbatched.lu_factor(scaled)
    return DenseFactor(
        lu, order, size, loose, are_pivots_significant(jnp.abs(diagonal(lu))), scaled
    )
