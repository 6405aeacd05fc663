"""Line search on the directional derivative, for steps down a (locally) convex energy.

``g(a) = R(x + a p).p`` is the slope of the energy along the step p at the step length a. It keeps
its digits near the solution, where differences of the energy lose them. For a convex energy ``g``
increases, and ``g(a) <= 0`` means that the energy falls from 0 to a. A full step is taken unless it
overshoots; then the root of ``g`` is bracketed.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
from jax import lax

from ..common.tree import pytree
from ..common.types import Array, Bool, Float, Int

# Both bounds are loose, because the next Newton step corrects the rest better than another trial.
# From 0.25 to 0.9, and from 0.1 to 0.5, the ready nets and yielding sections take as many steps.
_SLOPE_TOO_STEEP = 0.5  # too short while g(a) is below this part of g(0), both negative
_SLOPE_AFTER_MINIMUM = 0.25  # beyond the minimum a length is accepted up to this part of |g(0)|
_MAX_EVALUATIONS = 60  # evaluations in a line search: 60 bisections exhaust float64


@pytree
class LineSearch:
    """State of a line search for a root of g(a), the slope of the energy at step length a.

    Attributes:
        length: the step length a that is tried next, in (0, 1]; scalar.
        slope: g(0), negative.
        low, high: step lengths that bracket the root of g.
        g_low, g_high: values of g there.
        count: number of lengths tried so far.
    """

    length: Float[Array, ""]
    slope: Float[Array, ""]
    low: Float[Array, ""]
    g_low: Float[Array, ""]
    high: Float[Array, ""]
    g_high: Float[Array, ""]
    count: Int[Array, ""]

    @classmethod
    def init(cls, slope: Float[Array, ""]) -> LineSearch:
        """Return the state at the beginning, with the whole step as first length, from g(0)."""
        zero, one, most = (jnp.asarray(end, slope.dtype) for end in (0, 1, jnp.inf))
        return cls(one, slope, zero, slope, one, most, jnp.int32(0))

    def update(self, g: Float[Array, ""]) -> tuple[LineSearch, Bool[Array, ""], Bool[Array, ""]]:
        """Accept or refuse the length that was tried, and choose the next one.

        Args:
            g: slope of the energy along the step at the length that was tried.

        Returns:
            The search with the next length; whether the length that was tried is accepted; whether
            to try the next length. If both are False, the search has failed.
        """
        g = jnp.where(jnp.isfinite(g), g, jnp.inf)
        too_far = g > -_SLOPE_AFTER_MINIMUM * self.slope
        too_short = (self.length < 1) & (g < _SLOPE_TOO_STEEP * self.slope)
        again = (too_far | too_short) & (self.count < _MAX_EVALUATIONS) & (self.high > self.low)
        below = g <= 0
        low, g_low = jnp.where(below, self.length, self.low), jnp.where(below, g, self.g_low)
        high, g_high = jnp.where(below, self.high, self.length), jnp.where(below, self.g_high, g)
        # secant through the bracket and bisection alternately, so that no end of the bracket stalls
        secant = low + (high - low) * (-g_low / (g_high - g_low))
        inside = (secant > low) & (secant < high) & (self.count & 1 == 0)  # false for NaN
        length = jnp.where(inside, secant, 0.5 * (low + high))
        after = LineSearch(length, self.slope, low, g_low, high, g_high, self.count + 1)
        return after, ~too_far & ~again, again


def line_search(
    evaluate: Callable[[Float[Array, ""]], tuple[Float[Array, " n"], Float[Array, ""]]],
    step: Float[Array, " n"],
    slope: Float[Array, ""],
    usable: Bool[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, " n"], Float[Array, ""], Bool[Array, ""]]:
    """Find a step length a in (0, 1] at which the slope of the energy g(a) is nearly zero.

    The slope along the step p is ``g(a) = R(x + a p).p`` with the residual R. The whole step, a =
    1, is tried first.

    Args:
        evaluate: function from ``a`` to the residual [n] there, and the scale of forces that the
            residual is compared with (not finite where the step is inadmissible).
        step: p, [n].
        slope: g(0), negative.
        usable: whether to search; if not, nothing is evaluated.

    Returns:
        The length, the residual and the scale there, and whether the length is accepted.
    """

    def trial(s):
        tried, *_ = s
        residual, scale = evaluate(tried.length)
        g = jnp.where(jnp.isfinite(scale), residual @ step, jnp.inf)
        after, fine, again = tried.update(g)
        return after, tried.length, residual, scale, fine, again

    nothing = jnp.zeros_like(slope), jnp.zeros_like(step), jnp.zeros_like(slope)
    s = (LineSearch.init(slope), *nothing, jnp.zeros((), bool), jnp.ones((), bool))
    s = lax.while_loop(lambda s: s[-1] & usable, trial, s)
    _, length, residual, scale, fine, _ = s
    return length, residual, scale, usable & fine
