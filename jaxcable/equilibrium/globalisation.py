"""Globalisation of Newton's method: three small policies, independent of each other.

Each is a pytree of numbers with ``init`` for its first value and ``update`` for the value after an
iteration of `newton.equilibrate`. They change the steps, never the equilibrium that is found.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax.typing import DTypeLike

from .. import linear
from ..common.tree import copy, pytree
from ..common.types import Array, Bool, Float, Int
from ..linear import Matrix
from ..numerics.search import SHORT

_KAPPA = 1e-3  # initial shift: harmless in a taut net, a step of 1000 lengths in a slack one
_KAPPA_MIN, _KAPPA_MAX = 1e-10, 1e14
_PATIENCE = 15  # short steps before a tension-only structure is softened
_SETTLED = 0.1  # relative residual at which the added softness is reduced
_HARDEN = 0.1  # factor of each reduction
_STIFF = 0.01  # added strain over elastic strain, below which the softness is set to zero
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
    """

    on: Bool[Array, ""]

    @classmethod
    def init(cls) -> Sprint:
        """The sprint at the start of an iteration: on."""
        return cls(jnp.ones((), bool))

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
        return Sprint(on), self.on & ~on & ~converged


@pytree
class Softening:
    """A temporary spring in series with every element of a tension-only structure.

    Stiff cables that swing allow only short steps. After 15 short steps every element is softened
    to strain 1 under the largest load; the softness is divided by ten each time the residual has
    become small, until it is zero.

    Attributes:
        softness: compliance added to every element, strain per force, 1/N; 0 unless needed.
        softest: the largest compliance that is added; 0 without load.
        short: number of short steps so far.
        stiffness: largest entry on the diagonal of the last tangent, times a length, N.
    """

    softness: Float[Array, ""]
    softest: Float[Array, ""]
    short: Int[Array, ""]
    stiffness: Float[Array, ""]

    @classmethod
    def init(cls, load: Float[Array, ""]) -> Softening:
        """The start: no softness. `load` is the largest force of the dead loads at a node, N."""
        zero = jnp.zeros_like(load)
        return cls(zero, 1 / jnp.where(load > 0, load, jnp.inf), jnp.int32(0), zero)

    def seen(self, matrix: Matrix, length: Float[Array, ""]) -> Softening:
        """This softening with `stiffness` from a tangent and the length of the structure, m."""
        return copy(self, stiffness=jnp.max(linear.diagonal(matrix), initial=0.0) * length)

    def update(self, found: Bool[Array, ""], taken: Float[Array, ""]) -> Softening:
        """This softening after a step; arguments as for `Shift.update`. Counts short steps."""
        return copy(self, short=self.short + jnp.where((taken < SHORT) | ~found, 1, 0))

    def change(
        self, residual: Float[Array, ""], scale: Float[Array, ""]
    ) -> tuple[Softening, Bool[Array, ""]]:
        """The softening for the next step, and whether its softness has changed.

        Args:
            residual: largest unbalanced force, N.
            scale: the force that it is judged by, N.
        """
        begin = (self.short == _PATIENCE) & (self.softest > 0)
        settled = (self.softness > 0) & (residual <= _SETTLED * scale)
        harder = self.softness * _HARDEN
        harder = jnp.where(self.softness * self.stiffness < _STIFF, 0.0, harder)
        changed = begin | settled
        softness = jnp.where(begin, self.softest, jnp.where(settled, harder, self.softness))
        return copy(self, softness=softness, short=self.short + begin), changed
