"""Lengths of the steps of a continuation, and the scale of displacements in them."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.types import Array, Float, Int
from ..mechanics.assembly import System
from .correction import Corrected
from .run import Beyond, Point

_STRIDE = 0.02  # displacement in a step along a straight soft path, in structure sizes


def scale_of(found: Corrected, system: System) -> Float[Array, ""]:
    """Displacement per unit of the load factor where the path begins, m."""
    scale = jnp.linalg.norm(found.direction) / jnp.where(found.rise == 0, 1.0, jnp.abs(found.rise))
    usable = (scale > 0) & jnp.isfinite(scale)
    return jnp.where(usable, scale, system.length_scale())


def cosine(a: Point, p: Point) -> Float[Array, ""]:
    """Cosine of the angle between the tangents at two points."""
    return a.direction @ p.direction + a.rise * p.rise


def stride(
    p: Point, weight: Float[Array, ""], extent: Float[Array, ""], largest: Float[Array, ""]
) -> Float[Array, ""]:
    """Length of a step along a soft path: `largest` in load, or 2 % of the size of the structure.

    The shorter one; where hardly any load is added, as in plastic collapse, that of displacement.
    """
    shift = jnp.max(jnp.abs(p.direction), initial=0.0) * weight
    by_shift = _STRIDE * extent / jnp.where(shift > 0, shift, 1.0)
    return jnp.minimum(by_shift, largest / jnp.where(p.rise > 0, p.rise, 1.0))


def guess_ahead(
    anchor: Point,
    far_end: Beyond,
    bracket: Float[Array, ""],
    tries: Int[Array, ""],
    tol: Float[Array, ""],
) -> Float[Array, ""]:
    """Length of the next step while an event is located, by secants and bisection.

    Args:
        anchor: `Point` before the event.
        far_end: `Beyond` after the event.
        bracket: length of the step between them.
        tries: number of steps tried so far; every third one is a bisection.
        tol: length within which the event counts as located.
    """
    rise, stiffness = far_end.rise, far_end.stiffness
    reverses = (rise > 0) != (anchor.rise > 0)
    by_rise = anchor.rise / jnp.where(reverses, anchor.rise - rise, 1.0)
    softening = (stiffness > 0) != (anchor.stiffness > 0)
    by_stiffness = anchor.stiffness / jnp.where(softening, anchor.stiffness - stiffness, 1.0)
    part = jnp.where(reverses, by_rise, jnp.where(softening, by_stiffness, 0.5))
    part = jnp.where(far_end.smooth & jnp.isfinite(part) & (tries % 3 != 2), part, 0.5)
    # at least half the tolerance from both ends, so that the bracket closes from both sides
    length = jnp.clip(part * bracket, 0.5 * tol, jnp.maximum(bracket - 0.5 * tol, 0.5 * tol))
    return jnp.where(bracket <= tol, bracket, length)
