"""When an increment is in equilibrium: its residual is small beside the forces and beside its load.

A residual of 1e-10 of the forces may be more than a small load on a highly prestressed structure:
judged by the forces alone, such a load would move nothing. Hence what an increment adds to the dead
loads at nodes is a second measure. Against it stands what earlier increments have left unbalanced
within their tolerance: this stays, as if it were a load, so that the step that it would cause does
not add to that of the load.

Where rounding hides so small a residual, the iteration waits some steps; then the equilibrium is
good if the residual leaves half of the digits of the load, and AT_ROUNDING if not. In float32,
whose forces have seven digits at all, only the forces count.
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

_OF_LOAD = 50.0  # tolerance beside a small load over that beside the forces: 5e-9 of the load
_KEPT = 0.9  # part of the tolerance that what stays unbalanced may take
_SMALL = 1e-2  # added load over the forces up to which it is small: beyond, tol is 1e-8 of it
_SOON = 20  # steps for which it stays: a small load takes a few
_WAITS = 10  # steps within the tolerance of the forces after which rounding hides the load's
_HALF = 0.25  # residual over the load, in square roots of eps, up to which half of the digits hold


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
        load: largest dead load that the increment adds at a node, N; infinite if it adds none.
    """

    left: Float[Array, " n_free"]
    load: Float[Array, ""]

    @classmethod
    def of(
        cls, system: System, left: Float[Array, " n_free"], before: Float[Array, "n_row n_freedom"]
    ) -> Balance:
        """The balance of an increment after which the dead load is that of `system`.

        Args:
            system: `System` of the increment.
            left: as of `Balance`.
            before: dead load before the increment, [n_row, n_freedom], N and N m.
        """
        load = jnp.max(system.space.size(system.load - before), initial=0.0)
        return cls(left, jnp.where(load > 0, load, jnp.inf))

    @jax.jit  # one function in a program
    def kept(
        self, scale: Float[Array, ""], tol: Float[Array, ""], steps: Int[Array, ""]
    ) -> Float[Array, " n_free"]:
        """What stays unbalanced [n_free], N, after so many steps.

        Only beside a load that is small beside the force `scale`, N, that residuals are judged by,
        and only for some steps: where all elements of a node go slack, nothing can balance it.
        """
        kept = largest(self.left) <= _KEPT * tol * scale
        kept = kept & (self.load <= _SMALL * scale) & (steps <= _SOON)
        return jnp.where(kept, self.left, 0.0)

    def judged(
        self,
        residual: Float[Array, " n_free"],
        granted: Float[Array, " n_free"],
        scale: Float[Array, ""],
        begun: Float[Array, ""],
        tol: Float[Array, ""],
    ) -> tuple[Bool[Array, ""], Bool[Array, ""]]:
        """Whether a residual is small beside what is added, and whether it hides half the digits.

        Args:
            residual: N.
            granted: what rounding of displacements leaves of it, N.
            scale: force that it is judged by; a load below the rounding of this is none, N.
            begun: largest residual at the start of the increment, N; to it statements of prestress
                and movements of supports contribute, beside which a load need not be seen.
            tol: tolerance beside the scale.
        """
        added, eps = jnp.maximum(self.load, begun), jnp.finfo(residual.dtype).eps
        met = jnp.all(jnp.abs(residual) <= jnp.maximum(_OF_LOAD * tol * added, granted))
        met = met | (added > _SMALL * scale)
        hides = largest(residual) > _HALF * eps**0.5 * added
        return met, ~met & hides & (self.load > eps * scale)


def given_up(waits: Int[Array, ""]) -> Bool[Array, ""]:
    """Whether so many steps have not brought the residual down, so that rounding must hold it."""
    return waits >= _WAITS
