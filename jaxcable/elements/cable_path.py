"""Path of a cable over its nodes: straight segments, and arcs on saddles and pulleys with a radius.

A node is the center of its saddle, whose groove lies in a plane with the unit axis a about which
the cable turns (right-hand rule). The saddle rotates with its node, if this has a rotation. A
straight segment with the direction u touches the circles of radius r at both of its ends at
``c + r m``, ``m = u x a / |u x a|``, so that

    u = t / |t|,    t = c_2 + r_2 m_2(u) - c_1 - r_1 m_1(u).

Within a plane Newton's method is just this: m changes along u only, so that putting u in again
converges quadratically. The cable sticks or slips at the middle of its arc in the initial geometry,
a point that is fixed to the saddle: each half of the arc belongs to the segment beside it. When a
segment swings by an angle about the axis relative to the groove, its tangent point moves by r times
this angle, and so much cable leaves the arc, or comes onto it. The tensions act on the saddle at
the tangent points, and so with a moment about the node, ``r (T_2 - T_1) a`` if the segments lie in
the plane: the work of this moment is that of the change of lengths. (Derived for this package.)
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..common.checks import numpy_or_jax
from ..common.rules import Rule
from ..common.types import Array, ArrayLike, Float, Int
from ..numerics.implicit_root import TangentSolver, implicit_root
from ..numerics.rotations import invert, rotate
from ..numerics.vectors import scalar_product
from .element import Ends, Motion
from .friction import deviation_angles
from .sliding import moved_segments_with_lengths, segment_length_changes

_MOST_TILT = np.sin(np.radians(20.0))  # of a segment out of the plane of its saddle, at the start
_MAX_STEPS = 60  # of the directions of segments; 3 to 8 are seen


class CablePath(NamedTuple):
    """Segments of one cable, [n_segment], between its ends and deviators; fillers have no length.

    Attributes:
        along: unit vectors of the straight parts, [n, 3]; zero of fillers.
        length: of the straight parts and the halves of arcs beside them, [n_segment], m.
        change: of these lengths since the initial geometry, [n_segment], m.
        initial_length: lengths in the initial geometry, [n_segment], m.
        angle: by which the cable turns at every deviator, out of the plane of a saddle included,
            [n_deviator], rad.
        contact_angle: of the arc on every saddle, [n_deviator], rad; negative where the cable would
            lift off; None without a radius.
        axis: unit vectors about which the cable turns at every saddle, as the saddles are now,
            [n_deviator, 3], zero where there is none; None without a radius.
    """

    along: Float[Array, "n_segment 3"]
    length: Float[Array, " n_segment"]
    change: Float[Array, " n_segment"]
    initial_length: Float[Array, " n_segment"]
    angle: Float[Array, " n_deviator"]
    contact_angle: Float[Array, " n_deviator"] | None = None
    axis: Float[Array, "n_deviator 3"] | None = None


class Saddles(NamedTuple):
    """Circles on which a cable turns at its deviators.

    Attributes:
        radius: [n_deviator], m; 0: the cable bends at a point.
        axis: unit vectors about which it turns, [n_deviator, 3]; any of those without a radius.
    """

    radius: Float[Array, " n_deviator"]
    axis: Float[Array, "n_deviator 3"]


def path_over_points(ends: Ends, motion: Motion) -> CablePath:
    """Return the path of one cable that bends at its nodes."""
    segment, length = moved_segments_with_lengths(ends, motion)
    change, before, _ = segment_length_changes(ends, motion)
    along = segment / jnp.where(length > 0, length, 1.0)[:, None]
    return CablePath(along, length, change, before, deviation_angles(segment[:-1], segment[1:]))


@jax.jit  # traced once, although a program calls it for forces, tangents and results
def path_over_saddles(
    radius: Float[Array, " n_deviator"],
    axis: Float[Array, "n_deviator 3"] | None,
    ends: Ends,
    motion: Motion,
    rotation: Float[Array, "n_deviator 4"] | None = None,
) -> CablePath:
    """Return the path of one cable over saddles and pulleys with a `radius`.

    `axis` None: that about which the polygon of the initial nodes turns. NaN where circles overlap.
    Saddles have the `rotation` of their nodes, unit quaternions; None: they have none.
    """
    start = ends[1:] - ends[:-1]
    saddles = _saddles_at(radius, axis, start)
    relative = motion[1:] - motion[:-1]
    before, first = _tangents(saddles, start)
    axis_now = _rotated(rotation, saddles.axis)
    after, now = _tangents(saddles._replace(axis=axis_now), start + relative)
    both = _norms(before.straight) + _norms(after.straight)
    moved = relative + (after.offset - before.offset)
    change = jnp.sum((2 * before.straight + moved) * moved, axis=1)
    change = change / jnp.where(both > 0, both, 1.0)
    # by how much each segment swings about the axis behind it, and about that before it, as one
    # that rotates with the saddle sees it
    back = None if rotation is None else jax.vmap(invert)(rotation)
    from_saddle, to_saddle = _rotated(back, now[1:]), _rotated(back, now[:-1])
    behind = _angles_about(saddles.axis, first[1:], from_saddle)
    ahead = _angles_about(saddles.axis, first[:-1], to_saddle)
    turned = _angles_about(saddles.axis, first[:-1], first[1:])
    # from a quarter turn back to three quarters: ropes turn by half a circle and more
    turned = jnp.where(turned < -0.5 * jnp.pi, turned + 2 * jnp.pi, turned)
    arc, on = saddles.radius, saddles.radius > 0
    half = jnp.where(on, 0.5 * arc * turned, 0.0)
    initial = _norms(before.straight) + jnp.pad(half, (1, 0)) + jnp.pad(half, (0, 1))
    change = change + jnp.pad(arc * behind, (1, 0)) - jnp.pad(arc * ahead, (0, 1))
    contact = turned + behind - ahead
    tilt = _angles_from_plane(saddles.axis, from_saddle)
    tilt = tilt - _angles_from_plane(saddles.axis, to_saddle)
    square = contact**2 + tilt**2
    angle = jnp.sqrt(jnp.where(square > 0, square, 1.0)) * (square > 0)
    angle = jnp.where(on, angle, deviation_angles(now[:-1], now[1:]))
    contact = jnp.where(on, contact, 0.0)
    axis_now = jnp.where(on[:, None], axis_now, 0.0)
    return CablePath(now, initial + change, change, initial, angle, contact, axis_now)


def saddle_moments(
    path: CablePath,
    radius: Float[Array, " n_deviator"],
    before: Float[Array, " n_deviator"],
    after: Float[Array, " n_deviator"],
) -> Float[Array, "n_deviator 3"]:
    """Return the moments of one cable on the nodes of its saddles, [n_deviator, 3], N m.

    They are those about the nodes of the tensions `before` and `after` each saddle, N, which act at
    the tangent points.
    """

    def moments(along, tension):
        arm = radius[:, None] * _units(jnp.cross(along, path.axis))
        return jnp.cross(arm, tension[:, None] * along)

    return moments(path.along[1:], after) - moments(path.along[:-1], before)


def saddle_rules(
    radius: Float[ArrayLike, "n_elem n_deviator"],
    axis: Float[ArrayLike, "n_elem n_deviator 3"] | None,
    nodes: Float[ArrayLike, "n_node 3"],
    links: Int[np.ndarray, "n_elem n_end"],
) -> list[Rule]:
    """Return the conditions on saddles with a radius, m, at the initial positions `nodes`, m.

    The cable bends there in a plane: that of the nodes, which are not in line; or one normal to
    `axis`, about which the cable turns. The radius is at most half of the distance to the next
    node.
    """
    pack = numpy_or_jax((radius, axis, nodes))
    start = pack.asarray(nodes)[links[:, 1:]] - pack.asarray(nodes)[links[:, :-1]]

    def sizes(vectors):
        return pack.sqrt((vectors**2).sum(axis=-1))

    length = sizes(start)
    unit = start / pack.maximum(length, 1e-300)[..., None]
    first, last = unit[:, :-1], unit[:, 1:]
    shorter = pack.minimum(length[:, :-1], length[:, 1:])  # fillers use no radius
    on = (radius > 0) & (shorter > 0)
    large = "must not be larger than half of the distance to the next node"
    room = Rule("radius", (radius, shorter), lambda r, s: (r > 0.5 * s) & (s > 0), large)
    if axis is None:
        sine = sizes(pack.cross(first, last))
        text = "the polygon of the nodes is straight there, or turns back; give `axis`"
        straight = Rule("radius", (radius, sine, on), lambda _, s, on: on & (s < 1e-6), text)
        return [straight, room]
    about = axis / pack.maximum(sizes(axis), 1e-300)[..., None]
    tilt = pack.maximum(*(abs((about * one).sum(axis=-1)) for one in (first, last)))
    tilt = pack.where(sizes(axis) > 0, tilt, 1.0)
    along = "`axis` is zero there, or more than 20 degrees off the normal of a segment"
    turn = (about * pack.cross(first, last)).sum(axis=-1)
    ahead = (first * last).sum(axis=-1) >= 0  # up to a quarter turn, else it is three or more
    lifted = "the cable turns against `axis` there, and would lift off; reverse the vector"
    return [
        Rule("radius", (radius, tilt, on), lambda _, t, on: on & (t > _MOST_TILT), along),
        Rule("radius", (radius, turn, on & ahead), lambda _, t, on: on & (t < -1e-6), lifted),
        room,
    ]


class _Circle(NamedTuple):
    """Circle at one end of a segment, or of all of them: radius, m, and unit vector of its axis."""

    radius: Float[Array, ""]
    axis: Float[Array, " 3"]


class _Tangent(NamedTuple):
    """Straight part of a segment, [3], m, and what both circles add to the chord of its nodes."""

    straight: Float[Array, " 3"]
    offset: Float[Array, " 3"]


def _saddles_at(radius, axis, start):
    """Return the `Saddles` of one cable with initial chords, [n, 3], m; fillers have no radius."""
    if axis is None:
        axis = jnp.cross(start[:-1], start[1:])
    length = _norms(start)
    on = (length[1:] > 0) & (length[:-1] > 0) & (radius > 0)
    return Saddles(jnp.where(on, radius, 0.0), _units(axis))


def _rotated(rotation, vectors):
    """Return vectors, [n, 3], rotated by unit quaternions, [n, 4]; None: they stay as they are."""
    return vectors if rotation is None else jax.vmap(rotate)(rotation, vectors)


def _tangents(saddles, chord):
    """Return the `_Tangent` and unit vector of every segment between nodes `chord` apart, m."""
    radius = jnp.pad(saddles.radius, 1)
    axis = jnp.pad(saddles.axis, ((1, 1), (0, 0)))
    ends = _Circle(radius[:-1], axis[:-1]), _Circle(radius[1:], axis[1:])
    frozen = lax.stop_gradient((chord, *ends))
    straight = jax.vmap(_straight_part)
    eps = jnp.finfo(chord.dtype).eps

    def step(state):
        unit, _, count = state
        new = _units(straight(unit, *frozen).straight)
        return new, jnp.max(jnp.abs(new - unit)), count + 1

    def unfinished(state):
        return (state[1] > 4 * eps) & (state[2] < _MAX_STEPS)

    start = _units(frozen[0])
    state = start, jnp.full_like(start[0, 0], jnp.inf), jnp.int32(0)
    unit, off, _ = lax.while_loop(unfinished, step, state)
    unit = jnp.where(off <= 64 * eps, unit, jnp.nan)
    solver = TangentSolver(_solve_by_columns, _solve_by_columns)

    def mismatch(unit, given):
        return unit - _units(_straight_part(unit, *given).straight)

    def root(unit, *given):
        return implicit_root(mismatch, unit, given, solver)

    unit = jax.vmap(root)(unit, chord, *ends)
    return straight(unit, chord, *ends), unit


def _straight_part(unit, chord, first, last):
    """Return the `_Tangent` of one segment with the direction `unit` between two circles."""

    def outward(circle):
        return circle.radius * _units(jnp.cross(unit, circle.axis))

    offset = outward(last) - outward(first)
    return _Tangent(chord + offset, offset)


def _solve_by_columns(_, product, rhs):
    """Solve with a linear function of three numbers, by Cramer's rule, as `TangentSolver` does."""
    a, b, c = (product(unit) for unit in jnp.eye(3, dtype=rhs.dtype))
    minors = jnp.stack([jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)])
    return jnp.sum(minors * rhs[None], axis=1) / scalar_product(a, minors[0])


def _norms(vectors):
    """Return the lengths of vectors, [..., 3]; where one is zero, so is its derivative."""
    square = jnp.sum(vectors**2, axis=-1)
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)


def _units(vectors):
    """Return vectors, [..., 3], over their lengths; zero where these are zero."""
    length = _norms(vectors)
    return vectors / jnp.where(length > 0, length, 1.0)[..., None]


def _angles_about(axis, first, last):
    """Return the angles from unit vectors to others about axes, [n], rad; arrays are [n, 3]."""
    sine = jnp.sum(axis * jnp.cross(first, last), axis=1)
    cosine = jnp.sum(first * last, axis=1)
    cosine = cosine - jnp.sum(first * axis, axis=1) * jnp.sum(last * axis, axis=1)
    known = (sine != 0) | (cosine != 0)
    return jnp.where(known, jnp.arctan2(sine, jnp.where(known, cosine, 1.0)), 0.0)


def _angles_from_plane(axis, unit):
    """Return the angles between unit vectors and the planes that are normal to axes, [n], rad."""
    across = _norms(jnp.cross(axis, unit))
    return jnp.arctan2(jnp.sum(axis * unit, axis=1), jnp.where(across > 0, across, 1.0))
