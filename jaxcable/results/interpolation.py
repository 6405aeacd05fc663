"""Interpolate section forces of beams between the points at which results of phases have them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy  # its parts are imported where they are first used
from numpy.polynomial.legendre import legder, legvander

from ..common.types import Array, Float
from ..elements.bending import gauss_lobatto
from ..programs.program_calls import as_program

# Largest number of points through which there is one polynomial, with slopes of degree 11; higher
# degrees would be of no use. Through more points there are cubics.
_MOST_POINTS = 6


@functools.cache
def lobatto_interpolation_matrices(
    count: int, sloped: bool, places: tuple[float, ...]
) -> tuple[Float[np.ndarray, "n_data n_place"], Float[np.ndarray, "n_data n_place"]]:
    """Return matrices that interpolate from `count` Gauss-Lobatto points to places from 0 to 1.

    They evaluate the one polynomial through the values at all points; with more than six points,
    cubics between neighboring points instead.

    Args:
        count: number of points.
        sloped: True if the data are the values and then the slopes at all points; False for values.
        places: from 0 to 1.

    Returns:
        Two matrices [n_data, n_place]: ``data @ matrix`` are values, and slopes, at the places.
    """
    points = gauss_lobatto(count)[0]
    if count > _MOST_POINTS:
        values = np.eye(count, (2 if sloped else 1) * count)
        slopes = np.eye(count, 2 * count, count) if sloped else np.gradient(values, points, axis=0)
        spline = scipy.interpolate.CubicHermiteSpline(points, values, slopes)
        return spline(places).T, spline(places, 1).T
    degree = (2 if sloped else 1) * count - 1
    change = 2 * legder(np.eye(degree + 1))  # slope of every polynomial, on 0 to 1

    def at(places):
        x = 2 * np.asarray(places) - 1
        return legvander(x, degree).T, change.T @ legvander(x, degree - 1).T

    data = np.hstack(at(points)) if sloped else at(points)[0]
    value, slope = (np.linalg.solve(data, wanted) for wanted in at(places))
    return value, slope


def interpolate_section_forces(
    forces: Float[Any, "n_elem n_point 6"],
    length: Float[Any, " n_elem"],
    places: Float[np.ndarray, " n_place"],
) -> Float[Any, "n_elem n_place 6"]:
    """Interpolate section forces to any place from those at the Gauss-Lobatto points of beams.

    Moments follow the polynomial whose slopes at the points are the shear forces, ``My' = Vz`` and
    ``Mz' = -Vy``, of degree 5 for three points; shear forces are its slopes. This is exact under
    uniform loads. Moments of an axial force on deflections are included up to degree 4.

    Args:
        forces: ``N, Vy, Vz, T, My, Mz`` at the points, [n_elem, n_point, 6], N and N m.
        length: distance of the ends of each element, [n_elem], m.
        places: from 0 to 1, [n_place].

    Returns:
        ``N, Vy, Vz, T, My, Mz`` at the places, [n_elem, n_place, 6], NumPy or JAX like the forces.
    """
    xp, count, at = _array_module(forces), forces.shape[1], tuple(map(float, places))
    plain, (value, slope) = (
        lobatto_interpolation_matrices(count, False, at)[0],
        lobatto_interpolation_matrices(count, True, at),
    )
    parts = xp.moveaxis(forces, 2, 0)
    axial, torque = parts[0] @ plain, parts[3] @ plain
    span = length[:, None]
    about_y = xp.hstack([parts[4], span * parts[2]])
    about_z = xp.hstack([parts[5], -span * parts[1]])
    shear_y, shear_z = -(about_z @ slope) / span, about_y @ slope / span
    return xp.stack([axial, shear_y, shear_z, torque, about_y @ value, about_z @ value], axis=2)


def forces_of_point_loads(
    loads: Float[Any, "n_elem n_load 7"],
    length: Float[Any, " n_elem"],
    places: Float[np.ndarray, "#n_elem n_place"],
    seen_from: Float[np.ndarray, "#n_elem n_place"] | None = None,
) -> Float[Any, "n_elem n_place 6"]:
    """Return section forces of straight cantilevers, held at the second end, under loads.

    They have the jumps and kinks of section forces under these loads: what is left without them is
    smooth along the element.

    Args:
        loads: `elements.abilities.POINT_LOADS`.
        length: of the elements, [n_elem], m.
        places: from 0 to 1, [n_elem or 1, n_place]; at the place of a load the forces are those
            before it, except at the first end.
        seen_from: for each place one on the same side of the loads as the section, where that is
            the side that counts at the place of a load; default: the places.

    Returns:
        ``N, Vy, Vz, T, My, Mz`` at the places, [n_elem, n_place, 6], NumPy or JAX like the loads.
    """
    xp = _array_module(loads)
    place, force, moment = loads[:, None, :, :1], loads[:, None, :, 1:4], loads[:, None, :, 4:]
    s = xp.asarray(places)[:, :, None, None]
    side = s if seen_from is None else xp.asarray(seen_from)[:, :, None, None]
    acts = ((side > place) | (place <= 0)).astype(loads.dtype)
    arm = (s - place) * length[:, None, None, None]
    about = xp.concatenate(
        [
            moment[..., :1] + 0 * arm,
            moment[..., 1:2] + arm * force[..., 2:],
            moment[..., 2:] - arm * force[..., 1:2],
        ],
        axis=-1,
    )
    each = xp.concatenate([force + 0 * arm, about], axis=-1)
    return -(acts * each).sum(axis=2)


def forces_between_point_loads(
    loads: Float[np.ndarray, "n_elem n_load 7"],
    length: Float[np.ndarray, " n_elem"],
    ends: Float[np.ndarray, "n_elem 1+n_piece"],
) -> tuple[Float[np.ndarray, "n_elem n_piece 6"], Float[np.ndarray, "n_elem n_piece 6"]]:
    """Return `forces_of_point_loads` just within both ends of intervals that no load divides.

    Args:
        loads, length: as of `forces_of_point_loads`.
        ends: of the intervals, ascending, from 0 to 1; the places of all loads are among them.

    Returns:
        The forces at the starts and at the stops of the intervals, two arrays
        [n_elem, n_piece, 6], N and N m. They are linear between.
    """
    middle = ends[:, :-1] + np.diff(ends) / 2
    starts, stops = (
        forces_of_point_loads(loads, length, at, middle) for at in (ends[:, :-1], ends[:, 1:])
    )
    return starts, stops


def _array_module(values: Any) -> Any:
    """Return `numpy` for a NumPy array, `jax.numpy` for a JAX array."""
    return np if isinstance(values, np.ndarray) else jnp


def acting_point_loads(
    loads: Float[np.ndarray, "n_elem n_load 7"],
) -> Float[np.ndarray, "n_elem n_acting 7"]:
    """Return the concentrated loads that are not zero, those of each element in its first rows.

    Loads that follow a path stand in all of its elements, and are zero in all but one or two.

    Returns:
        Loads [n_elem, n_acting, 7], by their places along the element; elements with fewer loads
        have rows of zeros.
    """
    acts = (loads[..., 1:] != 0).any(axis=-1)
    order = np.argsort(np.where(acts, loads[..., 0], np.inf), axis=1, kind="stable")
    order = order[:, : int(acts.sum(axis=1).max(initial=0))]
    rows = np.take_along_axis(loads, order[..., None], axis=1)
    return np.where(np.take_along_axis(acts, order, axis=1)[..., None], rows, 0.0)


def interpolate_recorded_forces(
    parts: Sequence[Any],
    forces: Sequence[Float[Array, "n_elem n_point 6"] | None],
    positions: Float[Array, "n_node 3"],
    places: Float[np.ndarray, " n_place"],
    loads: Sequence[Float[Array, "n_elem n_load 7"] | None] | None = None,
) -> list[Any]:
    """Interpolate recorded section forces of all groups to other places along the elements.

    Args:
        parts: for each group an object that has its `links`, such as the group.
        forces: for each group the section forces at points of the elements, [n_elem, n_point, 6],
            as in a `State` or `PhaseResult`; None for groups that are no beams.
        positions: positions of the nodes, [n_node, 3], m.
        places: from 0 to 1, [n_place].
        loads: concentrated loads of each group (the result "point_loads"), or None.

    Returns:
        List with [n_elem, n_place, 6], N and N m, for each group; None for groups without forces.

    Raises:
        ValueError: a group has another number of elements than the result.
    """
    found: list[Any] = []
    loads = [None] * len(parts) if loads is None else loads
    for number, (values, part, own) in enumerate(zip(forces, parts, loads, strict=True)):
        if values is not None:
            links = part.links.array
            if len(values) != len(links):
                raise ValueError(
                    f"state: has {len(values)} elements in group {number}, the structure has "
                    f"{len(links)}"
                )
            at = tuple(map(float, places))
            values = _interpolate_forces(values, positions[links], own, places=at)
        found.append(values)
    return found


@functools.partial(as_program, static=("places",))
def _interpolate_forces(forces, ends, loads, *, places):
    """Return section forces [n_elem, n_place, 6] from those of a state; a program.

    Arguments as of `interpolate_recorded_forces`, for one group; `ends` are [n_elem, 2, 3], m.
    """
    chord, at = ends[:, 1] - ends[:, 0], np.array(places)
    length = jnp.sqrt((chord * chord).sum(axis=1))
    if loads is None:
        return interpolate_section_forces(forces, length, at)
    points = gauss_lobatto(forces.shape[1])[0]
    smooth = forces - forces_of_point_loads(loads, length, points[None])
    found = interpolate_section_forces(smooth, length, at)
    return found + forces_of_point_loads(loads, length, at[None])
