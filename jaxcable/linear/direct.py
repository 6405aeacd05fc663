"""What factors inside of the compiled program share: solves with marks, checked by refinement."""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Self

import jax.numpy as jnp
from jax import lax

from ..common.types import Array, Bool, Float

_UNSURE = 1e-2  # error of an answer, by rounding, from which it is none


class Direct(abc.ABC):
    """A factor of a general matrix that is scaled to unit diagonal.

    Attributes:
        size: scaling, the root of the diagonal, [n].
        loose: unknowns without a value, [n] bool.
        regular: whether the matrix of the other unknowns is regular to working precision.
    """

    size: Float[Array, " n"]
    loose: Bool[Array, " n"]
    regular: Bool[Array, ""]

    @abc.abstractmethod
    def substituted(self, b: Float[Array, " n"], transposed: bool) -> Float[Array, " n"]:
        """Solution [n] of the scaled matrix, or of its transpose."""

    @abc.abstractmethod
    def product(self, x: Float[Array, " n"], transposed: bool) -> Float[Array, " n"]:
        """The scaled matrix, or its transpose, times a vector [n]."""

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
            return jnp.where(self.loose | ~self.regular, jnp.nan, self._answer(b, False))

        def backward(_, b):
            return self.adjoint(b)

        return lax.custom_linear_solve(matvec, rhs, solve=forward, transpose_solve=backward)

    def _answer(self, b, transposed):
        b = jnp.where(self.loose, 0.0, b) / self.size
        return self.substituted(b, transposed) / self.size

    def marked(self, b: Float[Array, " n"]) -> tuple[Float[Array, " n"], Bool[Array, " n"]]:
        """Solution [n] with zeros for unknowns without a value, and which these are, [n]."""
        answer, sound = self._checked(b, False)
        unknown = self.loose | ~self.regular | ~sound
        return jnp.where(unknown, 0.0, answer), unknown

    def adjoint(self, b: Float[Array, " n"]) -> Float[Array, " n"]:
        """Solution [n] with the transposed matrix; NaN if `b` asks for what has no value."""
        # Not linear, on purpose: a loose unknown or a singular matrix gives NaN only if the right
        # side concerns it, so that phases and unknowns without influence do not spoil a gradient.
        asked = jnp.any((self.loose | ~self.regular) & (b != 0))
        answer, sound = self._checked(b, True)
        answer = jnp.where(self.regular, answer, 0.0)
        return jnp.where(asked | (self.regular & ~sound), jnp.nan, answer)

    def _checked(self, b, transposed):
        """The answer, and whether rounding leaves more than a percent of it.

        A matrix that is singular up to rounding may have regular pivots. Then the correction of
        iterative refinement is as large as the answer itself.
        """
        answer = self._answer(b, transposed)
        left = jnp.where(self.loose, 0.0, b)
        left = left - self.size * self.product(self.size * answer, transposed)
        error = jnp.max(jnp.abs(self.size * self._answer(left, transposed)), initial=0.0)
        largest = jnp.max(jnp.abs(self.size * answer), initial=0.0)
        return answer, ~(error > _UNSURE * largest)
