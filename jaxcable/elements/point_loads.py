"""Concentrated loads within a beam element, in the frame of the element.

In linear theory the displacements of a beam are the sum of two fields. One follows the ends of the
element (`bending`). The other is that of the element with clamped ends under its load. Their
stresses do no work on each other's strains, so that the second one adds to the potential

    - sum_j (f_j . u(c_j) + m_j . t(c_j)) - 1/2 (the same with the second field alone),

with the displacement u and the rotation t of the first field at the place c_j of load j. Forces and
moments of the ends are its derivatives. With the length and the bending stiffness 1, the second
field of a unit force at c is

    a s^2/2 + b s^3/6 + <s - c>^3/6,    a = c (1 - c)^2,    b = -(1 - c)^2 (1 + 2 c),

where a and -b are the moment and the force at the first end (tables of fixed-end moments), and
<x> is x where x > 0 and else 0. The field of a unit couple at c is its derivative by c. Along the
axis, the displacement of the neutral axis is s (1 - c) - <s - c>; a force on a node axis off the
neutral axis is a force on the neutral axis and a couple.

The axial force of the element works on the shortening that the sum of both fields makes, as in
`bending`; the part that is of second order in couples is left out. An element whose section is not
linear, or flexible in shear, has the first field only, by slopes of the axis and with its inner
unknowns: the kink of its curvature at the load is not modelled then. Forces on the ends are exact
in linear theory all the same.

Moments are shared between the ends, (1 - c) and c of each, as moments on the nodes that keep their
direction (`loads.points`). What is left works on the rotation t less its linear part between the
ends, and turns no element as a whole.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..common.tree import copy_with, pytree
from ..common.types import Array, Float
from ..numerics.rotations import cross
from .element import Scalar


@pytree(static=("sheared",))
class SpanLoads:
    """Concentrated loads of an element in its frame, and its section, if that is linear.

    Attributes:
        places: of the loads, from 0 to 1, [k].
        forces: along the rotated axes, [k, 3], N.
        moments: along the rotated axes, too, [k, 3], N m; None without.
        length: unstressed length, m.
        sag: curvatures of the second Legendre polynomial (`bending.StrainField.sag`), [2], 1/m.
        axial: stiffness EA, N; None if the section is not linear, like the following ones.
        coupling: axial strain of the node axis per curvature without axial force, negative, [2], m.
        compliance: curvature per moment about the neutral axis, [2, 2], 1/(N m2).
        sheared: whether the element is flexible in shear.
    """

    places: Float[Array, " k"]
    forces: Float[Array, "k 3"]
    moments: Float[Array, "k 3"] | None
    length: Scalar
    sag: Float[Array, " 2"]
    axial: Scalar = None  # type: ignore[assignment]  # None if the section is not linear
    coupling: Float[Array, " 2"] = None  # type: ignore[assignment]  # likewise
    compliance: Float[Array, "2 2"] = None  # type: ignore[assignment]  # likewise
    sheared: bool = False

    @property
    def has_clamped_field(self) -> bool:
        """Whether the second field is there: in linear sections that are rigid in shear."""
        return self.axial is not None and not self.sheared

    def field_of_ends(
        self, rotations: Float[Array, "2 2"], sag: Float[Array, " 2"], axial: Float[Array, " 2"]
    ) -> tuple[Float[Array, " k"], Float[Array, "k 2"], Float[Array, "k 2"]]:
        """Return displacements and rotations of the first field, which follows the ends, at loads.

        Args:
            rotations: of both ends about y and z, [2, 2], rad.
            sag: as of `SpanLoads`.
            axial: coefficients of the Legendre polynomials P1 and P2 in the axial strain, [2].

        Returns:
            Displacements along the axis without those of the mean strain, [k], m; deflections
            ``(-w_z, w_y)``, on which `bending_loads` do work, [k, 2], m; rotations about y and z
            less their linear part between the ends, [k, 2], rad.
        """
        c, length = self.places, self.length
        along = length * (axial[0] * (c - 1) * c + axial[1] * c * (1 - c) * (1 - 2 * c))
        first, second, bow = c * (1 - c) ** 2, -(c**2) * (1 - c), (c * (1 - c)) ** 2 / 2
        way = jnp.outer(first, rotations[0]) + jnp.outer(second, rotations[1])
        way = length * (way + length * jnp.outer(bow, sag))
        bump, slope = -3 * c * (1 - c), c * (1 - c) * (1 - 2 * c)
        turn = jnp.outer(bump, rotations[0] + rotations[1]) + length * jnp.outer(slope, sag)
        return along, way, turn

    def clamped_field(
        self, places: Float[Array, " n_place"], order: int
    ) -> tuple[Float[Array, " n_place"], Float[Array, "n_place 2"]]:
        """Return the second field at places, m, or its derivative by the place over the length.

        Args:
            places: from 0 to 1, [n_place].
            order: 0, or 1 and 2 for derivatives; -1 for its integral from 0.

        Returns:
            The displacement of the neutral axis along the element, [n_place], and deflections
            ``(-w_z, w_y)``, as of `field_of_ends`, [n_place, 2].
        """
        s, c, passed = places[:, None], self.places[None], acts_before(self.places, places)
        across, past, before = bending_loads(self.forces), jnp.maximum(s - c, 0.0), 1 - c
        by_force = _clamped_deflection(s, c, past, order)
        by_couple = _clamped_deflection_by_couple(s, c, past, passed, order)
        way = self.length**3 * (by_force @ across) + self.length**2 * (by_couple @ self._couples())
        along = {
            -1: s**2 / 2 * before - past**2 / 2,
            0: s * before - past,
            1: before - passed,
            2: jnp.zeros_like(past),
        }[order]
        stretch = self.length / self.axial * (along @ self.forces[:, 0])
        return stretch, way @ self.compliance

    def _couples(self):
        """Return the couples about the neutral axis that bend about y and z, [k, 2], N m."""
        couples = -jnp.outer(self.forces[:, 0], self.coupling)
        return couples if self.moments is None else couples + self.moments[:, 1:]

    def work(
        self, rotations: Float[Array, "2 2"], sag: Float[Array, " 2"], axial: Float[Array, " 2"]
    ) -> Scalar:
        """Return the work of the loads: on the first field, and half of that on the second one, J.

        The arguments are those of `field_of_ends`.
        """
        along, way, turn = self.field_of_ends(rotations, sag, axial)
        total = jnp.sum(self.forces[:, 0] * along) + jnp.sum(bending_loads(self.forces) * way)
        if self.moments is not None:
            total = total + jnp.sum(self.moments[:, 1:] * turn)
        if self.has_clamped_field:
            stretch, way = self.clamped_field(self.places, 0)
            turn = self.clamped_field(self.places, 1)[1] / self.length
            own = jnp.sum(self.forces[:, 0] * stretch) + jnp.sum(bending_loads(self.forces) * way)
            total = total + 0.5 * (own + jnp.sum(self._couples() * turn))
        return total

    def shortening(self, rotations: Float[Array, "2 2"], sag: Float[Array, " 2"]) -> Scalar:
        """Return the shortening of the deflected axis by the second field, as a part of the length.

        The product of both fields is in it, the square of the first one is not. It is zero without
        a second field. The arguments are those of `field_of_ends`.
        """
        if not self.has_clamped_field:
            return jnp.zeros_like(self.length)
        c, length = self.places, self.length
        square = (c * (1 - c)) ** 2
        slope = 2 * c * (1 - c) * (1 - 2 * c)
        # deflections at c of a clamped beam under the curvatures of the first field
        parts = (3 * c - 4) / 60, (3 * c + 1) / 60, length * (2 * c**2 - 2 * c - 1) / 120
        slopes: tuple[Any, ...] = (1 / 20, 1 / 20, length * (4 * c - 2) / 120)
        fields = rotations[0], rotations[1], sag
        pushed = length**2 * (bending_loads(self.forces) @ self.compliance)
        turned = length * (self._couples() @ self.compliance)
        total = jnp.zeros_like(length)
        for part, rise, about in zip(parts, slopes, fields, strict=True):
            total = total - jnp.sum(square * part * (pushed @ about))
            total = total - jnp.sum((slope * part + square * rise) * (turned @ about))
        return total + 0.5 * jnp.sum(_slope_product_integrals(c) * (pushed @ pushed.T))


class SpanLoadForces(NamedTuple):
    """Contributions of concentrated loads to the forces of an element.

    The first four are minus the derivatives of the work of the loads: external forces are
    subtracted from internal ones.

    Attributes:
        first, second: by the rotations of both ends about y and z, moments, [2], N m.
        by_sag, by_axial: by the inner unknowns: the curvatures `SpanLoads.sag`, [2], N m2, and the
            coefficients of both Legendre polynomials of the axial strain, [2], J.
        torque: moment of the loads on the frame of the element, [3], N m.
        pull: contribution to the derivative of the potential by a line load, [3], m2.
    """

    first: Float[Array, " 2"]
    second: Float[Array, " 2"]
    by_sag: Float[Array, " 2"]
    by_axial: Float[Array, " 2"]
    torque: Float[Array, " 3"]
    pull: Float[Array, " 3"]


def span_load_forces(
    terms: SpanLoads, rotations: Float[Array, "2 2"], axial: Float[Array, " 2"], tension: Scalar
) -> SpanLoadForces:
    """Return what concentrated loads add to the forces of an element, `SpanLoadForces`.

    They are derivatives of the potential of the loads.

    `rotations` and `axial` are those of `SpanLoads.field_of_ends`, `tension` is the axial force,
    its mean along the element, N.
    """

    def work(rotations, sag, axial, forces, moments):
        return copy_with(terms, forces=forces, moments=moments).work(rotations, sag, axial)

    def shortening(forces, moments):
        return copy_with(terms, forces=forces, moments=moments).shortening(rotations, terms.sag)

    loads: tuple[Any, ...] = terms.forces, terms.moments
    at = (rotations, terms.sag, axial, *loads)
    n_load = 1 if terms.moments is None else 2
    by_end, by_sag, by_axial, *by_load = jax.grad(work, tuple(range(3 + n_load)))(*at)
    shorter = jax.grad(shortening, tuple(range(n_load)))(*loads)
    torque = jnp.zeros_like(terms.forces[0])
    for load, moved, short in zip(loads, by_load, shorter, strict=False):
        torque = torque + jnp.sum(
            jax.vmap(cross)(load, terms.length * tension * short - moved), axis=0
        )
    pull = jnp.zeros_like(torque)
    if terms.axial is not None:
        length, coupling = terms.length, terms.coupling
        bent = length**2 / 12 * ((by_sag - coupling * by_axial[1]) @ terms.compliance)
        pull = jnp.stack([0.5 * length / terms.axial * by_axial[0], -bent[1], bent[0]])
        by_end = by_end - (3 / length * coupling * by_axial[0])[None]
    return SpanLoadForces(-by_end[0], -by_end[1], -by_sag, -by_axial, torque, pull)


def strain_of_clamped_field(terms: SpanLoads, places: Float[Array, " n"]) -> Float[Array, "n 3"]:
    """Return the strains e0, ky, kz of the second field at places, [n, 3]; linear sections."""
    stretch = terms.clamped_field(places, 1)[0] / terms.length
    curvature = terms.clamped_field(places, 2)[1] / terms.length**2
    return jnp.concatenate([(stretch - curvature @ terms.coupling)[:, None], curvature], axis=1)


def acts_before(places: Float[Array, " k"], at: Float[Array, " n"]) -> Float[Array, "n k"]:
    """Return 1 where a load at `places` is before a section `at`, else 0, [n, k].

    A section at the place of a load is before it, except at the first end of the element, where it
    is beyond.
    """
    passed = (at[:, None] > places[None]) | (places[None] <= 0)
    return passed.astype(places.dtype)


def bending_loads(forces: Float[Array, "k 3"]) -> Float[Array, "k 2"]:
    """Return the components ``(-f_z, f_y)`` of forces that bend about y and z, [k, 2]."""
    return jnp.stack([-forces[:, 2], forces[:, 1]], axis=1)


def _clamped_deflection(s, c, past, order):
    """Return the deflection at s of a clamped beam of length and stiffness 1 by a force at c.

    `past` is s - c where that is positive and else 0. `order` is that of the derivative by s, or -1
    for the integral from 0.
    """
    a, b = c * (1 - c) ** 2, -((1 - c) ** 2) * (1 + 2 * c)
    return {
        -1: a * s**3 / 6 + b * s**4 / 24 + past**4 / 24,
        0: a * s**2 / 2 + b * s**3 / 6 + past**3 / 6,
        1: a * s + b * s**2 / 2 + past**2 / 2,
        2: a + b * s + past,
    }[order]


def _clamped_deflection_by_couple(s, c, past, passed, order):
    """Return `_clamped_deflection` by a couple at c in place of a force.

    `passed` is 1 where s is beyond c, else 0.
    """
    a, b = (1 - c) * (1 - 3 * c), 6 * c * (1 - c)
    return {
        -1: a * s**3 / 6 + b * s**4 / 24 - past**3 / 6,
        0: a * s**2 / 2 + b * s**3 / 6 - past**2 / 2,
        1: a * s + b * s**2 / 2 - past,
        2: a + b * s - passed,
    }[order]


def _slope_product_integrals(c):
    """Return the integral of the product of two slopes for each pair of places c, [k, k].

    The slopes are those of a clamped beam of length and stiffness 1 under a unit force at either
    place. The integral is the deflection at the second place under the curvature that the force at
    the first one makes, as a load upwards.
    """
    first, second = c[:, None], c[None, :]
    a, b = first * (1 - first) ** 2, -((1 - first) ** 2) * (1 + 2 * first)
    end = a / 24 + b / 120 + (1 - first) ** 5 / 120
    slope = a / 6 + b / 24 + (1 - first) ** 4 / 24
    past = jnp.maximum(second - first, 0.0)
    load = a * second**4 / 24 + b * second**5 / 120 + past**5 / 120
    return (slope - 2 * end) * second**3 + (3 * end - slope) * second**2 - load
