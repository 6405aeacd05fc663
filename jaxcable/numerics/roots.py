"""The root of an increasing scalar function within a bracket, with its implicit derivative."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
from jax import lax

from ..common import jax_internals as internals
from ..common.types import Array, Float
from .implicit_root import TangentSolver, implicit_root

_MAX_STEPS = 120  # enough for bisection alone to halve any bracket of floats to its last digit


def bracketed_root(
    function: Callable[[Float[Array, ""]], Float[Array, ""]],
    guess: Float[Array, ""],
    low: Float[Array, ""],
    high: Float[Array, ""],
) -> Float[Array, ""]:
    """Find the root of an increasing scalar function by the secant method within a bracket.

    Bisection replaces a step that leaves the bracket, and a step from a value that is not a number.
    Newton's method needs two thirds of the steps, and each takes a derivative, which is more work.
    The root has derivatives, of any order, by the implicit function theorem.

    Args:
        function: increasing function of a scalar; it may be NaN or minus infinity below its root.
        guess: where the iteration starts, scalar.
        low, high: the bracket, scalars.

    Returns:
        The root, to the rounding of `function`; NaN if its parameters are NaN, or if there is no
        root in the bracket.
    """

    def solve(f, guess):
        eps = jnp.finfo(guess.dtype).eps
        tiny_step = jnp.sqrt(eps)

        def unfinished(s):
            *_, moved, before, count = s
            # steps shrink faster and faster; one not below half of the last is rounding only
            rounding = (moved < tiny_step) & (moved > 0.5 * before)
            return (moved > 2 * eps) & ~rounding & (count < _MAX_STEPS)

        def step(s):
            u, (u_before, value_before), low, high, moved, _, count = s
            value, is_first = f(u), count == 0
            below = ~(value >= 0)
            low, high = jnp.where(below, u, low), jnp.where(below, high, u)
            size = jnp.maximum(1, jnp.abs(u))
            slope = (value - value_before) / (u - u_before)
            secant = u - value / slope
            inside = (slope > 0) & jnp.isfinite(slope) & (secant >= low) & (secant <= high)
            new = jnp.where(inside, secant, 0.5 * (low + high))
            # where steps are small, values that do not rise any more are rounding
            new = jnp.where((slope <= 0) & (moved < tiny_step), u, new)
            # the first step only finds a slope
            new = jnp.where(is_first, u + jnp.where(below, 8, -8) * tiny_step * size, new)
            return new, (u, value), low, high, jnp.abs(new - u) / size, moved, count + 1

        far = jnp.full_like(guess, jnp.inf)
        start = (guess, (far, far), low, high, far, far, jnp.zeros_like(guess, jnp.int32))
        end, _, *_, count = lax.while_loop(unfinished, step, start)
        # an iteration that ends at an end of the bracket has found no root
        rounding = 4 * eps * jnp.maximum(1, jnp.abs(end))
        found = (end > low + rounding) & (end < high - rounding) & (count < _MAX_STEPS)
        return jnp.where(found, end, jnp.nan)

    guess = jnp.clip(guess, low, high)  # clips the start only, not a result
    low, high, guess = (lax.stop_gradient(v) for v in (low, high, guess))
    given, parameters = internals.convert_closure(function, guess)
    root = solve(lambda x: given(x, lax.stop_gradient(parameters)), guess)

    def divide(_, slope, rhs):
        return rhs / slope(jnp.ones_like(rhs))

    return implicit_root(given, root, parameters, TangentSolver(divide, divide))
