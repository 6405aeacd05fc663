"""Quadrilaterals whose sides are lines or circular arcs: cells of rolled sections, with moments.

A rolled section is a few rectangles with rounded corners. Its cells have the arcs as sides, so that
area and second moments are exact with few cells.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np

from ..common.types import ArrayLike, Float

Point: TypeAlias = ArrayLike
"""Coordinates (y, z) of a point, or a vector, [2]."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1), 0.5 * _WEIGHTS
"""Gauss points on a side from 0 to 1: exact for lines; for arcs up to 90 degrees to rounding."""


@dataclasses.dataclass(frozen=True)
class Quad:
    """A quadrilateral; some of its sides may be circular arcs.

    Attributes:
        corners: four points (y, z) in order, [4, 2], m.
        centers: center (y, z) of the arc from corner k to the next one, [4, 2], m; NaN for a line.
    """

    corners: Float[np.ndarray, "4 2"]
    centers: Float[np.ndarray, "4 2"]

    def mirrored(self, y: float = 1.0, z: float = 1.0) -> Quad:
        """Return the quadrilateral with coordinates times `y` and `z`, which are 1 or -1."""
        return Quad(self.corners * (y, z), self.centers * (y, z))


def quad(*corners: Point, **arcs: Point) -> Quad:
    """Make a quadrilateral of four corners (y, z).

    Args:
        corners: four points, m.

    Options:
        arcs: center of the arc from corner k to the next one, by the name ``arc<k>``.
    """
    centers = np.full((4, 2), np.nan)
    for name, center in arcs.items():
        centers[int(name.removeprefix("arc"))] = center
    return Quad(np.array(corners, float), centers)


def split_quad(
    a: Point,
    b: Point,
    c: Point,
    d: Point,
    size: float,
) -> list[Quad]:
    """Divide a quadrilateral with straight sides into cells whose sides are at most `size`, m."""
    corners = np.array([a, b, c, d], float)
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    n_u, n_v = (max(1, int(np.ceil(max(sides[k], sides[k + 2]) / size - 1e-9))) for k in (0, 1))
    u, v = np.linspace(0, 1, n_u + 1)[:, None, None], np.linspace(0, 1, n_v + 1)[None, :, None]
    low, high = (1 - u) * corners[0] + u * corners[1], (1 - u) * corners[3] + u * corners[2]
    grid = (1 - v) * low + v * high
    return [
        quad(grid[i, j], grid[i + 1, j], grid[i + 1, j + 1], grid[i, j + 1])
        for i in range(n_u)
        for j in range(n_v)
    ]


def fillet(
    corner: Point,
    first: Point,
    second: Point,
    radius: float,
) -> Quad:
    """Make the fillet in a reentrant corner.

    Args:
        corner: point (y, z) where the two faces would meet, m.
        first, second: unit vectors along the faces, away from the corner.
        radius: of the fillet, m.
    """
    p, d1, d2 = np.array(corner), np.array(first), np.array(second)
    half = 0.5 * np.arccos(d1 @ d2)
    bisector = (d1 + d2) / np.linalg.norm(d1 + d2)
    center = p + bisector * radius / np.sin(half)
    along = radius / np.tan(half)
    middle = center - radius * bisector
    return quad(p, p + along * d1, middle, p + along * d2, arc1=center, arc2=center)


def quad_moments(
    quads: Iterable[Quad],
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 2"], Float[np.ndarray, "m 3"]]:
    """Return area [m], centroid [m, 2] and second moments [m, 3] of m quadrilaterals.

    The second moments, integrals of ``z^2, y^2, y z``, are about axes through the centroid of each;
    the order of the corners, clockwise or not, has no influence. The integrals are those of Green's
    theorem along the sides.
    """
    quads = list(quads)
    corners = np.array([one.corners for one in quads])
    origin = corners[:, :1]
    begin = corners - origin
    end = np.roll(begin, -1, axis=1)
    center = np.array([one.centers for one in quads]) - origin
    is_arc = ~np.isnan(center[..., 0])
    arm, last = (np.nan_to_num(points - center) for points in (begin, end))
    angle = np.arctan2(
        arm[..., 0] * last[..., 1] - arm[..., 1] * last[..., 0], (arm * last).sum(-1)
    )
    turn = angle[..., None] * _NODES
    cos, sin = np.cos(turn)[..., None], np.sin(turn)[..., None]
    across = np.stack([-arm[..., 1], arm[..., 0]], -1)
    on_arc = (
        np.nan_to_num(center)[..., None, :] + cos * arm[..., None, :] + sin * across[..., None, :]
    )
    arc_slope = angle[..., None, None] * (cos * across[..., None, :] - sin * arm[..., None, :])
    on_line = begin[..., None, :] + _NODES[:, None] * (end - begin)[..., None, :]
    chosen = is_arc[..., None, None]
    (y, z), (dy, dz) = (
        np.moveaxis(values, -1, 0)
        for values in (
            np.where(chosen, on_arc, on_line),
            np.where(chosen, arc_slope, (end - begin)[..., None, :]),
        )
    )
    terms = [y * dz, y * y * dz / 2, -z * z * dy / 2, -(z**3) * dy / 3, y**3 * dz / 3]
    terms.append(y * y * z * dz / 2)
    area, y_area, z_area, z2, y2, yz = np.stack([(t @ _WEIGHTS).sum(-1) for t in terms])
    centroid = np.stack([y_area, z_area], -1) / area[:, None]
    y0, z0 = centroid.T
    own = np.stack([z2 - area * z0**2, y2 - area * y0**2, yz - area * y0 * z0], -1)
    way_round = np.sign(area)
    return way_round * area, centroid + origin[:, 0], way_round[:, None] * own
