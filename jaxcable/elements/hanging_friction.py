"""Friction of a cable whose segments hang as elastic catenaries between the nodes (see `hanging`).

With the mean tau of the tensions at both ends of a segment, the load q per unstressed length and
the chord d, the tensions at the first and the last end are ``tau +- q.d / (2 (1 + tau/EA))``,
whatever the unstressed length. The search of `slip_search` then needs the unstressed length that a
segment takes under a tension. It gets a function with the terms of a shallow cable that agrees with
the catenary at the last two unstressed lengths, and is repeated, with the angles as they are then,
until these do not change.

A deep catenary, whose tension rises with its length, pulls ever more cable towards itself where it
slips: there is no equilibrium, and the result is NaN. (Derived for this package.)
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from ..common.types import Array, Bool, Float, Int
from ..numerics.implicit_root import TangentSolver, implicit_root
from . import hanging
from .element import Scalar
from .friction import (
    FrictionCoefficients,
    SegmentTensions,
    deviation_angles,
    is_last_segment,
    residuals_vanish,
    solve_by_dense_matrix,
    tension_residuals,
)
from .hanging_terms import magnitude_and_direction
from .slip_search import Jack, SlipProblem, tensions_and_slip_signs

_MAX_SEARCHES = 60  # of slips; two spans need 5 to 10
_LARGEST_RATIO = 20.0  # of the slope of a catenary over that of a shallow one


class HangingSegments(NamedTuple):
    """Hanging segments of one cable between its nodes, [n_segment]; fillers have no length.

    Attributes:
        coefficients: of friction.
        chord: from the first to the last end of each segment, [n, 3], m.
        length: of the chords, [n_segment], m.
        stuck_elongation: chord minus unstressed length, if nothing slips now, [n_segment], m.
        load: dead load per unstressed length, [3], N/m.
        stiffness: EA, N.
        clamped: whether the cable is clamped to a deviator, [n_deviator].
        jack: None: there is no jack at an end.
    """

    coefficients: FrictionCoefficients
    chord: Float[Array, "n_segment 3"]
    length: Float[Array, " n_segment"]
    stuck_elongation: Float[Array, " n_segment"]
    load: Float[Array, " 3"]
    stiffness: Scalar
    clamped: Bool[Array, " n_deviator"]
    jack: Jack | None


class HangingShape(NamedTuple):
    """Tensions and shapes of hanging segments at given unstressed lengths.

    Attributes:
        unstressed: length of each segment, [n_segment], m.
        force: tension vector at mid-length, [n, 3], N.
        tension: mean of the tensions at both ends, [n_segment], N.
        theta: shape parameter of `hanging`, [n_segment].
        drop, bound: as of `SegmentTensions`.
    """

    unstressed: Float[Array, " n_segment"]
    force: Float[Array, "n_segment 3"]
    tension: Float[Array, " n_segment"]
    theta: Float[Array, " n_segment"]
    drop: Float[Array, " n_segment"]
    bound: Float[Array, " n_deviator"]


@jax.jit  # traced once, although a program calls it for forces, tangents and results
def hanging_tensions(segments: HangingSegments) -> tuple[SegmentTensions, HangingShape]:
    """Return tensions, slips and shapes of the hanging segments of one cable.

    They have derivatives of any order, and are NaN where there is no equilibrium.
    """
    elongation, sign = _find_elongations_and_slip_signs(lax.stop_gradient(segments))
    solver = TangentSolver(solve_by_dense_matrix, solve_by_dense_matrix)
    elongation = implicit_root(_residuals, elongation, (segments, sign), solver)
    shape = _hanging_shape(segments, elongation)
    return _make_segment_tensions(segments, elongation, shape, sign), shape


def _hanging_shape(segments, elongation):
    """Return the `HangingShape` where chords exceed unstressed lengths by `elongation`, m."""
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
    half = 0.5 * unstressed[:, None] * segments.load[None]
    angle = deviation_angles((force - half)[:-1], (force + half)[1:])
    bound = segments.coefficients.largest_log_ratio(angle, segments.length)
    return HangingShape(unstressed, force, tension, theta, drop, bound)


def _make_segment_tensions(segments, elongation, shape, sign):
    """Return the `SegmentTensions` of hanging segments with elongations, m, and signs of slips."""
    gained = jnp.where(segments.length > 0, segments.stuck_elongation - elongation, 0.0)
    gained = jnp.where(shape.tension > 0, gained, 0.0)
    jack = segments.jack
    out = None if jack is None else is_last_segment(segments.length) & jack.at_last
    return SegmentTensions(shape.tension, shape.drop, sign, shape.bound, gained, out)


def shallow_elongations(
    segments: HangingSegments, tension: Float[Array, " n_segment"]
) -> tuple[Float[Array, " n_segment"], Float[Array, " n_segment"]]:
    """Return chords less unstressed lengths of shallow cables under tensions, and flexibilities.

    Both are [n_segment], m and m/N: the flexibilities are the derivatives by the tensions.
    """
    weight, unit = magnitude_and_direction(segments.load)
    across2 = segments.length**2 - (segments.chord @ unit) ** 2
    some = jnp.where(tension > 0, tension, 1.0)
    sag = weight**2 * across2 * segments.length / 24 / some**2
    sag = jnp.where(tension > 0, jnp.maximum(sag, 0.0), 0.0)
    strain = tension / segments.stiffness
    stretched = segments.length / (1 + strain)
    return stretched * strain - sag, stretched / (1 + strain) / segments.stiffness + 2 * sag / some


def _residuals(elongation, parameters):
    """Return `tension_residuals` of hanging segments, [n_segment], N.

    Of slack ones and fillers: the elongation less the one without slip, m.
    """
    segments, sign = parameters
    shape = _hanging_shape(segments, elongation)
    tension = lax.stop_gradient(shape.tension)
    held = (segments.length <= 0) | (tension <= 0)
    # rates only scale the equations, but are not zero
    rate = jnp.where(held, 1.0, shallow_elongations(lax.stop_gradient(segments), tension)[1])
    found = _make_segment_tensions(segments, elongation, shape, sign)
    kept = elongation - jnp.where(segments.length > 0, segments.stuck_elongation, 0.0)
    left = tension_residuals(found, rate, segments.jack, is_last_segment(segments.length))
    return jnp.where(held, kept, left)


class _SlipSearchState(NamedTuple):
    """State of the search for slips of hanging segments, between two of its steps.

    Attributes:
        elongation: of the segments, [n_segment], m.
        sign: of the slips, [n_deviator].
        before, tension: elongations and mean tensions of the step before, [n_segment], m and N.
        ratio: by how much faster the elongations change with tension than those of shallow cables.
        deep: where the tension rises with the length, [n_segment].
        moved: largest change of an elongation in this step, m.
        runs_away: whether a deep segment slips.
        steps: their number.
    """

    elongation: Float[Array, " n_segment"]
    sign: Float[Array, " n_deviator"]
    before: Float[Array, " n_segment"]
    tension: Float[Array, " n_segment"]
    ratio: Float[Array, " n_segment"]
    deep: Bool[Array, " n_segment"]
    moved: Scalar
    runs_away: Bool[Array, ""]
    steps: Int[Array, ""]


def _find_elongations_and_slip_signs(segments):
    """Search for elongations of hanging segments, [n_segment], m, and slip signs, [n_deviator].

    They are NaN where there is no equilibrium, or none was found.
    """
    real, jack, last = segments.length > 0, segments.jack, is_last_segment(segments.length)
    alone = jnp.where(real, segments.stuck_elongation, 0.0)
    stuck = _hanging_shape(segments, alone).tension
    eps = jnp.finfo(alone.dtype).eps * jnp.sum(segments.length)

    def step(s):
        shape = _hanging_shape(segments, s.elongation)
        ratio, deep = _secant_ratio(segments, s, shape.tension)
        model = partial(_secant_elongations, segments, s.elongation, shape.tension, ratio)
        bound = jnp.where(segments.clamped, jnp.inf, shape.bound)
        tension, sign = tensions_and_slip_signs(
            SlipProblem(stuck, segments.stuck_elongation, real, bound, shape.drop, model, jack)
        )
        sign = jnp.where(real[1:] & real[:-1], sign, 0.0)
        slips = jnp.pad(sign, 1) != 0
        changes = slips[1:] | slips[:-1]
        if jack is not None:
            changes = changes.at[0].set(changes[0] | jack.at_first) | (last & jack.at_last)
        changes = changes & real
        new = jnp.where(changes, model(tension)[0], alone)
        moved = jnp.max(jnp.abs(new - s.elongation))
        runs_away = jnp.any(changes & deep)
        return _SlipSearchState(
            new, sign, s.elongation, shape.tension, ratio, deep, moved, runs_away, s.steps + 1
        )

    def unfinished(s):
        return (s.moved > 2 * eps) & (s.steps < _MAX_SEARCHES)

    one, far = jnp.ones_like(alone), jnp.full_like(eps, jnp.inf)
    start = _SlipSearchState(
        *(alone, jnp.zeros_like(alone[1:]), alone, stuck, one, jnp.zeros_like(real), far),
        *(jnp.zeros((), bool), jnp.int32(0)),
    )
    end = lax.while_loop(unfinished, step, start)
    shape = _hanging_shape(segments, end.elongation)
    rate = shallow_elongations(segments, jnp.where(shape.tension > 0, shape.tension, 1.0))[1]
    found = _make_segment_tensions(segments, end.elongation, shape, end.sign)
    balanced = residuals_vanish(found, rate, segments.length, jack, last)
    fails = end.runs_away | ~(end.moved <= 8 * eps) | ~balanced
    return jnp.where(fails, jnp.nan, end.elongation), end.sign


def _secant_ratio(segments, s, tension):
    """Return `ratio` and `deep` of `_SlipSearchState`, [n_segment], by secants of two steps."""
    change = s.elongation - s.before
    expected = (
        shallow_elongations(segments, tension)[0] - shallow_elongations(segments, s.tension)[0]
    )
    precise = jnp.sqrt(jnp.finfo(change.dtype).eps) * segments.length
    counts = (jnp.abs(change) > precise) & (jnp.abs(expected) > precise)
    secant = change / jnp.where(counts, expected, 1.0)
    # limits how fast the search goes, not where it ends: the last step is looked at
    limited = jnp.clip(secant, 1 / _LARGEST_RATIO, _LARGEST_RATIO)
    rises = counts & (secant > 0)
    return jnp.where(rises, limited, s.ratio), jnp.where(counts, secant < 0, s.deep)


def _secant_elongations(segments, elongation, tension, ratio, new):
    """Return elongations under tensions `new` by secants from known ones, and flexibilities."""
    later, rate = shallow_elongations(segments, new)
    return elongation + ratio * (later - shallow_elongations(segments, tension)[0]), ratio * rate
