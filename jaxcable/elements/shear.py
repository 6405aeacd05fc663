"""Shear flexibility of beams: angles between cross-sections and the normals of the deflected axis.

The rotations of the ends are those of the cross-sections, ``t``; the axis there has the slope
``t - g`` (Timoshenko 1921). Along an element the shear angle is linear, as the shear force is under
a uniform load,

    g(s) = g_m + g_1 P1,    GA g_m = V_m,    GA g_1 = L/2 (-q_z, q_y),

for the angles about y (with GAz) and about z (with GAy). The curvature is the derivative of ``t``,
as in Bernoulli's theory, and its part ``P1`` follows from the mean slope of the ends:
``k_1 = 3 (t_1 + t_2 - 2 g_m) / L``. A slender element can therefore bend without shear: it does not
lock. The energy has ``L/2 GA (g_m^2 + g_1^2 / 3)`` in addition.

``V_m`` is the difference of the end moments over the length, ``2 M_1 / L``. Hence in a linear
section, with the bending stiffness ``C`` about the neutral axis,

    (1 + 12 C / (GA L^2)) g_m = 6 C / (GA L^2) (t_1 + t_2),

which is exact in linear theory; a section of other laws has ``g_m`` among its inner unknowns.

The axial force is along the tangent of the deflected axis, and the shear force across it, as in
Engesser's theory of columns: ``P = P_E / (1 + P_E / GA)``. It is the one for lattice and built-up
columns, whose panels are sheared by the force across the axis. (In Haringx's theory, for springs
and rubber bearings, the axial force is normal to the cross-section.)

Source: Engesser (1891); Timoshenko (1921); Bazant and Cedolin, Stability of Structures, 1.7.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from ..common.tree import copy_with, pytree
from ..common.types import Array, Float
from .element import Scalar


@pytree
class ShearAngles:
    """Shear angles of an element, about y and z, and what they depend on.

    Attributes:
        mean: mean along the element, [2], rad.
        slope: half of the difference between the second end and the first, from the load, [2],
            rad; None without load.
        stiffness: GAz and GAy, [2], N; zero where rigid in shear.
        compliance: 1/GAz and 1/GAy, [2], 1/N; zero where rigid in shear.
        by_rotation: derivative of `mean` by the rotations of the first end, and of the second, in
            a linear section, [2, 2]; None for other laws.
        by_axial_load: its derivative by the axial load, [2], m/N; None for other laws.
    """

    mean: Float[Array, " 2"]
    slope: Float[Array, " 2"] | None
    stiffness: Float[Array, " 2"]
    compliance: Float[Array, " 2"]
    by_rotation: Float[Array, "2 2"] | None = None
    by_axial_load: Float[Array, " 2"] | None = None

    def end_slopes(self, rotations: Float[Array, "2 3"]) -> Float[Array, "2 3"]:
        """Return slopes of the axis at the ends from rotations of the cross-sections, [2, 3]."""
        first = second = self.mean
        if self.slope is not None:
            first, second = first - self.slope, second + self.slope
        return rotations.at[:, 1:].add(-jnp.stack([first, second]))

    def energy(self, length: Scalar) -> Scalar:
        """Return the shear energy, J, of an element of the unstressed `length`, m."""
        squares = self.mean**2
        if self.slope is not None:
            squares = squares + self.slope**2 / 3
        return 0.5 * length * jnp.sum(self.stiffness * squares)

    def moments_of_ends(self, bend: Float[Array, "3 2"]) -> Float[Array, " 2"] | float:
        """Return the moments on either end, about y and z, from angles that depend on rotations.

        In a linear section the angles balance the section forces in linear theory. What is left of
        the derivative of the energy by them is the work of the axial force on the shortening of the
        axis; `bend` has the derivatives of this work by the slopes of the axis at the first and the
        second end (rows), N m. Zero for other sections, whose angles are unknowns.
        """
        return 0.0 if self.by_rotation is None else -(bend[0] + bend[1]) @ self.by_rotation

    def work_by_load(self, bend: Float[Array, "3 2"], length: Scalar) -> Float[Array, " 3"]:
        """Return the derivative of the work of `moments_of_ends` by the load, [3], m2.

        The shear angles depend on the load per unstressed length along the rotated axes; `bend` is
        as for `moments_of_ends`, `length` the unstressed length, m.
        """
        along = jnp.zeros_like(length)
        if self.by_axial_load is not None:
            along = -(bend[0] + bend[1]) @ self.by_axial_load
        across = 0.5 * length * self.compliance * (bend[0] - bend[1])
        return jnp.stack([along, across[1], -across[0]])


def shear_stiffness(section: Any, dtype: Any) -> Float[Array, " 2"] | None:
    """Return GAz and GAy of a section, [2], N, zero where rigid; None if rigid in both."""
    if section.GAy is None and section.GAz is None:
        return None
    zero = jnp.zeros((), dtype)
    return jnp.stack([zero if v is None else v for v in (section.GAz, section.GAy)])


def shear_angles(
    stiffness: Float[Array, " 2"], length: Scalar, load: Float[Array, " 3"] | None, mean: Any
) -> ShearAngles:
    """Return the `ShearAngles` whose `mean`, [2], rad, is known or an unknown of the analysis.

    Args:
        stiffness: as of `shear_stiffness`.
        length: unstressed length, m.
        load: per unstressed length along the rotated axes, [3], N/m, or None.
        mean: mean along the element, [2], rad.
    """
    flexible = stiffness > 0
    compliance = jnp.where(flexible, 1 / jnp.where(flexible, stiffness, 1.0), 0.0)
    slope = None
    if load is not None:
        slope = 0.5 * length * compliance * jnp.stack([-load[2], load[1]])
    return ShearAngles(mean, slope, stiffness, compliance)


def shear_angles_of_linear_section(
    stiffness: Float[Array, " 2"],
    section: Float[Array, "3 3"],
    rotations: Float[Array, "2 3"],
    length: Scalar,
    load: Float[Array, " 3"] | None,
) -> ShearAngles:
    """Return the `ShearAngles` of an element of a linear section, from its end rotations and load.

    Args:
        stiffness, length, load: as of `shear_angles`.
        section: derivative of (N, My, Mz) by (e0, ky, kz), [3, 3].
        rotations: of the ends relative to the chord, along the rotated axes, [2, 3], rad.
    """
    angles = shear_angles(stiffness, length, load, jnp.zeros_like(stiffness))
    coupling = section[0, 1:] / section[0, 0]
    bending = section[1:, 1:] - jnp.outer(coupling, section[0, 1:])
    soft = 6 / length**2 * angles.compliance[:, None] * bending
    (a, b), (c, d) = jnp.eye(2, dtype=soft.dtype) + 2 * soft
    inverse = jnp.stack([jnp.stack([d, -b]), jnp.stack([-c, a])]) / (a * d - b * c)
    by_rotation, by_load = inverse @ soft, None
    mean = by_rotation @ (rotations[0, 1:] + rotations[1, 1:])
    if load is not None:
        by_load = -inverse @ (angles.compliance * coupling)
        mean = mean + by_load * load[0]
    return copy_with(angles, mean=mean, by_rotation=by_rotation, by_axial_load=by_load)
