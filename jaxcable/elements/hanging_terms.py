"""Terms of the equation of a hanging cable, see `hanging`; most are numbers without a unit."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.types import Array, Float
from ..numerics.vectors import scalar_product
from .element import Scalar


def magnitude_and_direction(load: Float[Array, " 3"]) -> tuple[Scalar, Float[Array, " 3"]]:
    """Return the magnitude of a load, N/m, and its unit direction [3]; both zero without load."""
    weight2 = scalar_product(load, load)
    heavy = weight2 > 0
    weight = jnp.where(heavy, jnp.sqrt(jnp.where(heavy, weight2, 1.0)), 0.0)
    return weight, load / jnp.where(heavy, weight, 1.0)


def mean_strain_and_theta(unknown_strain: Scalar, omega: Scalar) -> tuple[Scalar, Scalar]:
    """Return mean strain ``tau / EA`` and shape parameter theta (see `hanging`) of a cable.

    The mean of the tensions at both ends is tau.

    Args:
        unknown_strain: the tension unknown as a strain, ``(tau - |q| L0/2) / EA``, at least 0.
        omega: the load as a strain, ``|q| L0 / EA``.
    """
    # zero only in a slack cable without load, where theta is zero
    positive = unknown_strain > 0
    theta = 0.5 * jnp.log1p(omega / jnp.where(positive, unknown_strain, 1.0))
    return unknown_strain + 0.5 * omega, theta


def spring_stiffnesses(strain: Scalar, theta: Scalar) -> tuple[Scalar, Scalar]:
    """Return the secant stiffness across the load, and how much larger the one along the load is.

    It is the component of the tension vector at mid-length over that of the chord, in the unit
    ``EA / L0``. The arguments are the results of `mean_strain_and_theta`.
    """
    bend = theta_coth_minus_1(theta)
    spring = strain / (strain + 1 + bend)
    return spring, spring * bend / (strain + 1)


def sag_ratio_minus_1(strain: Scalar, theta: Scalar) -> Scalar:
    """Return ``r - 1``, computed without this subtraction.

    ``r = (1 + strain) / (theta / sinh(theta) + strain / cosh(theta))`` is 1 for a straight cable.
    """
    s, c = sinhc_minus_1(theta), cosh_minus_1(theta)
    return (s / (1 + s) + strain * c / (1 + c)) / (1 / (1 + s) + strain / (1 + c))


def sinhc_minus_1(t: Scalar) -> Scalar:
    """Return ``sinh(t)/t - 1`` without cancellation at small t."""
    t2 = t * t
    series = 1 + t2 / 342
    for k in (272, 210, 156, 110, 72, 42, 20):
        series = 1 + t2 / k * series
    big = jnp.where(t < 1, 1.0, t)
    return jnp.where(t < 1, t2 / 6 * series, jnp.sinh(big) / big - 1)


def cosh_minus_1(t: Scalar) -> Scalar:
    """Return ``cosh(t) - 1`` without cancellation at small t."""
    return 2 * jnp.sinh(0.5 * t) ** 2


def theta_coth_minus_1(t: Scalar) -> Scalar:
    """Return ``t coth(t) - 1`` without cancellation at small t."""
    s = sinhc_minus_1(t)
    small = (cosh_minus_1(t) - s) / (1 + s)
    return jnp.where(t < 1, small, t / jnp.tanh(jnp.where(t < 1, 1.0, t)) - 1)
