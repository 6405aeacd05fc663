"""Friction of a cable whose segments hang as elastic catenaries between the nodes (see `hanging`).

With the mean tau of the tensions at both ends of a segment, the load q per unstressed length and
the chord d, the tensions at the first and the last end are ``tau +- q.d / (2 (1 + tau/EA))``,
whatever the unstressed length. The search of `slip_search` then needs the unstressed length that a
segment takes under a tension. It gets a function with the terms of a shallow cable that agrees with
the catenary, in value and slope, at the present unstressed lengths, and is repeated, with the
angles as they are then, until these do not change.

A deep catenary, whose tension rises with its length, pulls ever more cable towards itself where it
slips: there is no equilibrium, and the result is NaN. (Derived for this package.)
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from ..common.types import Array, Bool, Float
from ..numerics.implicit_root import TangentSolver, implicit_root
from . import hanging
from .element import Scalar
from .friction import SegmentTensions, deviation_angles, mismatches, solve_small
from .hanging_terms import magnitude_and_direction
from .slip_search import Jack, SegmentsThatSlip, tensions_and_signs

_MAX_SEARCHES = 60  # of slips; two spans need 5 to 10
_LARGEST_RATIO = 20.0  # of the slope of a catenary over that of a shallow one


class HangingSegments(NamedTuple):
    """Hanging segments of one cable between its nodes, [n]; fillers have no length.

    Attributes:
        cable: the element, of which `friction_bound` is asked.
        chord: from the first to the last end of each segment, [n, 3], m.
        length: of the chords, [n], m.
        excess: chord minus unstressed length, if nothing slips in this increment, [n], m.
        load: dead load per unstressed length, [3], N/m.
        stiffness: EA, N.
        clamped: whether the cable is clamped to a deviator, [n - 1].
        jack: None: there is no jack at the first end.
    """

    cable: Any
    chord: Float[Array, "n 3"]
    length: Float[Array, " n"]
    excess: Float[Array, " n"]
    load: Float[Array, " 3"]
    stiffness: Scalar
    clamped: Bool[Array, " n_deviator"]
    jack: Jack | None


class HangingShape(NamedTuple):
    """Tensions and shapes of hanging segments at given unstressed lengths.

    Attributes:
        unstressed: length of each segment, [n], m.
        force: tension vector at mid-length, [n, 3], N.
        tension: mean of the tensions at both ends, [n], N.
        theta: shape parameter of `hanging`, [n].
        drop, bound: as of `SegmentTensions`.
    """

    unstressed: Float[Array, " n"]
    force: Float[Array, "n 3"]
    tension: Float[Array, " n"]
    theta: Float[Array, " n"]
    drop: Float[Array, " n"]
    bound: Float[Array, " n_deviator"]


@jax.jit  # traced once, although a program calls it for forces, tangents and results
def hanging_tensions(segments: HangingSegments) -> tuple[SegmentTensions, HangingShape]:
    """Return tensions and shapes of the segments of one cable, with derivatives of any order."""
    elongation, sign = _search(lax.stop_gradient(segments))
    solver = TangentSolver(solve_small, solve_small)
    elongation = implicit_root(_mismatches, elongation, (segments, sign), solver)
    shape = _hang(segments, elongation)
    return _with_slips(segments, elongation, shape, sign), shape


def tension_slopes(
    segments: HangingSegments, unstressed: Float[Array, " n"]
) -> tuple[HangingShape, Float[Array, " n"]]:
    """Return the shape, and by how much mean tensions rise as segments are shortened, [n], N/m."""
    elongation = segments.length - unstressed
    one = jnp.ones_like(elongation)
    shape, rate = jax.jvp(partial(_hang, segments), (elongation,), (one,))
    return shape, rate.tension


def _hang(segments, elongation):
    """Return the `HangingShape` where chords exceed unstressed lengths by `elongation`, [n], m."""
    real = segments.length > 0
    axis = jnp.asarray([1.0, 0.0, 0.0], segments.chord.dtype)
    length = jnp.where(real, segments.length, 1.0)
    unstressed = length - jnp.where(real, elongation, 0.01)  # fillers are taut: they have slopes
    force, tension, theta = jax.vmap(hanging.solve_catenary, (0, 0, None, 0, None))(
        jnp.where(real[:, None], segments.chord, axis),
        (length - unstressed) * (length + unstressed),
        segments.load,
        unstressed,
        segments.stiffness,
    )
    force = jnp.where(real[:, None], force, 0.0)
    tension, unstressed = jnp.where(real, tension, 0.0), jnp.where(real, unstressed, 0.0)
    drop = 0.5 * segments.chord @ segments.load / (1 + tension / segments.stiffness)
    half = 0.5 * unstressed[:, None] * segments.load
    angle = deviation_angles((force - half)[:-1], (force + half)[1:])
    bound = segments.cable.friction_bound(angle, segments.length)
    return HangingShape(unstressed, force, tension, theta, drop, bound)


def _with_slips(segments, elongation, shape, sign):
    """Return the `SegmentTensions` of hanging segments."""
    gained = jnp.where(segments.length > 0, segments.excess - elongation, 0.0)
    gained = jnp.where(shape.tension > 0, gained, 0.0)
    return SegmentTensions(shape.tension, shape.drop, sign, shape.bound, gained)


def _mismatches(elongation, parameters):
    """Return `mismatches` of hanging segments; of slack ones and fillers those of elongations."""
    segments, sign = parameters
    unstressed = segments.length - lax.stop_gradient(elongation)
    known, slope = tension_slopes(lax.stop_gradient(segments), unstressed)
    held = (segments.length <= 0) | (known.tension <= 0)
    rate = jnp.where(held, 1e-3, 1) / jnp.where(held, 1.0, slope)  # only scales, but is not zero
    found = _with_slips(segments, elongation, _hang(segments, elongation), sign)
    kept = elongation - jnp.where(segments.length > 0, segments.excess, 0.0)
    return jnp.where(held, kept, mismatches(found, rate, segments.jack))


def _search(segments):
    """Return elongations of the segments, [n], m, and the signs of the slips, [n - 1].

    They are NaN where there is no equilibrium, or none was found.
    """
    real = segments.length > 0
    alone = jnp.where(real, segments.excess, 0.0)
    stuck = _hang(segments, alone).tension
    eps = jnp.finfo(alone.dtype).eps * jnp.sum(segments.length)
    beside = real[1:] & real[:-1]

    def step(s):
        elongation, _, _, _, count = s
        shape, slope = tension_slopes(segments, segments.length - elongation)
        model = partial(_shallow_elongations, segments, elongation, shape.tension, slope)
        bound = jnp.where(segments.clamped, jnp.inf, shape.bound)
        tension, sign = tensions_and_signs(
            SegmentsThatSlip(stuck, segments.excess, real, bound, shape.drop, model, segments.jack)
        )
        sign = jnp.where(beside, sign, 0.0)
        slips = jnp.pad(sign, 1) != 0
        moves = slips[1:] | slips[:-1]
        if segments.jack is not None:
            moves = moves.at[0].set(moves[0] | segments.jack[1])
        new = jnp.where(moves & real, model(tension)[0], alone)
        runs_away = jnp.any(moves & (tension > 0) & (slope <= 0))
        return new, sign, jnp.max(jnp.abs(new - elongation)), runs_away, count + 1

    def unfinished(s):
        _, _, moved, _, count = s
        return (moved > 2 * eps) & (count < _MAX_SEARCHES)

    far = jnp.full_like(alone[0], jnp.inf)
    start = alone, jnp.zeros_like(alone[1:]), far, jnp.zeros((), bool), jnp.int32(0)
    elongation, sign, moved, runs_away, _ = lax.while_loop(unfinished, step, start)
    fails = runs_away | ~(moved <= 8 * eps)
    return jnp.where(fails, jnp.nan, elongation), sign


def _shallow_elongations(segments, elongation, tension, slope, new):
    """Return elongations under the tensions `new`, [n], m, as of shallow cables, and their rates.

    They agree with those of the catenaries at the elongations, m, tensions, N, and slopes of the
    tensions by the elongations, N/m, each [n].
    """
    weight, unit = magnitude_and_direction(segments.load)
    across2 = segments.length**2 - (segments.chord @ unit) ** 2
    sag = jnp.maximum(weight**2 * across2 * segments.length / 24, 0.0)

    def shallow(tension):
        strain, some = tension / segments.stiffness, jnp.where(tension > 0, tension, 1.0)
        sags = jnp.where(tension > 0, sag, 0.0)
        rate = segments.length / segments.stiffness / (1 + strain) ** 2 + 2 * sags / some**3
        return segments.length * strain / (1 + strain) - sags / some**2, rate

    value, rate = shallow(tension)
    ratio = 1 / jnp.where(slope > 0, slope, 1.0) / jnp.where(rate > 0, rate, 1.0)
    ratio = jnp.clip(ratio, 1 / _LARGEST_RATIO, _LARGEST_RATIO)
    ratio = jnp.where((slope > 0) & (rate > 0), ratio, 1.0)
    later, later_rate = shallow(new)
    return elongation + ratio * (later - value), ratio * later_rate
