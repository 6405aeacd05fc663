"""A hanging cable under a stated tension: two springs between chord and force.

The potential of the cable, whose derivative by the chord is the force, is the largest over tau of

    Psi = c_along d_along^2/2 + c_across d_across^2/2 - L0 tau/2

with ``c_along = tau/(L0 (1 + e))`` and ``c_across = tau/(L0 (A + e))`` of `hanging`. For a stated
tau the force ``c d`` is linear in the chord, and the derivative of Psi by tau is minus the equation
of `hanging`, which here reads ``spare_length = sag``: how much longer a straight cable could be
under this tension, and what the sag takes of this. Hence tau can be an unknown of its own beside
the chords (`equilibrium.tension_unknowns`). (Derived for this package.)
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, Float
from ..numerics.vectors import scalar_product
from .element import Scalar
from .hanging_terms import (
    magnitude_and_direction,
    mean_strain_and_theta,
    sag_ratio_minus_1,
    spring_stiffnesses,
)


@pytree
class HangingUnderTension:
    """A hanging cable between given ends under a given tension, not necessarily in equilibrium.

    Attributes:
        force: tension vector at mid-length, [3], N.
        force_per_tension: derivative of `force` by the tension, [3].
        spare_length: how much longer a straight cable could be, m, in the form
            ``(L0/2) (1 - d^2 / (L0 (1 + e))^2)`` with the chord d and the mean strain e.
        compliance: derivative of `spare_length` by the tension, m/N.
        sag: length that the sag takes, m, in the same form; in equilibrium equal to `spare_length`.
        sag_compliance: minus the derivative of `sag` by the tension, m/N.
    """

    force: Float[Array, " 3"]
    force_per_tension: Float[Array, " 3"]
    spare_length: Scalar
    compliance: Scalar
    sag: Scalar
    sag_compliance: Scalar


@jax.jit  # traced once, although a program calls it many times
def hanging_under_tension(
    tension: Scalar,
    chord: Float[Array, " 3"],
    excess: Scalar,
    load: Float[Array, " 3"],
    rest_length: Scalar,
    stiffness: Scalar,
) -> HangingUnderTension:
    """Return forces and spare length of a hanging cable at a tension ``tau - |q| L0/2``, N.

    The mean of the tensions at both ends is tau; it need not be the one of equilibrium between the
    given ends. Other arguments are as of `hanging.solve_catenary`.
    """
    weight, unit = magnitude_and_direction(load)
    across = chord - scalar_product(chord, unit) * unit
    omega, excess = weight * rest_length / stiffness, excess / rest_length**2
    least = tension / stiffness
    strain, theta = mean_strain_and_theta(least, omega)
    spring, further = spring_stiffnesses(strain, theta)

    def rise(u):
        # by the logarithm, because the tension of a loop may be so small that its square vanishes
        theta = 0.5 * jnp.log1p(omega * jnp.exp(-u))
        strain = jnp.exp(u) + 0.5 * omega
        more = sag_ratio_minus_1(strain, theta)
        return more * (2 + more) / (1 + strain) ** 2

    u = jnp.log(jnp.where(tension > 0, least, 1.0))
    rising, falling = jax.jvp(rise, (u,), (jnp.ones_like(u),))
    half = 0.5 * scalar_product(across, across) / rest_length
    return HangingUnderTension(
        stiffness / rest_length * (spring * chord + further * (chord - across)),
        (chord / (1 + strain) ** 2 + rising * across) / rest_length,
        0.5 * rest_length * (strain * (2 + strain) - excess) / (1 + strain) ** 2,
        rest_length * (1 + excess) / (stiffness * (1 + strain) ** 3),
        half * rising,
        -half * falling / jnp.where(tension > 0, tension, 1.0),
    )


def stiffness_under_tension(
    tension: Scalar, load: Float[Array, " 3"], rest_length: Scalar, stiffness: Scalar
) -> Float[Array, "3 3"]:
    """Return the derivative of a cable's tension vector by its chord at constant tension, N/m.

    The `tension`, N, is ``tau - |q| L0/2``; other arguments are as of `hanging.solve_catenary`.
    """
    weight, unit = magnitude_and_direction(load)
    strain, theta = mean_strain_and_theta(tension / stiffness, weight * rest_length / stiffness)
    spring, further = spring_stiffnesses(strain, theta)
    along = further * jnp.outer(unit, unit)
    return stiffness / rest_length * (spring * jnp.eye(3, dtype=load.dtype) + along)
