"""Strain from stress, for any law that is linear between known corners."""

from __future__ import annotations

import jax.numpy as jnp

from ..common.types import Array, Float, Int
from .law import Law, Memory, Numbers, Values

SAMPLED_BEYOND = 1.0
"""Strain beyond the last corner up to which a law without end is sampled: it is linear there."""


def invert_curve(law: Law, stress: Numbers, memory: Memory = None) -> Values:
    """Return the strain at `stress` on the rising branch from zero; NaN above the peak of `law`.

    Exact: the curve is evaluated at its corners and inverted linearly between two of them. On a
    plateau the result is the strain at which the plateau begins.
    """
    stress = jnp.asarray(stress)
    low, high = law.strain_limits
    corners = law.corner_strains(memory)
    corners = jnp.broadcast_to(corners, (*stress.shape, corners.shape[-1]))
    ends = jnp.stack(
        [
            jnp.maximum(low, jnp.min(corners, -1, initial=0.0) - SAMPLED_BEYOND),
            jnp.zeros_like(stress),
            jnp.minimum(high, jnp.max(corners, -1, initial=0.0) + SAMPLED_BEYOND),
        ],
        axis=-1,
    )
    strains = jnp.sort(jnp.clip(jnp.concatenate([corners, ends], -1), ends[..., :1], ends[..., 2:]))
    curve = law.extrapolated().stress_at(strains, None if memory is None else memory[..., None, :])
    target = stress[..., None]
    tension = target >= 0
    # The corner at which the stress first reaches the target, going away from zero. Reached within
    # rounding, so that the stress at the peak has a strain; and with a stress strictly beyond zero,
    # so that zero stress is inverted on the branch that loads and not on the slack branch.
    # Rounding of the strains of corners: the samples beyond them, where a law has no end, are far.
    size = jnp.max(jnp.abs(jnp.clip(corners, low, high)), -1, keepdims=True, initial=0.0)
    rounding = 8 * jnp.finfo(curve.dtype).eps * law.modulus * size
    reached = jnp.where(
        tension,
        curve >= jnp.maximum(target - rounding, rounding),
        curve <= jnp.minimum(target + rounding, -rounding),
    )
    if memory is None:  # the curve may fall again: only the branch that starts from zero counts
        reached = reached & jnp.where(tension, strains >= 0, strains <= 0)
    last = strains.shape[-1] - 1
    upper = jnp.argmax(reached, axis=-1, keepdims=True)
    lower = last - jnp.argmax(jnp.flip(reached, -1), axis=-1, keepdims=True)
    outer = jnp.where(tension, upper, lower)
    inner = jnp.clip(jnp.where(tension, outer - 1, outer + 1), 0, last)

    v0, v1, e0, e1 = (value_at_index(v, k) for v in (curve, strains) for k in (inner, outer))
    flat = v1 == v0
    # measured from the inner end, which is zero for small stresses: small strains keep their digits
    strain = e0 + (stress - v0) * jnp.where(flat, 0.0, e1 - e0) / jnp.where(flat, 1.0, v1 - v0)
    return jnp.where(jnp.any(reached, axis=-1), strain, jnp.nan)


def value_at_index(values: Float[Array, "*shape n"], index: Int[Array, "*shape 1"]) -> Values:
    """Return the entries of `values` at `index` on the last axis, which is dropped."""
    return jnp.take_along_axis(values, index, axis=-1)[..., 0]
