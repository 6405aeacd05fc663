"""When `minimize` has converged: what is small beside the loss, and beside the parameters.

Gill, Murray and Wright, Practical Optimization (1981), section 8.2.3, ask for a small gradient, a
small change of the loss and a small step, all at once, because each alone can be small far from a
minimum. The size of a loss that falls to zero is taken from the loss at the start, which may be
huge: the present loss is asked, too.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp

from ..common.types import Array, Bool, Float

_FIRST = 0.1  # part of the first loss that changes are compared with when the loss falls to zero


class Criteria:
    """The criteria for one problem.

    Args:
        largest: function of the flat parameters to the largest entries of their arrays, [n].
        floor: least sizes of the parameters: those at the start, [n].
        tol: largest measure of the gradient at convergence.
    """

    def __init__(
        self,
        largest: Callable[[Float[Array, " n"]], Float[Array, " n"]],
        floor: Float[Array, " n"],
        tol: Float[Array, ""],
    ):
        self.largest, self.floor, self.tol = largest, floor, tol

    def measured(
        self,
        x: Float[Array, " n"],
        inside: Float[Array, " n"],
        value: Float[Array, ""],
        first: Float[Array, ""],
        steepest: Float[Array, " n"],
    ) -> tuple[Float[Array, ""], Bool[Array, ""], Bool[Array, ""]]:
        """The measure of the gradient `inside` the bounds, and whether it is small, see `fallen`.

        Args:
            x: the point, [n].
            inside: its gradient, zero where a bound blocks it, [n].
            value, first: loss there and at the start.
            steepest: largest size that each entry of the gradient has had, [n].
        """
        promises = jnp.abs(inside) * jnp.maximum(self.floor, self.largest(x))
        largest = jnp.max(promises)
        measure = jnp.where(largest > 0, largest / self.against(value, first), 0.0)
        surely, at_rest = self.fallen(inside, promises, value, first, steepest)
        small = measure <= self.tol
        return measure, small & surely, small & at_rest

    def against(self, value: Float[Array, ""], first: Float[Array, ""]) -> Float[Array, ""]:
        """The size that changes of a loss are compared with: the loss, or a part of the first one.

        The larger of both counts, since no change is small beside a loss that falls to zero. Of a
        loss above the first one only the part counts.
        """
        least = _FIRST * jnp.abs(first)
        return jnp.where(value <= first, jnp.maximum(jnp.abs(value), least), least)

    def fallen(
        self,
        inside: Float[Array, " n"],
        promises: Float[Array, " n"],
        value: Float[Array, ""],
        first: Float[Array, ""],
        steepest: Float[Array, " n"],
    ) -> tuple[Bool[Array, ""], Bool[Array, ""]]:
        """Whether every entry of the gradient is small: surely, and if no step lowers the loss.

        The loss at the start says nothing of directions that hardly take part in it: the present
        loss counts, unless it has fallen to zero, or a fall of the entry itself.
        """
        beside = promises <= self.tol * jnp.abs(value)
        surely = beside | (jnp.abs(inside) <= self.tol**2 * steepest)
        at_rest = beside | (jnp.abs(inside) <= self.tol * steepest)
        zero = self.zero(value, first)
        return jnp.all(surely) | zero, jnp.all(at_rest) | zero

    def zero(self, value: Float[Array, ""], first: Float[Array, ""]) -> Bool[Array, ""]:
        """Whether a loss is zero beside that at the start."""
        return jnp.abs(value) <= self.tol**3 * jnp.abs(first)

    def short(self, step: Float[Array, " n"], x: Float[Array, " n"]) -> Bool[Array, ""]:
        """Whether a step changes the parameters by next to nothing.

        That is sqrt(tol) of their sizes now, as for a loss that is known to `tol` (Gill, Murray and
        Wright, 1981, section 8.2.3), or tol^1.5 of those at the start.
        """
        allowed = jnp.maximum(self.largest(x), self.tol * self.floor)
        return jnp.all(jnp.abs(step) <= jnp.sqrt(self.tol) * allowed)

    def little(
        self, promised: Float[Array, ""], value: Float[Array, ""], first: Float[Array, ""]
    ) -> Bool[Array, ""]:
        """Whether a promised decrease is small beside the loss, or the loss has fallen to zero."""
        return (promised <= self.tol * jnp.abs(value)) | self.zero(value, first)

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
