"""Products and lengths of short vectors, written so that XLA fuses them."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common.types import Array, Float


@jax.jit  # one function in a program, however often it is called
def scalar_product(a: Float[Array, " n"], b: Float[Array, " n"]) -> Float[Array, ""]:
    """Return the scalar product of two short vectors, as a sum of products.

    Of ``a @ b`` XLA makes a matrix product under `jax.vmap`, which on CPUs is a call of a library:
    it takes longer than an element, and prevents the fusion of the operations around it.
    """
    return jnp.sum(a * b)


@jax.jit
def chord_lengths(ends: Float[Array, "n n_end 3"]) -> Float[Array, " n"]:
    """Return the distance between the first two end points of every element, [n], m."""
    return jnp.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
