"""What factors of all kinds share: solves with marks, and their derivatives."""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Self

import jax.numpy as jnp
from jax import lax

from ..common.tree import copy
from ..common.types import Array, Bool, Float

_UNSURE = 1e-2  # error of an answer, by rounding, from which it is none


class Factor(abc.ABC):
    """A factor of a general matrix.

    Attributes:
        loose: unknowns without a value, [n] bool.
        regular: whether the matrix of the other unknowns is regular to working precision.
    """

    loose: Bool[Array, " n"]
    regular: Bool[Array, ""]

    @abc.abstractmethod
    def answered(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
        """Solution [n] with the matrix or its transpose, and `regular`."""

    @abc.abstractmethod
    def checked(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""], Bool[Array, ""]]:
        """`answered`, and whether rounding leaves anything of the solution."""

    @abc.abstractmethod
    def or_identity(self) -> Self:
        """This factor, or that of the identity if the matrix is singular."""

    def solve(
        self, rhs: Float[Array, " n"], matvec: Callable[[Float[Array, " n"]], Float[Array, " n"]]
    ) -> Float[Array, " n"]:
        """Solve for `rhs` [n]; derivatives are those of the linear function `matvec`.

        All NaN if the matrix is singular. Loose unknowns have no value: they are NaN, the others
        are exact. An adjoint whose right side is not zero at a loose unknown is all NaN.
        """

        def forward(_, b):
            answer, regular = self.answered(b, False)
            return jnp.where(self.loose | ~regular, jnp.nan, answer)

        def backward(_, b):
            return self.adjoint(b)

        return lax.custom_linear_solve(matvec, rhs, solve=forward, transpose_solve=backward)

    def marked(self, b: Float[Array, " n"]) -> tuple[Float[Array, " n"], Bool[Array, " n"]]:
        """Solution [n] with zeros for unknowns without a value, and which these are, [n]."""
        answer, regular, sound = self.checked(b, False)
        unknown = self.loose | ~regular | ~sound
        return jnp.where(unknown, 0.0, answer), unknown

    def adjoint(self, b: Float[Array, " n"]) -> Float[Array, " n"]:
        """Solution [n] with the transposed matrix; NaN if `b` asks for what has no value."""
        # Not linear, on purpose: a loose unknown or a singular matrix gives NaN only if the right
        # side concerns it, so that phases and unknowns without influence do not spoil a gradient.
        answer, regular, sound = self.checked(b, True)
        asked = jnp.any((self.loose | ~regular) & (b != 0))
        answer = jnp.where(regular, answer, 0.0)
        return jnp.where(asked | (regular & ~sound), jnp.nan, answer)


class Direct(Factor):
    """A factor inside of the compiled program, of a matrix that is scaled to unit diagonal.

    Attributes:
        size: scaling, the root of the diagonal, [n].
        loose, regular: see `Factor`.
        replaced: whether this stands for the factor of the identity, scalar bool; None if not.
    """

    size: Float[Array, " n"]
    replaced: Bool[Array, ""] | None

    @abc.abstractmethod
    def substituted(self, b: Float[Array, " n"], transposed: bool) -> Float[Array, " n"]:
        """Solution [n] of the scaled matrix, or of its transpose."""

    @abc.abstractmethod
    def product(self, x: Float[Array, " n"], transposed: bool) -> Float[Array, " n"]:
        """The scaled matrix, or its transpose, times a vector [n]."""

    def or_identity(self) -> Self:
        """See `Factor`."""
        size = jnp.where(self.regular, self.size, 1.0)
        return copy(self, size=size, regular=jnp.ones((), bool), replaced=~self.regular)

    def answered(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
        """See `Factor`."""
        b = jnp.where(self.loose, 0.0, b) / self.size
        return self._unless_replaced(self.substituted(b, transposed), b) / self.size, self.regular

    def checked(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""], Bool[Array, ""]]:
        """See `Factor`: sound if rounding leaves no more than a percent of the answer.

        A matrix that is singular up to rounding may have regular pivots. Then the correction of
        iterative refinement is as large as the answer itself.
        """
        answer, regular = self.answered(b, transposed)
        scaled, left = self.size * answer, jnp.where(self.loose, 0.0, b)
        left = left - self.size * self._unless_replaced(self.product(scaled, transposed), scaled)
        error = jnp.max(jnp.abs(self.size * self.answered(left, transposed)[0]), initial=0.0)
        largest = jnp.max(jnp.abs(scaled), initial=0.0)
        return answer, regular, ~(error > _UNSURE * largest)

    def _unless_replaced(self, x, same):
        return x if self.replaced is None else jnp.where(self.replaced, same, x)


def scales(diagonal: Float[Array, " n"]) -> Float[Array, " n"]:
    """What rows and columns are divided by for a unit diagonal, so that pivots can be compared."""
    size = jnp.sqrt(jnp.abs(diagonal))
    return jnp.where(size > 0, size, 1.0)


def have_digits(pivots: Float[Array, " n"]) -> Bool[Array, ""]:
    """Whether all pivots of a scaled matrix are beyond its rounding, n eps of the largest."""
    limit = len(pivots) * jnp.finfo(pivots.dtype).eps * jnp.max(pivots, initial=0.0)
    return jnp.all(pivots > limit) & jnp.all(jnp.isfinite(pivots))
