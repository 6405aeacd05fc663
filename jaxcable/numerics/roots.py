"""The zero of a rising function of one number, with its derivative."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import ClosedJaxpr, jaxpr_as_fun

from ..common.types import Array, Float
from .rooted import rooted

_MAX_STEPS = 120  # bisection alone halves any bracket of floats to its last digit in these


def rising_root(
    function: Callable[[Float[Array, ""]], Float[Array, ""]],
    guess: Float[Array, ""],
    low: Float[Array, ""],
    high: Float[Array, ""],
) -> Float[Array, ""]:
    """Zero of a function that rises where it is a number: Newton's method within a bracket.

    A step that leaves the bracket, or a value that is not a number, is answered by bisection. The
    derivative is that of the implicit function theorem, of any order.

    Args:
        function: of a scalar, rising; not a number, or minus infinity, only below its zero.
        guess: scalar.
        low, high: a bracket, scalars.

    Returns:
        The zero, to the rounding of `function`; NaN if its parameters are, or if the bracket has
        none.
    """

    def solve(f, guess):
        eps = jnp.finfo(guess.dtype).eps

        def unfinished(s):
            _, _, _, moved, before, count = s
            # near the zero each step is far smaller than the last, until only rounding is left
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
        # at an end of the bracket there is no zero in it: no number is better than a wrong one
        room = 4 * eps * jnp.maximum(1, jnp.abs(end))
        found = (end > low + room) & (end < high - room) & (count < _MAX_STEPS)
        return jnp.where(found, end, jnp.nan)

    guess = jnp.clip(guess, low, high)  # of a guess only: where to begin, no part of the result
    low, high, guess = (lax.stop_gradient(v) for v in (low, high, guess))
    equation = jax.make_jaxpr(function)(guess)

    def given(x, parameters):
        return jaxpr_as_fun(ClosedJaxpr(equation.jaxpr, parameters))(x)[0]

    root = solve(lambda x: given(x, lax.stop_gradient(equation.consts)), guess)
    return rooted(given, root, equation.consts, lambda p, g, y: y / g(jnp.ones_like(y)))
