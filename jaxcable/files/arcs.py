"""Arcs of drawings, replaced by chords."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

_MOST_CHORDS = 1000  # of an arc, so that a tiny sagitta does not exhaust the memory


def arcs_to_chords(
    points: Sequence[tuple[float, float, float]], closed: bool, sagitta: float
) -> list[tuple[float, float]]:
    """Return the points (x, y) along a plane polyline, with each arc replaced by equal chords.

    Args:
        points: vertices (x, y, bulge); the bulge of a vertex is the tangent of a quarter of the
            angle of the arc to the next vertex, positive anticlockwise, zero for a straight
            segment.
        closed: whether a last segment joins the last vertex to the first one.
        sagitta: largest distance of an arc from its chords, in the unit of the points; at most 1000
            chords are made of an arc.
    """
    way: list[tuple[float, float]] = []
    following = [*points[1:], *points[:1]] if closed else points[1:]
    for (x, y, bulge), (x_next, y_next, _) in zip(points, following, strict=False):
        way.append((x, y))
        length = float(np.hypot(x_next - x, y_next - y))
        if bulge == 0 or length == 0 or not np.isfinite([bulge, length]).all():
            continue
        angle = 4.0 * float(np.arctan(bulge))
        radius = length / (2.0 * abs(float(np.sin(0.5 * angle))))
        step = 2.0 * float(np.arccos(max(1.0 - sagitta / radius, -1.0)))
        count = int(min(np.ceil(abs(angle) / step), _MOST_CHORDS)) if step > 0 else _MOST_CHORDS
        # the centre lies to the left of the middle of the chord, for a positive bulge below 1
        half = 0.5 * complex(x_next - x, y_next - y)
        centre = complex(x, y) + half * (1.0 + 1j / float(np.tan(0.5 * angle)))
        for k in range(1, count):
            point = centre + (complex(x, y) - centre) * np.exp(1j * angle * k / count)
            way.append((point.real, point.imag))
    last = points[0] if closed else points[-1]
    return [*way, (last[0], last[1])]


def points_along_entity(entity: Any, sagitta: float) -> list[tuple[float, float, float]]:
    """Return the points (x, y, z) along an ARC, or a plane POLYLINE or LWPOLYLINE, as a list.

    Args:
        entity: the entity of a drawing, an object of the library ezdxf.
        sagitta: largest distance of an arc from its chords, in units of the drawing, as the points.
    """
    kind = entity.dxftype()
    if kind == "ARC":
        (x, y, height), radius = entity.dxf.center, entity.dxf.radius
        first, last = np.radians([entity.dxf.start_angle, entity.dxf.end_angle])
        bulge = float(np.tan(0.25 * ((last - first) % (2 * np.pi))))
        ends = [(x + radius * np.cos(a), y + radius * np.sin(a)) for a in (first, last)]
        points, closed = [(*ends[0], bulge), (*ends[1], 0.0)], False
    elif kind == "LWPOLYLINE":
        points, closed = list(entity.get_points("xyb")), entity.closed
        height = entity.dxf.elevation
    else:
        places = [(vertex.dxf.location, vertex.dxf.bulge) for vertex in entity.vertices]
        points, closed = [(at.x, at.y, bulge) for at, bulge in places], entity.is_closed
        height = entity.dxf.elevation.z
    plane = [(x, y, height) for x, y in arcs_to_chords(points, closed, sagitta)]
    return [tuple(point) for point in entity.ocs().points_to_wcs(plane)]
