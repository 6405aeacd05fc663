"""What factors of all kinds share: solves with marks, and their derivatives."""

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
    """A factorised general matrix, with solves for derivatives in both modes.

    Attributes:
        loose: unknowns without a value, [n] bool.
        regular: whether the matrix of the other unknowns is regular to working precision.
    """

    loose: Bool[Array, " n"]
    regular: Bool[Array, ""]

    @abc.abstractmethod
    def solve_with_status(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
        """Solve with the matrix or its transpose: return the solution [n], and `regular`.

        Loose unknowns and singular matrices are not marked in the solution.
        """

    @abc.abstractmethod
    def solve_checked(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""], Bool[Array, ""]]:
        """Solve, and also tell whether rounding leaves digits of the solution."""

    @abc.abstractmethod
    def identity_if_singular(self) -> Self:
        """Return this factor, or that of the identity if the matrix is singular."""

    def solve(
        self, rhs: Float[Array, " n"], matvec: Callable[[Float[Array, " n"]], Float[Array, " n"]]
    ) -> Float[Array, " n"]:
        """Solve for `rhs` [n]; derivatives are those of the linear function `matvec`.

        All NaN if the matrix is singular. Loose unknowns have no value: they are NaN, the others
        are exact. An adjoint whose right side is not zero at a loose unknown is all NaN.
        """

        def forward(_, b):
            answer, regular = self.solve_with_status(b, False)
            return jnp.where(self.loose | ~regular, jnp.nan, answer)

        def backward(_, b):
            return self.solve_adjoint(b)

        return lax.custom_linear_solve(matvec, rhs, solve=forward, transpose_solve=backward)

    def solve_with_marks(
        self, b: Float[Array, " n"]
    ) -> tuple[Float[Array, " n"], Bool[Array, " n"]]:
        """Solve for `b`: return the solution [n], zero where undefined, and this mask, [n]."""
        answer, regular, sound = self.solve_checked(b, False)
        unknown = self.loose | ~regular | ~sound
        return jnp.where(unknown, 0.0, answer), unknown

    def solve_adjoint(self, b: Float[Array, " n"]) -> Float[Array, " n"]:
        """Solve with the transposed matrix; NaN if `b` asks for an unknown without a value."""
        # Not linear, on purpose: a loose unknown or a singular matrix gives NaN only if the right
        # side concerns it, so that phases and unknowns without influence do not spoil a gradient.
        answer, regular, sound = self.solve_checked(b, True)
        asked = jnp.any((self.loose | ~regular) & (b != 0))
        answer = jnp.where(regular, answer, 0.0)
        return jnp.where(asked | (regular & ~sound), jnp.nan, answer)


class OnDeviceFactor(MatrixFactor):
    """A factor inside of the compiled program, of a matrix that is scaled to unit diagonal.

    Attributes:
        size: scaling, the root of the diagonal, [n].
        loose, regular: see `MatrixFactor`.
        replaced: whether this stands for the factor of the identity, scalar bool; None if not.
    """

    size: Float[Array, " n"]
    replaced: Bool[Array, ""] | None

    @abc.abstractmethod
    def solve_scaled(self, b: Float[Array, " n"], transposed: bool) -> Float[Array, " n"]:
        """Solve with the scaled matrix, or with its transpose; return the solution [n]."""

    @abc.abstractmethod
    def multiply_scaled(self, x: Float[Array, " n"], transposed: bool) -> Float[Array, " n"]:
        """Multiply the scaled matrix, or its transpose, by a vector [n]."""

    def identity_if_singular(self) -> Self:
        """See `MatrixFactor`."""
        size = jnp.where(self.regular, self.size, 1.0)
        return copy_with(self, size=size, regular=jnp.ones((), bool), replaced=~self.regular)

    def solve_with_status(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
        """See `MatrixFactor`."""
        b = jnp.where(self.loose, 0.0, b) / self.size
        return self._use_identity_if_replaced(
            self.solve_scaled(b, transposed), b
        ) / self.size, self.regular

    def solve_checked(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""], Bool[Array, ""]]:
        """Solve; sound means that rounding leaves an error of a percent at most.

        A matrix that is singular up to rounding may have regular pivots. Then the correction of
        iterative refinement is as large as the answer itself.
        """
        answer, regular = self.solve_with_status(b, transposed)
        scaled, left = self.size * answer, jnp.where(self.loose, 0.0, b)
        left = left - self.size * self._use_identity_if_replaced(
            self.multiply_scaled(scaled, transposed), scaled
        )
        error = jnp.max(
            jnp.abs(self.size * self.solve_with_status(left, transposed)[0]), initial=0.0
        )
        largest = jnp.max(jnp.abs(scaled), initial=0.0)
        return answer, regular, ~(error > _LARGEST_ERROR * largest)

    def _use_identity_if_replaced(self, x, same):
        """Return `x`, or `same` if this stands for the factor of the identity."""
        return x if self.replaced is None else jnp.where(self.replaced, same, x)


def diagonal_scale(diagonal: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return what rows and columns are divided by for a unit diagonal, [n], to compare pivots."""
    size = jnp.sqrt(jnp.abs(diagonal))
    return jnp.where(size > 0, size, 1.0)


def are_pivots_significant(pivots: Float[Array, " n"]) -> Bool[Array, ""]:
    """Return whether all pivots of a scaled matrix are beyond rounding: n eps of the largest."""
    limit = len(pivots) * jnp.finfo(pivots.dtype).eps * jnp.max(pivots, initial=0.0)
    return jnp.all(pivots > limit) & jnp.all(jnp.isfinite(pivots))
