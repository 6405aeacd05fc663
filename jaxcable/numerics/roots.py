"""The root of an increasing scalar function within a bracket, with its implicit derivative."""

from __future__ import annotations

from collections.abc import Callable

import jax
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
    """Find the root of an increasing scalar function by Newton's method within a bracket.

    Bisection replaces a step that leaves the bracket, and a step from a value that is not a number.
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

        def unfinished(s):
            _, _, _, moved, before, count = s
            # Newton steps shrink quadratically; one not below half of the last is rounding only
            rounding = (moved < jnp.sqrt(eps)) & (moved > 0.5 * before)
            return (moved > 2 * eps) & ~rounding & (count < _MAX_STEPS)

        def step(s):
            u, low, high, before, _, count = s
            value, slope = jax.jvp(f, (u,), (jnp.ones_like(u),))
            below = ~(value >= 0)
            low, high = jnp.where(below, u, low), jnp.where(below, high, u)
            new = u - value / slope
            inside = (new >= low) & (new <= high)
            new = jnp.where(inside, new, 0.5 * (low + high))
            moved = jnp.abs(new - u) / jnp.maximum(1, jnp.abs(new))
            return new, low, high, moved, before, count + 1

        far = jnp.full_like(guess, jnp.inf)
        start = (guess, low, high, far, far, jnp.zeros_like(guess, jnp.int32))
        end, *_, count = lax.while_loop(unfinished, step, start)
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
