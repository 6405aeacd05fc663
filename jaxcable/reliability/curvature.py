"""The curvature of the distance along a limit state surface, by differences of its gradient.

At a stationary point the distance from the origin is a minimum where the matrix
``B = P (I + beta / |dG/du| d2G/du2) P`` is positive definite in the tangent plane, with the
projection P on it. Its smallest eigenvalue comes from a few products with vectors (Lanczos 1950).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..common.types import Float
from .search import SearchPoint

_PROBES = 10  # at most: products with the matrix


def difference_step(dtype: np.dtype) -> float:
    """Return the distance between points whose gradients are subtracted, in standard normal space.

    The error of a curvature is of this size.
    """
    return 1e-2 if dtype == np.float32 else 1e-3


def smallest_curvature(
    evaluate: Callable[[Float[np.ndarray, " n"]], SearchPoint], point: SearchPoint
) -> tuple[float, Float[np.ndarray, " n"]]:
    """Return the smallest eigenvalue of the matrix B at a stationary point, and its eigenvector.

    Each probe beside the point gives the product of the matrix with one more orthonormal vector.

    Args:
        evaluate: function of u to a `SearchPoint`.
        point: stationary point.

    Returns:
        Eigenvalue, 1 without a tangent plane, NaN if the limit state is not finite at a probe; and
            eigenvector, [n], zero in these cases.
    """
    u, alpha, step = point.u, point.alpha(), difference_step(point.u.dtype)
    if u.size == 1:
        return u.dtype.type(1.0), np.zeros_like(u)
    # the first direction is no particular one
    rest = np.random.default_rng(2).standard_normal(u.size).astype(u.dtype)
    rest -= (alpha @ rest) * alpha
    vectors, images = np.empty((2, 0, u.size), u.dtype)
    while True:
        vector = rest / np.linalg.norm(rest)
        probe = evaluate(u + step * vector)
        change = (probe.gradient - point.gradient) / step
        image = vector + (point.beta() / point.slope()) * (change - (alpha @ change) * alpha)
        if not (probe.is_finite() and np.isfinite(image).all()):
            return u.dtype.type(np.nan), np.zeros_like(u)
        vectors, images = np.vstack([vectors, vector]), np.vstack([images, image])
        products = vectors @ images.T
        values, columns = np.linalg.eigh((products + products.T) / 2)
        lowest, weights = values[0], columns[:, 0]
        residual = weights @ images - lowest * (weights @ vectors)
        rest = image
        for _ in range(2):  # twice: once leaves rounding
            rest = rest - (vectors @ rest) @ vectors - (alpha @ rest) * alpha
        is_settled = np.linalg.norm(residual) <= 5 * step
        # a negative curvature is one, whatever further vectors say
        is_negative = lowest < -10 * step
        is_complete = len(vectors) == min(u.size - 1, _PROBES) or np.linalg.norm(rest) <= step
        if is_settled or is_negative or is_complete:
            return lowest, weights @ vectors
