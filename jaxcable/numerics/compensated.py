"""Compensated (double-double) arithmetic: sums and products to twice the working precision.

A *pair* (high, low) is the unevaluated sum of two floats, ``|low| <= eps |high|``. Compilers may
contract a product and a sum to one operation with one rounding. Here this does no harm, because
only products of half-length factors are added where rounding counts, and these are exact.

All functions take arrays of float32 or float64, elementwise, also under jit and vmap. They serve
for corrections that have no derivatives (`lax.stop_gradient`).

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
"""A number as the unevaluated sum of two floats, (high, low)."""


@jax.jit  # one function in a program, as below
def two_sum(a: Float[Array, " ..."], b: Float[Array, " ..."]) -> Pair:
    """Return (s, e): rounded sum of two floats, and its error, s + e = a + b (Knuth's two-sum)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def split_digits(a: Float[Array, " ..."]) -> Pair:
    """Split a float into (high, low) of half its digits; products of such parts are exact."""
    bits = jnp.finfo(a.dtype)
    high = lax.reduce_precision(a, bits.nexp, (bits.nmant - 1) // 2)
    return high, a - high


@jax.jit
def subtract_product(
    whole: Float[Array, " ..."], a: Float[Array, " ..."], b: Float[Array, " ..."]
) -> Float[Array, " ..."]:
    """Return ``whole - a b`` without cancellation error, where `whole` is ``a b`` up to rounding.

    All differences but the last are exact, because they fit into the digits of a float.
    """
    (p, q), (r, s) = split_digits(a), split_digits(b)
    return (((whole - p * r) - p * s) - q * r) - q * s


def two_product(a: Float[Array, " ..."], b: Float[Array, " ..."]) -> Pair:
    """Return (p, e): rounded product of two floats, and its error, p + e = a b (by Dekker)."""
    (p, q), (r, s) = split_digits(a), split_digits(b)
    whole = p * r + (p * s + q * r)  # ``a * b`` might be contracted with what it is added to
    return whole, (((p * r - whole) + p * s) + q * r) + q * s


@jax.jit
def dot_of_pairs(a: Pair, b: Pair) -> Pair:
    """Return the scalar products of vectors [..., 3] to twice the precision, [..., 1].

    Vectors and results are pairs (high, low) of floats, whose sum is the number.
    """
    whole, lost = two_product(a[0], b[0])
    lost = lost + (a[0] * b[1] + a[1] * b[0])
    (p, q, r), (s, t, u) = ([v[..., k : k + 1] for k in range(3)] for v in (whole, lost))
    first, left = two_sum(p, q)
    both, more = two_sum(first, r)
    return two_sum(both, (left + more) + ((s + t) + u))


def sqrt_of_pair(square: Pair) -> Pair:
    """Return the square root, to twice the precision, of a number given as a pair (high, low).

    The result is such a pair, too; the number must not be negative.
    """
    found = jnp.sqrt(square[0])
    left = subtract_product(square[0], found, found) + square[1]
    return found, left / jnp.where(found > 0, 2 * found, 1.0)


def elongation_correction(
    chord: Pair, moved: Pair, guess: Float[Array, "... 1"]
) -> Float[Array, "... 1"]:
    """Return the correction of an elongation ``c = |d + w| - |d|`` to twice the precision.

    One step of Newton's method for ``c (2 |d| + c) = (2 d + w) w``: an error of the guess of some
    eps c becomes one of some eps^2 c. Where the length ``|d + w|`` nearly vanishes, this equation
    does not determine c, and the correction is limited.

    Args:
        chord: d, the chord before, a pair (high, low) of vectors [..., 3], m.
        moved: w, the change of the chord, a pair of vectors [..., 3], m.
        guess: c to working precision, [..., 1], m.

    Returns:
        The number to be added to the guess, [..., 1], m.
    """
    start, rest = sqrt_of_pair(dot_of_pairs(chord, chord))
    both, lost = two_sum(2 * chord[0], moved[0])
    square = dot_of_pairs((both, lost + (2 * chord[1] + moved[1])), moved)
    factor, lost = two_sum(2 * start, guess)
    left = subtract_product(square[0], guess, factor) + (square[1] - guess * (lost + 2 * rest))
    least = jnp.sqrt(jnp.finfo(start.dtype).eps) * start
    length = jnp.maximum(start + guess, least)
    return left / jnp.where(length > 0, 2 * length, 1.0)


def compensated_sum(terms: Float[Array, "... n"]) -> Float[Array, " ..."]:
    """Return the sum over the last axis, with an error of eps of the sum and eps^2 of the terms.

    Terms are added pairwise; the rounding errors of all sums are added at the end.
    """
    lost = jnp.zeros_like(terms[..., 0])
    while terms.shape[-1] > 1:
        if terms.shape[-1] % 2:
            terms = jnp.concatenate([terms, jnp.zeros_like(terms[..., :1])], axis=-1)
        half = terms.shape[-1] // 2
        terms, left = two_sum(terms[..., :half], terms[..., half:])
        lost = lost + jnp.sum(left, axis=-1)
    return terms[..., 0] + lost
