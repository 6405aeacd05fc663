"""Products of short vectors."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common.types import Array, Float


@jax.jit  # one function in a program, however often it is called
def inner(a: Float[Array, " n"], b: Float[Array, " n"]) -> Float[Array, ""]:
    """Scalar product of two vectors of a few numbers.

    As a sum, because XLA makes a matrix product of ``a @ b`` under `jax.vmap`, and for CPUs a call
    of a library, which takes longer than an element and ends the fusion of what is around it.
    """
    return jnp.sum(a * b)


@jax.jit
def chord_lengths(ends: Float[Array, "n n_end 3"]) -> Float[Array, " n"]:
    """Distances from the first to the second of several points."""
    return jnp.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
