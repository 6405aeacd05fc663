"""Outlines of a section, and their faults: edges that cross, holes outside, no area."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common import checks
from ..common.types import ArrayLike, Bool, Float


def corners(points: Float[ArrayLike, "n 2"], name: str) -> Float[np.ndarray, "n 2"]:
    """Corners of a polygon, checked, NumPy [n, 2]."""
    if checks.concrete(points) is None:
        raise ValueError(f"{name}: cannot be traced; use Section.mesh(points, cells, laws)")
    points = checks.floats(points, name)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise ValueError(f"{name}: expected shape [n, 2] with n >= 3, got {points.shape}")
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        k = int(finite.argmin())
        raise ValueError(f"{name}[{k}] = {points[k].tolist()}: must be finite")
    return np.asarray(points)


def signed_area(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, ""]:
    """Area of a polygon, positive if it is anticlockwise."""
    y, z = (points - points[0]).T
    return 0.5 * np.sum(y * np.roll(z, -1) - z * np.roll(y, -1))


def crossed(outline: Float[np.ndarray, "n 2"]) -> str | None:
    """The fault of a closed line [n, 2] in words, no area or a crossing; None if it is sound."""
    if _flat(outline):
        return "points: all on one line, which has no area"
    if (pair := _crossing(outline, outline)) is not None:
        where = _edges("points", outline, "points", outline, pair)
        return f"points: the line crosses itself: {where}; name its corners in turn"
    return None


def fault(outline: Float[np.ndarray, "n 2"], holes: Sequence[Float[np.ndarray, "_ 2"]]) -> str:
    """The fault in words of a polygon and its holes, [n, 2] each, whose areas do not add up."""
    named = {"points": outline} | {f"holes[{k}]": hole for k, hole in enumerate(holes)}
    for name, ring in named.items():
        if _flat(ring):
            return f"{name}: all on one line, which has no area"
    for name, ring in named.items():
        if (pair := _crossing(ring, ring)) is not None:
            what = "the outline" if name == "points" else "a hole"
            where = _edges(name, ring, name, ring, pair)
            return f"{name}: {what} crosses itself: {where}; name its corners in turn"
    names = list(named)
    for number, name in enumerate(names):
        for other in names[:number]:
            pair = _crossing(named[other], named[name])
            if pair is not None:
                where = _edges(other, named[other], name, named[name], pair)
                return f"{other}: a hole crosses it or another hole: {where}"
    for name, hole in list(named.items())[1:]:
        outside = ~inside(hole, outline)
        if outside.any():
            k = int(outside.argmax())
            return f"{name}[{k}] = {hole[k].tolist()}: outside of the outline"
    return "points, holes: the outline crosses itself, or a hole crosses it or another hole"


def _flat(ring):
    return np.linalg.matrix_rank(ring - ring[0], tol=1e-12 * np.abs(ring - ring[0]).max()) < 2


def _crossing(outline, other):
    """Indices of the first two edges that cross within their lengths, or None."""
    a, b = outline[:, None], np.roll(outline, -1, axis=0)[:, None]
    c, d = other[None], np.roll(other, -1, axis=0)[None]
    divided = _side(a, b, c) * _side(a, b, d) < 0
    found = np.argwhere(divided & (_side(c, d, a) * _side(c, d, b) < 0))
    return tuple(int(k) for k in found[0]) if len(found) else None


def _side(a, b, c):
    """Side of the line from a to b on which the point c lies: 1 left, 0 on it, -1 right."""
    ab, ac = b - a, c - a
    return np.sign(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])


def _edges(name, ring, other, around, pair):
    """Two edges that cross, in words."""
    (i, j), n, m = pair, len(ring), len(around)
    return (
        f"the edge from {name}[{i}] to {name}[{(i + 1) % n}] crosses that from {other}[{j}] to "
        f"{other}[{(j + 1) % m}]"
    )


def inside(
    points: Float[np.ndarray, "n 2"], ring: Float[np.ndarray, "m 2"]
) -> Bool[np.ndarray, " n"]:
    """Whether points are inside of a polygon, by the crossings of a ray, [n] bool."""
    a, b = ring[None], np.roll(ring, -1, axis=0)[None]
    y, z = points[:, None, 0], points[:, None, 1]
    spans = (a[..., 1] > z) != (b[..., 1] > z)
    rise = np.where(b[..., 1] == a[..., 1], 1.0, b[..., 1] - a[..., 1])
    at = a[..., 0] + (z - a[..., 1]) / rise * (b[..., 0] - a[..., 0])
    return (spans & (y < at)).sum(axis=1) % 2 == 1
