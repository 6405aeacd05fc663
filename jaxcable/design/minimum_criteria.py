"""When `minimize` has converged: what is small compared with the loss and the parameters.

Gill, Murray and Wright, Practical Optimization (1981), section 8.2.3, ask for a small gradient, a
small change of the loss and a small step, all at once, because each alone can be small far from a
minimum. The size of a loss that falls to zero is taken from the loss at the start, which may be
huge: the present loss is compared with, too.
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp

from ..common.types import Array, Bool, Float
from .bounds import BoxBounds

# Part of the loss at the start that changes are compared with when the loss falls to zero. A larger
# one would let `tol` mean less, the worse the start is.
_FIRST = 0.1


@dataclasses.dataclass(frozen=True)
class MinimumCriteria:
    """Criteria by which `minimize` decides that a point is a minimum within the bounds.

    Args:
        box: `BoxBounds` of the flat parameters.
        floor: typical sizes of the parameters at the start, [n]; sizes never count as smaller.
        tol: largest dimensionless gradient (`measure_gradient`) at convergence.
    """

    box: BoxBounds
    floor: Float[Array, " n"]
    tol: Float[Array, ""]

    def measure_gradient(
        self,
        x: Float[Array, " n"],
        inside: Float[Array, " n"],
        value: Float[Array, ""],
        first: Float[Array, ""],
        steepest: Float[Array, " n"],
    ) -> tuple[Float[Array, ""], Bool[Array, ""], Bool[Array, ""]]:
        """Compute the dimensionless size of a gradient, and judge whether it is small.

        It is the largest entry times the size of its parameter, over the size of the loss. Every
        single entry must be small, too: compared with the present loss (unless that has fallen to
        zero), or with the largest value that this entry has had. The loss at the start says nothing
        of parameters that hardly contribute to it.

        Args:
            x: the point, [n].
            inside: gradient there, with zeros where a bound blocks the parameter, [n].
            value, first: loss there and at the start.
            steepest: largest absolute value that each entry of the gradient has had, [n].

        Returns:
            The size; whether it is small enough for a minimum in any case; whether it is small
                enough for a minimum provided that no step lowers the loss.
        """
        promises = jnp.abs(inside) * jnp.maximum(self.floor, self.box.largest_per_array(x))
        largest = jnp.max(promises)
        # the loss, or a part of the first one if that is more, since no change is small beside a
        # loss that falls to zero; of a loss above the first one only the part counts
        least = _FIRST * jnp.abs(first)
        against = jnp.where(value <= first, jnp.maximum(jnp.abs(value), least), least)
        measure = jnp.where(largest > 0, largest / against, 0.0)
        beside, zero = promises <= self.tol * jnp.abs(value), self.loss_is_zero(value, first)
        surely, at_rest = (
            zero | jnp.all(beside | (jnp.abs(inside) <= part * steepest))
            for part in (self.tol**2, self.tol)
        )
        small = measure <= self.tol
        return measure, small & surely, small & at_rest

    def loss_is_zero(self, value, first):
        """Return whether a loss counts as zero: at most tol^3 of the loss `first` at the start."""
        return jnp.abs(value) <= self.tol**3 * jnp.abs(first)

    def step_is_short(self, step: Float[Array, " n"], x: Float[Array, " n"]) -> Bool[Array, ""]:
        """Return whether a step [n] from `x` [n] changes every parameter by a negligible amount.

        Negligible is sqrt(tol) of the present size of the parameter, as for a loss that is known to
        a relative precision of `tol` (Gill, Murray and Wright, 1981, section 8.2.3), or tol^1.5 of
        its size at the start.
        """
        allowed = jnp.maximum(self.box.largest_per_array(x), self.tol * self.floor)
        return jnp.all(jnp.abs(step) <= jnp.sqrt(self.tol) * allowed)

    def decrease_is_small(
        self, promised: Float[Array, ""], value: Float[Array, ""], first: Float[Array, ""]
    ) -> Bool[Array, ""]:
        """Return whether a predicted decrease `promised` is negligible beside the loss `value`.

        It is, too, if the loss is zero beside the loss `first` at the start.
        """
        return (promised <= self.tol * jnp.abs(value)) | self.loss_is_zero(value, first)

    def minimum_is_near(
        self,
        x: Float[Array, " n"],
        moved: Float[Array, " n"],
        slope: Float[Array, ""],
        before: Float[Array, ""],
        value: Float[Array, ""],
        first: Float[Array, ""],
    ) -> Bool[Array, ""]:
        """Return whether the minimum along the last step is near its end, by the secant method.

        Args:
            x: point at the end of the step, [n].
            moved: the step, [n].
            slope, before: derivative of the loss along the step, at its end and at its start.
            value, first: loss at the end of the step, and at the start of the search.
        """
        bend = slope - before
        left = jnp.abs(slope) / jnp.where(bend > 0, bend, 1.0)
        near = self.step_is_short(left * moved, x) & self.decrease_is_small(
            left * jnp.abs(slope), value, first
        )
        return (bend > 0) & near
