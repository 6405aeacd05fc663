"""Division by a scale that may be zero: relative residuals, normalized shapes, vector norms."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common.types import Array, ArrayLike, Float

# displacement of a mode, over its largest unknown, below which it is rounding: some 1e4 eps, far
# below the displacements of any mode that is not made of rotations alone
_SMALLEST_SHAPE = 1e-12
_EQUAL = 1 - 1e-6  # component over the largest from which it counts as equal


def relative_residual(
    residual: Float[ArrayLike, " *n"], scale: Float[ArrayLike, " *n"]
) -> Float[Array, " *n"]:
    """Return ``residual / scale``, entry by entry; where the scale is zero, the residual itself."""
    return residual / jnp.where(scale == 0, 1.0, scale)


def safe_norm(vectors: Float[Array, "*n k"]) -> Float[Array, " *n"]:
    """Return the Euclidean norms of vectors; a zero norm has derivative zero instead of NaN."""
    square = jnp.sum(vectors**2, axis=-1)
    is_zero = square == 0  # NaN is not, and stays
    return jnp.where(is_zero, 0.0, jnp.sqrt(jnp.where(is_zero, 1.0, square)))


def mode_shape_scales(
    shapes: Float[Array, "n n_node 3"], vectors: Float[ArrayLike, "n n_free"]
) -> Float[Array, " n"]:
    """Return factors that scale shapes to length 1 at the node that moves most.

    They make its largest component positive. A mode of rotations alone has no displacements to
    scale: its factor is zero.

    Args:
        shapes: displacements of all nodes in every mode, [n, n_node, 3].
        vectors: all unknowns in the same modes, [n, n_free]; a shape that is tiny beside them is
            only rounding.
    """
    size = jnp.max(safe_norm(shapes), axis=-1)
    flat = shapes.reshape(len(shapes), -1)
    sizes = jnp.abs(flat)
    # the first of equal components, such as those of an antisymmetric mode: not what rounding says
    first = jnp.argmax(sizes >= _EQUAL * jnp.max(sizes, axis=1, keepdims=True), axis=1)
    largest = jnp.take_along_axis(flat, first[:, None], axis=1)[:, 0]
    moves = size > _SMALLEST_SHAPE * jnp.max(jnp.abs(vectors), axis=-1)
    return jnp.where(moves, jnp.sign(largest) / jnp.where(moves, size, 1.0), 0.0)


@jax.jit
def normalize_mode_shapes(
    shapes: Float[ArrayLike, "n n_node 3"], vectors: Float[ArrayLike, "n n_free"]
) -> Float[Array, "n n_node 3"]:
    """Scale mode shapes to length 1 at the node that moves most, largest component positive.

    Arguments are those of `mode_shape_scales`; the shape of a mode of rotations alone is zero.
    """
    return shapes * mode_shape_scales(jnp.asarray(shapes), vectors)[:, None, None]
