"""Line search on the directional derivative, for a step down a (locally) convex energy.

``g(a) = R(x + a p).p`` keeps its digits near the solution where the energy has lost them. Along any
line a convex energy has growing ``g``, and ``g <= 0`` means that it fell all the way. A full step
is taken unless it overshoots; then the zero of ``g`` is bracketed.
"""

import jax.numpy as jnp
from jax import lax

_OVERSHOOT = 0.25  # accept g(a) up to this part of |g(0)| beyond the minimum
SHORT = 0.5  # in a bracket, come at least this close from below
_MAX_SEARCH = 60  # residuals per line search: a bisection of 60 exhausts float64


def search(evaluate, step, slope, usable):
    """Find a step length a in (0, 1].

    Args:
        evaluate: function of ``a``: residual [n] there, and the force it is judged by.
        step: p, [n].
        slope: g(0), negative.
        usable: whether there is a step to search along.

    Returns:
        The length, residual and scale there, and whether it may be used.
    """

    def trial(a):
        residual, scale = evaluate(a)
        g = residual @ step
        return residual, scale, jnp.where(jnp.isfinite(g) & jnp.isfinite(scale), g, jnp.inf)

    # state: a, its residual, scale and g; the bracket (low, g_low), (high, g_high); count
    def searching(s):
        a, _, _, g, low, _, high, _, count = s
        too_far = g > _OVERSHOOT * -slope
        too_short = (a < 1) & (g < -SHORT * -slope)
        return (too_far | too_short) & (count < _MAX_SEARCH) & (high > low)

    def narrow(s):
        a, _, _, g, low, g_low, high, g_high, count = s
        below = g <= 0
        low, g_low = jnp.where(below, a, low), jnp.where(below, g, g_low)
        high, g_high = jnp.where(below, high, a), jnp.where(below, g_high, g)
        # secant through the bracket, every other time bisection: neither end can stall
        secant = low + (high - low) * (-g_low / (g_high - g_low))
        middle = 0.5 * (low + high)
        inside = jnp.isfinite(secant) & (secant > low) & (secant < high) & (count % 2 == 0)
        a = jnp.where(inside, secant, middle)
        residual, scale, g = trial(a)
        return a, residual, scale, g, low, g_low, high, g_high, count + 1

    one = jnp.ones((), step.dtype)
    residual, scale, g = trial(one)
    count = jnp.where(usable, 0, _MAX_SEARCH)
    s = (one, residual, scale, g, 0 * one, slope, one, jnp.inf * one, count)
    a, residual, scale, g, *_ = lax.while_loop(searching, narrow, s)
    return a, residual, scale, usable & (g <= _OVERSHOOT * -slope)
