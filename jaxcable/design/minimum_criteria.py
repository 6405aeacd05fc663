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
    """Criteria for a minimum of one problem, within bounds.

    Args:
        box: `BoxBounds` of the parameters.
        floor: smallest sizes of the parameters: those at the start, [n].
        tol: largest measure of the gradient at convergence.
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
        """Measure the gradient `inside` the bounds, and judge whether it is small.

        Every entry has to be small, too. The loss at the start says nothing of parameters that
        hardly contribute to it: each entry is compared with the present loss, unless that has
        fallen to zero, or with the largest size that the entry has had.

        Args:
            x: the point, [n].
            inside: its gradient, zero where a bound blocks it, [n].
            value, first: loss there and at the start.
            steepest: largest size that each entry of the gradient has had, [n].

        Returns:
            The measure; whether the gradient is small in any case; whether it is small enough for
            a minimum if, besides, no step lowers the loss.
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
        """Whether a loss is zero compared with that at the start."""
        return jnp.abs(value) <= self.tol**3 * jnp.abs(first)

    def step_is_short(self, step: Float[Array, " n"], x: Float[Array, " n"]) -> Bool[Array, ""]:
        """Whether a step changes no parameter by more than a negligible amount.

        Negligible is sqrt(tol) of their sizes now, as for a loss that is known to `tol` (Gill,
        Murray and Wright, 1981, section 8.2.3), or tol^1.5 of those at the start.
        """
        allowed = jnp.maximum(self.box.largest_per_array(x), self.tol * self.floor)
        return jnp.all(jnp.abs(step) <= jnp.sqrt(self.tol) * allowed)

    def decrease_is_small(
        self, promised: Float[Array, ""], value: Float[Array, ""], first: Float[Array, ""]
    ) -> Bool[Array, ""]:
        """Whether a predicted decrease is small compared with the loss, or the loss is zero."""
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
        """Whether the minimum along the last step is near, by the slopes at its ends (secant).

        Args:
            x: the point at its end, [n].
            moved: the step, [n].
            slope, before: change of the loss along the step, by the gradients at its end and start.
            value, first: loss at its end and at the start of the search.
        """
        bend = slope - before
        left = jnp.abs(slope) / jnp.where(bend > 0, bend, 1.0)
        near = self.step_is_short(left * moved, x) & self.decrease_is_small(
            left * jnp.abs(slope), value, first
        )
        return (bend > 0) & near
