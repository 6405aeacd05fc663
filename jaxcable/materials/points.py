"""Rules for the points of a law: its strains and stresses, known numbers and traced ones."""

from __future__ import annotations

import numpy as np

from ..common import checks
from ..common.rules import Rule
from ..common.types import ArrayLike, Float


def rules(
    strain: Float[ArrayLike, " n"], stress: Float[ArrayLike, " n"], unloading: str
) -> list[Rule]:
    """Rules of strains and stresses, [n] each; the first broken rule names what is wrong."""
    values = strain, stress
    found = [
        Rule("strain", strain, lambda e: abs(e) == np.inf, "must be finite"),
        Rule("strain", strain, lambda e: e[1:] <= e[:-1], _order),
        Rule("strain", strain, lambda e: (e[0] > 0) | (e[-1] <= 0), _reach),
        Rule("stress", values, _misses_origin, _at_origin),
        Rule("stress", values, _not_rising, _slope_at_origin),
        Rule("stress", values, lambda e, s: s * e < 0, _sign),
    ]
    if unloading == "elastic":
        found += [
            Rule("stress", values, _convex, lambda index, *_: _concave([index[0] + 1])),
            Rule("stress", values, _falling, _concave),
            Rule("stress", values, _unequal, _pair),
        ]
    return found


def suspect(strain: Float[np.ndarray, " n"]) -> None:
    """Warn if strains, [n], look like percentages."""
    if np.abs(strain).max() > 1:
        k = int(np.abs(strain).argmax())
        text = f"strain[{k}] = {strain[k]:.6g}: more than 1; it is a ratio, not a percentage"
        checks.suspect(text)


def with_origin(
    e: Float[np.ndarray, " n"], s: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """The points in NumPy, with the origin inserted if it lies within a segment."""
    if np.isnan(e).any() or (e == 0).any():
        return e, s
    k = int(np.searchsorted(e, 0.0))
    return np.insert(e, k, 0.0), np.insert(s, k, 0.0)


def _same(dtype):
    """Relative difference up to which two stated numbers count as one."""
    return 1e-9 if np.finfo(dtype).eps < 1e-12 else 1e-4


def _slopes(e, s):
    return (s[1:] - s[:-1]) / (e[1:] - e[:-1])


def _stress_at_origin(e, s):
    """Stress of the curve at zero strain."""
    segment = (e[:-1] <= 0) & (e[1:] > 0)
    return (segment * (s[:-1] - e[:-1] * _slopes(e, s))).sum()


def _misses_origin(e, s):
    # a point at zero strain must have exactly zero stress; between two points there is rounding
    stated = (e == 0).any()
    return abs(_stress_at_origin(e, s)) > _same(s.dtype) * abs(s).max() * ~stated


def _at_origin(_, e, s):
    if (e == 0).any():
        k = int((e == 0).argmax())
        return f"stress[{k}] = {s[k]}: at zero strain the stress must be zero"
    value = _stress_at_origin(e, s)
    return f"stress: the curve has {value:.6g} Pa at zero strain; it must pass the origin"


def _not_rising(e, s):
    return (e[:-1] <= 0) & (e[1:] >= 0) & (_slopes(e, s) <= 0)


def _slope_at_origin(index, e, s):
    slope = _slopes(e, s)[index]
    return f"stress: the slope at the origin, {slope:.6g} Pa, must be positive"


def _order(index, e):
    k = index[0] + 1
    return f"strain[{k}] = {e[k]}: must be above strain[{k - 1}] = {e[k - 1]}"


def _reach(_, e):
    return f"strain: goes from {e[0]} to {e[-1]}; the points must pass the origin"


def _sign(index, e, s):
    return f"stress[{index[0]}] = {s[index]}: of the other sign than its strain, {e[index]}"


def _convex(e, s):
    """Corners, [n - 2], at which slopes rise going away from the origin."""
    slopes, corners = _slopes(e, s), e[1:-1]
    drops = (slopes[1:] - slopes[:-1]) * (1 - 2 * (corners > 0))
    return (drops < -_same(s.dtype) * slopes.max()) & (corners != 0)


def _falling(e, s):
    slopes = _slopes(e, s)
    return slopes < -_same(s.dtype) * slopes.max()


def _concave(index, *_):
    return (
        f"stress[{index[0]}]: elastic unloading needs a concave curve: slopes that fall away from "
        'the origin and not below zero; use unloading="reversible"'
    )


def _unequal(e, s):
    """Segments, counted from the origin, whose slopes differ in tension and compression."""
    slopes = _slopes(e, s)
    count = len(slopes)
    number = np.arange(count)
    pull, push = (e[1:] <= 0).sum() + number, (e < 0).sum() - 1 - number
    difference = abs(slopes[pull % count] - slopes[push % count])
    # slopes computed from stated points have rounding errors
    paired = (pull < count) & (push >= 0)
    return paired & (difference > 1e3 * _same(s.dtype) * slopes.max())


def _pair(index, e, s):
    slopes, k = _slopes(e, s), index[0]
    pull, push = slopes[(e[1:] <= 0).sum() + k], slopes[(e < 0).sum() - 1 - k]
    return (
        "stress: elastic unloading needs equal slopes in tension and compression; "
        f"segment {k} from the origin has {pull:.6g} and {push:.6g} Pa"
    )
