"""Minimum and maximum of values along elements, of piecewise polynomials."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..common.types import Float
from ..elements.bending import gauss_lobatto
from ..results.interpolation import lobatto_interpolation_matrices

# Number of places at which a polynomial is replaced by cubics. Their error falls with the fourth
# power of the distance: a moment of degree 5 is met within 1e-7.
_FINE = 17
_NEAR = 1e-9  # of the largest value: what exceeds the value at an end by less is rounding


class Extremes(NamedTuple):
    """Minimum and maximum of values along elements, and their places.

    Attributes:
        low, high: smallest and largest value, [...]; NaN where there is no value.
        low_at, high_at: their places along the element, from 0 to 1, [...]; NaN also where all
            values are equal.
    """

    low: Float[np.ndarray, " *shape"]
    low_at: Float[np.ndarray, " *shape"]
    high: Float[np.ndarray, " *shape"]
    high_at: Float[np.ndarray, " *shape"]


def fine_places_and_slope_matrix(
    count: int,
) -> tuple[Float[np.ndarray, " n_fine"], Float[np.ndarray, "n_point n_fine"]]:
    """Return many places along elements, from 0 to 1, and a matrix that gives slopes there.

    Values [..., n_point] at `count` Gauss-Lobatto points, which are among the places, times the
    matrix are the slopes, with respect to the place, of the polynomial through them.
    """
    places = np.unique(np.concatenate([np.linspace(0.0, 1.0, _FINE), gauss_lobatto(count)[0]]))
    return places, lobatto_interpolation_matrices(count, False, tuple(places.tolist()))[1]


def hermite_cubic_coefficients(
    values: Float[np.ndarray, "*shape n_point"],
    slopes: Float[np.ndarray, "*shape n_point"],
    places: Float[np.ndarray, " n_point"],
) -> Float[np.ndarray, "*shape n_piece 4"]:
    """Return the cubics between neighboring places with given values and slopes there.

    Args:
        values: values at the places.
        slopes: derivatives with respect to the place.
        places: along the element, from 0 to 1, ascending.

    Returns:
        Coefficients of 1, t, t^2, t^3 along the last axis; t goes from 0 to 1 between two places.
    """
    size = np.diff(places)
    change, first = np.diff(values, axis=-1), slopes[..., :-1] * size
    last = slopes[..., 1:] * size
    third = first + last - 2 * change
    return np.stack([values[..., :-1], first, change - first - third, third], axis=-1)


def cubic_derivatives(
    cubic: Float[np.ndarray, "*shape n_piece 4"], places: Float[np.ndarray, " n_point"]
) -> Float[np.ndarray, "*shape n_piece 4"]:
    """Return the coefficients of the derivatives of cubics with respect to the place.

    `cubic` are those of cubics, as of `hermite_cubic_coefficients`. The last of the four is zero.
    """
    slope = np.zeros_like(cubic)
    slope[..., :3] = cubic[..., 1:] * [1, 2, 3]
    return slope / np.diff(places)[:, None]


def fit_parabola(
    values: Float[np.ndarray, "*shape n_point"], places: Float[np.ndarray, " n_point"]
) -> Float[np.ndarray, "*shape 1 4"]:
    """Return the parabola that fits the values at `places`, from 0 to 1, by least squares.

    It is a single piece as of `hermite_cubic_coefficients`: the coefficients of 1, t, t^2 and t^3,
    the last zero, where t is the place.
    """
    powers = np.linalg.pinv(places[:, None] ** np.arange(3))
    quadratic = values @ powers.T
    return np.concatenate([quadratic, np.zeros_like(quadratic[..., :1])], axis=-1)[..., None, :]


def merge_piece_ends(
    places: Float[np.ndarray, " 1+n_piece"], cuts: Float[np.ndarray, "*shape n_cut"]
) -> Float[np.ndarray, "*shape 1+n_more"]:
    """Return the ends of pieces after cuts at further places, sorted; n_more = n_piece + n_cut.

    Args:
        places: ends of the pieces before, from 0 to 1, ascending.
        cuts: places of the cuts of each element, in any order; equal ones make pieces of length
            zero.
    """
    every = np.broadcast_to(places, (*cuts.shape[:-1], len(places)))
    # rules keep places of loads within elements: rounding may put one beyond an end
    return np.sort(np.concatenate([every, np.clip(cuts, 0.0, 1.0)], axis=-1), axis=-1)


def split_cubics(
    cubic: Float[np.ndarray, "*shape n_piece 4"],
    places: Float[np.ndarray, " 1+n_piece"],
    ends: Float[np.ndarray, "*#shape 1+n_more"],
) -> Float[np.ndarray, "*shape n_more 4"]:
    """Return the coefficients of piecewise cubics on smaller pieces.

    Args:
        cubic: coefficients of each piece, as of `hermite_cubic_coefficients`.
        places: ends of these pieces, ascending.
        ends: ends of the smaller pieces of each element, as of `merge_piece_ends`.
    """
    start, size = ends[..., :-1], np.diff(ends)
    whole = np.searchsorted(places, start + size / 2, side="right") - 1
    whole = np.clip(whole, 0, len(places) - 2)  # the piece that each part is of
    width = np.diff(places)[whole]
    t, part = (start - places[whole]) / width, size / width
    index = np.broadcast_to(whole, (*cubic.shape[:-2], whole.shape[-1]))[..., None]
    zero, one, two, three = np.moveaxis(np.take_along_axis(cubic, index, axis=-2), -1, 0)
    value = zero + t * (one + t * (two + t * three))
    slope = one + t * (2 * two + 3 * t * three)
    powers = [value, part * slope, part**2 * (two + 3 * t * three), part**3 * three]
    return np.stack(powers, axis=-1)


def add_linear_terms(
    cubic: Float[np.ndarray, "*shape n_piece 4"],
    starts: Float[np.ndarray, "*shape n_piece"],
    ends: Float[np.ndarray, "*shape n_piece"],
) -> Float[np.ndarray, "*shape n_piece 4"]:
    """Return piecewise cubics plus, in each piece, the line between two values at its ends.

    `cubic` are coefficients as of `hermite_cubic_coefficients`; `starts` and `ends` are the values
    at t = 0 and 1.
    """
    found = cubic.copy()
    found[..., 0] += starts
    found[..., 1] += ends - starts
    return found


def polynomial_extremes(
    coefficients: Float[np.ndarray, "*shape n_piece 4"],
    places: Float[np.ndarray, "*#shape 1+n_piece"],
) -> Extremes:
    """Return the `Extremes` of piecewise cubics.

    Args:
        coefficients: coefficients of each piece, as of `hermite_cubic_coefficients`.
        places: ends of the pieces, ascending; the same for all elements, or their own.
    """
    _, one, two, three = np.moveaxis(coefficients, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        # both roots of the slope; this form keeps the digits of the smaller one
        half = -(two + np.copysign(np.sqrt(two**2 - 3 * three * one), two))
        roots = np.stack([half / (3 * three), one / half], axis=-1)
    inside = (roots > 0) & (roots < 1)
    ends = np.broadcast_to([0.0, 1.0], roots.shape)
    t = np.concatenate([ends, np.where(inside, roots, 0.0)], axis=-1)
    c = coefficients[..., None, :]
    values = c[..., 0] + t * (c[..., 1] + t * (c[..., 2] + t * c[..., 3]))
    at = places[..., :-1, None] + np.diff(places)[..., None] * t
    return sampled_extremes(values, at)


def sampled_extremes(
    values: Float[np.ndarray, "*shape n_piece n_place"],
    at: Float[np.ndarray, "*shape n_piece n_place"],
) -> Extremes:
    """Return the `Extremes` of values at discrete places, over all pieces of an element.

    Args:
        values: values at several places of each piece.
        at: places along the element, from 0 to 1; of equal values the first place counts.
    """
    shape = (*values.shape[:-2], values.shape[-2] * values.shape[-1])
    # ends of all pieces come before places between them
    values = np.swapaxes(values, -1, -2).reshape(shape)
    at = np.swapaxes(np.broadcast_to(at, (*values.shape[:-1], *at.shape[-2:])), -1, -2)
    at = at.reshape(shape)
    near = _NEAR * np.nanmax(np.abs(values), initial=0.0)
    low, high = values.min(axis=-1), values.max(axis=-1)
    varies = high - low > near

    def place(close):
        first = np.take_along_axis(at, close.argmax(axis=-1)[..., None], axis=-1)[..., 0]
        return np.where(varies, first, np.nan)

    return Extremes(
        low,
        place(values <= (low + near)[..., None]),
        high,
        place(values >= (high - near)[..., None]),
    )
