"""Strains along a beam in the frame of the element, and the forces conjugate to them.

Along the axis, ``s`` from 0 to 1, with Legendre's polynomials on it, ``P1 = 2 s - 1`` and
``P2 = 6 s^2 - 6 s + 1``:

    e0(s) = e + h + a_1 P1 + a_2 P2,      k(s) = (t_2 - t_1)/L + 3 (t_1 + t_2)/L P1 + b P2

for each of the curvatures ky, kz with the end rotations ``t_1, t_2`` about y, z. ``e`` is the
stretch of the chord; ``h`` the shortening of the deflected axis, its mean (or it would lock),

    h = sum_{y,z} (2 t_1^2 - t_1 t_2 + 2 t_2^2)/30 - b L (t_2 - t_1)/60 + (b L)^2/420.

The deflection is the sum of the cubic and ``b L^2 s^2 (1 - s)^2 / 2``, the deflection of a clamped
beam under a uniform load. With ``a_1, a_2`` the axial strain follows the load along the axis, and
bending where the neutral axis moves or is off the node axis. These four numbers (b is one number
about y and one about z) belong to the element alone:

- in a linear section they follow from the load and the ends without iteration, because the orders
  of Legendre's polynomials are uncoupled: ``N_1 = -q_x L/2``, ``N_2 = 0``,
  ``M_2 = L^2 (-q_z, q_y)/12``. This is exact in linear theory, wherever the neutral axis is;
- in a section of other laws they are unknowns of the analysis (`Beams.inner_unknowns`); their
  residual is zero when the section's forces balance the load in the mean weighted by these shapes.

With shear flexibility (`shear`) the end rotations above are those of the cross-sections in the
difference ``t_2 - t_1`` of the curvature, and slopes of the axis everywhere else.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Float
from ..numerics.rotations import cross
from .corotation import Pose
from .element import Scalar
from .point_loads import SpanLoads, span_load_forces, strain_of_clamped_field
from .shear import ShearAngles


@pytree
class StrainField:
    """Strains along an element as Legendre polynomials, and their derivatives by end rotations.

    Attributes:
        strain: coefficients of e0, ky, kz (columns) for the polynomials 1, P1, P2 (rows), [3, 3].
        shortening: derivatives of the shortening of the deflected axis by the rotations of the
            first and the second end and by `sag` (rows), each about y and z, [3, 2].
        sag: coefficient of P2 in the curvatures about y and z, [2], 1/m.
        twist: rotation of the second end about the axis relative to the first, rad.
        bending_compliance: curvature per moment about the neutral axis of a linear section, [2, 2];
            None for other sections and without load.
        shear: angles between cross-sections and the normals of the axis; None if rigid in shear.
        points: concentrated loads within the element; None without. `strain` and `shortening` have
            the shortening of the axis that they cause, but not the curvatures between clamped ends.
    """

    strain: Float[Array, "3 3"]
    shortening: Float[Array, "3 2"]
    sag: Float[Array, " 2"]
    twist: Scalar
    bending_compliance: Float[Array, "2 2"] | None = None
    shear: ShearAngles | None = None
    points: SpanLoads | None = None

    def strains_at(self, places: Float[ArrayLike, " n_place"]) -> Float[Array, "n_place 3"]:
        """Return the section strains e0, ky, kz at positions from 0 to 1, [n_place, 3]."""
        places = jnp.asarray(places, self.strain.dtype)
        strains = legendre_basis(places) @ self.strain
        if self.points is None or not self.points.has_clamped_field:
            return strains
        return strains + strain_of_clamped_field(self.points, places)


def with_point_loads(
    field: StrainField,
    pose: Pose,
    length: Scalar,
    points: Float[Array, "k 4or7"] | None,
    stiffness: Float[Array, "3 3"] | None,
) -> StrainField:
    """Return the `StrainField` of an element with concentrated loads, or as it is without any.

    Args:
        field, length, stiffness: result and arguments of `strain_field`.
        pose: of the element.
        points: as of `ElementLoad.points`, of one element, or None.
    """
    if points is None:
        return field
    rotations, axes = pose.rotations, pose.axes
    forces = points[:, 1:4] @ axes.T
    moments = points[:, 4:] @ axes.T if points.shape[1] > 4 else None
    terms = SpanLoads(
        points[:, 0], forces, moments, length, field.sag, sheared=field.shear is not None
    )
    if stiffness is not None:
        coupling = stiffness[0, 1:] / stiffness[0, 0]
        yielding = bending_compliance(stiffness[1:, 1:] - jnp.outer(coupling, stiffness[0, 1:]))
        terms = copy_with(terms, axial=stiffness[0, 0], coupling=coupling, compliance=yielding)
    shorter, slopes = jax.value_and_grad(terms.shortening, (0, 1))(rotations[:, 1:], field.sag)
    return copy_with(
        field,
        strain=field.strain.at[0, 0].add(shorter),
        shortening=field.shortening + jnp.concatenate([slopes[0], slopes[1][None]]),
        points=terms,
    )


def work_of_point_loads(field: StrainField, rotations: Float[Array, "2 3"]) -> Scalar:
    """Return the work of the concentrated loads of a field (`SpanLoads.work`), J."""
    terms: SpanLoads = field.points  # type: ignore[assignment]  # asked where there are some
    return terms.work(axis_slopes(field, rotations)[:, 1:], field.sag, field.strain[1:, 0])


def strain_field(
    rotations: Float[Array, "2 3"],
    stretch: Scalar,
    length: Scalar,
    load: Float[Array, " 3"] | None,
    stiffness: Float[Array, "3 3"] | None = None,
    inner: Float[Array, "2 2"] | None = None,
    shear: ShearAngles | None = None,
) -> StrainField:
    """Return the `StrainField` of an element from its end rotations, its stretch and its load.

    Args:
        rotations: of the ends relative to the chord, along the rotated axes, [2, 3], rad.
        stretch: strain of the chord.
        length: unstressed length, m.
        load: dead load per unstressed length along the rotated axes, [3], N/m, or None.
        stiffness: stiffness of a linear section, [3, 3]; None for other sections.
        inner: unknowns of a section that is not linear, [2, 2], or None: coefficients of P1, P2 in
            the axial strain, and of P2 in the curvatures ky, kz, 1/m.
        shear: shear angles, or None.
    """
    first, second = rotations[0, 1:], rotations[1, 1:]
    even = (second - first) / length
    if shear is not None:
        first, second = shear.end_slopes(rotations)[:, 1:]
    odd = 3 * (first + second) / length
    bent = 2 * first**2 - first * second + 2 * second**2
    slopes = jnp.stack([4 * first - second, 4 * second - first, jnp.zeros_like(first)]) / 30
    yielding = None
    if stiffness is None:
        (a_1, a_2), sag = inner  # type: ignore[misc]  # given without `stiffness`
    else:
        # curvature about the neutral axis first, so that nothing cancels if it is far from the axis
        coupling = stiffness[0, 1:] / stiffness[0, 0]
        a_1, a_2, sag = -coupling @ odd, jnp.zeros_like(stretch), None
        if load is not None:
            yielding = bending_compliance(stiffness[1:, 1:] - jnp.outer(coupling, stiffness[0, 1:]))
            a_1 = a_1 - 0.5 * load[0] * length / stiffness[0, 0]
            sag = yielding @ (length**2 / 12 * bending_components(load))
            a_2 = -coupling @ sag
    if sag is None:
        sag = jnp.zeros_like(even)
    else:
        bow = length * sag
        bent = bent - bow * (second - first) / 2 + bow**2 / 14
        by_end = bow / 60
        by_sag = length * (bow / 210 - (second - first) / 60)
        slopes = slopes + jnp.stack([by_end, -by_end, by_sag])
    axial = jnp.stack([stretch + jnp.sum(bent) / 30, a_1, a_2])
    strain = jnp.column_stack([axial, jnp.stack([even, odd, sag])])
    twist = rotations[1, 0] - rotations[0, 0]
    return StrainField(strain, slopes, sag, twist, yielding, shear)


def axis_slopes(field: StrainField, rotations: Float[Array, "2 3"]) -> Float[Array, "2 3"]:
    """Return slopes of the axis at the ends from rotations of the cross-sections, [2, 3], rad.

    The first component is the rotation about the axis. Both are the same without shear flexibility.
    """
    return rotations if field.shear is None else field.shear.end_slopes(rotations)


def bending_compliance(matrix):
    """Return the inverse of a bending stiffness [2, 2]; zero about an axis without stiffness.

    Fibres on one line have no stiffness for bending along this line.
    """
    (a, b), (c, d) = matrix
    whole = a * d - b * c
    regular = whole > 8 * jnp.finfo(whole.dtype).eps * a * d
    diagonal = [jnp.where(v > 0, 1 / jnp.where(v > 0, v, 1.0), 0.0) for v in (a, d)]
    inverse = jnp.stack([jnp.stack([d, -b]), jnp.stack([-c, a])]) / jnp.where(regular, whole, 1.0)
    return jnp.where(regular, inverse, jnp.diag(jnp.stack(diagonal)))


def bending_components(load: Float[Array, " 3"]) -> Float[Array, " 2"]:
    """Return the components ``(-q_z, q_y)`` of a load [3] that bend about y and z, [2]."""
    return jnp.stack([-load[2], load[1]])


def legendre_basis(places: Float[ArrayLike, " n_place"]) -> Float[Array, "n_place 3"]:
    """Return Legendre polynomials 1, P1, P2 at positions from 0 to 1: columns of [n_place, 3]."""
    place = jnp.asarray(places)
    return jnp.stack([jnp.ones_like(place), 2 * place - 1, 6 * place * (place - 1) + 1], axis=1)


def mean_deflection(
    field: StrainField, rotations: Float[Array, "2 3"], length: Scalar
) -> Float[Array, " 3"]:
    """Return the mean displacement of the axis from its chord, along the rotated axes, [3], m."""
    slopes = axis_slopes(field, rotations)
    bow = length / 12 * (slopes[0, 1:] - slopes[1, 1:]) + length**2 / 60 * field.sag
    return jnp.stack([-field.strain[1, 0] * length / 6, bow[1], -bow[0]])


def generalized_forces(
    field: StrainField,
    rotations: Float[Array, "2 3"],
    length: Scalar,
    sums: Float[Array, "3 3"],
    torsion: Scalar,
    load: Float[Array, " 3"] | None,
    following: tuple[Float[Array, " 3"], Float[Array, "3 3"]] | None = None,
) -> tuple[Scalar, Float[Array, "2 3"], Float[Array, " 3"], Float[Array, "2 2"]]:
    """Return forces and moments of an element from integrals of its section forces.

    Args:
        field, rotations, length, load: as of `strain_field`.
        sums: integrals of N, My, Mz (columns) times the polynomials 1, P1, P2 (rows) over the axis
            from 0 to 1, [3, 3], N and N m.
        torsion: torsional stiffness, N m2.
        following: derivatives of a following load, the last two results of
            `corotation.pressure_load`, or None.

    Returns:
        Axial force, N; moments on the ends, [2, 3], N m; moment of the load on the frame that
        follows the element, [3], N m; and residuals of the unknowns `inner`, [2, 2], J and N m2,
        or, with shear flexibility, [3, 2] with those of the mean shear angles in J.
    """
    force, even, odd = sums[0, 0], sums[0, 1:], 3 * sums[1, 1:]
    if load is not None:
        odd_load = length**2 / 12 * bending_components(load)
        first_load, second_load = odd_load, -odd_load
    bend = length * force * field.shortening
    first, second = bend[0] - even + odd, bend[1] + even + odd
    by_slopes = bend  # what shear angles of linear sections do not balance
    by_sag = length * sums[2, 1:] + bend[2]
    by_axial = length * sums[1:, 0]
    torque = jnp.zeros(3, force.dtype)
    added = None
    if field.points is not None:
        slopes = axis_slopes(field, rotations)[:, 1:]
        added = span_load_forces(field.points, slopes, field.strain[1:, 0], force)
        by_slopes = by_slopes.at[:2].add(jnp.stack([added.first, added.second]))
        first, second = first + added.first, second + added.second
        by_sag, by_axial = by_sag + added.by_sag, by_axial + added.by_axial
        torque = added.torque
    if load is not None:
        first, second = first - first_load, second - second_load
        by_sag = by_sag - length**3 / 60 * bending_components(load)
        by_axial = by_axial + jnp.stack([load[0] * length**2 / 6, jnp.zeros_like(force)])
        pull = -length * mean_deflection(field, rotations, length)
        if field.bending_compliance is not None:
            # b changes with a load that turns against the frame
            turned = length**2 / 12 * (field.bending_compliance @ bend[2])
            pull = pull + jnp.stack([jnp.zeros_like(force), turned[1], -turned[0]])
        if field.shear is not None:
            pull = pull + field.shear.work_by_load(by_slopes, length)
        pull = pull if added is None else pull + added.pull
        turning = cross(load, pull)
        torque = turning if added is None else torque + turning
        if following is not None:
            by_length, by_frame = following
            force, torque = force + by_length @ pull, torque + by_frame @ pull
    inner = [by_axial, by_sag]
    if field.shear is not None:
        inner.append(length * field.shear.stiffness * field.shear.mean - first - second)
        by_shear = field.shear.moments_of_ends(by_slopes)
        first, second = first + by_shear, second + by_shear
    twisting = torsion * field.twist / length
    moments = jnp.stack([jnp.append(-twisting[None], first), jnp.append(twisting[None], second)])
    return force, moments, torque, jnp.stack(inner)


def linear_section_integrals(
    stiffness: Float[Array, "3 3"], strain: Float[Array, "3 3"]
) -> Float[Array, "3 3"]:
    """Return the integrals of N, My, Mz times Legendre polynomials, [3, 3], for linear laws.

    `strain` is `StrainField.strain`, `stiffness` that of the section, by e0, ky, kz.
    """
    return strain @ stiffness * jnp.array([1, 1 / 3, 1 / 5], strain.dtype)[:, None]


def deflected_axis(
    field: StrainField,
    rotations: Float[Array, "2 3"],
    length: Scalar,
    chord: Scalar,
    places: Float[ArrayLike, " n_place"],
) -> tuple[Float[Array, "n_place 3"], Float[Array, "n_place 3"], Float[Array, "n_place 3"]]:
    """Return points, their integrals and rotations of the deflected axis, along rotated axes.

    Args:
        field, rotations, length: as of `strain_field`.
        chord: length of the chord, m.
        places: positions along the axis, from 0 to 1, [n_place].

    Returns:
        Points relative to the first end, m; their integrals from 0 to each place, m; and rotation
        vectors of the axis, rad; [n_place, 3] each.
    """
    s = jnp.asarray(places)[:, None]
    slopes = axis_slopes(field, rotations)
    first, second, sag = slopes[:1, 1:], slopes[1:, 1:], length * field.sag[None]
    bubble = s**2 * (1 - s) ** 2 / 2
    turn = first * (1 - 4 * s + 3 * s**2) + second * (3 * s**2 - 2 * s)
    turn = turn + sag * s * (1 - s) * (1 - 2 * s)
    way = first * s * (1 - s) ** 2 - second * s**2 * (1 - s) + sag * bubble
    area = first * (s**2 / 2 - 2 * s**3 / 3 + s**4 / 4) + second * (s**4 / 4 - s**3 / 3)
    area = area + sag * (s**3 / 6 - s**4 / 4 + s**5 / 10)
    push = length * field.strain[1, 0]
    along = chord * s - push * s * (1 - s)
    along_area = chord * s**2 / 2 - push * (s**2 / 2 - s**3 / 3)
    twist = rotations[0, 0] + s * field.twist
    if field.points is not None and field.points.has_clamped_field:
        at = s[:, 0]
        (pulled, bent), (_, slope), (pulled_area, bent_area) = (
            field.points.clamped_field(at, order) for order in (0, 1, -1)
        )
        shift = slope @ field.points.coupling / length  # the node axis against the neutral axis
        along = along + (pulled - shift)[:, None]
        along_area = along_area + (pulled_area - bent @ field.points.coupling / length)[:, None]
        way, area, turn = way + bent / length, area + bent_area / length, turn + slope / length

    def vectors(x, about):
        return jnp.concatenate([x, length * about[:, 1:], -length * about[:, :1]], axis=1)

    return vectors(along, way), vectors(along_area, area), jnp.concatenate([twist, turn], axis=1)


def gauss_lobatto(n: int) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return Gauss-Lobatto points from 0 to 1 and weights, [n] each (exact to degree 2 n - 3)."""
    legendre = np.polynomial.legendre.Legendre.basis(n - 1)
    points = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    return 0.5 + 0.5 * points, 1 / (n * (n - 1) * legendre(points) ** 2)


def split_strains(strain: Float[Array, "n_point 3"]) -> tuple[Array, Array, Array]:
    """Split section strains e0, ky, kz, [n_point, 3], into three arrays [n_point]."""
    strain, about_y, about_z = strain.T
    return strain, about_y, about_z


def cross_products(a: Float[Array, "... 3"], b: Float[Array, "... 3"]) -> Float[Array, "... 3"]:
    """Return the cross products of arrays [..., 3], by shifts: fewer operations to compile."""
    return jnp.roll(a, -1, -1) * jnp.roll(b, 1, -1) - jnp.roll(a, 1, -1) * jnp.roll(b, -1, -1)
