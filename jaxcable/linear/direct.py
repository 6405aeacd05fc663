"""What factors of all kinds share: solves with masks of undefined entries, and derivatives."""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Self

import jax.numpy as jnp
from jax import lax

from ..common.tree import copy_with
from ..common.types import Array, Bool, Float

_LARGEST_ERROR = 1e-2  # of a solution, by rounding, from which it counts as undefined


class MatrixFactor(abc.ABC):
    """Factor of a general matrix A, with solves for A, its transpose, and for derivatives.

    Attributes:
        loose: unknowns with empty rows and columns, which have no solution, [n] bool.
        regular: whether the matrix of the other unknowns is regular to working precision, a scalar.
    """

    loose: Bool[Array, " n"]
    regular: Bool[Array, ""]

    @abc.abstractmethod
    def solve_with_status(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
        """Solve A x = b, or ``A^T x = b`` if `transposed`: return x, [n], and whether A is regular.

        x is meaningless at unknowns with empty rows, and everywhere if A is singular.
        """

    @abc.abstractmethod
    def solve_checked(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""], Bool[Array, ""]]:
        """Solve A x = b (or ``A^T x = b``), and check how much rounding leaves of the solution.

        Returns x [n], whether A is regular, and whether x has correct digits.
        """

    @abc.abstractmethod
    def identity_if_singular(self) -> Self:
        """Return this factor, or that of the identity if the matrix is singular."""

    def solve(
        self, rhs: Float[Array, " n"], matvec: Callable[[Float[Array, " n"]], Float[Array, " n"]]
    ) -> Float[Array, " n"]:
        """Return x with A x = `rhs`, [n], differentiable: its derivatives follow from `matvec`.

        x is all NaN if A is singular, and NaN at unknowns with empty rows (`loose`). An adjoint
        solve whose right side is not zero at one of them is all NaN.

        Args:
            rhs: right side, [n].
            matvec: the linear function ``v -> A v``.
        """

        def forward(_, b):
            answer, regular = self.solve_with_status(b, False)
            return jnp.where(self.loose | ~regular, jnp.nan, answer)

        def backward(_, b):
            return self.solve_adjoint(b)

        return lax.custom_linear_solve(matvec, rhs, solve=forward, transpose_solve=backward)

    def solve_with_undefined_mask(
        self, b: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Bool[Array, " n"]]:
        """Solve A x = b: return x [n], zero where undefined, and a mask of undefined entries, [n].

        Undefined are unknowns without stiffness, and all if A is singular or x has no
        digits.
        """
        answer, regular, sound = self.solve_checked(b, False)
        unknown = self.loose | ~regular | ~sound
        return jnp.where(unknown, 0.0, answer), unknown

    def solve_adjoint(self, b: Float[Array, " n"]) -> Float[Array, " n"]:
        """Solve ``A^T x = b`` for x, [n]; all NaN if b is not zero at an empty row of A."""
        # Not linear, on purpose: a loose unknown or a singular matrix gives NaN only if the right
        # side concerns it, so that phases and unknowns without influence do not spoil a gradient.
        answer, regular, sound = self.solve_checked(b, True)
        asked = jnp.any((self.loose | ~regular) & (b != 0))
        answer = jnp.where(regular, answer, 0.0)
        return jnp.where(asked | (regular & ~sound), jnp.nan, answer)


class OnDeviceFactor(MatrixFactor):
    """A factor that the compiled program computes itself, of a matrix scaled to unit diagonal.

    Attributes:
        size: what rows and columns were divided by, the root of the diagonal, [n].
        replaced: whether the object stands for the factor of the identity instead, scalar bool;
            None if that was never asked.
    """

    size: Float[Array, " n"]
    replaced: Bool[Array, ""] | None

    @abc.abstractmethod
    def solve_scaled(self, b: Float[Array, " n"], transposed: bool) -> Float[Array, " n"]:
        """Solve with the scaled matrix, or with its transpose; return the solution [n]."""

    @abc.abstractmethod
    def multiply_scaled(self, x: Float[Array, " n"], transposed: bool) -> Float[Array, " n"]:
        """Multiply the scaled matrix, or its transpose, by a vector; return the product [n]."""

    def identity_if_singular(self) -> Self:
        """Return this factor, or that of the identity if the matrix is singular."""
        size = jnp.where(self.regular, self.size, 1.0)
        return copy_with(self, size=size, regular=jnp.ones((), bool), replaced=~self.regular)

    def solve_with_status(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
        """Solve with the unscaled matrix or its transpose: return x [n], whether it is regular."""
        b = jnp.where(self.loose, 0.0, b) / self.size
        return self._unchanged_if_identity(
            self.solve_scaled(b, transposed), b
        ) / self.size, self.regular

    def solve_checked(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""], Bool[Array, ""]]:
        """Solve with the matrix or its transpose, and check x by one iterative refinement.

        A matrix that is singular up to rounding may have large pivots; the correction is then as
        large as x. Returns x [n], whether the matrix is regular, and whether the correction is
        below a percent.
        """
        answer, regular = self.solve_with_status(b, transposed)
        scaled, left = self.size * answer, jnp.where(self.loose, 0.0, b)
        left = left - self.size * self._unchanged_if_identity(
            self.multiply_scaled(scaled, transposed), scaled
        )
        error = jnp.max(
            jnp.abs(self.size * self.solve_with_status(left, transposed)[0]), initial=0.0
        )
        largest = jnp.max(jnp.abs(scaled), initial=0.0)
        return answer, regular, ~(error > _LARGEST_ERROR * largest)

    def _unchanged_if_identity(self, result, operand):
        """Return `operand` if this stands for the factor of the identity, else `result`."""
        return result if self.replaced is None else jnp.where(self.replaced, operand, result)


def diagonal_scale(diagonal: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return the root of the absolute diagonal, [n], 1 where it is zero, to scale a matrix by."""
    size = jnp.sqrt(jnp.abs(diagonal))
    return jnp.where(size > 0, size, 1.0)


def are_pivots_significant(pivots: Float[Array, " n"]) -> Bool[Array, ""]:
    """Return whether all pivots [n] of a scaled matrix exceed rounding: n eps times the largest."""
    limit = len(pivots) * jnp.finfo(pivots.dtype).eps * jnp.max(pivots, initial=0.0)
    return jnp.all(pivots > limit) & jnp.all(jnp.isfinite(pivots))
