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

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common.types import Array, Float
from ..numerics.implicit_root import TangentSolver, implicit_root
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
    size, soft, mean = _catenary_parameters(mid_length_tension, theta, load, stiffness)
    return size * _sag_over_parameter(soft, mean, theta, _midspan_shift(soft, mean, theta))


def _catenary_parameters(mid_length_tension, theta, load, stiffness):
    """Return ``a = H/q``, m, ``e = H/EA`` and m, the formulas' parameters, of a hanging cable.

    Arguments are those of `midspan_sag`.
    """
    weight, unit = magnitude_and_direction(load)
    along = scalar_product(mid_length_tension, unit)
    across = mid_length_tension - along * unit
    level = jnp.sqrt(scalar_product(across, across))
    return level / weight, level / stiffness, jnp.arcsinh(along / level / jnp.cosh(theta))


def _midspan_shift(soft, mean, theta):
    """Return g of the formulas, the place of midspan as a shift from m.

    `soft` is e, `mean` is m; `theta` is the parameter of the shape.
    """
    product = jnp.cosh(theta) * jnp.cosh(mean)
    product = product + jnp.sqrt(1 + (jnp.sinh(mean) * jnp.cosh(theta)) ** 2)
    middle = jnp.arcsinh(jnp.sinh(mean) * jnp.sinh(theta) ** 2 / product)
    apart = product / (jnp.cosh(theta) + 1) * _sinhc(middle)

    def balance(part):
        half = 0.5 * middle * part
        return part + soft * (part * jnp.cosh(mean + half) * _sinhc(half) - apart)

    guess = soft * apart / (1 + soft * jnp.cosh(mean))
    bracket = jnp.full_like(guess, -0.5), jnp.full_like(guess, 1.5)
    return middle * bracketed_root(balance, guess, *bracket)


def _sag_over_parameter(soft, mean, theta, shift):
    """Return the midspan sag over ``a = H/q``, without unit.

    The arguments are e, m, theta and g of the formulas above.
    """
    shape = jnp.cosh(mean) * cosh_minus_1(theta)
    shape = shape - 2 * jnp.sinh(mean + 0.5 * shift) * jnp.sinh(0.5 * shift)
    stretch = jnp.cosh(2 * mean) * cosh_minus_1(2 * theta)
    stretch = stretch - 2 * jnp.sinh(2 * mean + shift) * jnp.sinh(shift)
    return shape + 0.25 * soft * stretch


def chord_strain_at_sag(
    chord: Float[Array, " 3"], load: Float[Array, " 3"], stiffness: Scalar, sag: Scalar
) -> Scalar:
    """Solve for the strain (chord over unstressed length, minus 1) at which a cable has a sag.

    The sag grows with the length, so that there is one solution. The search goes outwards from the
    parabola ``L0 (1 + N/EA) = d (1 + 8/3 (sag l/d^2)^2)``, ``N = q d^2 / (8 sag)``, where l is the
    part of the chord d across the load. Its derivatives are those of the formulas above, which need
    no search within the search.

    Args:
        chord: [3], m.
        load: per unstressed length, [3], N/m, not along the chord; not zero.
        stiffness: EA, N.
        sag: distance from the chord at midspan, along the load, positive, m.
    """
    strain, shape = _search_shape_at_sag(*lax.stop_gradient((chord, load, stiffness, sag)))
    weight, unit = magnitude_and_direction(load)
    along = scalar_product(chord, unit)
    across = chord - along * unit
    span = jnp.sqrt(scalar_product(across, across))
    length = jnp.sqrt(scalar_product(chord, chord))
    given = span, along, length, weight / stiffness, sag
    solver = TangentSolver(_solve_four_equations, _solve_four_equations)
    return implicit_root(_mismatches_and_strain, shape, given, solver, strain)[1]


def _search_shape_at_sag(chord, load, stiffness, sag):
    """Return the strain, and a, theta, m and g, [4], at which a cable has a sag.

    Arguments are those of `chord_strain_at_sag`. The strain of a taut cable has more digits than
    one that is computed from the other numbers.
    """
    length2 = scalar_product(chord, chord)
    length = jnp.sqrt(length2)

    def hang(u):
        excess = -length2 * jnp.expm1(2 * u)
        force, _, theta = solve_catenary(chord, excess, load, length * jnp.exp(u), stiffness)
        return force, theta

    def mismatch(u):
        return jnp.log(midspan_sag(*hang(u), load, stiffness) / sag)

    weight, unit = magnitude_and_direction(load)
    across = chord - scalar_product(chord, unit) * unit
    slope = jnp.sqrt(scalar_product(across, across)) / length
    ratio = sag / length
    shallow = jnp.log1p(8 / 3 * (ratio * slope) ** 2)
    taut = jnp.log1p(weight * length / (8 * ratio * stiffness))
    deep = jnp.log1p(2 * ratio)
    guess = jnp.minimum(shallow, deep) - taut
    u = bracketed_root(mismatch, guess, guess - 5 - 2 * taut, deep + 5)
    force, theta = hang(u)
    size, soft, mean = _catenary_parameters(force, theta, load, stiffness)
    shape = jnp.stack([size, theta, mean, _midspan_shift(soft, mean, theta)])
    return jnp.expm1(-u), shape


def _mismatches_and_strain(shape, given):
    """Return by how much a cable misses its ends, its sag and its midspan, [4]; and its strain.

    Args:
        shape: a, theta, m and g of the formulas above, [4].
        given: the chord across and along the load, and its length, m; load over stiffness, 1/m;
            sag, m.
    """
    size, theta, mean, shift = shape
    span, along, length, soft, sag = given
    soft = size * soft
    stretch = 0.5 * soft * jnp.sinh(2 * mean) * jnp.sinh(2 * theta)
    past_middle = 2 * jnp.cosh(mean + 0.5 * shift) * jnp.sinh(0.5 * shift)
    missed = jnp.stack(
        [
            2 * size * (soft * jnp.cosh(mean) * jnp.sinh(theta) + theta) / span - 1,
            (size * (2 * jnp.sinh(mean) * jnp.sinh(theta) + stretch) - along) / length,
            size * _sag_over_parameter(soft, mean, theta, shift) / sag - 1,
            shift - soft * (jnp.sinh(mean) * cosh_minus_1(theta) - past_middle),
        ]
    )
    return missed, length / (2 * size * jnp.cosh(mean) * jnp.sinh(theta)) - 1


def _solve_four_equations(_, product, rhs):
    """Return x [4] with ``product(x) = rhs`` for a linear function `product` of four numbers.

    The first argument, parameters, is not needed (see `TangentSolver`).
    """
    matrix = jax.vmap(product, out_axes=1)(jnp.eye(4, dtype=rhs.dtype))
    return linear.solve_general(matrix, rhs)[0]


def _sinhc(t):
    """Return ``sinh(t) / t`` for a number t of either sign; 1 at zero."""
    return 1 + sinhc_minus_1(jnp.where(t < 0, -t, t))
