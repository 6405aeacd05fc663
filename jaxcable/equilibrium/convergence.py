"""Convergence criterion of an increment: the residual beside the forces and beside the added load.

A residual of 1e-10 of the forces may be more than a small load on a highly prestressed structure:
by the forces alone, such a load would move nothing. Hence the dead loads that a phase adds at nodes
are a second measure. The residual that earlier increments have left within their tolerance is
carried along as a constant load: otherwise its correction would be added to the displacement of
this increment.

If the residual meets the first criterion but not the second, and no longer falls, a limited number
of steps is taken without progress. Then the increment counts as converged if the residual leaves
half of the digits of the load, and ends AT_ROUNDING if not. In float32, whose forces have seven
digits in all, only the forces count.
"""

from __future__ import annotations

from typing import Protocol

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike

from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..mechanics.assembly import System
from .newton_step import max_abs

# Residual beside a small load, over tol: 5e-9 of it. Where a load stops being small, this is half
# of what the forces allow, so that the criterion hardly jumps there.
_TOL_OF_LOAD = 50.0
_SMALL_LOAD = 1e-2  # load over the forces up to which it is small: beyond, tol is 1e-8 of it
# Largest residual that is carried along, over the tolerance: below 1, because the residual with the
# carried part must meet the tolerance, too.
_MAX_CARRIED = 0.9
# Steps for which it is carried. A small load takes a few; where nothing can balance the carried
# residual (all elements of a node slack), the iteration must be able to give it up.
_CARRIED_STEPS = 20
_STAGNANT_STEPS = 10  # steps without halving the residual after which only rounding is left of it
_HALF_DIGITS = 0.25  # residual over the load, in sqrt(eps), above which half of the digits are lost
_MAX_GRANTED = 1e-3  # residual over the load up to which the rounding of displacements excuses it
# Load in roundings (eps) of the forces up to which it counts as none: sin(pi) times a load is that
# of a model whose load is meant to be zero.
_NO_LOAD = 64.0


class IterationSettings(Protocol):
    """Settings that the iteration needs, as `newton.Newton` has them."""

    @property
    def tol(self) -> Float[ArrayLike, ""] | None:
        """Relative residual that counts as converged; None for the default of the dtype."""

    @property
    def max_steps(self) -> Int[ArrayLike, ""]:
        """Largest number of Newton steps per increment."""


def default_tolerance(dtype: DTypeLike) -> float:
    """Return the default relative tolerance of a dtype: 1e-10, or 1e-5 in float32."""
    return 1e-10 if jnp.finfo(dtype).eps < 1e-12 else 1e-5


def residual_tolerance(method: IterationSettings, dtype: DTypeLike) -> Float[Array, ""]:
    """Return the relative residual that counts as converged: `method.tol`, at least 64 eps."""
    tol = default_tolerance(dtype) if method.tol is None else method.tol
    return jnp.maximum(jnp.asarray(tol, dtype), 64 * jnp.finfo(dtype).eps)


@pytree
class AddedLoadCriterion:
    """Second criterion of convergence: the residual is small beside the load that a phase adds.

    An increment must meet it in addition to the first one, the residual beside the forces
    (`residual_tolerance`), unless the residual no longer falls. `compare_with_load` says how small
    it must be, `carried_residual` when the earlier residual acts as a load.

    Attributes:
        earlier_residual: residual that earlier increments have left, [n_free], N.
        added_load: largest dead load that the phase adds at a node, N; infinite if it adds none.
    """

    earlier_residual: Float[Array, " n_free"]
    added_load: Float[Array, ""]

    @classmethod
    def for_increment(
        cls,
        system: System,
        earlier_residual: Float[Array, " n_free"],
        load_at_start: Float[Array, "n_row n_freedom"],
        factor: Float[Array, ""],
        largest_added: Float[Array, ""] | None = None,
    ) -> AddedLoadCriterion:
        """Make the criterion of an increment.

        Args:
            system: `System` of the increment.
            earlier_residual: residual that earlier increments have left, [n_free], N.
            load_at_start: dead load at the start of the phase, [n_row, n_freedom], N and N m.
            factor: load factor of the increment; at 0 nothing is added.
            largest_added: largest load that the phase adds at a node, N, if loads are not
                proportional to the load factor.
        """
        if largest_added is None:
            load = jnp.max(system.space.force_norm(system.load - load_at_start)) / factor
        else:
            load = jnp.where(factor > 0, largest_added, 0.0)
        return cls(earlier_residual, jnp.where(load > 0, load, jnp.inf))

    @jax.jit  # one function in a program
    def carried_residual(
        self, scale: Float[Array, ""], tol: Float[Array, ""], steps: Int[Array, ""]
    ) -> Float[Array, " n_free"]:
        """Return the earlier residual if it is carried along as a load, else zeros, [n_free], N.

        It is carried only if the added load is small beside `scale`, and only for some steps: where
        all elements of a node go slack, nothing can balance it.

        Args:
            scale: force that residuals are compared with, N.
            tol: relative tolerance.
            steps: Newton steps so far.
        """
        small = max_abs(self.earlier_residual) <= _MAX_CARRIED * tol * scale
        small = small & (self.added_load <= _SMALL_LOAD * scale) & (steps <= _CARRIED_STEPS)
        return jnp.where(small, self.earlier_residual, 0.0)

    def compare_with_load(
        self,
        residual: Float[Array, " n_free"],
        granted: Float[Array, " n_free"],
        scale: Float[Array, ""],
        start_residual: Float[Array, ""],
        tol: Float[Array, ""],
    ) -> tuple[Bool[Array, ""], Bool[Array, ""]]:
        """Compare a residual with the load that the phase adds.

        Args:
            residual: residual, [n_free], N.
            granted: part of it that the rounding of displacements explains, [n_free], N.
            scale: force that residuals are compared with, N.
            start_residual: largest residual at the start of the increment, N. It includes
                prestress and movements of supports: a load that is small beside them need not be
                resolved.
            tol: relative tolerance.

        Returns:
            Whether the criterion is met: the residual is at most 50 `tol` of the load (or what is
            granted, up to 1e-3 of the load), or the load is no small one, more than 1e-2 of
            `scale`. And whether it is not met, and leaves less than half of the digits of the load.
        """
        added, eps = jnp.maximum(self.added_load, start_residual), jnp.finfo(residual.dtype).eps
        allowed = jnp.maximum(
            _TOL_OF_LOAD * tol * added, jnp.minimum(granted, _MAX_GRANTED * added)
        )
        met = jnp.all(jnp.abs(residual) <= allowed) | (added > _SMALL_LOAD * scale)
        lost = max_abs(residual) > _HALF_DIGITS * eps**0.5 * added
        lost = lost & (self.added_load > _NO_LOAD * eps * scale)
        return met, ~met & lost


@pytree
class Progress:
    """Start values of an iteration, and whether its residual still falls.

    Attributes:
        has_begun: whether a point has been evaluated.
        start_residual: largest residual at the start of the increment, N.
        start_rounding: residual that the rounding of the first point excuses throughout, N, a
            scalar or [n_free]; None if no element estimates any.
        stagnant_steps: steps that met the criterion of forces without halving the residual.
    """

    has_begun: Bool[Array, ""]
    start_residual: Float[Array, ""]
    start_rounding: Array | None
    stagnant_steps: Int[Array, ""]


class Convergence:
    """Both criteria of convergence of an increment.

    Args:
        settings: `IterationSettings`.
        criterion: `AddedLoadCriterion` of the increment; None: the residual is only compared with
            forces. So it is in float32.
        dtype: dtype of the motion.
    """

    def __init__(
        self, settings: IterationSettings, criterion: AddedLoadCriterion | None, dtype: DTypeLike
    ):
        self.tol, self.max_steps = residual_tolerance(settings, dtype), settings.max_steps
        self.criterion = criterion if jnp.finfo(dtype).eps < 1e-12 else None

    def carried_residual(
        self, scale: Float[Array, ""], steps: Int[Array, ""]
    ) -> Float[ArrayLike, " n_free"]:
        """Return the earlier residual that counts as a load, [n_free], N."""
        if self.criterion is None:
            return 0.0
        return self.criterion.carried_residual(scale, self.tol, steps)

    def compare(
        self,
        progress: Progress,
        residuals: tuple[Float[Array, " n_free"], Float[Array, ""]],
        scale: Float[Array, ""],
        granted: Float[Array, " n_free"],
        steps: Int[Array, ""],
        search_over: Bool[Array, ""],
    ) -> tuple[Progress, Bool[Array, ""], Bool[ArrayLike, ""]]:
        """Compare the residual at a point with the tolerances.

        Args:
            progress: `Progress` so far.
            residuals: residual at the point, less the carried one, [n_free], and the largest one at
                the point before, N.
            scale: force that residuals are compared with, N.
            granted: residual that rounding excuses, [n_free], N.
            steps: Newton steps so far.
            search_over: whether the search along the last step has ended.

        Returns:
            The `Progress`; whether the point is an equilibrium; whether it leaves less than half of
            the digits of the load.
        """
        residual, before = residuals
        balanced = residual + self.carried_residual(scale, steps)
        converged = jnp.all(jnp.abs(balanced) <= jnp.maximum(self.tol * scale, granted))
        if self.criterion is None:
            return progress, converged, False
        halved = max_abs(residual) < 0.5 * before
        stagnant = progress.stagnant_steps + (converged & search_over & ~halved)
        given = residual, granted, scale, progress.start_residual, self.tol
        met, lost = self.criterion.compare_with_load(*given)
        ends = converged & (met | (stagnant >= _STAGNANT_STEPS) | (steps >= self.max_steps))
        return copy_with(progress, stagnant_steps=stagnant), ends, ends & lost
