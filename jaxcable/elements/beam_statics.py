"""Section forces and axial forces along a beam element, by equilibrium of a part of it."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.types import Array, ArrayLike, Float
from . import bending
from .bending import cross_products
from .corotation import Pose
from .element import Scalar
from .point_loads import acts_before


def section_forces_by_equilibrium(
    pose: Pose,
    field: bending.StrainField,
    load: Float[Array, " 3"] | None,
    end_forces: tuple[Float[Array, " 3"], Float[Array, "2 3"]],
    length: Scalar,
    places: Float[ArrayLike, " n_place"],
) -> Float[Array, "n_place 6"]:
    """Return ``N, Vy, Vz, T, My, Mz`` at places, [n_place, 6], N and N m.

    Where a concentrated load acts they are those just before it (`point_loads.acts_before`).

    Args:
        pose, field: frame of the element (`corotation.pose`), and its strains.
        load: load per unstressed length along the rotated axes, [3], N/m, or None.
        end_forces: force on the second end, [3], N, and moments on both ends, [2, 3], N m.
        length: unstressed length, m.
        places: from 0 to 1, [n_place].
    """
    pull, moments = end_forces
    s = jnp.asarray(places, pull.dtype)
    load = jnp.zeros(3, pull.dtype) if load is None else load * length
    start = -(pose.axes @ pull) - load / 2  # force of the node on the element
    twist = pose.axes @ moments[0]
    place, area, turn = bending.deflected_axis(field, pose.rotations, length, pose.length, s)
    points = field.points
    if points is not None:
        share = 1 - points.places
        start = start - share @ points.forces
        if points.moments is not None:
            twist = twist - share @ points.moments
    carried = start[None] + jnp.outer(s, load)
    if points is not None:
        before = acts_before(points.places, s)
        carried = carried + before @ points.forces
    moment = cross_products(place, carried) - cross_products(area, load[None]) - twist[None]
    if points is not None:
        at = bending.deflected_axis(field, pose.rotations, length, pose.length, points.places)[0]
        about = cross_products(at, points.forces)
        about = about if points.moments is None else about + points.moments
        moment = moment - before @ about
    both = jnp.stack([-carried, moment], axis=1)
    # into the axes of the section by its small rotation, to second order like everything here
    spin = turn[:, None]
    change = cross_products(spin, both)
    return (both - change + 0.5 * cross_products(spin, change)).reshape(-1, 6)


def lacks_clamped_end_strains(field: bending.StrainField) -> bool:
    """Return whether `field` leaves out strains that concentrated loads cause between clamped ends.

    It is so for linear sections that are flexible in shear.
    """
    return field.points is not None and field.points.axial is not None and field.points.sheared


def strains_of_linear_section(
    stiffness: Float[Array, "3 3"], forces: Float[Array, "n_place 6"]
) -> Float[Array, "n_place 3"]:
    """Return the strains e0, ky, kz of a linear section under ``N, Vy, Vz, T, My, Mz``."""
    coupling = stiffness[0, 1:] / stiffness[0, 0]
    own = bending.bending_compliance(stiffness[1:, 1:] - jnp.outer(coupling, stiffness[0, 1:]))
    axial, moments = forces[:, :1], forces[:, 4:]
    curvature = (moments - axial * coupling[None]) @ own
    return jnp.concatenate([axial / stiffness[0, 0] - curvature @ coupling[:, None], curvature], 1)


def peak_axial_force(
    mean: Scalar,
    along: Float[Array, " 3"],
    length: Scalar,
    line: Float[Array, " 3"] | None,
    points: Float[Array, "k 4or7"] | None,
) -> Scalar:
    """Return the axial force of largest absolute value along an element, N.

    Args:
        mean: mean of the axial force, N.
        along: direction of the chord, [3].
        length: unstressed length, m.
        line: load per unstressed length, [3], N/m, or None.
        points: concentrated loads as of `ElementLoad.points`, or None.
    """
    if points is None:
        half = 0.5 * length * jnp.abs(line @ along)  # type: ignore[operator]  # one of both loads
        return mean + jnp.where(mean < 0, -half, half)
    whole = jnp.zeros_like(mean) if line is None else length * line @ along
    places, forces = points[:, 0], points[:, 1:4] @ along
    at = jnp.concatenate([jnp.array([0.0, 1.0], places.dtype), places])
    start = mean + whole * (0.5 - at) + (1 - places) @ forces
    before = start - acts_before(places, at) @ forces
    inside = (at[:, None] >= places[None]) & (places[None] < 1)  # a load at the end is beyond it
    found = jnp.concatenate([before, start - inside.astype(places.dtype) @ forces])
    return found[jnp.argmax(jnp.abs(found))]


def point_loads_along(
    axes: Float[Array, "3 3"], points: Float[Array, "k 4or7"]
) -> Float[Array, "k 7"]:
    """Return concentrated loads with forces and moments along rotated axes, as of `POINT_LOADS`.

    Args:
        axes: rotated axes of the element, one in each row.
        points: place, 0 to 1, force, N, and moment, N m, in space, as of `ElementLoad.points`; with
            four columns all moments are zero.
    """
    vectors = [points[:, k : k + 3] @ axes.T for k in range(1, points.shape[1], 3)]
    found = jnp.concatenate([points[:, :1], *vectors], axis=1)
    return jnp.pad(found, ((0, 0), (0, 7 - found.shape[1])))
