"""Torsion constants: rectangles, closed cells of thin walls, and which sections are round."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import nan_if_broken, positive
from ..common.types import ArrayLike, Bool, Float
from . import outlines


def rectangle_torsion(
    width: Float[ArrayLike, ""], height: Float[ArrayLike, ""]
) -> Float[ArrayLike, ""]:
    """Return the torsion constant of a rectangle, m4, by Saint-Venant's series.

    Source: Timoshenko and Goodier, Theory of Elasticity, art. 109.
    """
    pack = np if isinstance(width, float) and isinstance(height, float) else jnp
    short, long = pack.minimum(width, height), pack.maximum(width, height)
    n = np.arange(1, 40, 2)
    series = pack.sum(pack.tanh(n * (np.pi / 2) * long / short) / n.astype(float) ** 5)
    # the terms that the sum leaves out, in all of which tanh is 1; 31/32 zeta(5) is the full sum
    rest = 31 / 32 * 1.0369277551433699 - np.sum(1 / n.astype(float) ** 5)
    return long * short**3 / 3 * (1 - 192 / np.pi**5 * short / long * (series + rest))


def bredt_torsion(
    points: Float[ArrayLike, "n 2"], thickness: Float[ArrayLike, "#n"]
) -> Float[ArrayLike, ""]:
    """Return the torsion constant of a closed thin-walled cell, ``4 A^2 / sum(l / t)``.

    ``A`` is the area inside the middle line of the walls. The contribution of the walls as open
    strips, ``sum l t^3 / 3``, is left out: it is smaller by the square of thickness over width.
    Both arguments may be traced.

    Args:
        points: corners (y, z) of the middle line in order, clockwise or anticlockwise, [n, 2], m.
        thickness: of the walls, m; a scalar, or [n], where entry k is the thickness of the wall
            from ``points[k]`` to the next corner.

    Returns:
        Scalar, m4.

    Raises:
        ValueError: wrong shapes, a thickness that is not positive, a line that crosses itself or
            has no area inside.

    Source: Bredt (1896); Timoshenko and Goodier, Theory of Elasticity, art. 115.

    Example:
        A box of 200 x 200 x 10 mm welded of four plates; the separate plates have 2.5e-7 m4:

        >>> middle = [[-0.095, -0.095], [0.095, -0.095], [0.095, 0.095], [-0.095, 0.095]]
        >>> J = jc.sections.bredt_torsion(middle, thickness=0.01)  # t a^3
        >>> print(f"{J:.3e} m4")
        6.859e-05 m4
        >>> steel = jc.Elastic(210e9)
        >>> flange = jc.Section.rectangle(0.2, 0.01, steel)
        >>> side = jc.Section.rectangle(0.01, 0.18, steel)
        >>> plates = [flange.shifted(z=z) for z in (-0.095, 0.095)]
        >>> plates += [side.shifted(y=y) for y in (-0.095, 0.095)]
        >>> box = jc.Section.composite(plates, torsion=J)
        >>> print(f"{box.torsional_stiffness() / 1e6:.2f} MN m2")  # G J
        5.54 MN m2
    """
    points, thickness = checks.as_floats(points, "points"), checks.as_floats(thickness, "thickness")
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise ValueError(f"points: expected shape [n, 2] with n >= 3, got {points.shape}")
    if thickness.shape not in ((), (len(points),)):
        raise ValueError(
            f"thickness: expected a scalar or shape ({len(points)},), one value per wall, "
            f"got shape {thickness.shape}"
        )
    thickness = nan_if_broken(positive("thickness", thickness))
    known = checks.array_if_known(points)
    if (
        known is not None
        and np.isfinite(known).all()
        and (text := outlines.describe_line_fault(known))
    ):
        raise ValueError(text)
    traced = known is None or checks.array_if_known(thickness) is None
    pack = jnp if traced else np
    y, z = points.T
    next_y, next_z = pack.roll(y, -1), pack.roll(z, -1)
    area = 0.5 * pack.sum(y * next_z - z * next_y)
    length = pack.sqrt((next_y - y) ** 2 + (next_z - z) ** 2)
    return 4 * area**2 / pack.sum(length / thickness)


def are_concentric_circles(parts: Sequence[tuple[Any, ...]]) -> Bool[ArrayLike, ""]:
    """Return whether all parts are discs and rings about one centre; traced if their numbers are.

    Compares the torsion constant of each part with the polar moment of its area about the common
    centroid. Both are equal only for a disc or a ring about this centre: any other shape warps,
    which makes its torsion constant smaller, and about any other centre the polar moment is larger.

    Args:
        parts: list of (y, z, area, own, torsion), fields of a `Section` of one law; where one of
            the last two is None the result is False.
    """
    if any(moments is None or torsion is None for *_, moments, torsion in parts):
        return False
    traced = any(checks.array_if_known(v) is None for part in parts for v in part)
    pack = jnp if traced else np
    y, z, area = (pack.concatenate([part[k] for part in parts]) for k in range(3))
    y0, z0 = area @ y / area.sum(), area @ z / area.sum()
    near = []
    for y, z, area, moments, torsion in parts:
        polar = pack.sum(area * ((y - y0) ** 2 + (z - z0) ** 2) + moments[:, 0] + moments[:, 1])
        # wide tolerance: rounding of fourth powers of lengths and of their differences
        near.append(abs(torsion - polar) <= pack.sqrt(pack.finfo(area.dtype).eps) * polar)
    return pack.all(pack.stack(near)) if traced else all(near)
