"""Numbers over their own scale, where that may be zero: residuals, shapes, lengths of vectors."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common.types import Array, ArrayLike, Float

_STILL = 1e-12  # a shape that is smaller, over its unknowns, is the rounding of none


def relative(
    residual: Float[ArrayLike, " *n"], scale: Float[ArrayLike, " *n"]
) -> Float[Array, " *n"]:
    """``residual / scale``; the residual itself where no force sets a scale."""
    return residual / jnp.where(scale > 0, scale, 1.0)


def length(vectors: Float[Array, "*n k"]) -> Float[Array, " *n"]:
    """Lengths of vectors, with a derivative of zero where one is zero."""
    square = jnp.sum(vectors**2, axis=-1)
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)


@jax.jit
def unit_shapes(
    shapes: Float[ArrayLike, "n n_node 3"], vectors: Float[ArrayLike, "n n_free"]
) -> Float[Array, "n n_node 3"]:
    """Shapes scaled to 1 at the node that moves most, the largest component of each positive.

    A mode of rotations alone has no shape to scale: it is zero.

    Args:
        shapes: displacements of nodes.
        vectors: the unknowns of the same modes, whose size tells a shape from rounding.
    """
    size = jnp.max(length(shapes), axis=-1)
    flat = shapes.reshape(len(shapes), -1)
    largest = jnp.take_along_axis(flat, jnp.argmax(jnp.abs(flat), axis=1)[:, None], axis=1)[:, 0]
    moves = size > _STILL * jnp.max(jnp.abs(vectors), axis=-1)
    scale = jnp.where(moves, jnp.sign(largest) / jnp.where(moves, size, 1.0), 0.0)
    return shapes * scale[:, None, None]
