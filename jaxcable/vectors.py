"""Vectors of three numbers, by their components.

Written as sums of products, which compilers fuse with what is around them; inside `vmap` a product
``a @ b`` becomes a product of matrices, a piece of program of its own to compile and to start.
"""

import jax.numpy as jnp


def dot(a, b):
    """Scalar product of two vectors [3]."""
    return jnp.sum(a * b)


def norm(a):
    """Length of a vector [3] that is not zero."""
    return jnp.sqrt(dot(a, a))
