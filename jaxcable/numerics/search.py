"""Line search on the directional derivative, for steps down a (locally) convex energy.

``g(a) = R(x + a p).p`` keeps its digits near the solution, where differences of the energy lose
them. Along any line a convex energy has an increasing ``g``, and ``g <= 0`` means that the energy
falls all the way. A full step is taken unless it overshoots; then the zero of ``g`` is bracketed.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
from jax import lax

from ..common.tree import pytree
from ..common.types import Array, Bool, Float, Int

_SHORT = 0.5  # a step shorter than 1 is too short while g(a) is below this part of g(0)
_OVERSHOOT = 0.25  # beyond the minimum accept g(a) up to this part of |g(0)|
_MAX_SEARCH = 60  # evaluations per line search: 60 bisections exhaust float64


@pytree
class Search:
    """The state of a search along a step.

    Attributes:
        length: the a that is tried next, in (0, 1]; scalar.
        slope: g(0), negative.
        low, g_low, high, g_high: bracket of the zero of g, and the values of g there.
        count: number of lengths refused so far.
    """

    length: Float[Array, ""]
    slope: Float[Array, ""]
    low: Float[Array, ""]
    g_low: Float[Array, ""]
    high: Float[Array, ""]
    g_high: Float[Array, ""]
    count: Int[Array, ""]

    @classmethod
    def init(cls, slope: Float[Array, ""]) -> Search:
        """A search that tries the whole step first."""
        zero, one, most = (jnp.asarray(end, slope.dtype) for end in (0, 1, jnp.inf))
        return cls(one, slope, zero, slope, one, most, jnp.int32(0))

    def update(self, g: Float[Array, ""]) -> tuple[Search, Bool[Array, ""], Bool[Array, ""]]:
        """Judge the length that was tried by the derivative `g` there.

        Returns:
            The search with the next length; whether the length that was tried is accepted; whether
            to try the next length. If both are False, the search has failed.
        """
        g = jnp.where(jnp.isfinite(g), g, jnp.inf)
        too_far = g > -_OVERSHOOT * self.slope
        too_short = (self.length < 1) & (g < _SHORT * self.slope)
        again = (too_far | too_short) & (self.count < _MAX_SEARCH) & (self.high > self.low)
        below = g <= 0
        low, g_low = jnp.where(below, self.length, self.low), jnp.where(below, g, self.g_low)
        high, g_high = jnp.where(below, self.high, self.length), jnp.where(below, self.g_high, g)
        # secant through the bracket and bisection alternately, so that no end of the bracket stalls
        secant = low + (high - low) * (-g_low / (g_high - g_low))
        inside = (secant > low) & (secant < high) & (self.count & 1 == 0)  # false for NaN
        length = jnp.where(inside, secant, 0.5 * (low + high))
        after = Search(length, self.slope, low, g_low, high, g_high, self.count + 1)
        return after, ~too_far & ~again, again


def search(
    evaluate: Callable[[Float[Array, ""]], tuple[Float[Array, " n"], Float[Array, ""]]],
    step: Float[Array, " n"],
    slope: Float[Array, ""],
    usable: Bool[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, " n"], Float[Array, ""], Bool[Array, ""]]:
    """Find a step length a in (0, 1].

    Args:
        evaluate: function from ``a`` to the residual [n] there, and the force it is judged by.
        step: p, [n].
        slope: g(0), negative.
        usable: whether there is a step to search along.

    Returns:
        The length, the residual and that force there, and whether the length is accepted.
    """

    def trial(s):
        tried, *_ = s
        residual, scale = evaluate(tried.length)
        g = jnp.where(jnp.isfinite(scale), residual @ step, jnp.inf)
        after, fine, again = tried.update(g)
        return after, tried.length, residual, scale, fine, again

    nothing = jnp.zeros_like(slope), jnp.zeros_like(step), jnp.zeros_like(slope)
    s = (Search.init(slope), *nothing, jnp.zeros((), bool), jnp.ones((), bool))
    s = lax.while_loop(lambda s: s[-1] & usable, trial, s)
    _, length, residual, scale, fine, _ = s
    return length, residual, scale, usable & fine
