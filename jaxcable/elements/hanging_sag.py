"""Sag of an elastic catenary: its distance from the chord at midspan, along the load.

With ``phi = asinh(slope)`` against the direction across the load, ``a = H/q`` and ``e = H/EA`` a
catenary is ``x = a (e sinh(phi) + phi)``, ``z = a (cosh(phi) + e/2 sinh(phi)^2)``. Its ends are at
``m -+ theta`` (`hanging` has theta), the middle of its unstressed length at ``m + b``,

    sinh(m + b) = sinh(m) cosh(theta),

and midspan, where x is the mean of the ends, at ``m + g`` with

    g = e (sinh(m) cosh(theta) - sinh(m + g)),   0 <= g/b < 1.

An inextensible catenary (e = 0) has g = 0: its slope at midspan is sinh(m). The sag is the mean
of z at the ends less z at midspan; no nearly equal numbers are subtracted.
"""

from __future__ import annotations

import jax.numpy as jnp

from ..common.types import Array, Float
from ..numerics.roots import bracketed_root
from ..numerics.vectors import scalar_product
from .element import Scalar
from .hanging import solve_catenary
from .hanging_terms import cosh_minus_1, magnitude_and_direction, sinhc_minus_1


def midspan_sag(
    mid_length_tension: Float[Array, " 3"],
    theta: Scalar,
    load: Float[Array, " 3"],
    stiffness: Scalar,
) -> Scalar:
    """Return the distance of the cable from its chord at midspan, along the load, m.

    Args:
        mid_length_tension: tension vector in the middle of the unstressed length, [3], N, the first
            result of `solve_catenary`.
        theta: parameter of the shape, the last result of `solve_catenary`.
        load: per unstressed length, [3], N/m, not along the chord; not zero.
        stiffness: EA, N.
    """
    weight, unit = magnitude_and_direction(load)
    along = scalar_product(mid_length_tension, unit)
    across = mid_length_tension - along * unit
    level = jnp.sqrt(scalar_product(across, across))
    size, soft = level / weight, level / stiffness
    steep = along / level  # slope in the middle of the unstressed length
    mean = jnp.arcsinh(steep / jnp.cosh(theta))
    product = jnp.cosh(theta) * jnp.cosh(mean) + jnp.sqrt(1 + steep**2)
    middle = jnp.arcsinh(jnp.sinh(mean) * jnp.sinh(theta) ** 2 / product)
    apart = product / (jnp.cosh(theta) + 1) * _sinhc(middle)

    def balance(part):
        half = 0.5 * middle * part
        return part + soft * (part * jnp.cosh(mean + half) * _sinhc(half) - apart)

    guess = soft * apart / (1 + soft * jnp.cosh(mean))
    bracket = jnp.full_like(guess, -0.5), jnp.full_like(guess, 1.5)
    shift = middle * bracketed_root(balance, guess, *bracket)
    shape = jnp.cosh(mean) * cosh_minus_1(theta)
    shape = shape - 2 * jnp.sinh(mean + 0.5 * shift) * jnp.sinh(0.5 * shift)
    stretch = jnp.cosh(2 * mean) * cosh_minus_1(2 * theta)
    stretch = stretch - 2 * jnp.sinh(2 * mean + shift) * jnp.sinh(shift)
    return size * (shape + 0.25 * soft * stretch)


def chord_strain_at_sag(
    chord: Float[Array, " 3"], load: Float[Array, " 3"], stiffness: Scalar, sag: Scalar
) -> Scalar:
    """Solve for the strain (chord over unstressed length, minus 1) at which a cable has a sag.

    The sag grows with the length, so that there is one solution. The search goes outwards from the
    parabola ``L0 (1 + N/EA) = d (1 + 8/3 (sag l/d^2)^2)``, ``N = q d^2 / (8 sag)``, where l is the
    part of the chord d across the load.

    Args:
        chord: [3], m.
        load: per unstressed length, [3], N/m, not along the chord; not zero.
        stiffness: EA, N.
        sag: distance from the chord at midspan, along the load, positive, m.
    """
    length2 = scalar_product(chord, chord)
    length = jnp.sqrt(length2)

    def mismatch(u):
        rest_length = length * jnp.exp(u)
        excess = -length2 * jnp.expm1(2 * u)
        force, _, theta = solve_catenary(chord, excess, load, rest_length, stiffness)
        return jnp.log(midspan_sag(force, theta, load, stiffness) / sag)

    weight, unit = magnitude_and_direction(load)
    across = chord - scalar_product(chord, unit) * unit
    slope = jnp.sqrt(scalar_product(across, across)) / length
    ratio = sag / length
    shallow = jnp.log1p(8 / 3 * (ratio * slope) ** 2)
    taut = jnp.log1p(weight * length / (8 * ratio * stiffness))
    deep = jnp.log1p(2 * ratio)
    guess = jnp.minimum(shallow, deep) - taut
    return jnp.expm1(-bracketed_root(mismatch, guess, guess - 5 - 2 * taut, deep + 5))


def _sinhc(t):
    """Return ``sinh(t) / t`` for a number t of either sign; 1 at zero."""
    return 1 + sinhc_minus_1(jnp.where(t < 0, -t, t))
