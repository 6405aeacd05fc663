"""When `minimize` has converged: what is small beside the loss, and beside the parameters.

Gill, Murray and Wright, Practical Optimization (1981), section 8.2.3, ask for a small gradient, a
small change of the loss and a small step, all at once, because each alone can be small far from a
minimum. The size of a loss that falls to zero is taken from the loss at the start, which may be
huge: the present loss is asked, too.
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp

from ..common.types import Array, Bool, Float
from .box import Box

_FIRST = 0.1  # part of the first loss that changes are compared with when the loss falls to zero


@dataclasses.dataclass(frozen=True)
class Criteria:
    """The criteria for one problem.

    Args:
        box: `Box` of the parameters.
        floor: least sizes of the parameters: those at the start, [n].
        tol: largest measure of the gradient at convergence.
    """

    box: Box
    floor: Float[Array, " n"]
    tol: Float[Array, ""]

    def measured(
        self,
        x: Float[Array, " n"],
        inside: Float[Array, " n"],
        value: Float[Array, ""],
        first: Float[Array, ""],
        steepest: Float[Array, " n"],
    ) -> tuple[Float[Array, ""], Bool[Array, ""], Bool[Array, ""]]:
        """The measure of the gradient `inside` the bounds, and whether it is small.

        It is small, surely or if no step lowers the loss, where every entry is, too. The loss at
        the start says nothing of directions that hardly take part in it: the present loss counts,
        unless it has fallen to zero, or a fall of the entry itself.

        Args:
            x: the point, [n].
            inside: its gradient, zero where a bound blocks it, [n].
            value, first: loss there and at the start.
            steepest: largest size that each entry of the gradient has had, [n].

        Returns:
            The measure; whether it is surely small; whether it is small if no step lowers the loss.
        """
        promises = jnp.abs(inside) * jnp.maximum(self.floor, self.box.largest(x))
        largest = jnp.max(promises)
        # the loss, or a part of the first one if that is more, since no change is small beside a
        # loss that falls to zero; of a loss above the first one only the part counts
        least = _FIRST * jnp.abs(first)
        against = jnp.where(value <= first, jnp.maximum(jnp.abs(value), least), least)
        measure = jnp.where(largest > 0, largest / against, 0.0)
        beside, zero = promises <= self.tol * jnp.abs(value), self._zero(value, first)
        surely, at_rest = (
            zero | jnp.all(beside | (jnp.abs(inside) <= part * steepest))
            for part in (self.tol**2, self.tol)
        )
        small = measure <= self.tol
        return measure, small & surely, small & at_rest

    def _zero(self, value, first):
        """Whether a loss is zero beside that at the start."""
        return jnp.abs(value) <= self.tol**3 * jnp.abs(first)

    def short(self, step: Float[Array, " n"], x: Float[Array, " n"]) -> Bool[Array, ""]:
        """Whether a step changes the parameters by next to nothing.

        That is sqrt(tol) of their sizes now, as for a loss that is known to `tol` (Gill, Murray and
        Wright, 1981, section 8.2.3), or tol^1.5 of those at the start.
        """
        allowed = jnp.maximum(self.box.largest(x), self.tol * self.floor)
        return jnp.all(jnp.abs(step) <= jnp.sqrt(self.tol) * allowed)

    def little(
        self, promised: Float[Array, ""], value: Float[Array, ""], first: Float[Array, ""]
    ) -> Bool[Array, ""]:
        """Whether a promised decrease is small beside the loss, or the loss has fallen to zero."""
        return (promised <= self.tol * jnp.abs(value)) | self._zero(value, first)

    def near(
        self,
        x: Float[Array, " n"],
        moved: Float[Array, " n"],
        slope: Float[Array, ""],
        before: Float[Array, ""],
        value: Float[Array, ""],
        first: Float[Array, ""],
    ) -> Bool[Array, ""]:
        """Whether the minimum along a step that was made is near, by slopes at its ends (secant).

        Args:
            x: the point at its end, [n].
            moved: the step, [n].
            slope, before: change of the loss along it at its end and at its beginning.
            value, first: loss at its end and at the start of the search.
        """
        bend = slope - before
        left = jnp.abs(slope) / jnp.where(bend > 0, bend, 1.0)
        near = self.short(left * moved, x) & self.little(left * jnp.abs(slope), value, first)
        return (bend > 0) & near
