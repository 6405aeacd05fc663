"""Coulomb friction of a cable on the nodes that deviate it: the tensions of its segments.

Over a deviator the tension changes by at most a factor ``exp(b)``, and by this factor where the
cable slips, against the slip:

    exp(-b) <= T_2 / T_1 <= exp(b),    b = mu theta,

with the angle theta between the directions of the two segments (Euler, Eytelwein). On a pulley
whose axle has friction, and on which the rope does not slip, the balance of moments about the axle
gives ``b = 2 asinh(k sin(theta / 2) / sqrt(1 - k^2))``, with k the friction coefficient of the axle
times its radius over that of the pulley.

Slips are not found by trial. In the logarithms of the tensions, y, friction has a potential: for
given positions of the nodes the tensions minimize a strictly convex sum of functions ``H(y)`` of
the segments, ``H' = m - a(exp y)`` with the unstressed length a that a segment takes under its
tension and the length m that it has without slip, subject to ``|y_2 - y_1| <= b`` at every
deviator. Slips are the multipliers of these bounds. Hence there is one solution, whatever the order
in which the cable begins to slip at its deviators, and dynamic programming finds it in one pass
along the cable: with the tension t that minimizes the sum over all segments up to one, the tension
of this segment is t if that is within the bound of the next tension, and at the bound if not.

Without tension nothing slips: what a cable that has gone slack remembers is where it last was taut.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common.types import Array, ArrayLike, Bool, Float
from ..numerics.implicit_root import TangentSolver, implicit_root
from .cable import TensionOnly

_MAX_STEPS = 100  # enough for bisection to halve a bracket to its last digit
_ROUNDINGS = 64  # of eps, within which a slip is zero, or a ratio the largest one
_CLAMPED = 80.0  # bound from which the cable is held: its exponential is finite in float32, too


class StraightSegments(NamedTuple):
    """Straight segments of one cable between its nodes, [n], and the cable, whose law they have.

    Attributes:
        cable: the element: `force` by strain, not negative, and `strain_at`, its inverse.
        length: present lengths, [n], m; 0 for segments that only fill up a shorter chain.
        no_slip_elongation: present minus unstressed length if nothing slips in this increment,
            [n], m.
        bound: largest logarithm of the ratio of successive tensions, [n - 1]; infinite at a clamp,
            zero beside segments that only fill up.
        jack: tension of the first segment, N, which then takes any unstressed length, and whether
            there is a jack that prescribes it; None: there is none.
    """

    cable: TensionOnly
    length: Float[Array, " n"]
    no_slip_elongation: Float[Array, " n"]
    bound: Float[Array, " n_deviator"]
    jack: tuple[Float[Array, ""], Bool[ArrayLike, ""]] | None


class SegmentTensions(NamedTuple):
    """Tensions of the segments of one cable, and where it slips.

    Attributes:
        tension: [n], N.
        sign: for every deviator 1 where the cable slips towards the next segment, so that the
            tension there is larger by the largest ratio; -1 where it slips back; 0 where it sticks.
    """

    tension: Float[Array, " n"]
    sign: Float[Array, " n_deviator"]


def deviation_angles(
    segments: Float[Array, "n 3"], lengths: Float[Array, " n"]
) -> Float[Array, " n_deviator"]:
    """Return the angles between successive segments of a cable, [n - 1], rad; 0 beside fillers.

    The angle has no derivative where it is zero; zero is returned for it.
    """
    unit = segments / jnp.where(lengths > 0, lengths, 1.0)[:, None]
    square = jnp.sum(jnp.cross(unit[:-1], unit[1:]) ** 2, axis=1)
    sine = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
    cosine = jnp.sum(unit[:-1] * unit[1:], axis=1)
    return jnp.where(lengths[1:] * lengths[:-1] > 0, jnp.arctan2(sine, cosine), 0.0)


def axle_bound(
    angle: Float[Array, " n_deviator"], ratio: Float[Array, " n_deviator"]
) -> Float[Array, " n_deviator"]:
    """Return the largest logarithm of the ratio of tensions on pulleys whose axles have friction.

    `angle` is that of the deviation, rad; `ratio` the friction coefficient of the axle times its
    radius over that of the pulley, below 1.
    """
    return 2 * jnp.arcsinh(ratio * jnp.sin(0.5 * angle) / jnp.sqrt(1 - ratio**2))


@jax.jit  # traced once, although a program calls it for forces, tangents and results
def segment_tensions(segments: StraightSegments) -> SegmentTensions:
    """Return the tensions of the segments of one cable, with their derivatives of any order.

    A cable that is longer than its chain everywhere between two clamps has no tension there.
    """
    tension, sign = _find_tensions_and_slips(lax.stop_gradient(segments))
    solver = TangentSolver(_solve_linear_system, _solve_linear_system)
    tension = implicit_root(_mismatches, tension, (segments, sign), solver)
    return SegmentTensions(tension, sign)


def slips(segments: StraightSegments, found: SegmentTensions) -> Float[Array, " n_deviator"]:
    """Return the length that slips over each deviator in this increment, [n - 1], m.

    It is unstressed length, positive towards the next segment; zero where the cable sticks, and
    where it has no tension.
    """
    later = jnp.triu(_connected_by_slips(found.sign), 1)
    return (later @ _missing_elongation(segments, found.tension))[:-1]


def at_slip_limit(segments: StraightSegments, found: SegmentTensions) -> Bool[Array, " n_deviator"]:
    """Return where the cable is between sticking and slipping, up to rounding, [n - 1] bool.

    Tensions have no derivative there: under a larger load it slips, under a smaller one it sticks.
    """
    tension, eps = found.tension, _ROUNDINGS * jnp.finfo(segments.length.dtype).eps
    taut = (tension[1:] > 0) & (tension[:-1] > 0)
    ratio = jnp.where(taut, tension[1:], 1.0) / jnp.where(taut, tension[:-1], 1.0)
    at_bound = jnp.abs(jnp.log(ratio)) >= segments.bound * (1 - eps) - eps
    still = jnp.abs(slips(segments, found)) <= eps * jnp.sum(segments.length)
    return taut & (segments.bound > 0) & at_bound & still


def elongations(segments: StraightSegments, tension: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return by how much tensions stretch the segments, at their present lengths, [n], m."""
    strain = segments.cable.strain_at(tension)
    return segments.length * (strain / (1 + strain))


def elongations_and_rates(
    segments: StraightSegments, tension: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Return `elongations` of the segments, m, and their derivatives by the tensions, m/N."""
    one = jnp.ones_like(tension)
    return jax.jvp(lambda t: elongations(segments, t), (tension,), (one,))


def _missing_elongation(segments, tension):
    """Return by how much each segment lacks unstressed length for its tension, [n], m."""
    return jnp.where(tension > 0, segments.no_slip_elongation - elongations(segments, tension), 0.0)


def _connected_by_slips(sign):
    """Return which segments are connected by slips, [n, n], as floats 0 or 1."""
    block = jnp.concatenate([jnp.zeros(1), jnp.cumsum(jnp.where(sign == 0, 1.0, 0.0))])
    return jnp.where(block[:, None] == block[None, :], 1.0, 0.0).astype(sign.dtype)


def _mismatches(tension, parameters):
    """Return the mismatches of the equations of the tensions, one for each segment, [n], N.

    Where the cable slips after a segment, the next tension differs by the largest ratio. Otherwise
    the segments up to this one that are connected by slips keep their unstressed length together,
    or with a jack the first tension is that of the jack. A segment without tension has none.
    `parameters` are `StraightSegments` and the signs of the slips.
    """
    segments, sign = parameters
    slack = lax.stop_gradient(tension) <= 0
    earlier = jnp.tril(_connected_by_slips(sign))
    rate = elongations_and_rates(segments, lax.stop_gradient(tension))[1]
    balance = earlier @ _missing_elongation(segments, tension) / (earlier @ lax.stop_gradient(rate))
    if segments.jack is not None:
        force, jacked = segments.jack
        balance = jnp.where(jacked & (earlier[:, 0] > 0), tension[0] - force, balance)
    bound = jnp.minimum(segments.bound, _CLAMPED)
    ratio = tension[1:] - tension[:-1] * jnp.exp(sign * bound)
    held = jnp.where(sign == 0, balance[:-1], ratio)
    return jnp.where(slack, tension, jnp.concatenate([held, balance[-1:]]))


def _solve_linear_system(_, product, rhs):
    """Solve with the linear function `product` of [n] numbers."""
    matrix = jax.vmap(product, out_axes=1)(jnp.eye(len(rhs), dtype=rhs.dtype))
    return linear.solve_general(matrix, rhs)[0]


# --- the search, by dynamic programming along the cable


def _find_tensions_and_slips(segments):
    """Return the tensions of all segments, [n], N, and the signs of the slips, [n - 1]."""
    zero = jnp.zeros_like(segments.length)
    n, dtype = len(zero), zero.dtype
    unstressed = segments.length - segments.no_slip_elongation
    strain = segments.no_slip_elongation / jnp.where(unstressed > 0, unstressed, 1.0)
    strain = jnp.where(unstressed <= 0, 1.0, strain)  # as an end of a bracket only
    stuck = jnp.where(segments.length > 0, jnp.maximum(segments.cable.force(strain), 0.0), 0.0)
    # infinite at clamps, where comparisons with it are false even if a tension is zero
    growth = jnp.where(segments.bound < _CLAMPED, jnp.exp(segments.bound), jnp.inf).astype(dtype)
    reach = jnp.zeros((), dtype), jnp.full((), jnp.inf, dtype)
    rounding = 8 * jnp.finfo(dtype).eps
    first = stuck[0]
    if segments.jack is not None:
        force, jacked = segments.jack
        first = jnp.where(jacked, force, first)
        reach = jnp.where(jacked, force, reach[0]), jnp.where(jacked, force, reach[1])

    def extend(i, carry):
        """Find the tension that is best for the segments 0 to i together."""
        best, (low, high) = carry
        before, ratio = best[i - 1], growth[i - 1]
        low, high = low / ratio, jnp.where(high > 0, high * ratio, high)
        alone = jnp.where(segments.length[i] > 0, stuck[i], before)
        found = _minimizing_tension(segments, growth, best, i, alone, (low, high))
        sticks = ~(alone * ratio < before) & ~(alone > before * ratio)
        found = jnp.where(sticks, alone, found)
        return best.at[i].set(jnp.clip(found, low, high)), (low, high)

    best, _ = lax.fori_loop(1, n, extend, (zero.at[0].set(first), reach))

    def go_back(later, at):
        own, ratio = at
        low, high = later / ratio, later * ratio
        # at its bound the cable counts as slipping: so it does beside a jack, however it is rounded
        rises, falls = own <= low * (1 + rounding), own >= high * (1 - rounding)
        sign = jnp.where(rises, 1.0, jnp.where(falls, -1.0, 0.0)).astype(dtype)
        own = jnp.where(own < low, low, jnp.where(own > high, high, own))
        return own, (own, sign)

    _, (tension, sign) = lax.scan(go_back, best[-1], (best[:-1], growth), reverse=True)
    # comparisons with NaN are false: they would pass for a cable that sticks
    given = jnp.sum(segments.no_slip_elongation) + jnp.sum(jnp.minimum(segments.bound, _CLAMPED))
    return jnp.where(jnp.isnan(given), given, jnp.concatenate([tension, best[-1:]])), sign


def _minimizing_tension(segments, growth, best, i, alone, reach):
    """Return the tension of segment i that is best for the segments 0 to i together, N.

    Args:
        segments: `StraightSegments`.
        growth: largest ratios of successive tensions, [n - 1].
        best: best tensions for the segments up to each one before i, [n].
        i: number of the segment.
        alone: tension of segment i without slip, N.
        reach: smallest and largest tension that friction allows beside a jack, N.
    """
    before, ratio = best[i - 1], growth[i - 1]
    low = jnp.clip(jnp.minimum(alone, before), *reach)
    high = jnp.clip(jnp.maximum(alone, before), *reach)
    # the function is concave where it matters, so that steps from below do not pass the root
    start = jnp.clip(jnp.where(alone > before, before * ratio, alone), low, high)
    eps = jnp.finfo(start.dtype).eps

    def unfinished(s):
        _, _, _, moved, count = s
        return (moved > 2 * eps) & (count < _MAX_STEPS)

    def step(s):
        tension, low, high, _, count = s
        value, rate = _length_mismatch_and_rate(segments, growth, best, i, tension)
        low, high = jnp.where(value < 0, tension, low), jnp.where(value < 0, high, tension)
        new = tension - value / rate
        new = jnp.where((new >= low) & (new <= high), new, 0.5 * (low + high))
        size = jnp.maximum(jnp.abs(new), jnp.finfo(new.dtype).tiny)
        return new, low, high, jnp.abs(new - tension) / size, count + 1

    far = jnp.full_like(start, jnp.inf)
    found = lax.while_loop(unfinished, step, (start, low, high, far, jnp.int32(0)))[0]
    # a cable that is too long even under a vanishing tension has none
    vanishing = jnp.full_like(start, jnp.finfo(start.dtype).tiny / eps)
    too_long = _length_mismatch_and_rate(segments, growth, best, i, vanishing)[0] >= 0
    return jnp.where(too_long, 0.0, found)


def _length_mismatch_and_rate(segments, growth, best, i, tension):
    """Return by how much the segments that slip with segment i are too long for its tension, m.

    It is the sum over the segments whose tension changes with that of segment i, and increases with
    it; and its derivative, m/N.
    """
    n = len(best)

    def go_back(later, at):
        """Return tension and share of a segment from those of the next one, and if it counts."""
        tension, share, counts = later
        k, before, ratio = at
        falls, grows = tension / ratio > before, tension * ratio < before
        factor = jnp.where(falls, 1 / ratio, ratio)
        own = tension * factor, share * factor, counts & (falls | grows)
        own = jax.tree.map(lambda new, old: jnp.where(k <= i, new, old), own, later)
        return own, own

    last = tension, jnp.ones_like(tension), jnp.ones((), bool)
    at = jnp.arange(1, n), best[:-1], growth
    _, earlier = lax.scan(go_back, last, at, reverse=True)
    tensions, shares, counts = (
        jnp.append(values, value) for values, value in zip(earlier, last, strict=True)
    )
    counts = counts & (jnp.arange(n) <= i)
    stretched, rate = elongations_and_rates(segments, tensions)
    mismatch = jnp.sum(jnp.where(counts, stretched - segments.no_slip_elongation, 0.0))
    return mismatch, jnp.sum(jnp.where(counts, shares * rate, 0.0))
