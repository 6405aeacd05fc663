"""The curvature of the distance along a limit state surface, by differences of its gradient.

At a stationary point the distance from the origin is a minimum where the matrix
``B = P (I + beta / |dG/du| d2G/du2) P`` is positive definite in the tangent plane, with the
projection P on it. Its smallest eigenvalue comes from a few products with vectors (Lanczos 1950).
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..common.types import Array, Bool, Float, Int
from ..linear import unbatched
from .search import Point

_PROBES = 10  # at most: products with the matrix
_UNUSED = 1e6  # eigenvalue of rows that have no vector yet


def difference_step(dtype: np.dtype) -> float:
    """Return the distance of a probe, which is the error of the curvature, too."""
    return 1e-2 if dtype == np.float32 else 1e-3


class Curvature(NamedTuple):
    """What is known of the matrix B at a point.

    Attributes:
        vectors: orthonormal vectors in the tangent plane, [k, n]; the first `n_products` have
            images, the next one is probed. Zero rows are not used yet.
        images: products of the matrix with these, [k, n].
        n_products: number of products.
        lowest: smallest eigenvalue in their space; 1 without a tangent plane, NaN if the limit
            state is not finite at a probe.
        weights: combination of the vectors that is its eigenvector, [k].
        is_known: whether no further probe is needed.
    """

    vectors: Float[Array, "k n"]
    images: Float[Array, "k n"]
    n_products: Int[Array, ""]
    lowest: Float[Array, ""]
    weights: Float[Array, " k"]
    is_known: Bool[Array, ""]

    def direction(self) -> Float[Array, " n"]:
        """Return the eigenvector, [n]; zero without a tangent plane or a finite eigenvalue."""
        return self.weights @ self.vectors

    def trial(self, point: Point) -> Float[Array, " n"]:
        """Return the next probe, beside the point."""
        rows = np.arange(len(self.vectors)) == self.n_products
        step = difference_step(point.u.dtype)
        return point.u + step * jnp.sum(jnp.where(rows[:, None], self.vectors, 0.0), axis=0)


def begin_curvature(point: Point) -> Curvature:
    """Return what is known before the first probe, whose direction is no particular one."""
    n = point.u.size
    size = max(min(n - 1, _PROBES), 1)
    drawn = jnp.asarray(np.random.default_rng(2).standard_normal(n).astype(point.u.dtype))
    alpha = point.alpha()
    first = drawn - (alpha @ drawn) * alpha
    first = first / jnp.sqrt(jnp.sum(first**2)) if n > 1 else jnp.zeros_like(point.u)
    empty = jnp.zeros((size, n), point.u.dtype)
    vectors = jnp.where((np.arange(size) == 0)[:, None], first[None], empty)
    one = jnp.ones((), point.u.dtype)
    return Curvature(
        vectors, empty, jnp.zeros((), jnp.int32), one, empty[:, 0], jnp.full((), n == 1)
    )


def probe_curvature(state: Curvature, point: Point, gradient: Float[Array, " n"]) -> Curvature:
    """Return what is known after a probe.

    Args:
        state: present state.
        point: stationary point.
        gradient: of the limit state at ``state.trial(point)``.
    """
    rows, alpha = np.arange(len(state.vectors)), point.alpha()
    vector = jnp.sum(jnp.where((rows == state.n_products)[:, None], state.vectors, 0.0), axis=0)
    step = difference_step(point.u.dtype)
    change = (gradient - point.gradient) / step
    bend = (point.beta() / point.slope()) * (change - (alpha @ change) * alpha)
    sound = jnp.all(jnp.isfinite(gradient))
    image = vector + jnp.where(sound, bend, 0.0)
    images = jnp.where((rows == state.n_products)[:, None], image[None], state.images)
    count = state.n_products + 1
    used = rows < count
    known = jnp.where(used[:, None], state.vectors, 0.0)
    small = known @ images.T
    small = jnp.where(used[:, None] & used[None], (small + small.T) / 2, 0.0)
    values, columns = unbatched.eigh(small + jnp.diag(jnp.where(used, 0.0, _UNUSED)))
    lowest, weights = values[0], jnp.where(used, columns[:, 0], 0.0)
    residual = weights @ images - lowest * (weights @ known)
    rest = image
    for _ in range(2):  # twice: once leaves rounding
        rest = rest - (known @ rest) @ known - (alpha @ rest) * alpha
    length = jnp.sqrt(jnp.sum(rest**2))
    following = rest / jnp.where(length > 0, length, 1.0)
    vectors = jnp.where((rows == count)[:, None], following[None], known)
    is_settled = jnp.sqrt(jnp.sum(residual**2)) <= 5 * step
    # a negative curvature is one, whatever further vectors say
    is_known = is_settled | (lowest < -10 * step) | (count == len(rows)) | (length <= step) | ~sound
    return Curvature(
        vectors,
        images,
        count,
        jnp.where(sound, lowest, jnp.nan),
        jnp.where(sound, weights, 0.0),
        is_known,
    )
