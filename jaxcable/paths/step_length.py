"""Lengths of the steps of a continuation, and the scale of displacements in them."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.types import Array, Float, Int
from ..mechanics.assembly import System
from .corrector import CorrectorState
from .path_state import BracketEnd, PathPoint

# Displacement in a step along a straight soft path, in sizes of the structure. Any small part would
# do: steps are shortened again where the path turns.
_SOFT_DISPLACEMENT = 0.02


def displacement_per_load(found: CorrectorState, system: System) -> Float[Array, ""]:
    """Return the norm of the displacements per unit of the load factor, m, where the path begins.

    It follows from the tangent in `found`. Where that is zero or infinite, a typical length of the
    elements in `system` is returned.
    """
    scale = jnp.linalg.norm(found.direction) / jnp.where(found.rise == 0, 1.0, jnp.abs(found.rise))
    usable = (scale > 0) & jnp.isfinite(scale)
    return jnp.where(usable, scale, system.length_scale())


def cosine_between_tangents(a: PathPoint, p: PathPoint) -> Float[Array, ""]:
    """Return the cosine of the angle between the tangents of the path at points `a` and `p`.

    Components are those of the unknowns over `displacement_scale`, and of the load factor.
    """
    return a.direction @ p.direction + a.rise * p.rise


def low_stiffness_step_length(
    p: PathPoint,
    displacement_scale: Float[Array, ""],
    extent: Float[Array, ""],
    largest: Float[Array, ""],
) -> Float[Array, ""]:
    """Return the length of a step from point `p` on a straight path with little stiffness.

    Such a step adds `largest` to the load factor, or 2 % of the size of the structure (`extent`, m)
    to a displacement, whichever is shorter: the latter where hardly any load is added, as in
    plastic collapse. `displacement_scale` is the displacement in m that counts as much as a unit of
    load factor.
    """
    shift = jnp.max(jnp.abs(p.direction), initial=0.0) * displacement_scale
    by_shift = _SOFT_DISPLACEMENT * extent / jnp.where(shift > 0, shift, 1.0)
    return jnp.minimum(by_shift, largest / jnp.where(p.rise > 0, p.rise, 1.0))


def bracketing_step_length(
    anchor: PathPoint,
    bracket_end: BracketEnd,
    bracket: Float[Array, ""],
    n_tried: Int[Array, ""],
    tol: Float[Array, ""],
) -> Float[Array, ""]:
    """Return the length of the next step while an event is located, by secants and bisection.

    Args:
        anchor: `PathPoint` before the event.
        bracket_end: `BracketEnd` beyond the event.
        bracket: length of the step between them.
        n_tried: number of steps tried so far; every third one is a bisection.
        tol: length within which the event counts as located.
    """
    rise, stiffness = bracket_end.rise, bracket_end.stiffness
    reverses = (rise > 0) != (anchor.rise > 0)
    by_rise = anchor.rise / jnp.where(reverses, anchor.rise - rise, 1.0)
    softening = (stiffness > 0) != (anchor.stiffness > 0)
    by_stiffness = anchor.stiffness / jnp.where(softening, anchor.stiffness - stiffness, 1.0)
    part = jnp.where(reverses, by_rise, jnp.where(softening, by_stiffness, 0.5))
    part = jnp.where(bracket_end.smooth & jnp.isfinite(part) & (n_tried % 3 != 2), part, 0.5)
    # at least half the tolerance from both ends, so that the bracket closes from both sides
    length = jnp.clip(part * bracket, 0.5 * tol, jnp.maximum(bracket - 0.5 * tol, 0.5 * tol))
    return jnp.where(bracket <= tol, bracket, length)
