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

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import linear
from ..common import checks
from ..common.rules import Rule
from ..common.types import Array, ArrayLike, Bool, Float, PyTree
from ..materials.law import Law
from ..numerics.implicit_root import TangentSolver, implicit_root
from .cable import TensionOnly
from .slip_search import CLAMPED_LOG_RATIO, Jack, SlipProblem, tensions_and_slip_signs

_ROUNDINGS = 64  # of eps, within which a slip is zero, or a ratio the largest one
_SEARCH_ROUNDINGS = 1024  # of eps of length and tension, more than any search was seen to leave


class StraightSegments(NamedTuple):
    """Straight segments of one cable between its nodes, [n_segment], before the search for slips.

    Attributes:
        cable: the element: `force` by strain, not negative, and `strain_at`, its inverse.
        length: present lengths, [n_segment], m; 0 for segments that only fill up a shorter chain.
        stuck_elongation: present length minus unstressed length, if nothing slips in this
            increment, [n_segment], m.
        bound: largest logarithm of the ratio of successive tensions, [n_deviator]; zero beside
            segments that only fill up.
        clamped: whether the cable is clamped to a deviator, [n_deviator].
        jack: None: there is none at an end.
    """

    cable: TensionOnly
    length: Float[Array, " n_segment"]
    stuck_elongation: Float[Array, " n_segment"]
    bound: Float[Array, " n_deviator"]
    clamped: Bool[Array, " n_deviator"]
    jack: Jack | None


class SegmentTensions(NamedTuple):
    """Tensions of all segments of one cable, [n_segment], and where it slips: result of a search.

    Attributes:
        tension: mean of the tensions at both ends of each segment, [n_segment], N.
        drop: by how much the tension at the first end exceeds this mean, and that at the last end
            falls short of it, [n_segment], N, the effect of weight; None: both are the same.
        sign: for every deviator 1 where the cable slips towards the next segment, so that the
            tension there is larger by the largest ratio; -1 where it slips back; 0 where it sticks.
        bound: largest logarithm of the ratio of the tensions at every deviator that friction alone
            allows, [n_deviator]; a clamp allows any.
        gained: unstressed length that each segment has more than before the increment, [n_segment],
            m; zero without tension.
        jacked_last: the last segment, as a mask, if a jack at its end takes length out or in,
            [n_segment] bool; None: there is none at an end.
    """

    tension: Float[Array, " n_segment"]
    drop: Float[Array, " n_segment"] | None
    sign: Float[Array, " n_deviator"]
    bound: Float[Array, " n_deviator"]
    gained: Float[Array, " n_segment"]
    jacked_last: Bool[Array, " n_segment"] | None = None

    def deviator_tensions(self) -> tuple[Float[Array, " n_deviator"], Float[Array, " n_deviator"]]:
        """Return the tensions before and after every deviator, [n_deviator] each, N."""
        if self.drop is None:
            return self.tension[:-1], self.tension[1:]
        return (self.tension - self.drop)[:-1], (self.tension + self.drop)[1:]


def deviation_angles(
    before: Float[Array, "n_deviator 3"], after: Float[Array, "n_deviator 3"]
) -> Float[Array, " n_deviator"]:
    """Return the angles by which a cable turns at its deviators, [n_deviator], 0 to pi, rad.

    They are those between the vectors along the cable before and after each deviator.

    The angle has no derivative where it is zero; zero is returned for it, and beside vectors
    without length.
    """

    def unit(vector):
        square = jnp.sum(vector**2, axis=1, keepdims=True)
        return vector / jnp.sqrt(jnp.where(square > 0, square, 1.0))

    first, second = unit(before), unit(after)
    square = jnp.sum(jnp.cross(first, second) ** 2, axis=1)
    sine = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
    is_real = jnp.any(before != 0, axis=1) & jnp.any(after != 0, axis=1)
    return jnp.arctan2(sine, jnp.where(is_real, jnp.sum(first * second, axis=1), 1.0))


class FrictionCoefficients(NamedTuple):
    """Coefficients of friction of one cable, without unit but the last; None: none of this kind.

    Attributes:
        friction: of the cable on each deviator, [n_deviator].
        axle_friction: of the axles of pulleys, times the radius of the axle over that of the
            pulley, [n_deviator], below 1.
        wobble: of unintended angles, 1/m.
    """

    friction: Float[Array, " n_deviator"] | None
    axle_friction: Float[Array, " n_deviator"] | None
    wobble: Float[Array, ""] | None

    def rules(self) -> list[Rule]:
        """Return the rules: axle friction is from 0 to below 1, the others are not negative."""
        text = "must be from 0 to below 1: radius of the axle over that of the pulley, times mu"
        axle = Rule("axle_friction", self.axle_friction, lambda v: ~((v >= 0) & (v < 1)), text)
        pairs = ("friction", self.friction), ("wobble", self.wobble)
        return [axle, *(Rule(*pair, lambda v: ~(v >= 0), "must not be negative") for pair in pairs)]

    def largest_log_ratio(
        self, angle: Float[Array, " n_deviator"], length: Float[Array, " n_segment"]
    ) -> Float[Array, " n_deviator"]:
        """Return b of the largest ratio of tensions ``exp(b)`` at each deviator, [n_deviator].

        `angle` has the deviations, rad, `length` the chords of the segments, m, 0 for fillers.
        """
        bound = jnp.zeros_like(angle)
        if self.friction is not None:
            bound = bound + self.friction * angle
        if self.axle_friction is not None:
            ratio = self.axle_friction
            bound = bound + 2 * jnp.arcsinh(ratio * jnp.sin(0.5 * angle) / jnp.sqrt(1 - ratio**2))
        if self.wobble is not None:
            bound = bound + self.wobble * 0.5 * (length[1:] + length[:-1])
        return jnp.where((length[1:] <= 0) | (length[:-1] <= 0), 0.0, bound)


def floats_per_deviator(
    value: ArrayLike, name: str, shape: tuple[int, int]
) -> Float[ArrayLike, "n_elem n_deviator ..."]:
    """Return `value`, broadcast to a number, or an axis [3], for each deviator of each cable.

    `name` is the field ("axis" for axes), `shape` is (n_elem, n_deviator). ValueError for values
    that cannot be broadcast.
    """
    if name == "axis":
        hint = "; one vector, or one for each node between the ends of each cable"
        values = checks.floats_of_shape(value, name, (3,), (*shape, 3), hint=hint)
        return checks.numpy_or_jax(values).broadcast_to(values, (*shape, 3))
    hint = "; one number, one for each cable, or one for each node between its ends"
    flat = [shape[1:]] if shape[0] == 1 else []  # of one cable
    values = checks.floats_of_shape(value, name, (), shape[:1], *flat, shape, hint=hint)
    if shape[0] == 1 and values.ndim == 1 and len(values) > 1:
        values = values[None]
    values = values[:, None] if values.ndim == 1 else values
    return checks.numpy_or_jax(values).broadcast_to(values, shape)


def clamp_rule(name: str, values: Float[Array, " ..."]) -> Rule:
    """Return the rule that clamps are 0 (open) or 1 (closed)."""
    return Rule(name, values, lambda v: (v != 0) & (v != 1), "a clamp is open, 0, or closed, 1")


def stressed_ends_rule(name: str, values: Float[ArrayLike, "n_elem 2"]) -> Rule:
    """Return the rule that ends are 0 (not stressed) or 1, and at least one of both is 1."""

    def broken(v):
        return ((v != 0) & (v != 1)).any(axis=-1) | ~(v != 0).any(axis=-1)

    return Rule(name, values, broken, "an end is stressed, 1, or not, 0; at least one is")


def no_softening_rules(laws: Sequence[Law]) -> list[Rule]:
    """Return the rules that no law softens: its stress must not fall with strain, a list."""
    text = "softens; a cable with friction needs a law whose stress does not fall"
    stresses = (law.softening_stresses() for law in laws)
    return [
        Rule("law", stress, lambda s: (s[..., 1:] < s[..., :-1]).any(), text)
        for stress in stresses
        if stress is not None
    ]


def slip_lengths(found: SegmentTensions) -> Float[Array, " n_deviator"]:
    """Return the lengths that slip over deviators in this increment, [n_deviator], m.

    They are unstressed, positive towards the next segment; zero where the cable sticks, and
    where it has no tension.
    """
    connected = connected_by_slips(found.sign)
    later = (jnp.triu(connected, 1) @ found.gained)[:-1]
    if found.jacked_last is None:
        return later
    # what segments before have lost has gone over the deviator, also where a jack takes it out
    behind = jnp.cumsum(found.jacked_last)[:-1] == 0
    to_jack = behind & (found.sign != 0) & ((connected @ found.jacked_last)[:-1] > 0)
    return jnp.where(to_jack, -(jnp.tril(connected) @ found.gained)[:-1], later)


def length_fed_at_ends(
    found: SegmentTensions, gained: Float[Array, " n_segment"], at_first: Bool[ArrayLike, ""]
) -> Float[Array, " 2"]:
    """Return the unstressed lengths fed in by jacks at the first and the last end, [2], m.

    They are those of this increment, negative where cable is pulled out. `gained` has the lengths
    that segments gain, also slack ones; `at_first` is whether the first end has a jack.
    """
    slip = slip_lengths(found)
    first = jnp.where(at_first, gained[0] + jnp.sum(slip[:1]), 0.0)
    last = jnp.zeros_like(first)
    if found.jacked_last is not None:
        last = jnp.sum(jnp.where(found.jacked_last, gained - jnp.pad(slip, (1, 0)), 0.0))
    return jnp.stack([first, last])


def is_last_segment(length: Float[Array, " n_segment"]) -> Bool[Array, " n_segment"]:
    """Return which segment is the last one with a length (no filler), [n_segment] bool."""
    return (length > 0) & ~jnp.pad(length[1:] > 0, (0, 1))


def at_slip_limit(
    found: SegmentTensions, length: Float[Array, " n_segment"]
) -> Bool[Array, " n_deviator"]:
    """Return at which deviators slip impends: at the bound, but none yet, [n_deviator] bool.

    Tensions have no derivative there: under a larger load it slips, under a smaller one it sticks.
    Clamps are not looked at. `length` is the present one of each segment, [n_segment], m.
    """
    before, after = found.deviator_tensions()
    eps = _ROUNDINGS * jnp.finfo(length.dtype).eps
    taut = (after > 0) & (before > 0)
    ratio = jnp.where(taut, after, 1.0) / jnp.where(taut, before, 1.0)
    at_bound = jnp.abs(jnp.log(ratio)) >= found.bound * (1 - eps) - eps
    still = jnp.abs(slip_lengths(found)) <= eps * jnp.sum(length)
    return taut & (found.bound > 0) & at_bound & still


def connected_by_slips(sign: Float[Array, " n_deviator"]) -> Float[Array, "n n"]:
    """Return 1 for each pair of segments with slip at all deviators between, else 0, [n, n]."""
    block = jnp.concatenate([jnp.zeros(1), jnp.cumsum(jnp.where(sign == 0, 1.0, 0.0))])
    return jnp.where(block[:, None] == block[None, :], 1.0, 0.0).astype(sign.dtype)


def tension_residuals(
    found: SegmentTensions,
    rate: Float[Array, " n_segment"],
    jack: Jack | None,
    last: Bool[ArrayLike, " n_segment"],
) -> Float[Array, " n_segment"]:
    """Return the residuals of the equations for the tensions of the segments, [n_segment], N.

    Where the cable slips after a segment, the next tension differs by the largest ratio. Otherwise
    the segments up to this one that are connected by slips keep their unstressed length together,
    or with a jack the first tension is that of the jack, and so is that of the segment `last`, a
    mask. `rate` has the flexibilities of the segments, m/N.
    """
    earlier = jnp.tril(connected_by_slips(found.sign))
    balance = earlier @ found.gained / (earlier @ lax.stop_gradient(rate))
    if jack is not None:
        drop = 0.0 if found.drop is None else found.drop
        at_start, at_end = found.tension + drop - jack.force, found.tension - drop - jack.force
        balance = jnp.where(jack.at_first & (earlier[:, 0] > 0), at_start[0], balance)
        balance = jnp.where(jack.at_last & last, at_end, balance)
    before, after = found.deviator_tensions()
    ratio = after - before * jnp.exp(found.sign * jnp.minimum(found.bound, CLAMPED_LOG_RATIO))
    held = jnp.where(found.sign == 0, balance[:-1], ratio)
    return jnp.concatenate([held, balance[-1:]])


def residuals_vanish(
    found: SegmentTensions,
    rate: Float[Array, " n_segment"],
    length: Float[Array, " n_segment"],
    jack: Jack | None,
    last: Bool[ArrayLike, " n_segment"],
) -> Bool[Array, ""]:
    """Return whether the residuals of all segments with tension are zero up to rounding.

    `rate` and `last` are those of `tension_residuals`; `length` has the present lengths, m.
    """
    rounding = _SEARCH_ROUNDINGS * jnp.finfo(length.dtype).eps
    allowed = rounding * (found.tension + jnp.sum(length) / rate)
    off = jnp.abs(tension_residuals(found, rate, jack, last)) > allowed
    return ~jnp.any(off & (found.tension > 0))


def solve_by_dense_matrix(_: PyTree[Array], product: Callable[[Array], Array], rhs: Array) -> Array:
    """Return v, [n], with ``product(v) = rhs`` for a linear function, by its dense matrix."""
    matrix = jax.vmap(product, out_axes=1)(jnp.eye(len(rhs), dtype=rhs.dtype))
    return linear.solve_general(matrix, rhs)[0]


# --- straight segments


@jax.jit  # traced once, although a program calls it for forces, tangents and results
def segment_tensions(segments: StraightSegments) -> SegmentTensions:
    """Return the tensions and slips of straight segments of one cable; NaN if the search fails.

    They have derivatives of any order.

    A cable that is longer than its chain everywhere between two clamps has no tension there.
    """
    frozen = lax.stop_gradient(segments)
    tension, sign = _find_tensions_and_slip_signs(frozen)
    rate = elongations_and_flexibilities(frozen, tension)[1]
    at_end = _make_segment_tensions(frozen, tension, sign)
    last = _is_last_equation(segments)
    is_found = residuals_vanish(at_end, rate, segments.length, segments.jack, last)
    tension = jnp.where(is_found, tension, jnp.nan)
    solver = TangentSolver(solve_by_dense_matrix, solve_by_dense_matrix)
    tension = implicit_root(_residuals, tension, (segments, sign), solver)
    return _make_segment_tensions(segments, tension, sign)


def elongations_and_flexibilities(
    segments: StraightSegments, tension: Float[Array, " n_segment"]
) -> tuple[Float[Array, " n_segment"], Float[Array, " n_segment"]]:
    """Return elongations of segments of given present length under tensions, and flexibilities.

    An elongation, [n_segment], m, is the present less the unstressed length; flexibilities are the
    derivatives by the tensions, [n_segment], m/N.
    """

    def elongations(tension):
        strain = segments.cable.strain_at(tension)
        return segments.length * (strain / (1 + strain))

    return jax.jvp(elongations, (tension,), (jnp.ones_like(tension),))


def _make_segment_tensions(segments, tension, sign):
    """Return the `SegmentTensions` of straight segments under tensions, [n_segment], N."""
    gained = segments.stuck_elongation - elongations_and_flexibilities(segments, tension)[0]
    gained = jnp.where(tension > 0, gained, 0.0)
    jack = segments.jack
    out = None if jack is None else is_last_segment(segments.length) & jack.at_last
    return SegmentTensions(tension, None, sign, segments.bound, gained, out)


def _is_last_equation(segments):
    """Return a mask [n_segment], True in its last entry: the equation of a jack at the last end."""
    return np.arange(len(segments.length)) == len(segments.length) - 1


def _residuals(tension, parameters):
    """Return `tension_residuals` of straight segments; of slack ones the tension itself."""
    segments, sign = parameters
    rate = elongations_and_flexibilities(segments, lax.stop_gradient(tension))[1]
    found = _make_segment_tensions(segments, tension, sign)
    slack = lax.stop_gradient(tension) <= 0
    left = tension_residuals(found, rate, segments.jack, _is_last_equation(segments))
    return jnp.where(slack, tension, left)


def _find_tensions_and_slip_signs(segments):
    """Search for tensions of straight segments, [n_segment], N, and slip signs, [n_deviator]."""
    unstressed = segments.length - segments.stuck_elongation
    strain = segments.stuck_elongation / jnp.where(unstressed > 0, unstressed, 1.0)
    strain = jnp.where(unstressed <= 0, 1.0, strain)  # as an end of a bracket only
    is_real = segments.length > 0
    stuck = jnp.where(is_real, jnp.maximum(segments.cable.force(strain), 0.0), 0.0)
    return tensions_and_slip_signs(
        SlipProblem(
            stuck,
            segments.stuck_elongation,
            is_real,
            jnp.where(segments.clamped, jnp.inf, segments.bound),
            None,
            partial(elongations_and_flexibilities, segments),
            segments.jack,
        )
    )
