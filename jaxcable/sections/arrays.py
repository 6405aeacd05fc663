"""Arrays of sections: NumPy arrays as long as none of their numbers is traced."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.types import ArrayLike, Float


def stack(*values: Float[ArrayLike, ""]) -> Float[ArrayLike, " n"]:
    """Scalars as one array [n]."""
    if any(checks.concrete(v) is None for v in values):
        return jnp.stack([jnp.asarray(v) for v in values])
    return np.array([float(v) for v in values])


def concatenate(arrays: Sequence[Float[ArrayLike, "_ ..."]]) -> Float[ArrayLike, "n ..."]:
    """Arrays one after the other."""
    traced = any(checks.concrete(a) is None for a in arrays)
    return (jnp if traced else np).concatenate(arrays)
