"""What steers Newton's method from far away: three small policies, none of which knows the others.

Each is a pytree of numbers with ``init`` and what it makes of what happened in an iteration of
`newton.equilibrate`. They steer the steps and leave the equilibrium as it is.
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
_SETTLED = 0.1  # relative residual at which the added softness is taken back a step
_HARDEN = 0.1  # by this factor
_STIFF = 0.01  # added strain, relative to the elastic one, that is dropped altogether
_SPRINT = 20  # plain Newton steps that may be tried first
_ASTRAY = 10.0  # displacement, in structure sizes, at which they have led nowhere


@pytree
class Shift:
    """Levenberg shift ``kappa |R| / l`` on the tangent, which dies with the residual.

    Attributes:
        kappa: scalar, in |R| / length.
    """

    kappa: Float[Array, ""]

    @classmethod
    def init(cls, dtype: DTypeLike) -> Shift:
        """The first shift."""
        return cls(jnp.asarray(_KAPPA, dtype))

    def on(self, residual: Float[Array, ""], length: Float[Array, ""]) -> Float[Array, ""]:
        """The shift, N/m, for a largest residual, N, in a structure of a size, m."""
        return self.kappa * residual / length

    def update(self, found: Bool[Array, ""], taken: Float[Array, ""]) -> Shift:
        """Less after a whole step, more after a short one, much more where there was none.

        Args:
            found: whether there was a step.
            taken: its length, in (0, 1].
        """
        part = jnp.where(taken >= 1, 0.1, jnp.where(taken < 0.1, 10.0, 1.0))
        # keeps the shift a usable float
        return Shift(jnp.clip(self.kappa * jnp.where(found, part, 100.0), _KAPPA_MIN, _KAPPA_MAX))


@pytree
class Sprint:
    """Up to 20 plain Newton steps, taken whole; the iteration begins again if they lead nowhere.

    Attributes:
        on: whether they are being tried.
    """

    on: Bool[Array, ""]

    @classmethod
    def init(cls) -> Sprint:
        """They are tried first."""
        return cls(jnp.ones((), bool))

    def update(
        self,
        found: Bool[Array, ""],
        reach: Float[Array, ""],
        steps: Int[Array, ""],
        extent: Float[Array, ""],
        converged: Bool[Array, ""],
    ) -> tuple[Sprint, Bool[Array, ""]]:
        """The sprint after a step, and whether to begin again.

        Args:
            found: whether there was a step that leads to numbers.
            reach: largest displacement where it led, m.
            steps: Newton steps so far, with it.
            extent: size of the structure, m.
            converged: whether that is an equilibrium.
        """
        astray = reach > _ASTRAY * extent
        on = self.on & found & ~astray & (steps < _SPRINT)
        return Sprint(on), self.on & ~on & ~converged


@pytree
class Softening:
    """A spring in series with every element of a tension-only structure, for the time being.

    Stiff cables that swing allow only short steps; after 15 of them each is softened to strain 1
    under the largest load, and stiffened by tens as it settles.

    Attributes:
        softness: compliance added to every element, strain per force, 1/N; 0 most of the time.
        softest: the largest that is added; 0 where there is no load to take it from.
        short: short steps so far.
        stiffness: largest on the diagonal of the last tangent, times a length, N.
    """

    softness: Float[Array, ""]
    softest: Float[Array, ""]
    short: Int[Array, ""]
    stiffness: Float[Array, ""]

    @classmethod
    def init(cls, load: Float[Array, ""]) -> Softening:
        """No softness; `load` is the largest at a node, N."""
        zero = jnp.zeros_like(load)
        return cls(zero, 1 / jnp.where(load > 0, load, jnp.inf), jnp.int32(0), zero)

    def seen(self, matrix: Matrix, length: Float[Array, ""]) -> Softening:
        """With the stiffness of a tangent noted."""
        return copy(self, stiffness=jnp.max(linear.diagonal(matrix), initial=0.0) * length)

    def update(self, found: Bool[Array, ""], taken: Float[Array, ""]) -> Softening:
        """After a step: one that is short, or none, counts."""
        return copy(self, short=self.short + jnp.where((taken < SHORT) | ~found, 1, 0))

    def change(
        self, residual: Float[Array, ""], scale: Float[Array, ""]
    ) -> tuple[Softening, Bool[Array, ""]]:
        """The softness for the next step, and whether it is another one.

        Args:
            residual: largest, N.
            scale: the force that it is judged by, N.
        """
        begin = (self.short == _PATIENCE) & (self.softest > 0)
        settled = (self.softness > 0) & (residual <= _SETTLED * scale)
        harder = self.softness * _HARDEN
        harder = jnp.where(self.softness * self.stiffness < _STIFF, 0.0, harder)
        changed = begin | settled
        softness = jnp.where(begin, self.softest, jnp.where(settled, harder, self.softness))
        return copy(self, softness=softness, short=self.short + begin), changed
