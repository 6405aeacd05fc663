"""Lowest and highest values along elements, of polynomials piece by piece."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..common.types import Float
from ..elements.bending import lobatto
from ..results.interpolation import interpolation_matrices

_FINE = 17  # places at which it is taken; between them are cubics, with errors of 1e-7
_NEAR = 1e-9  # of the largest value: what exceeds an end by less is rounding


class Extremes(NamedTuple):
    """Lowest and highest values along elements, and where they are, from 0 to 1.

    A place is NaN where the values are the same all along, and everything where there is no value.
    """

    low: Float[np.ndarray, " *shape"]
    low_at: Float[np.ndarray, " *shape"]
    high: Float[np.ndarray, " *shape"]
    high_at: Float[np.ndarray, " *shape"]


def interpolation(
    count: int, sloped: bool
) -> tuple[
    Float[np.ndarray, " n_fine"],
    Float[np.ndarray, "n_data n_fine"],
    Float[np.ndarray, "n_data n_fine"],
]:
    """The polynomial through values at `count` Gauss-Lobatto points, at many places.

    Returns:
        places: from 0 to 1, [n_fine], the points among them.
        values, slopes: matrices [n_data, n_fine] that give both there, from the data; see
            `results.between.interpolation_matrices`.
    """
    places = np.unique(np.concatenate([np.linspace(0.0, 1.0, _FINE), lobatto(count)[0]]))
    return places, *interpolation_matrices(count, sloped, tuple(places.tolist()))


def cubics(
    values: Float[np.ndarray, "*shape n_point"],
    slopes: Float[np.ndarray, "*shape n_point"],
    places: Float[np.ndarray, " n_point"],
) -> Float[np.ndarray, "*shape n_piece 4"]:
    """Coefficients of 1, t, t^2, t^3 of the cubics with given values and slopes at the places.

    From place to place t goes from 0 to 1.
    """
    size = np.diff(places)
    change, first = np.diff(values, axis=-1), slopes[..., :-1] * size
    last = slopes[..., 1:] * size
    third = first + last - 2 * change
    return np.stack([values[..., :-1], first, change - first - third, third], axis=-1)


def derivatives(
    cubic: Float[np.ndarray, "*shape n_piece 4"], places: Float[np.ndarray, " n_point"]
) -> Float[np.ndarray, "*shape n_piece 4"]:
    """Coefficients of the derivatives by the place of `cubics` between the places."""
    slope = np.zeros_like(cubic)
    slope[..., :3] = cubic[..., 1:] * [1, 2, 3]
    return slope / np.diff(places)[:, None]


def parabola(
    values: Float[np.ndarray, "*shape n_point"], places: Float[np.ndarray, " n_point"]
) -> Float[np.ndarray, "*shape 1 4"]:
    """Coefficients of one parabola from 0 to 1 through all values, which are on one."""
    powers = np.linalg.pinv(places[:, None] ** np.arange(3))
    quadratic = values @ powers.T
    return np.concatenate([quadratic, np.zeros_like(quadratic[..., :1])], axis=-1)[..., None, :]


def along(
    coefficients: Float[np.ndarray, "*shape n_piece 4"],
    places: Float[np.ndarray, " 1+n_piece"],
) -> Extremes:
    """`Extremes` of polynomials up to cubics between places."""
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
    at = places[:-1, None] + np.diff(places)[:, None] * t
    return among(values, at)


def among(
    values: Float[np.ndarray, "*shape n_piece n_place"],
    at: Float[np.ndarray, "*shape n_piece n_place"],
) -> Extremes:
    """`Extremes` of given values at places; of equal ones the first of a piece counts."""
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
