"""Outlines of a section, and messages on their faults: crossing edges, holes outside, no area."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common import checks
from ..common.types import ArrayLike, Bool, Float


def checked_corners(points: Float[ArrayLike, "n 2"], name: str) -> Float[np.ndarray, "n 2"]:
    """Check the corners of a polygon, and return them as NumPy [n, 2].

    Raises:
        ValueError: traced, not of shape [n, 2], fewer than three, or not finite; names `name`.
    """
    if checks.array_if_known(points) is None:
        raise ValueError(f"{name}: cannot be traced; use Section.mesh(points, cells, laws)")
    points = checks.as_floats(points, name)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise ValueError(f"{name}: expected shape [n, 2] with n >= 3, got {points.shape}")
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        k = int(finite.argmin())
        raise ValueError(f"{name}[{k}] = {points[k].tolist()}: must be finite")
    return np.asarray(points)


def signed_area(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, ""]:
    """Return the area of a polygon of corners (y, z), m2, positive if they are anticlockwise."""
    y, z = (points - points[0]).T
    return 0.5 * np.sum(y * np.roll(z, -1) - z * np.roll(y, -1))


def describe_line_fault(outline: Float[np.ndarray, "n 2"]) -> str | None:
    """Return a message if a closed line has no area or crosses itself; None if it is valid."""
    if _is_collinear(outline):
        return "points: all on one straight line, which encloses no area"
    if (pair := _first_crossing(outline, outline)) is not None:
        where = _describe_crossing("points", outline, "points", outline, pair)
        return f"points: the line crosses itself: {where}; list its corners in order"
    return None


def describe_polygon_fault(
    outline: Float[np.ndarray, "n 2"], holes: Sequence[Float[np.ndarray, "_ 2"]]
) -> str:
    """Return a message that says why the mesh of a polygon with holes has the wrong area.

    Args:
        outline: corners of the polygon.
        holes: corners of each hole.
    """
    named = {"points": outline} | {f"holes[{k}]": hole for k, hole in enumerate(holes)}
    for name, ring in named.items():
        if _is_collinear(ring):
            return f"{name}: all on one straight line, which encloses no area"
    for name, ring in named.items():
        if (pair := _first_crossing(ring, ring)) is not None:
            what = "the outline" if name == "points" else "a hole"
            where = _describe_crossing(name, ring, name, ring, pair)
            return f"{name}: {what} crosses itself: {where}; list its corners in order"
    names = list(named)
    for number, name in enumerate(names):
        for other in names[:number]:
            pair = _first_crossing(named[other], named[name])
            if pair is not None:
                where = _describe_crossing(other, named[other], name, named[name], pair)
                return f"{other}: a hole crosses it or another hole: {where}"
    for name, hole in list(named.items())[1:]:
        outside = ~points_inside(hole, outline)
        if outside.any():
            k = int(outside.argmax())
            return f"{name}[{k}] = {hole[k].tolist()}: outside of the outline"
    return "points, holes: the outline crosses itself, or a hole crosses it or another hole"


def _is_collinear(ring):
    """Return whether all points are on one line (to 1e-12 of their distances)."""
    return np.linalg.matrix_rank(ring - ring[0], tol=1e-12 * np.abs(ring - ring[0]).max()) < 2


def _first_crossing(outline, other):
    """Return the indices of the first two edges that cross, one of each outline; None without.

    `outline` and `other`, which may be the same, are corners (y, z), [n, 2] and [m, 2], m.
    """
    a, b = outline[:, None], np.roll(outline, -1, axis=0)[:, None]
    c, d = other[None], np.roll(other, -1, axis=0)[None]
    divided = _side_of_line(a, b, c) * _side_of_line(a, b, d) < 0
    found = np.argwhere(divided & (_side_of_line(c, d, a) * _side_of_line(c, d, b) < 0))
    return tuple(int(k) for k in found[0]) if len(found) else None


def _side_of_line(a, b, c):
    """Return on which side of the line from a to b the point c is: 1 left, 0 on it, -1 right."""
    ab, ac = b - a, c - a
    return np.sign(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])


def _describe_crossing(name, ring, other_name, other_ring, pair):
    """Return the words on two edges that cross, whose indices are the `pair`, in two outlines."""
    (i, j), n, m = pair, len(ring), len(other_ring)
    return (
        f"the edge from {name}[{i}] to {name}[{(i + 1) % n}] crosses that from "
        f"{other_name}[{j}] to {other_name}[{(j + 1) % m}]"
    )


def points_inside(
    points: Float[np.ndarray, "n 2"], ring: Float[np.ndarray, "m 2"]
) -> Bool[np.ndarray, " n"]:
    """Return which points are inside a polygon of corners `ring`, by crossings of a ray."""
    a, b = ring[None], np.roll(ring, -1, axis=0)[None]
    y, z = points[:, None, 0], points[:, None, 1]
    spans = (a[..., 1] > z) != (b[..., 1] > z)
    rise = np.where(b[..., 1] == a[..., 1], 1.0, b[..., 1] - a[..., 1])
    at = a[..., 0] + (z - a[..., 1]) / rise * (b[..., 0] - a[..., 0])
    return (spans & (y < at)).sum(axis=1) % 2 == 1
