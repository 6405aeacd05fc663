"""Error-free arithmetic: sums and products to nearly twice the working precision.

A *pair* (high, low) is the unevaluated sum of two floats, ``|low| <= eps |high|``. Compilers may
contract a product and a sum to one operation with one rounding. Here this does no harm, because
only products of halves are added to anything whose rounding counts, and these are exact.

Everything is a function of arrays of float32 or float64, element by element, under jit and vmap. It
is meant for corrections without derivatives (`lax.stop_gradient`).

Sources: Dekker, "A floating-point technique for extending the available precision" (1971); Ogita,
Rump, Oishi, "Accurate sum and dot product" (2005).
"""

from __future__ import annotations

from typing import TypeAlias

import jax
import jax.numpy as jnp
from jax import lax

from ..common.types import Array, Float

Pair: TypeAlias = 'tuple[Float[Array, " ..."], Float[Array, " ..."]]'
"""A number as the sum of two floats."""


@jax.jit  # one function in a program, as below
def two_sum(a: Float[Array, " ..."], b: Float[Array, " ..."]) -> Pair:
    """The sum of two floats, and its rounding error, which is exact."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def halves(a: Float[Array, " ..."]) -> Pair:
    """A float as the sum of two with half of the digits each: products of halves are exact."""
    bits = jnp.finfo(a.dtype)
    high = lax.reduce_precision(a, bits.nexp, (bits.nmant - 1) // 2)
    return high, a - high


@jax.jit
def less_product(
    whole: Float[Array, " ..."], a: Float[Array, " ..."], b: Float[Array, " ..."]
) -> Float[Array, " ..."]:
    """``whole - a b`` for a `whole` that is the product up to some of its roundings.

    All differences but the last are exact, because they fit into the digits of a float.
    """
    (p, q), (r, s) = halves(a), halves(b)
    return (((whole - p * r) - p * s) - q * r) - q * s


def two_product(a: Float[Array, " ..."], b: Float[Array, " ..."]) -> Pair:
    """The product of two floats, and its rounding error."""
    (p, q), (r, s) = halves(a), halves(b)
    whole = p * r + (p * s + q * r)  # ``a * b`` might be contracted with what it is added to
    return whole, (((p * r - whole) + p * s) + q * r) + q * s


@jax.jit
def dot(a: Pair, b: Pair) -> Pair:
    """Scalar product of vectors of pairs, [..., 3], as a pair of [..., 1]."""
    whole, lost = two_product(a[0], b[0])
    lost = lost + (a[0] * b[1] + a[1] * b[0])
    (p, q, r), (s, t, u) = ([v[..., k : k + 1] for k in range(3)] for v in (whole, lost))
    first, left = two_sum(p, q)
    both, more = two_sum(first, r)
    return two_sum(both, (left + more) + ((s + t) + u))


def root(square: Pair) -> Pair:
    """Square root of a pair that is not negative."""
    found = jnp.sqrt(square[0])
    left = less_product(square[0], found, found) + square[1]
    return found, left / jnp.where(found > 0, 2 * found, 1.0)


def lengthened(chord: Pair, moved: Pair, guess: Float[Array, "... 1"]) -> Float[Array, "... 1"]:
    """What guesses c of ``|d + w| - |d|`` lack, for vectors d and w of pairs, [..., 3].

    One step of Newton's method for ``c (2 |d| + c) = (2 d + w) w``: an error of the guess of some
    eps c becomes one of some eps^2 c. Where the length ``|d + w|`` nearly vanishes the equation
    does not tell it, and the correction is cut.
    """
    start, rest = root(dot(chord, chord))
    both, lost = two_sum(2 * chord[0], moved[0])
    square = dot((both, lost + (2 * chord[1] + moved[1])), moved)
    factor, lost = two_sum(2 * start, guess)
    left = less_product(square[0], guess, factor) + (square[1] - guess * (lost + 2 * rest))
    least = jnp.sqrt(jnp.finfo(start.dtype).eps) * start
    length = jnp.maximum(start + guess, least)
    return left / jnp.where(length > 0, 2 * length, 1.0)


def total(terms: Float[Array, "... n"]) -> Float[Array, " ..."]:
    """Sum over the last axis, with an error of eps of itself, and of some eps^2 of the terms."""
    lost = jnp.zeros_like(terms[..., 0])
    while terms.shape[-1] > 1:
        if terms.shape[-1] % 2:
            terms = jnp.concatenate([terms, jnp.zeros_like(terms[..., :1])], axis=-1)
        half = terms.shape[-1] // 2
        terms, left = two_sum(terms[..., :half], terms[..., half:])
        lost = lost + jnp.sum(left, axis=-1)
    return terms[..., 0] + lost
