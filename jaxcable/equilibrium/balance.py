"""Convergence of an increment: a residual small beside the forces and beside the load of the phase.

A residual of 1e-10 of the forces may be more than a small load on a highly prestressed structure:
judged by the forces alone, such a load would move nothing. Hence what a phase adds to the dead
loads at nodes is a second measure. The residual that earlier increments have left within their
tolerance is carried along as a constant load: otherwise its correction would be added to the
displacement of this increment.

If the residual meets the first criterion but not the second, and falls no more, some steps are
taken in vain. Then the equilibrium is good if the residual leaves half of the digits of the load,
and AT_ROUNDING if not. In float32, whose forces have seven digits at all, only the forces count.
"""

from __future__ import annotations

from typing import Protocol

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike

from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..mechanics.assembly import System
from .newton_step import largest

_OF_LOAD = 50.0  # factor on tol for a small load: 5e-9 of it
_SMALL = 1e-2  # load over the forces up to which it is small: beyond, tol is 1e-8 of it
_CARRIED = 0.9  # largest carried residual, over the tolerance
_CARRIED_STEPS = 20  # steps for which it is carried: a small load takes a few
_VAIN_STEPS = 10  # steps without halving the residual after which rounding holds it
_HALF = 0.25  # residual over the load, in square roots of eps, up to which half of the digits hold
_GRANTED = 1e-3  # residual over the load up to which the rounding of displacements is granted
_NONE = 64.0  # load in roundings (eps) of the forces up to which it is none, as a sine of pi is


class Method(Protocol):
    """What an iteration needs of its method, such as `newton.Newton`."""

    @property
    def tol(self) -> Float[ArrayLike, ""] | None:
        """Relative residual that counts as converged; None for the default."""

    @property
    def max_steps(self) -> Int[ArrayLike, ""]:
        """Steps allowed per increment."""


def default_tolerance(dtype: DTypeLike) -> float:
    """Relative tolerance that a dtype can be expected to reach: 1e-10, or 1e-5 in float32."""
    return 1e-10 if jnp.finfo(dtype).eps < 1e-12 else 1e-5


def limit(method: Method, dtype: DTypeLike) -> Float[Array, ""]:
    """The relative residual that counts as converged."""
    tol = default_tolerance(dtype) if method.tol is None else method.tol
    return jnp.maximum(jnp.asarray(tol, dtype), 64 * jnp.finfo(dtype).eps)


@pytree
class Balance:
    """What an increment asks of its residual.

    Attributes:
        left: residual that the increments before have left, [n_free], N.
        load: largest dead load that the phase adds at a node, N; infinite if it adds none.
    """

    left: Float[Array, " n_free"]
    load: Float[Array, ""]

    @classmethod
    def of(
        cls,
        system: System,
        left: Float[Array, " n_free"],
        begun: Float[Array, "n_row n_freedom"],
        factor: Float[Array, ""],
        most: Float[Array, ""] | None = None,
    ) -> Balance:
        """The balance of an increment.

        Args:
            system: `System` of the increment.
            left: as of `Balance`.
            begun: dead load at the start of the phase, [n_row, n_freedom], N and N m.
            factor: load factor of the increment; at 0 nothing is added.
            most: `Balance.load`, if the load is not proportional to the load factor.
        """
        if most is None:
            load = jnp.max(system.space.size(system.load - begun)) / factor
        else:
            load = jnp.where(factor > 0, most, 0.0)
        return cls(left, jnp.where(load > 0, load, jnp.inf))

    @jax.jit  # one function in a program
    def carried(
        self, scale: Float[Array, ""], tol: Float[Array, ""], steps: Int[Array, ""]
    ) -> Float[Array, " n_free"]:
        """The residual that is carried along after so many steps, [n_free], N.

        Only beside a load that is small beside the force `scale`, N, that residuals are judged by,
        and only for some steps: where all elements of a node go slack, nothing can balance it.
        """
        small = largest(self.left) <= _CARRIED * tol * scale
        small = small & (self.load <= _SMALL * scale) & (steps <= _CARRIED_STEPS)
        return jnp.where(small, self.left, 0.0)

    def judged(
        self,
        residual: Float[Array, " n_free"],
        granted: Float[Array, " n_free"],
        scale: Float[Array, ""],
        begun: Float[Array, ""],
        tol: Float[Array, ""],
    ) -> tuple[Bool[Array, ""], Bool[Array, ""]]:
        """Return whether a residual is small beside the load, and whether half its digits are lost.

        Args:
            residual: N.
            granted: what the rounding of displacements leaves of it, N.
            scale: force that it is judged by, N.
            begun: largest residual at the start of the increment, N. It includes statements of
                prestress and movements of supports: a load that is small beside them need not be
                resolved.
            tol: tolerance beside the scale.
        """
        added, eps = jnp.maximum(self.load, begun), jnp.finfo(residual.dtype).eps
        allowed = jnp.maximum(_OF_LOAD * tol * added, jnp.minimum(granted, _GRANTED * added))
        met = jnp.all(jnp.abs(residual) <= allowed) | (added > _SMALL * scale)
        lost = largest(residual) > _HALF * eps**0.5 * added
        lost = lost & (self.load > _NONE * eps * scale)
        return met, ~met & lost


def in_vain(steps: Int[Array, ""]) -> Bool[Array, ""]:
    """Whether so many steps that have not halved the residual are enough."""
    return steps >= _VAIN_STEPS
