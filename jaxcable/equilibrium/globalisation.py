"""Globalisation of Newton's method: two small policies, independent of each other.

Each is a pytree of numbers with ``init`` for its first value and ``update`` for the value after an
iteration of `newton.equilibrate`. They change the steps, never the equilibrium that is found.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax.typing import DTypeLike

from ..common.tree import pytree
from ..common.types import Array, Bool, Float, Int
from .newton_step import largest

_KAPPA = 1e-3  # initial shift: harmless in a taut net, a step of 1000 lengths in a slack one
_KAPPA_MIN, _KAPPA_MAX = 1e-10, 1e14
_FALLS = 0.9  # part of the residual that a step leaves at most, where nothing else proves it
_SPRINT = 20  # number of plain Newton steps that are tried first, at most
ASTRAY = 10.0  # displacement, in structure sizes, at which a sprint counts as failed


@pytree
class Shift:
    """Levenberg shift ``kappa |R| / l`` on the tangent, which vanishes with the residual.

    Attributes:
        kappa: scalar, in |R| / length.
    """

    kappa: Float[Array, ""]

    @classmethod
    def init(cls, dtype: DTypeLike) -> Shift:
        """The first shift."""
        return cls(jnp.asarray(_KAPPA, dtype))

    def on(self, residual: Float[Array, ""], length: Float[Array, ""]) -> Float[Array, ""]:
        """The shift, N/m, for the largest `residual`, N, and the `length` of the structure, m."""
        return self.kappa * residual / length

    def update(self, found: Bool[Array, ""], taken: Float[Array, ""]) -> Shift:
        """The next shift: smaller after a full step, larger after a short one or after none.

        Args:
            found: whether a step was taken.
            taken: the part of it that was taken, in (0, 1].
        """
        part = jnp.where(taken >= 1, 0.1, jnp.where(taken < 0.1, 10.0, 1.0))
        # keeps the shift a usable float
        return Shift(jnp.clip(self.kappa * jnp.where(found, part, 100.0), _KAPPA_MIN, _KAPPA_MAX))


@pytree
class Sprint:
    """Up to 20 full Newton steps without search; if they fail, the iteration begins again.

    Attributes:
        on: whether the iteration is sprinting.
        unproven: whether, after the sprint, the symmetric part of an unsymmetric tangent is not
            positive definite, so that the step need not lead downhill: it is tried whole, and taken
            if it decreases the residual. None where all tangents are symmetric.
    """

    on: Bool[Array, ""]
    unproven: Bool[Array, ""] | None = None

    @classmethod
    def init(cls, may_be_unsymmetric: bool) -> Sprint:
        """The sprint at the start of an iteration: on."""
        return cls(jnp.ones((), bool), jnp.zeros((), bool) if may_be_unsymmetric else None)

    def accept(
        self,
        searched: tuple[Bool[Array, ""], Bool[Array, ""]],
        finite: Bool[Array, ""],
        residuals: tuple[Float[Array, " n_free"], Float[Array, " n_free"]],
    ) -> tuple[Bool[Array, ""], Bool[Array, ""]]:
        """Decide whether a point is accepted, and whether a shorter step is tried if not.

        Args:
            searched: what the line search says of both; it does not decide about whole steps.
            finite: whether the forces at the point are finite.
            residuals: before the step and at the point, N.
        """
        fine, again = searched
        fine, again = jnp.where(self.on, finite, fine), again & ~self.on
        if self.unproven is None:
            return fine, again
        before, after = map(largest, residuals)
        falls = finite & (after < _FALLS * before)
        return jnp.where(self.unproven, falls, fine), again & ~self.unproven

    def update(
        self,
        found: Bool[Array, ""],
        reach: Float[Array, ""],
        steps: Int[Array, ""],
        extent: Float[Array, ""],
        converged: Bool[Array, ""],
    ) -> tuple[Sprint, Bool[Array, ""]]:
        """The sprint after a step, and whether the iteration begins again.

        Args:
            found: whether a step was taken, to a point with finite forces.
            reach: largest displacement at that point, m.
            steps: Newton steps so far, this one included.
            extent: size of the structure, m.
            converged: whether the point is an equilibrium.
        """
        astray = reach > ASTRAY * extent
        on = self.on & found & ~astray & (steps < _SPRINT)
        return Sprint(on, self.unproven), self.on & ~on & ~converged
