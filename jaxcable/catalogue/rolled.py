"""Cells of rolled and hollow sections, with their rounded corners: I, U, L, rectangles and circles.

Each function returns quadrilaterals in axes of its own, in m: the web of an I and of a U along z,
the legs of an L along y and z from the heel. `size` is the largest side of the cells that have
straight sides only.
"""

from __future__ import annotations

import numpy as np

from .quads import Quad, fillet, quad, split_quad


def i_cells(h: float, b: float, tw: float, tf: float, r: float, size: float) -> list[Quad]:
    """Return the cells of a doubly symmetric I: height `h` and width `b`, fillets of radius `r`.

    `tw` and `tf` are the thicknesses of web and flanges, m.
    """
    w, inner = tw / 2, h / 2 - tf
    flange = split_quad((-b / 2, inner), (b / 2, inner), (b / 2, h / 2), (-b / 2, h / 2), size)
    root = fillet((w, inner), (1.0, 0.0), (0.0, -1.0), r)
    upper = [*flange, root, root.mirrored(y=-1)]
    web = split_quad((-w, -inner), (w, -inner), (w, inner), (-w, inner), size)
    return [*web, *upper, *(cell.mirrored(z=-1) for cell in upper)]


def u_cells(
    h: float, b: float, tw: float, tf: float, r: float, r2: float, slope: float, size: float
) -> list[Quad]:
    """Return the cells of a U whose web begins at y = 0.

    Args:
        h, b: height, and width of the flanges.
        tw, tf: thicknesses of the web and of the flanges, the latter at `flange_thickness_at`.
        r, r2: radii of the fillets, and of the rounded toes (0: none).
        slope: of the inner faces of the flanges; 0 if they are parallel.
        size: largest side of the cells with straight sides.
    """
    at = flange_thickness_at(h, b, tw)

    def inner(y):
        return h / 2 - tf - slope * (at - y)

    along = np.array([1.0, slope]) / np.hypot(1.0, slope)
    root = fillet((tw, inner(tw)), along, (0.0, -1.0), r)
    web = split_quad((0.0, -h / 2), (tw, -h / 2), (tw, h / 2), (0.0, h / 2), size)
    if not r2:
        tip, toe = b, []
    else:
        # the arc touches the end of the flange and its inner face
        low = inner(b) + r2 * (np.hypot(1.0, slope) - slope)
        center = (b - r2, low)
        tip = b - r2 + r2 * along[1]
        toe = [quad((tip, h / 2), (b, h / 2), (b, low), (tip, inner(tip)), arc2=center)]
    flange = split_quad((tw, inner(tw)), (tip, inner(tip)), (tip, h / 2), (tw, h / 2), size)
    upper = [*flange, root, *toe]
    return [*web, *upper, *(cell.mirrored(z=-1) for cell in upper)]


def flange_thickness_at(h: float, b: float, tw: float) -> float:
    """Return the distance from the back of a UPN where its flange thickness is measured, m."""
    return b / 2 if h <= 0.3 else (b + tw) / 2


def l_cells(a: float, t: float, r: float, r2: float, size: float) -> list[Quad]:
    """Return the cells of an equal angle of legs `a` and thickness `t` whose heel is the origin.

    `r` is the radius of its fillet, and `r2` that of its toes.
    """
    leg = split_quad((0.0, t), (t, t), (t, a - r2), (0.0, a - r2), size)
    toe = quad((0.0, a - r2), (t, a - r2), (t - r2, a), (0.0, a), arc1=(t - r2, a - r2))
    standing = [*leg, toe]
    lying = [Quad(cell.corners[:, ::-1], cell.centers[:, ::-1]) for cell in standing]
    heel = quad((0.0, 0.0), (t, 0.0), (t, t), (0.0, t))
    return [heel, *standing, *lying, fillet((t, t), (1.0, 0.0), (0.0, 1.0), r)]


def rectangular_cells(
    h: float, b: float, t: float, outer: float, inner: float, size: float
) -> list[Quad]:
    """Return the cells of a rectangular hollow section of height `h` and width `b`.

    `t` is the wall thickness; `outer` and `inner` are the radii of the corners, m.
    """
    y, z = b / 2, h / 2
    wall = split_quad(
        (-(y - outer), z), (y - outer, z), (y - t - inner, z - t), (-(y - t - inner), z - t), size
    )
    side = split_quad(
        (y, -(z - outer)), (y, z - outer), (y - t, z - t - inner), (y - t, -(z - t - inner)), size
    )
    out, into = (y - outer, z - outer), (y - t - inner, z - t - inner)
    diagonal = np.sqrt(0.5)
    far, near = (
        (out[0] + outer * diagonal, out[1] + outer * diagonal),
        (
            into[0] + inner * diagonal,
            into[1] + inner * diagonal,
        ),
    )
    upper = quad((y - outer, z), far, near, (into[0], z - t), arc0=out, arc2=into)
    lower = quad(far, (y, z - outer), (y - t, into[1]), near, arc0=out, arc2=into)
    corners = [cell.mirrored(s, c) for cell in (upper, lower) for s in (1, -1) for c in (1, -1)]
    pairs = [*wall, *(cell.mirrored(z=-1) for cell in wall)]
    return [*pairs, *side, *(cell.mirrored(y=-1) for cell in side), *corners]


def circular_cells(d: float, t: float, size: float) -> list[Quad]:
    """Return the cells of a circular hollow section, one through the wall.

    `d` is the outer diameter and `t` the wall thickness, m; 16 cells or more are around it.
    """
    count = max(16, int(np.ceil(np.pi * d / size - 1e-9)))
    angle = 2 * np.pi * np.arange(count + 1) / count
    way = np.column_stack([np.cos(angle), np.sin(angle)])
    outer, inner = d / 2 * way, (d / 2 - t) * way
    zero = (0.0, 0.0)
    return [
        quad(inner[k], outer[k], outer[k + 1], inner[k + 1], arc1=zero, arc3=zero)
        for k in range(count)
    ]
