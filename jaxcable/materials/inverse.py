"""Strain from stress, for any law that is linear between known corners."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.types import Array, ArrayLike, Float
from .law import Law

_FAR = 1.0  # strain by which a law without end is followed beyond its last corner


def inverse(
    law: Law, stress: Float[ArrayLike, "*shape"], memory: Float[Array, "... n_memory"] | None = None
) -> Float[Array, "*shape"]:
    """Strain at `stress` on the rising branch from zero; NaN above the peak of `law`.

    Exact: the curve is evaluated at its corners and inverted linearly between two of them. On a
    plateau the strain at its beginning.
    """
    stress = jnp.asarray(stress)
    low, high = law.limits
    corners = law.corners(memory)
    corners = jnp.broadcast_to(corners, (*stress.shape, corners.shape[-1]))
    ends = jnp.stack(
        [
            jnp.maximum(low, jnp.min(corners, -1, initial=0.0) - _FAR),
            jnp.zeros_like(stress),
            jnp.minimum(high, jnp.max(corners, -1, initial=0.0) + _FAR),
        ],
        axis=-1,
    )
    at = jnp.sort(jnp.clip(jnp.concatenate([corners, ends], -1), ends[..., :1], ends[..., 2:]))
    curve = law.extended().stress_at(at, None if memory is None else memory[..., None, :])
    target = stress[..., None]
    pull = target >= 0
    # The corner at which the target is first reached, going away from zero: to a rounding, so that
    # a law reaches its own peak; and strictly beyond zero, so that zero is inverted by the branch
    # that loads, not by the slack one.
    rounding = (
        8 * jnp.finfo(curve.dtype).eps * law.modulus * jnp.max(jnp.abs(at), -1, keepdims=True)
    )
    reached = jnp.where(
        pull,
        curve >= jnp.maximum(target - rounding, rounding),
        curve <= jnp.minimum(target + rounding, -rounding),
    )
    if memory is None:  # may fall again: only the branch that starts from zero counts
        reached = reached & jnp.where(pull, at >= 0, at <= 0)
    last = at.shape[-1] - 1
    upper = jnp.argmax(reached, axis=-1, keepdims=True)
    lower = last - jnp.argmax(jnp.flip(reached, -1), axis=-1, keepdims=True)
    outer = jnp.where(pull, upper, lower)
    inner = jnp.clip(jnp.where(pull, outer - 1, outer + 1), 0, last)

    def pick(values, index):
        return jnp.take_along_axis(values, index, axis=-1)[..., 0]

    v0, v1, e0, e1 = pick(curve, inner), pick(curve, outer), pick(at, inner), pick(at, outer)
    flat = v1 == v0
    # from the inner end, which is zero for small stresses: these keep their digits
    strain = e0 + (stress - v0) * jnp.where(flat, 0.0, e1 - e0) / jnp.where(flat, 1.0, v1 - v0)
    return jnp.where(jnp.any(reached, axis=-1), strain, jnp.nan)
