"""Clearances: the least distance of elements from a plane, the ground below, or another line."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.element_shapes import StateOrPhase, element_shapes, map_shapes
from ..common import checks
from ..common.rules import Rule, nan_if_broken
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..loads.groups import Key, indices_of_groups
from ..model.structure import Structure
from ..numerics.roots import bracketed_root
from ..numerics.vectors import scalar_product
from ..programs.program_calls import as_program


@pytree
class Clearance:
    """Least distances of elements from something, and where: the result of the functions here.

    Batches have their axes in front.

    Attributes:
        least: the least distance of all chosen elements, scalar, m.
        place: where on the elements that is, [3], m.
        group, element: index of the group, and of the element in it, scalars.
        distance: the least distance of every element in the shape of the structure's `elements`,
            each [n_elem], m; None for groups that were not chosen, NaN for elements that are not
            active.
        places: where on each element that is, likewise, each [n_elem, 3], m.

    Example:
        >>> line = jc.Catenaries([[0, 1]], axial_stiffness=33e6, weight=16.0)
        >>> nodes = [[0.0, 0.0, 20.0], [300.0, 0.0, 20.0]]
        >>> structure = jc.Structure(nodes, line, supports=jc.pinned([0, 1]))
        >>> strung = jc.solve(structure, jc.Phase(sag=8.0, loads=jc.SelfWeight()))
        >>> found = jc.results.clearance_to_plane(structure, strung, (0.0, 0.0, 2.0))
        >>> print(strung.status, f"{found.least:.6f} m", found.place.round(6))
        0 10.000000 m [150.   0.  12.]
    """

    least: Float[Array, ""]
    place: Float[Array, " 3"]
    group: Int[Array, ""]
    element: Int[Array, ""]
    distance: PyTree[Float[Array, " n_elem"] | None]
    places: PyTree[Float[Array, "n_elem 3"] | None]


def clearance_to_plane(
    structure: Structure,
    state: StateOrPhase,
    point: Float[ArrayLike, " 3"],
    normal: Float[ArrayLike, " 3"] = (0.0, 0.0, 1.0),
    *,
    on: Key = None,
) -> Clearance:
    """Find the least distance of elements from a plane, on the side to which its normal points.

    Exact for straight elements and catenaries; faces count by their edges, beams by their chords.
    Differentiable like the solution: distances are smooth, also where the nearest point of a
    catenary reaches an end; `least` has a kink, and places jump, where another end or element
    becomes the nearest.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (NaN if it has failed) or `State`, or one of
            ``solution.phases`` for the end of that phase; batches have leading axes.
        point: a point of the plane, [3], m.
        normal: vector at right angles to the plane, [3]; default z: the plane is level.

    Options:
        on: key of the group, or of several groups, in the structure's `elements`; None: all.

    Returns:
        `Clearance`; distances are negative beyond the plane.

    Raises:
        ValueError: not a state; wrong shapes; a normal of length zero; no such group.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases)
        >>> floor = jc.results.clearance_to_plane(structure, solution, (0.0, 0.0, -0.1))
        >>> print(solution.status, f"{floor.least:.6f} m")
        0 0.087162 m
    """
    point, normal = _checked_vector(point, "point"), _checked_vector(normal, "normal")
    text = "normal: expected a vector of length above zero"
    normal = nan_if_broken(Rule("normal", normal, lambda v: (v == 0).all(), lambda *_: text))
    normal = jnp.asarray(normal)
    unit = normal / jnp.sqrt(scalar_product(normal, normal))
    return _clearance(structure, state, on, _nearest_to_plane, jnp.asarray(point), unit)


def clearance_over_ground(
    structure: Structure,
    state: StateOrPhase,
    profile: Float[ArrayLike, "n 3"],
    *,
    on: Key = None,
) -> Clearance:
    """Find the least height of elements above the ground, which is given by a profile.

    The profile is a polyline; between its points the ground has their slope, and at right angles to
    each of its pieces in plan it is level: a point of a cable that the wind has blown aside is
    compared with the profile beside it. Elements, or parts of them, that are beside no piece of the
    profile do not count; where two pieces of a profile with a bend in plan both are beside an
    element, the smaller height counts.

    Exact for straight elements and catenaries; faces count by their edges, beams by their chords.
    Differentiable like the solution, with kinks over corners of the profile and where another
    element becomes the nearest.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (NaN if it has failed) or `State`, or one of
            ``solution.phases`` for the end of that phase; batches have leading axes.
        profile: points of the ground along a line, [n, 3], m; neighbors must differ in plan.

    Options:
        on: key of the group, or of several groups, in the structure's `elements`; None: all.

    Returns:
        `Clearance` with vertical distances, negative below the ground; inf for elements that are
        not beside the profile.

    Raises:
        ValueError: not a state; wrong shapes; two points above each other; no such group.

    Example:
        A span of 300 m over a hill of 6 m:

        >>> line = jc.Catenaries([[0, 1]], axial_stiffness=33e6, weight=16.0)
        >>> nodes = [[0.0, 0.0, 20.0], [300.0, 0.0, 20.0]]
        >>> structure = jc.Structure(nodes, line, supports=jc.pinned([0, 1]))
        >>> strung = jc.solve(structure, jc.Phase(sag=8.0, loads=jc.SelfWeight()))
        >>> hill = [[-10.0, 0.0, 0.0], [80.0, 0.0, 6.0], [170.0, 0.0, 0.0], [310.0, 0.0, 0.0]]
        >>> found = jc.results.clearance_over_ground(structure, strung, hill)
        >>> print(strung.status, f"{found.least:.3f} m at x = {found.place[0]:.1f} m")
        0 7.741 m at x = 80.0 m
    """
    points = _checked_polyline(profile, "profile")
    step = points[1:] - points[:-1]

    def upright(v):
        return (v[:, :2] == 0).all(axis=1, keepdims=True)

    def text(index, _):
        k = index[0]
        return f"profile[{k + 1}]: lies above or below profile[{k}]; the ground has no such slope"

    step = nan_if_broken(Rule("profile", step, upright, text))
    ground = jnp.asarray(points[:-1]), jnp.asarray(step)
    return _clearance(structure, state, on, _nearest_to_ground, *ground)


def distance_to_line(
    structure: Structure,
    state: StateOrPhase,
    points: Float[ArrayLike, "n 3"],
    *,
    on: Key = None,
) -> Clearance:
    """Find the least distance in space of elements from a polyline, such as a road or another line.

    For straight elements and catenaries, to rounding: the minimum along an element is looked for
    from the nearest of 17 places. (Two minima closer than 1/16 of the element may be confused.)
    Faces count by their edges, beams by their chords.
    Differentiable like the solution; it has kinks where another element, piece or minimum becomes
    the nearest, and no derivative where the distance is zero.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (NaN if it has failed) or `State`, or one of
            ``solution.phases`` for the end of that phase; batches have leading axes.
        points: points of the line, [n, 3], m.

    Options:
        on: key of the group, or of several groups, in the structure's `elements`; None: all.

    Returns:
        `Clearance`.

    Raises:
        ValueError: not a state; wrong shapes; no such group.

    Example:
        A road 12 m below one support, at right angles to the span:

        >>> line = jc.Catenaries([[0, 1]], axial_stiffness=33e6, weight=16.0)
        >>> nodes = [[0.0, 0.0, 20.0], [300.0, 0.0, 20.0]]
        >>> structure = jc.Structure(nodes, line, supports=jc.pinned([0, 1]))
        >>> strung = jc.solve(structure, jc.Phase(sag=8.0, loads=jc.SelfWeight()))
        >>> road = [[150.0, -50.0, 2.0], [150.0, 50.0, 2.0]]
        >>> found = jc.results.distance_to_line(structure, strung, road)
        >>> print(strung.status, f"{found.least:.6f} m")
        0 10.000000 m
    """
    points = jnp.asarray(_checked_polyline(points, "points"))
    return _clearance(structure, state, on, _nearest_to_line, points[:-1], points[1:] - points[:-1])


def _checked_vector(value, name):
    """Return `value` as a vector [3]; ValueError, which names the argument, for another shape."""
    return checks.floats_of_shape(value, name, (3,))


def _checked_polyline(value, name):
    """Return `value` as points of a polyline, [n, 3]; ValueError, with `name`, for others."""
    points = checks.as_floats(value, name)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
        raise ValueError(
            f"{name}: expected shape [n, 3] with at least 2 points, got {points.shape}"
        )
    return points


def _clearance(structure, state, on, function, *others):
    """Return the `Clearance` of the chosen groups of elements.

    Args:
        structure, state, on: as of the functions of this module.
        function: function of the `ElementShapes` of one element and `others` that returns the least
            distance, m, and the point where it is, [3].
        others: arrays that are the same for all elements.
    """
    chosen = indices_of_groups(on, structure)
    if not chosen:
        raise ValueError(f"on = {on!r}: means no group of the structure")
    distances, places = [None] * len(structure.groups), [None] * len(structure.groups)
    rows: list[Any] = []
    every = element_shapes(structure, state)
    for number in chosen:
        shapes, there = every[number]
        distance, place = map_shapes(function, shapes, *others)
        distances[number], places[number], ranked = _distances_by_element(distance, place, there)
        rows.append((ranked, places[number]))
    least, place, row = _least_distance(rows)
    counts = np.array([len(structure.groups[number].links) for number in chosen])
    owner = np.repeat(np.arange(len(chosen)), counts)
    begin = np.concatenate([[0], np.cumsum(counts)[:-1]])
    return Clearance(
        least=least,
        place=place,
        group=jnp.asarray(np.array(chosen)[owner])[row],
        element=row - jnp.asarray(begin[owner])[row],
        distance=structure.arrange(distances),
        places=structure.arrange(places),
    )


@as_program
def _distances_by_element(distance, place, there):
    """Return distances and places of elements, NaN where not active, and distances to compare.

    Elements of several lines, [..., n_elem, n_line], have the least of theirs.
    """
    if distance.ndim > there.ndim:
        k = jnp.argmin(jax.lax.stop_gradient(distance), axis=-1)
        distance = jnp.take_along_axis(distance, k[..., None], -1)[..., 0]
        place = jnp.take_along_axis(place, k[..., None, None], -2)[..., 0, :]
    ranked = jnp.where(there, distance, jnp.inf)
    return (
        jnp.where(there, distance, jnp.nan),
        jnp.where(there[..., None], place, jnp.nan),
        ranked,
    )


@as_program
def _least_distance(rows):
    """Return the least distance of all elements, m, its point, [3], and the index of the element.

    `rows` has for each group distances [..., n_elem], m, and points [..., n_elem, 3]; the index
    counts through all groups.
    """
    distance = jnp.concatenate([distance for distance, _ in rows], axis=-1)
    place = jnp.concatenate([place for _, place in rows], axis=-2)
    row = jnp.argmin(jax.lax.stop_gradient(distance), axis=-1)
    least = jnp.take_along_axis(distance, row[..., None], -1)[..., 0]
    return least, jnp.take_along_axis(place, row[..., None, None], -2)[..., 0, :], row


def _nearest_to_plane(shape, point, unit):
    """Return the signed distance of an element's nearest point to a plane, m, and this point, [3].

    The distance is the least one, negative beyond the plane. `shape` is the `ElementShapes` of
    the element, `point` a point of the plane, [3], m, `unit` its unit normal, [3].
    """
    ends = jnp.zeros((), unit.dtype), jnp.ones((), unit.dtype)
    place = shape.point(shape.highest_part(-unit, *ends))
    return scalar_product(place - point, unit), place


def _nearest_to_ground(shape, begin, step):
    """Return the least height of an element above the ground, m, and the point where it is, [3].

    Negative below the ground, inf beside no segment of its profile. `shape` is the
    `ElementShapes` of the element; `begin` and `step` are first points of the segments, and
    vectors to the second points, [n, 3], m.
    """
    over = jax.vmap(lambda a, d, half: _height_over_segment(shape, half, a, d), (0, 0, None))
    heights, places = jax.vmap(over, (None, None, 0))(begin, step, jnp.arange(2))
    k = jnp.argmin(jax.lax.stop_gradient(heights.ravel()))
    return heights.ravel()[k], places.reshape(-1, 3)[k]


def _height_over_segment(shape, half, begin, step):
    """Return the least height of a part of an element over a segment of ground, m, and the point.

    The station of a catenary along the segment turns at one place at most, by which the element
    is divided into two halves, `half` 0 and 1. The height is inf where the half is not beside
    the segment. Other arguments as of `_nearest_to_ground`, for one segment, [3].
    """
    length = jnp.sqrt(scalar_product(step[:2], step[:2]))
    along = step * np.array([1.0, 1.0, 0.0]) / length
    at_first, fall = scalar_product(shape.pull, along), scalar_product(shape.load, along)
    turns = fall != 0
    turn = jnp.clip(jnp.where(turns, at_first / jnp.where(turns, fall, 1.0), 1.0), 0.0, 1.0)
    low, high = jnp.where(half == 0, 0.0, turn), jnp.where(half == 0, turn, 1.0)

    def station(part):
        return scalar_product(shape.point(part) - begin, along) / length

    ends = station(low), station(high)
    sign = jnp.where(ends[1] < ends[0], -1.0, 1.0)
    beside = (jnp.minimum(*ends) <= 1.0) & (jnp.maximum(*ends) >= 0.0)

    def part_at(wanted):
        """Return the part at a station; that of the nearer end where the half has no such one."""
        down, up = sign * (ends[0] - wanted), sign * (ends[1] - wanted)
        inside = (down < 0) & (up > 0)
        guess = low + (high - low) * jnp.where(inside, -down, 0.5) / jnp.where(
            inside, up - down, 1.0
        )

        def balance(part):
            return jnp.where(inside, sign * (station(part) - wanted), part - guess)

        root = bracketed_root(balance, guess, low - 0.1, high + 0.1)
        return jnp.where(inside, root, jnp.where(down >= 0, low, high))

    parts = part_at(jnp.zeros_like(length)), part_at(jnp.ones_like(length))
    across = ends[0] == ends[1]  # at right angles to the piece: all of it is beside one station
    parts = jnp.where(across, low, parts[0]), jnp.where(across, high, parts[1])
    up = jnp.array([0.0, 0.0, 1.0], step.dtype)
    below = step[2] / length * along - up
    place = shape.point(shape.highest_part(below, jnp.minimum(*parts), jnp.maximum(*parts)))
    height = -scalar_product(place - begin, below)
    return jnp.where(beside & (high > low), height, jnp.inf + 0 * length), place  # NaN stays NaN


def _nearest_to_line(shape, begin, step):
    """Return the least distance of an element from a polyline, m, and the element's point, [3].

    `shape` is the `ElementShapes` of the element; `begin` and `step` are first points of the
    segments of the line, and vectors to the second points, [n, 3], m.
    """

    def of_piece(begin, step):
        size = scalar_product(step, step)

        def square(point):
            apart = point - begin
            at = jnp.clip(scalar_product(apart, step) / jnp.where(size > 0, size, 1.0), 0.0, 1.0)
            across = apart - at * step
            return scalar_product(across, across)

        place = shape.point(shape.argmin_along(square))
        return jnp.sqrt(square(place)), place

    distances, places = jax.vmap(of_piece)(begin, step)
    k = jnp.argmin(jax.lax.stop_gradient(distances))
    return distances[k], places[k]
