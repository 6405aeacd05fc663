"""A hanging cable under a stated tension: two springs between chord and force.

The potential of the cable, whose derivative by the chord is the force, is the largest over tau of

    Psi = c_along d_along^2/2 + c_across d_across^2/2 - L0 tau/2

with ``c_along = tau/(L0 (1 + e))`` and ``c_across = tau/(L0 (A + e))`` of `hanging`. For a stated
tau the force ``c d`` is linear in the chord, and the derivative of Psi by tau is minus the equation
of `hanging`, which here reads ``gap = sag``: how much longer a straight cable could be under this
tension, and what the sag takes of this. Hence tau can be an unknown of its own beside the chords
(`equilibrium.tension_unknowns`). (Derived for this package.)
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, Float
from ..numerics.vectors import scalar_product
from .element import Scalar
from .hanging_terms import directed, ratio_less_1, strained, two_springs


@pytree
class Under:
    """A hanging cable between given ends under a given tension, which need not be in balance.

    Attributes:
        force: tension vector in the middle, [3], N.
        along: its derivative by the tension, [3].
        gap: ``(L0/2) (1 - d^2 / (L0 (1 + e))^2)``, m: how much longer a straight cable could be.
        compliance: derivative of the gap by the tension, m/N.
        sag: what the sag takes of this, m.
        less: minus the derivative of `sag` by the tension, m/N.
    """

    force: Float[Array, " 3"]
    along: Float[Array, " 3"]
    gap: Scalar
    compliance: Scalar
    sag: Scalar
    less: Scalar


@jax.jit  # traced once, although a program calls it many times
def under(
    tension: Scalar,
    chord: Float[Array, " 3"],
    excess: Scalar,
    load: Float[Array, " 3"],
    rest_length: Scalar,
    stiffness: Scalar,
) -> Under:
    """`Under` for ``tau - |q| L0/2``, the other arguments as of `hang`."""
    weight, unit = directed(load)
    across = chord - scalar_product(chord, unit) * unit
    omega, excess = weight * rest_length / stiffness, excess / rest_length**2
    least = tension / stiffness
    strain, theta = strained(least, omega)
    spring, further = two_springs(strain, theta)

    def rise(u):
        # by the logarithm, because the tension of a loop may be so small that its square vanishes
        theta = 0.5 * jnp.log1p(omega * jnp.exp(-u))
        strain = jnp.exp(u) + 0.5 * omega
        more = ratio_less_1(strain, theta)
        return more * (2 + more) / (1 + strain) ** 2

    u = jnp.log(jnp.where(tension > 0, least, 1.0))
    rising, falling = jax.jvp(rise, (u,), (jnp.ones_like(u),))
    half = 0.5 * scalar_product(across, across) / rest_length
    return Under(
        stiffness / rest_length * (spring * chord + further * (chord - across)),
        (chord / (1 + strain) ** 2 + rising * across) / rest_length,
        0.5 * rest_length * (strain * (2 + strain) - excess) / (1 + strain) ** 2,
        rest_length * (1 + excess) / (stiffness * (1 + strain) ** 3),
        half * rising,
        -half * falling / jnp.where(tension > 0, tension, 1.0),
    )


def matrix(
    tension: Scalar, load: Float[Array, " 3"], rest_length: Scalar, stiffness: Scalar
) -> Float[Array, "3 3"]:
    """Derivative of ``force`` of `Under` by the chord, [3, 3], N/m."""
    weight, unit = directed(load)
    strain, theta = strained(tension / stiffness, weight * rest_length / stiffness)
    spring, further = two_springs(strain, theta)
    along = further * jnp.outer(unit, unit)
    return stiffness / rest_length * (spring * jnp.eye(3, dtype=load.dtype) + along)
