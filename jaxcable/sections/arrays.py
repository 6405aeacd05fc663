"""Arrays of sections that are NumPy as long as nothing in them is traced."""

import jax.numpy as jnp
import numpy as np

from ..common import checks


def stack(*values):
    """Scalars as one array [n]."""
    if any(checks.concrete(v) is None for v in values):
        return jnp.stack([jnp.asarray(v) for v in values])
    return np.array([float(v) for v in values])


def concatenate(arrays):
    """Arrays one after the other."""
    traced = any(checks.concrete(a) is None for a in arrays)
    return (jnp if traced else np).concatenate(arrays)
