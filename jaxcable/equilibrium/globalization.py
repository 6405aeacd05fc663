"""Globalization of Newton's method: the Levenberg shift, and steps without line search.

Each is a pytree of numbers with ``initial`` for its first value and ``update`` for the value after
an iteration of `newton.equilibrate`. They change the steps, never the equilibrium that is found.
The other parts of the globalization are the line search (`numerics.line_search`), the length to
which a step is cut before it is tried (`predicted_forces`, `interior_point`, `conic_equations`),
and the change from one kind of steps to another (`tension_unknowns.TensionUnknowns.switch_mode`).

All shifts of the diagonal of a matrix:

- `LevenbergShift`: structures that are no nets, and line searches of nets. It is zero in full steps
  of structures with nodes that rotate; in all others full steps have it, too.
- `MIXED_SHIFT`: all steps of nets but interior ones.
- ``damping`` of `interior_point`: interior steps with bounds. Those with cones have none.
- `TensionUnknowns.min_shift_in_eps`: the least shift in nets, in line searches and after indefinite
  matrices.
- `newton_step.stability_shift`: at an equilibrium, where only its stability is judged.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax.typing import DTypeLike

from ..common.tree import pytree
from ..common.types import Array, Bool, Float, Int
from .newton_step import max_abs

_KAPPA = 1e-3  # initial shift: harmless in a taut net, a step of 1000 lengths in a slack one
_KAPPA_MIN, _KAPPA_MAX = 1e-10, 1e14  # bounds that keep the shift a usable float
# Residual after a step over that before, at most, where the step may lead uphill: a small decrease
# is asked for, so that such steps cannot creep without end.
_MAX_RATIO = 0.9
# Full Newton steps that are tried first, at most: enough for an iteration that converges by them,
# and few enough to lose where it does not.
_FULL_STEPS = 20
ASTRAY = 10.0  # displacement, in structure sizes, at which full steps count as failed
MIXED_SHIFT = 1e-6  # shift of mixed and finishing steps of nets, over tension per length


@pytree
class LevenbergShift:
    """Levenberg shift of the tangent's diagonal, proportional to the residual.

    It is ``kappa |R| / l`` with the largest residual R, N, and the mean length l of elements, m.

    Attributes:
        kappa: dimensionless factor.
    """

    kappa: Float[Array, ""]

    @classmethod
    def initial(cls, dtype: DTypeLike) -> LevenbergShift:
        """Return the shift with the first `kappa`."""
        return cls(jnp.asarray(_KAPPA, dtype))

    def value(self, residual: Float[Array, ""], length: Float[Array, ""]) -> Float[Array, ""]:
        """Return the shift, N/m, for the largest `residual`, N, and mean element `length`, m."""
        return self.kappa * residual / length

    def update(self, accepted: Bool[Array, ""], length: Float[Array, ""]) -> LevenbergShift:
        """Return the next shift: smaller after a full step, larger after a short one or none.

        Args:
            accepted: whether a step was taken.
            length: the length of the step that was taken (`LineSearch.length`), in (0, 1].
        """
        factor = jnp.where(length >= 1, 0.1, jnp.where(length < 0.1, 10.0, 1.0))
        kappa = self.kappa * jnp.where(accepted, factor, 100.0)
        return LevenbergShift(jnp.clip(kappa, _KAPPA_MIN, _KAPPA_MAX))


@pytree
class FullStepPhase:
    """Up to 20 full Newton steps without line search with which some iterations begin; and after.

    They are those of structures whose tangent can be unsymmetric, by rotations, following loads or
    elements. If they fail, the iteration starts again from its first point, with line search. They
    fail at an indefinite tangent if it is symmetric; an unsymmetric one they pass.

    Attributes:
        is_on: whether the iteration takes full steps without line search.
        may_go_uphill: of the steps after this phase: whether the tangent is unsymmetric and its
            symmetric part not positive definite, so that the step need not be a descent direction:
            it is tried whole, and taken if it decreases the residual.
    """

    is_on: Bool[Array, ""]
    may_go_uphill: Bool[Array, ""]

    @classmethod
    def initial(cls) -> FullStepPhase:
        """Return the state at the start of an iteration: full steps are on."""
        return cls(jnp.ones((), bool), jnp.zeros((), bool))

    def accept(
        self,
        searched: tuple[Bool[Array, ""], Bool[Array, ""]],
        finite: Bool[Array, ""],
        residuals: tuple[Float[Array, " n_free"], Float[Array, " n_free"]],
    ) -> tuple[Bool[Array, ""], Bool[Array, ""]]:
        """Decide whether a point is accepted, and whether a shorter step is tried if not.

        Args:
            searched: these two decisions by the line search; full steps ignore them.
            finite: whether the forces at the point are finite.
            residuals: before the step and at the point, [n_free] each, N.

        Returns:
            The two decisions.
        """
        fine, again = searched
        fine, again = jnp.where(self.is_on, finite, fine), again & ~self.is_on
        before, after = map(max_abs, residuals)
        falls = finite & (after < _MAX_RATIO * before)
        return jnp.where(self.may_go_uphill, falls, fine), again & ~self.may_go_uphill

    def update(
        self,
        accepted: Bool[Array, ""],
        largest_displacement: Float[Array, ""],
        steps: Int[Array, ""],
        extent: Float[Array, ""],
        converged: Bool[Array, ""],
    ) -> tuple[FullStepPhase, Bool[Array, ""]]:
        """Return the state after a step, and whether the iteration starts again.

        Args:
            accepted: whether a step was taken, to a point with finite forces.
            largest_displacement: largest displacement at that point, m.
            steps: Newton steps so far, this one included.
            extent: size of the structure, m.
            converged: whether the point is an equilibrium.
        """
        astray = largest_displacement > ASTRAY * extent
        is_on = self.is_on & accepted & ~astray & (steps < _FULL_STEPS)
        return FullStepPhase(is_on, self.may_go_uphill), self.is_on & ~is_on & ~converged
