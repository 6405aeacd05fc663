"""Rules for the points of a law: its strains and stresses, known numbers and traced ones."""

from __future__ import annotations

import numpy as np

from ..common import checks
from ..common.rules import Rule
from ..common.types import ArrayLike, Float


def point_rules(
    strain: Float[ArrayLike, " n"], stress: Float[ArrayLike, " n"], unloading: str
) -> list[Rule]:
    """Return the conditions on the points of a `Polygonal` law, in the order of checking.

    Strains are finite and increase, and the curve goes through the origin, rises there, and has
    stresses of the sign of the strain. With elastic unloading it does not fall, is concave away
    from the origin, and has the same slope on both sides of it. Of several that are broken, the
    first is reported. `unloading` is "reversible" or "elastic".
    """
    values = strain, stress
    found = [
        Rule("strain", strain, lambda e: abs(e) == np.inf, "must be finite"),
        Rule("strain", strain, lambda e: e[1:] <= e[:-1], _strain_order_message),
        Rule("strain", strain, lambda e: (e[0] > 0) | (e[-1] <= 0), _origin_outside_message),
        Rule("stress", values, _misses_origin, _missed_origin_message),
        Rule("stress", values, _does_not_rise_at_origin, _origin_slope_message),
        Rule("stress", values, lambda e, s: s * e < 0, _stress_sign_message),
    ]
    if unloading == "elastic":
        found += [
            Rule(
                "stress",
                values,
                _is_convex_corner,
                lambda index, *_: _concavity_message([index[0] + 1]),
            ),
            Rule("stress", values, _is_falling, _concavity_message),
            Rule("stress", values, _has_unequal_slopes, _unequal_slopes_message),
        ]
    return found


def warn_if_percent(strain: Float[np.ndarray, " n"]) -> None:
    """Warn if the magnitude of a strain is above 1: it has probably been given in percent."""
    if np.abs(strain).max() > 1:
        k = int(np.abs(strain).argmax())
        text = f"strain[{k}] = {strain[k]:.6g}: more than 1; it is a ratio, not a percentage"
        checks.warn_user(text)


def insert_origin(
    e: Float[np.ndarray, " n"], s: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Insert the origin (0, 0) between points of increasing strains `e` and of stresses `s`, Pa.

    Points that have zero strain among them, or NaN as in traced input, are returned as they are.
    """
    if np.isnan(e).any() or (e == 0).any():
        return e, s
    k = int(np.searchsorted(e, 0.0))
    return np.insert(e, k, 0.0), np.insert(s, k, 0.0)


def _relative_tolerance(dtype):
    """Return the relative difference up to which two given numbers count as equal.

    Users give numbers with some digits only; float32 keeps seven of them.
    """
    return 1e-9 if np.finfo(dtype).eps < 1e-12 else 1e-4


def _segment_slopes(e, s):
    """Return the slopes between neighboring points of strains e and stresses s, Pa, [n - 1]."""
    return (s[1:] - s[:-1]) / (e[1:] - e[:-1])


def _stress_at_origin(e, s):
    """Return the stress, Pa, at zero strain on the polygon of strains e and stresses s.

    It is 0 if the strains do not contain zero.
    """
    segment = (e[:-1] <= 0) & (e[1:] > 0)
    return (segment * (s[:-1] - e[:-1] * _segment_slopes(e, s))).sum()


def _misses_origin(e, s):
    """Return whether the curve through strains e and stresses s misses the origin."""
    # a point at zero strain must have exactly zero stress; between two points there is rounding
    stated = (e == 0).any()
    return abs(_stress_at_origin(e, s)) > _relative_tolerance(s.dtype) * abs(s).max() * ~stated


def _missed_origin_message(_, e, s):
    """Return the message that the curve misses the origin, with its stress there.

    The first argument, an index, is not used; `e` and `s` are strains and stresses, Pa.
    """
    if (e == 0).any():
        k = int((e == 0).argmax())
        return f"stress[{k}] = {s[k]}: at zero strain the stress must be zero"
    value = _stress_at_origin(e, s)
    return f"stress: the curve has {value:.6g} Pa at zero strain; it must pass the origin"


def _does_not_rise_at_origin(e, s):
    """Return which segments at the origin, or over it, are level or fall, [n - 1] bool."""
    return (e[:-1] <= 0) & (e[1:] >= 0) & (_segment_slopes(e, s) <= 0)


def _origin_slope_message(index, e, s):
    """Return the message that the slope at the origin must be positive.

    `index` is that of the segment, a tuple of one; `e` and `s` are strains and stresses.
    """
    slope = _segment_slopes(e, s)[index]
    return f"stress: the slope at the origin, {slope:.6g} Pa, must be positive"


def _strain_order_message(index, e):
    """Return the message that strains must increase from point to point.

    `index` is that of the segment whose strain does not, a tuple of one; `e` are the strains.
    """
    k = index[0] + 1
    return f"strain[{k}] = {e[k]}: must be above strain[{k - 1}] = {e[k - 1]}"


def _origin_outside_message(_, e):
    """Return the message that the strains `e` must go from zero or below to above zero."""
    return f"strain: goes from {e[0]} to {e[-1]}; the points must pass the origin"


def _stress_sign_message(index, e, s):
    """Return the message that a stress has another sign than its strain.

    `index` is that of the point, a tuple of one; `e` and `s` are strains and stresses, Pa.
    """
    return f"stress[{index[0]}] = {s[index]}: of the other sign than its strain, {e[index]}"


def _is_convex_corner(e, s):
    """Return at which inner points the slope rises away from the origin, [n - 2] bool.

    At the origin itself it is False. `e` and `s` are strains and stresses, Pa, of the points, [n].
    """
    slopes, corners = _segment_slopes(e, s), e[1:-1]
    drops = (slopes[1:] - slopes[:-1]) * (1 - 2 * (corners > 0))
    return (drops < -_relative_tolerance(s.dtype) * slopes.max()) & (corners != 0)


def _is_falling(e, s):
    """Return which segments have a stress that falls as strain grows, [n - 1] bool."""
    slopes = _segment_slopes(e, s)
    return slopes < -_relative_tolerance(s.dtype) * slopes.max()


def _concavity_message(index, *_):
    """Return the message that elastic unloading needs a concave curve.

    `index` is that of the stress to be named, a tuple or list of one.
    """
    return (
        f"stress[{index[0]}]: elastic unloading needs a concave curve: slopes that fall away from "
        'the origin and not below zero; use unloading="reversible"'
    )


def _has_unequal_slopes(e, s):
    """Return which segments have another slope in tension than in compression, [n - 1] bool.

    Segments are counted from the origin in both directions.
    """
    slopes = _segment_slopes(e, s)
    count = len(slopes)
    number = np.arange(count)
    pull, push = (e[1:] <= 0).sum() + number, (e < 0).sum() - 1 - number
    difference = abs(slopes[pull % count] - slopes[push % count])
    # slopes computed from stated points have rounding errors
    paired = (pull < count) & (push >= 0)
    return paired & (difference > 1e3 * _relative_tolerance(s.dtype) * slopes.max())


def _unequal_slopes_message(index, e, s):
    """Return the message that elastic unloading needs equal slopes in both directions.

    `index` is the number of the segments from the origin, a tuple of one.
    """
    slopes, k = _segment_slopes(e, s), index[0]
    pull, push = slopes[(e[1:] <= 0).sum() + k], slopes[(e < 0).sum() - 1 - k]
    return (
        "stress: elastic unloading needs equal slopes in tension and compression; "
        f"segment {k} from the origin has {pull:.6g} and {push:.6g} Pa"
    )
