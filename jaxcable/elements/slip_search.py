"""Where a cable slips over its deviators: dynamic programming along it, see `friction`.

With the tension that is best for all segments up to one, the tension of this segment is that if it
is within the bounds that the next tension sets, and at a bound if not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from ..common.types import Array, ArrayLike, Bool, Float

MAX_STEPS = 100  # enough for bisection to halve a bracket to its last digit
# Bound from which the cable is held: its exponential is finite in float32, too.
CLAMPED_LOG_RATIO = 80.0


class Jack(NamedTuple):
    """Jacks that prescribe the tension at ends of a cable, which then take any length out or in.

    Attributes:
        force: tension at every end that has a jack, N.
        at_first, at_last: whether there is a jack at the first end, and at the last one.
    """

    force: Float[Array, ""]
    at_first: Bool[ArrayLike, ""]
    at_last: Bool[ArrayLike, ""]


class SlipProblem(NamedTuple):
    """Input of the search for slips: the segments of one cable, [n_segment].

    Attributes:
        stuck: tension of each segment if nothing slips in this increment, [n_segment], N.
        stuck_elongation: present length minus unstressed length then, [n_segment], m.
        is_real: False for segments that only fill up a shorter chain, [n_segment].
        bound: largest logarithm of the ratio of the tensions on both sides of every deviator,
            [n_deviator]; infinite at a clamp, zero beside segments that only fill up.
        drop: by how much the tension at the first end of each segment exceeds its mean, and that at
            the last one falls short of it, [n_segment], N; None: segments without weight.
        elongations_and_flexibilities: function of the tensions, [n_segment], N, that returns the
            present less the unstressed length under them, m, which increases, and its derivatives,
            m/N.
        jack: None: there is no jack at an end.
    """

    stuck: Float[Array, " n_segment"]
    stuck_elongation: Float[Array, " n_segment"]
    is_real: Bool[Array, " n_segment"]
    bound: Float[Array, " n_deviator"]
    drop: Float[Array, " n_segment"] | None
    elongations_and_flexibilities: Callable[[Array], tuple[Array, Array]]
    jack: Jack | None


def tensions_and_slip_signs(
    segments: SlipProblem,
) -> tuple[Float[Array, " n_segment"], Float[Array, " n_deviator"]]:
    """Return tensions of all segments, [n_segment], N, and signs of slips, [n_deviator].

    A sign is 1 where the cable slips towards the next segment, -1 where it slips back, else 0.
    """
    bound, dtype = segments.bound, segments.stuck.dtype
    # infinite at clamps, where comparisons with it are false even if a tension is zero
    growth = jnp.where(bound < CLAMPED_LOG_RATIO, jnp.exp(bound), jnp.inf).astype(dtype)
    drop = jnp.zeros_like(segments.stuck) if segments.drop is None else segments.drop
    best, last = _prefix_minimizing_tensions(segments, growth, drop)
    if segments.jack is not None:
        force, _, at_last = segments.jack
        last = jnp.where(at_last, force + drop[-1], last)
    rounding = _relative_rounding(segments)

    def go_back(later, at):
        own, pair, ratio = at
        low, high = _tension_limits_before(later, pair, ratio)
        # at its bound the cable counts as slipping: so it does beside a jack, however it is rounded
        rises, falls = own <= low * (1 + rounding), own >= high * (1 - rounding)
        sign = jnp.where(rises, 1.0, jnp.where(falls, -1.0, 0.0)).astype(dtype)
        own = jnp.where(own < low, low, jnp.where(own > high, high, own))
        return own, (own, sign)

    at = best[:-1], (drop[:-1], drop[1:]), growth
    _, (tension, sign) = lax.scan(go_back, last, at, reverse=True)
    # comparisons with NaN are false: they would pass for a cable that sticks
    given = jnp.sum(segments.stuck_elongation) + jnp.sum(jnp.minimum(bound, CLAMPED_LOG_RATIO))
    return jnp.where(jnp.isnan(given), given, jnp.append(tension, last)), sign


def _relative_rounding(segments):
    """Return the relative rounding error of tensions that differ by ratios along the cable."""
    return 8 * len(segments.stuck) * jnp.finfo(segments.stuck.dtype).eps


def _tension_limits_before(later, drops, ratio):
    """Return the least and largest tension of a segment before one with the tension `later`, N.

    `drops` are those of the segment and of the next one; `ratio` is the largest ratio of tensions
    that friction allows between them.
    """
    start = later + drops[1]
    low = jnp.where(ratio < jnp.inf, start / ratio + drops[0], -jnp.inf)
    # a tension below the drop would be negative at an end
    return low, jnp.maximum(start * ratio + drops[0], jnp.abs(drops[0]))


def _prefix_minimizing_tensions(segments, growth, drop):
    """Return the tension of each segment that minimizes the sum up to it, and the last one, N."""
    zero = jnp.zeros_like(segments.stuck)
    reach = zero[0], zero[0] + jnp.inf
    first = segments.stuck[0]
    if segments.jack is not None:
        force, at_first, _ = segments.jack
        first = jnp.where(at_first, force - drop[0], first)
        reach = jnp.where(at_first, first, reach[0]), jnp.where(at_first, first, reach[1])

    def extend(i, carry):
        best, (low, high) = carry
        before, ratio = best[i - 1], growth[i - 1]
        ends = low - drop[i - 1], high - drop[i - 1]
        low = ends[0] / ratio - drop[i]
        high = jnp.where(ends[1] > 0, ends[1] * ratio, ends[1]) - drop[i]
        end = before - drop[i - 1]
        alone = jnp.where(segments.is_real[i], segments.stuck[i], end - drop[i])
        found = _minimizing_tension(segments, growth, drop, best, i, alone, (low, high))
        sticks = ~((alone + drop[i]) * ratio < end) & ~(alone + drop[i] > end * ratio)
        found = jnp.where(sticks, alone, found)
        # a bound of the problem, which hides no result: without a jack all is in reach, and beside
        # one friction holds the tension there, where the cable slips
        inner = _narrowed_limits(segments, (low, high), 2)
        found = jnp.where(found <= inner[0], low, jnp.where(found >= inner[1], high, found))
        return best.at[i].set(found), (low, high)

    best, _ = lax.fori_loop(1, len(zero), extend, (zero.at[0].set(first), reach))
    return best, best[-1]


def _narrowed_limits(segments, reach, roundings):
    """Return the limits of a tension, `reach`, moved inwards by some `roundings`, a pair, N.

    At the ends of the reach the tensions up to the jack would count as free or not by rounding.
    """
    rounding = roundings * _relative_rounding(segments)
    low, high = reach
    return low * (1 + rounding * jnp.sign(low)), high * (1 - rounding * jnp.sign(high))


def _minimizing_tension(segments, growth, drop, best, i, alone, reach):
    """Return the tension of segment i that minimizes the sum over the segments 0 to i, N.

    Args:
        segments: `SlipProblem`.
        growth: largest ratios of tensions at the deviators, [n_deviator].
        drop: as of `SlipProblem`, but no None.
        best: best tensions for the segments up to each one before i, [n_segment].
        i: index of the segment.
        alone: tension of segment i without slip, N.
        reach: smallest and largest tension that friction allows beside a jack, N.
    """
    ratio, step_up = growth[i - 1], drop[i - 1] + drop[i]
    before = best[i - 1] - step_up  # where the tension goes on as it is
    reach = _narrowed_limits(segments, reach, 1)
    # only brackets are clipped: the root is between these tensions, or friction holds it at an end
    low = jnp.clip(jnp.minimum(alone, before), *reach)
    high = jnp.clip(jnp.maximum(alone, before), *reach)
    # the function is concave where it matters, so that steps from below do not pass the root
    raised = (best[i - 1] - drop[i - 1]) * ratio - drop[i]
    start = jnp.clip(jnp.where(alone > before, raised, alone), low, high)
    eps = jnp.finfo(start.dtype).eps

    def unfinished(s):
        tension, _, _, moved, count = s
        size = jnp.maximum(jnp.abs(tension), jnp.finfo(tension.dtype).tiny)
        return (moved > 2 * eps * size) & (count < MAX_STEPS)

    def step(s):
        tension, low, high, moved, count = s
        value, rate = _excess_length_and_flexibility(segments, growth, drop, best, i, tension)
        low, high = jnp.where(value < 0, tension, low), jnp.where(value < 0, high, tension)
        new = tension - value / rate
        # beside a kink, Newton's steps can go back and forth between both ends of the bracket
        shrinks = (jnp.abs(new - tension) < 0.5 * moved) & (new >= low) & (new <= high)
        new = jnp.where(shrinks, new, 0.5 * (low + high))
        return new, low, high, jnp.abs(new - tension), count + 1

    far = jnp.full_like(start, jnp.inf)
    found = lax.while_loop(unfinished, step, (start, low, high, far, jnp.int32(0)))[0]
    # a cable that is too long even under a vanishing tension has none
    vanishing = jnp.full_like(start, jnp.sqrt(jnp.finfo(start.dtype).tiny))
    too_long = _excess_length_and_flexibility(segments, growth, drop, best, i, vanishing)[0] >= 0
    # beside a jack, which takes any length in, friction keeps a tension
    return jnp.where(too_long & (reach[0] <= 0), 0.0, found)


def _excess_length_and_flexibility(segments, growth, drop, best, i, tension):
    """Return the excess of unstressed length of the segments that slip with segment i, m.

    It is their present unstressed length less the one that belongs to `tension` of segment i, N,
    and increases with it; also its derivative, m/N.
    """
    n = len(best)

    def go_back(later, at):
        """Return tension and share of a segment from those of the next one, and if it counts."""
        tension, share, counts = later
        k, before, drops, ratio = at
        low, high = _tension_limits_before(tension, drops, ratio)
        falls, grows = low > before, high < before
        factor = jnp.where(falls, 1 / ratio, ratio)
        own = jnp.where(falls, low, high), share * factor, counts & (falls | grows)
        own = jax.tree.map(lambda new, old: jnp.where(k <= i, new, old), own, later)
        return own, own

    last = tension, jnp.ones_like(tension), jnp.ones((), bool)
    at = jnp.arange(1, n), best[:-1], (drop[:-1], drop[1:]), growth
    _, earlier = lax.scan(go_back, last, at, reverse=True)
    tensions, shares, counts = (
        jnp.append(values, value) for values, value in zip(earlier, last, strict=True)
    )
    counts = counts & (jnp.arange(n) <= i)
    stretched, rate = segments.elongations_and_flexibilities(tensions)
    mismatch = jnp.sum(jnp.where(counts, stretched - segments.stuck_elongation, 0.0))
    return mismatch, jnp.sum(jnp.where(counts, shares * rate, 0.0))
