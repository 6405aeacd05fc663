"""Meshes of cross-sections: points [n, 2] (y, z) and cells [m, 4], NumPy on the host.

A cell is a quadrilateral, or a triangle whose last point is repeated. The fibre of a cell has the
cell's area and lies at its centroid.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from ..common.types import ArrayLike, Float, Int

Mesh: TypeAlias = 'tuple[Float[np.ndarray, "n_point 2"], Int[np.ndarray, "n_cell 4"]]'
"""Points and cells."""


def biunit_square_mesh(n_y: int, n_z: int) -> Mesh:
    """Return points and cells of the square from -1 to 1 in y and z, with `n_y` by `n_z` cells.

    Points are ordered by y, then by z; cells likewise. The corners of a cell are anticlockwise,
    from the one of least y and z.
    """
    y, z = np.meshgrid(np.linspace(-1, 1, n_y + 1), np.linspace(-1, 1, n_z + 1), indexing="ij")
    number = np.arange(y.size).reshape(y.shape)
    corners = (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    return np.column_stack([y.ravel(), z.ravel()]), np.stack(corners, -1).reshape(-1, 4)


def disc_mesh(n_y: int, n_z: int) -> Mesh:
    """Return points and cells of a disc of diameter 1, with the exact area of the circle.

    Squares about the centre become circles with equal angles between the points (Shirley and Chiu
    1997). The polygon is then scaled to the area pi/4 (by 0.41 % for 40 sides, 10 x 10 cells).

    Args:
        n_y, n_z: cells along the sides of the square that is mapped to the disc.
    """
    points, cells = biunit_square_mesh(n_y, n_z)
    a, b = points.T
    radius = np.maximum(np.abs(a), np.abs(b))
    wide = np.abs(a) >= np.abs(b)
    safe = np.where(radius > 0, np.where(wide, a, b), 1.0)
    angle = np.where(wide, np.pi / 4 * b / safe, np.pi / 2 - np.pi / 4 * a / safe)
    sign = np.where(safe < 0, -1.0, 1.0)  # the formulas hold for the half-planes a > 0, b > 0
    points = (0.5 * sign * radius)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return points * np.sqrt(np.pi / 4 / cell_areas(points, cells).sum()), cells


def polar_ring_mesh(
    n_radial: int, n_around: int
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 2"], Int[np.ndarray, "n_cell 4"]]:
    """Return points, without their radii, and cells of a ring whose radii may be traced.

    A point is at its radius times its direction.

    Args:
        n_radial, n_around: cells along a radius, and around.

    Returns:
        Position of the points between the inner (0) and the outer edge (1), [n]; direction from
        the centre, [n, 2], a little longer than 1, so that the polygons have the exact area of
        circles; cells, [n_cell, 4], four indices of points each.
    """
    fraction, angle = np.meshgrid(
        np.linspace(0, 1, n_radial + 1), 2 * np.pi * np.arange(n_around) / n_around, indexing="ij"
    )
    number = np.arange(fraction.size).reshape(fraction.shape)
    after = np.roll(number, -1, axis=1)
    corners = (number[:-1], number[1:], after[1:], after[:-1])
    longer = np.sqrt(2 * np.pi / n_around / np.sin(2 * np.pi / n_around))
    direction = longer * np.column_stack([np.cos(angle.ravel()), np.sin(angle.ravel())])
    return fraction.ravel(), direction, np.stack(corners, -1).reshape(-1, 4)


def polygon_mesh(
    outline: Float[np.ndarray, "n 2"], holes: Sequence[Float[np.ndarray, "_ 2"]], size: float
) -> Mesh:
    """Return points and cells of a polygon with holes; cells are not larger than `size`, m.

    The polygon is cut into strips parallel to y at every corner. Within a strip the edges do not
    cross, and the trapezoids between every other pair of edges are inside (even-odd rule).
    """
    edges = np.concatenate([np.stack([p, np.roll(p, -1, axis=0)], 1) for p in (outline, *holes)])
    edges = edges[edges[:, 0, 1] != edges[:, 1, 1]]  # an edge parallel to y is no side of a strip
    levels = np.unique(edges[:, :, 1])
    strips = itertools.pairwise(levels)
    parts = [np.linspace(a, b, _count_parts(b - a, size), endpoint=False) for a, b in strips]
    levels = np.concatenate([*parts, levels[-1:]])
    points, cells = [], []
    for low, high in itertools.pairwise(levels):
        middle = 0.5 * (low + high)
        hit = edges[(edges[:, :, 1].min(1) < middle) & (edges[:, :, 1].max(1) > middle)]
        bottom, centre, top = (_crossing_positions(hit, level) for level in (low, middle, high))
        order = np.argsort(centre)
        for left, right in order.reshape(-1, 2):
            widest = max(bottom[right] - bottom[left], top[right] - top[left])
            t = np.linspace(0, 1, _count_parts(widest, size) + 1)
            below = bottom[left] + t * (bottom[right] - bottom[left])
            above = top[left] + t * (top[right] - top[left])
            first = len(points)
            for y_below, y_above in zip(below, above, strict=True):
                points += [(y_below, low), (y_above, high)]
            for k in range(first, len(points) - 2, 2):
                cells.append((k, k + 2, k + 3, k + 1))
    return np.array(points), np.array(cells)


def split_into_triangles(cells: Int[np.ndarray, "n_cell 4"]) -> Int[np.ndarray, "n_triangle 4"]:
    """Split every quadrilateral into two triangles, along alternating diagonals.

    A triangle repeats its last point. Triangles among the cells stay as they are.
    """
    a, b, c, d = cells.T
    alternate = (np.arange(len(cells)) % 2 == 0)[:, None]
    first = np.where(alternate, np.column_stack([a, b, c, c]), np.column_stack([a, b, d, d]))
    second = np.where(alternate, np.column_stack([a, c, d, d]), np.column_stack([b, c, d, d]))
    out = np.stack([first, second], 1).reshape(-1, 4)
    return out[(out[:, 0] != out[:, 1]) & (out[:, 1] != out[:, 2]) & (out[:, 0] != out[:, 2])]


def cell_areas(
    points: Float[ArrayLike, "n_point 2"], cells: Int[np.ndarray, "m 4"]
) -> Float[ArrayLike, " m"]:
    """Return the area of every cell (indices of its four points), [m]."""
    return cell_moments(points, cells)[0]


def cell_moments(
    points: Float[ArrayLike, "n_point 2"], cells: Int[np.ndarray, "m 4"]
) -> tuple[Float[ArrayLike, " m"], Float[ArrayLike, "m 2"], Float[ArrayLike, "m 3"]]:
    """Return area [m], centroid [m, 2] and second moments [m, 3] of every cell.

    The second moments, integrals of ``z^2, y^2, y z``, are about axes through the centroid of the
    cell and exact (a cell is two triangles). `points` may be traced; cells may be clockwise or
    anticlockwise.
    """
    corner = points[cells]
    halves = (
        _triangle_moments(corner[:, 0], corner[:, 1], corner[:, 2]),
        _triangle_moments(corner[:, 0], corner[:, 2], corner[:, 3]),
    )
    area = halves[0][0] + halves[1][0]
    flat = area == 0  # a cell without area has no centroid
    centroid = sum(a[:, None] * c for a, c, _ in halves) / (area + flat)[:, None]
    second_moments = sum(
        a[:, None] * (squares + _coordinate_products(c - centroid)) for a, c, squares in halves
    )
    way_round = 1 - 2 * (area < 0)
    return abs(area), centroid, way_round[:, None] * second_moments


def _triangle_moments(a, b, c):
    """Return signed area [m], centroid [m, 2] and mean products [m, 3] of m triangles.

    The last are the means over the area of ``z^2, y^2, y z`` about the centroid. `a`, `b` and `c`
    are the corners (y, z) of all triangles, [m, 2] each.
    """
    u, v, centre = b - a, c - a, (a + b + c) / 3
    squares = sum(_coordinate_products(corner - centre) for corner in (a, b, c)) / 12
    return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]), centre, squares


def _coordinate_products(points):
    """Return the products ``z^2, y^2, y z``, [m, 3], of coordinates (y, z), [m, 2]."""
    return points[:, [1, 0, 0]] * points[:, [1, 0, 1]]


def _count_parts(length, size):
    """Return the least number of equal parts of a length that are not longer than `size`."""
    return max(1, int(np.ceil(length / size - 1e-9)))  # a quotient that is rounded up is whole


def _crossing_positions(edges, level):
    """Return the y at which the lines through edges cross the line ``z = level``, [n].

    `edges` are the ends (y, z) of the edges, [n, 2, 2]; none is parallel to y.
    """
    (y0, z0), (y1, z1) = edges[:, 0].T, edges[:, 1].T
    return y0 + (level - z0) / (z1 - z0) * (y1 - y0)
