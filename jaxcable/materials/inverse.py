"""Strain from stress, for any law that is linear between known corners."""

import jax.numpy as jnp

_FAR = 1.0  # strain by which a law without end is followed beyond its last corner


def inverse(law, stress, plastic=None):
    """Strain at `stress` on the rising branch from zero; NaN above the peak of `law`.

    Exact: the curve is evaluated at its corners and inverted linearly between two of them. On a
    plateau the strain at its beginning.
    """
    stress = jnp.asarray(stress)
    low, high = law.limits
    corners = law.corners(plastic)
    corners = jnp.broadcast_to(corners, (*stress.shape, corners.shape[-1]))
    ends = jnp.stack(
        [jnp.maximum(low, jnp.min(corners, -1, initial=0.0) - _FAR), jnp.zeros_like(stress)]
        + [jnp.minimum(high, jnp.max(corners, -1, initial=0.0) + _FAR)],
        axis=-1,
    )
    at = jnp.sort(jnp.clip(jnp.concatenate([corners, ends], -1), ends[..., :1], ends[..., 2:]))
    curve = law.continued().stress_at(at, None if plastic is None else plastic[..., None, :])
    target = stress[..., None]
    pull = target >= 0
    # the corner at which the target is first reached, going away from zero
    reached = jnp.where(pull, curve >= target, curve <= target)
    if plastic is None:  # may fall again: only the branch that starts from zero counts
        reached = reached & jnp.where(pull, at >= 0, at <= 0)
    last = at.shape[-1] - 1
    upper = jnp.argmax(reached, axis=-1, keepdims=True)
    lower = last - jnp.argmax(jnp.flip(reached, -1), axis=-1, keepdims=True)
    outer = jnp.where(pull, upper, lower)
    inner = jnp.clip(jnp.where(pull, outer - 1, outer + 1), 0, last)

    def pick(values, index):
        return jnp.take_along_axis(values, index, axis=-1)[..., 0]

    v0, v1, e0, e1 = pick(curve, inner), pick(curve, outer), pick(at, inner), pick(at, outer)
    rise = jnp.where(v1 == v0, 1.0, v1 - v0)
    found = jnp.any(reached, axis=-1)
    strain = e1 - (v1 - stress) * jnp.where(v1 == v0, 0.0, e1 - e0) / rise
    return jnp.where(found, strain, jnp.nan)
