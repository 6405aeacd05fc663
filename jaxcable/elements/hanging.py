"""The elastic catenary: a cable under a uniform dead load, reduced to one equation.

Along the unstressed length ``s`` the tension vector is ``T(s) = F - q (s - L0/2)``, with the load
``q`` per unstressed length and ``F`` the tension vector in the middle. Integrating
``dr/ds = T/EA + T/|T|`` gives the chord ``d``. With the mean ``tau`` of the tensions at both ends,
the part ``V`` of ``F`` along the load and the part ``H`` across it,

    d_along  = L0 V (1/EA + 1/tau)
    d_across = L0 H (1/EA + A/tau),     A = theta coth(theta),   tanh(theta) = |q| L0 / (2 tau),

and ``(V/tau)^2 + (H/tau)^2 cosh(theta)^2 = 1``, hence
``H = tau sqrt(1 - (V/tau)^2) / cosh(theta)``. Together they give one equation for ``tau``,

    L0^2 (1 + e)^2 - d^2 = d_across^2 (r^2 - 1),
    e = tau/EA,   r = (1 + e) / (theta/sinh(theta) + e/cosh(theta)),

whose left side rises and whose right side falls with ``tau``. This equation is regular from a slack
cable to a straight one and from a level chord to a vertical one, and without weight it is the law
of a straight cable. No nearly equal numbers are subtracted: ``L0^2 - d^2`` comes from the start
elongation. (The closed forms are those of Irvine, Cable Structures, 1981; the reduction of two
equations to one was derived for this package.)
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common.types import Array, Float
from ..numerics.roots import bracketed_root
from ..numerics.vectors import scalar_product
from .element import Scalar
from .hanging_terms import (
    magnitude_and_direction,
    mean_strain_and_theta,
    sag_ratio_minus_1,
    spring_stiffnesses,
    theta_coth_minus_1,
)


@jax.jit  # traced once, although a program calls it many times
def solve_catenary(
    chord: Float[Array, " 3"],
    excess: Scalar,
    load: Float[Array, " 3"],
    rest_length: Scalar,
    stiffness: Scalar,
) -> tuple[Float[Array, " 3"], Scalar, Scalar]:
    """Solve for the tensions and the shape of a cable that hangs between given ends.

    Args:
        chord: from the first end to the second, [3], m.
        excess: ``|chord|^2 - L0^2``, m2; given, because the subtraction would lose digits.
        load: dead load per unstressed length, [3], N/m; may be zero.
        rest_length: unstressed length L0, m.
        stiffness: EA, N.

    Returns:
        The tension vector at mid-length, [3], N; the mean tau of the tensions at the ends, N; and
        theta, with ``tanh(theta) = |q| L0 / (2 tau)`` for the load q. All zero where a cable
        without load is slack.
    """
    weight, unit = magnitude_and_direction(load)
    across = chord - scalar_product(chord, unit) * unit
    # for a chord along the load: negligible elsewhere, and its square does not underflow
    tiny = jnp.finfo(chord.dtype).tiny ** 0.45
    across2 = scalar_product(across, across) / rest_length**2 + tiny
    excess = excess / rest_length**2
    omega = weight * rest_length / stiffness
    empty = (omega == 0) & (excess < 0)
    least = _solve_tension_unknown(omega, across2, jnp.where(empty, 0.0, excess))
    strain, theta = mean_strain_and_theta(least, omega)
    spring, further = spring_stiffnesses(strain, theta)
    pull = stiffness / rest_length * (spring * chord + further * (chord - across))
    none = jnp.where(empty, 0.0, 1.0)
    return none * pull, none * stiffness * strain, theta


def tension_unknown(
    chord: Float[Array, " 3"],
    excess: Scalar,
    load: Float[Array, " 3"],
    rest_length: Scalar,
    stiffness: Scalar,
) -> Scalar:
    """Return the mean of the end tensions minus half of the load, ``tau - |q| L0/2``, N.

    This is the unknown of `hanging_springs`; arguments are those of `solve_catenary`.
    """
    _, tau, theta = solve_catenary(chord, excess, load, rest_length, stiffness)
    weight, _ = magnitude_and_direction(load)
    heavy = weight > 0
    deep = weight * rest_length / jnp.expm1(2 * jnp.where(heavy, theta, 1.0))
    return jnp.where(heavy, deep, tau)


def _solve_tension_unknown(omega, across2, excess):
    """Solve for ``(tau - |q| L0/2) / EA``, the tension unknown as a strain.

    `omega` is the load ``|q| L0 / EA``; of the chord d, `across2` is ``(d_across / L0)^2`` with the
    part across the load, and `excess` is ``(d / L0)^2 - 1``.

    The unknown is a logarithm, because the horizontal force falls exponentially where a cable hangs
    nearly vertically in a loop. For a taut cable it is the logarithm of the strain that the load
    adds to that of the straight cable, because this may be far below the rounding of the strain.
    Then both sides of the equation, in logarithms, are nearly straight lines.
    """
    straight = excess / (1 + jnp.sqrt(jnp.where(excess > 0, 1 + excess, 1.0)))
    taut = (excess >= 0) & (straight >= 0.5 * omega)
    base = jnp.where(taut, straight - 0.5 * omega, 0.0)
    gap = jnp.where(taut, 0.0, 0.5 * omega - straight)
    floor = jnp.finfo(omega.dtype).tiny ** 0.2  # of the sag's term, for a cable without load

    def balance(u):
        added = jnp.exp(u)
        strain, theta = mean_strain_and_theta(base + added, omega)
        more = sag_ratio_minus_1(strain, theta)
        left = jnp.where(
            excess > 0, (added + gap) * (2 + strain + straight), strain * (2 + strain) - excess
        )
        return jnp.log(left) - jnp.log(across2) - jnp.log(more * (2 + more) + floor)

    theta, strain, added = _guess_theta_and_strain(omega, across2, excess)
    added = jnp.where(taut, added, jnp.where(omega > 0, omega / jnp.expm1(2 * theta), strain))
    tiny = jnp.finfo(omega.dtype).tiny
    low = jnp.log(jnp.full_like(omega, 1e3 * tiny))  # above underflow after rounding
    high = jnp.log(2 + 2 * jnp.sqrt(jnp.maximum(1 + excess, 0.0)) + omega)
    return base + jnp.exp(
        bracketed_root(balance, jnp.log(jnp.maximum(added, 1e3 * tiny)), low, high)
    )


def _guess_theta_and_strain(omega, across2, excess):
    """Return guesses of theta, of the mean strain, and of the part of it that the load adds.

    Arguments are those of `_solve_tension_unknown`. The guess is the closed form of a shallow
    cable; theta is corrected if the cable is deep.
    """
    tiny = jnp.finfo(omega.dtype).tiny
    straight = excess / (1 + jnp.sqrt(jnp.maximum(1 + excess, 0.0)))
    # e^3 - straight e^2 = k, whose positive root Newton's method finds from above
    k = across2 * omega**2 / 24
    slack = jnp.sqrt(k / jnp.maximum(-straight, tiny))
    strain = jnp.where(straight > 0, straight, 0.0) + jnp.cbrt(k)
    strain = jnp.where(straight < 0, jnp.minimum(strain, slack), strain)
    strain = jnp.maximum(strain, tiny**0.3)  # its cube does not underflow

    def cubic(_, strain):
        slope = 3 * strain**2 - 2 * straight * strain
        step = (strain**3 - straight * strain**2 - k) / jnp.where(slope > 0, slope, 1.0)
        return jnp.where(slope > 0, jnp.maximum(strain - step, 0.1 * strain), strain)

    strain = jax.lax.fori_loop(0, 4, cubic, strain)
    theta = jnp.minimum(0.5 * omega / strain, 1e6)
    # inextensible cable: log(sinh(t)/t) = log(sqrt(L0^2 - d_along^2)/d_across); the left side is
    # convex, and Newton's method comes from the right
    ratio = 0.5 * jnp.log1p(jnp.maximum(-excess, 0.0) / across2)

    def inextensible(_, deep):
        t = jnp.maximum(deep, 1e-2)
        log_sinhc = t + jnp.log(-jnp.expm1(-2 * t) / (2 * t))
        # clipped to where the formula can be evaluated; the root search corrects the guess
        return jnp.clip(t - (log_sinhc - ratio) / (1 / jnp.tanh(t) - 1 / t), 1e-2, t)

    deep = jax.lax.fori_loop(0, 3, inextensible, theta)
    limit = 0.45 * jnp.abs(jnp.log(tiny))
    theta = jnp.minimum(jnp.where(theta > 0.5, deep, theta), limit)
    return theta, strain, k / strain / strain


def stored_energy(
    force: Float[Array, " 3"],
    tau: Scalar,
    theta: Scalar,
    chord: Float[Array, " 3"],
    load: Float[Array, " 3"],
    rest_length: Scalar,
    stiffness: Scalar,
) -> Scalar:
    """Return the energy of a cable as a function of its chord, J; its gradient is ``force``.

    It is ``F.d`` minus the complementary energy, the integral of ``|T|^2/(2 EA) + |T|`` over the
    unstressed length: the stored energy plus the potential of the load along the cable, without the
    shares of this load at the ends. `force`, `tau`, `theta` are results of `solve_catenary`, others
    its arguments.
    """
    weight2 = scalar_product(load, load)
    heavy = weight2 > 0
    along = scalar_product(force, load)
    along2 = along**2 / jnp.where(heavy, weight2, 1.0)
    across2 = jnp.maximum(scalar_product(force, force) - along2, 0.0)
    some = jnp.where(tau > 0, tau, 1.0)
    integral = 0.5 * (tau + along2 / some + across2 * (1 + theta_coth_minus_1(theta)) / some)
    square = scalar_product(force, force) + weight2 * rest_length**2 / 12
    return force @ chord - rest_length * (0.5 * square / stiffness + integral)


def positions_along(
    part: Float[Array, " n_place"],
    force: Float[Array, " 3"],
    tau: Scalar,
    load: Float[Array, " 3"],
    rest_length: Scalar,
    stiffness: Scalar,
) -> Float[Array, "n_place 3"]:
    """Return points relative to the first end, m, at `part` (0 to 1) of the cable's length.

    Every piece of a catenary is a catenary: the same equations hold between 0 and s. `force` is the
    tension vector at mid-length, N; other arguments are as of `solve_catenary`.
    """
    arc = (part * rest_length)[:, None]
    first = force + 0.5 * rest_length * load
    first = jnp.broadcast_to(first, (len(arc), 3))
    here = first - jnp.outer(arc[:, 0], load)
    mean = 0.5 * (first + here)
    both = _row_norms(first) + _row_norms(here)
    weight, unit = magnitude_and_direction(load)
    along = jnp.outer(mean @ unit, unit)
    c = weight * arc / jnp.where(both > 0, both, 1.0)
    theta = jnp.arctanh(jnp.minimum(c, 1 - jnp.finfo(c.dtype).eps))
    stretched = mean / stiffness
    straight = 2 / jnp.where(both > 0, both, 1.0)
    return arc * (stretched + straight * (along + (1 + theta_coth_minus_1(theta)) * (mean - along)))


def _row_norms(vectors):
    """Return the Euclidean norms of vectors [..., 3], as an array [..., 1]."""
    return jnp.sqrt(jnp.sum(vectors**2, axis=-1, keepdims=True))
