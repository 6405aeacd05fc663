"""Eigenvalues of the tangent that cross zero between two points of a path.

They are counted by the inertia of the tangent, the number of its negative eigenvalues.
"""

from __future__ import annotations

import jax.numpy as jnp

from .. import linear
from ..common.types import Array, Bool, Float, Int
from .path_state import BracketEnd, PathPoint


def _has_odd_count(p):
    """Whether the number of negative eigenvalues is odd; from a sign where they are not counted."""
    return jnp.where(p.n_negative < 0, p.stiffness < 0, p.n_negative % 2 == 1)


def is_unstable(p: PathPoint) -> Bool[Array, ""]:
    """Whether the tangent has negative eigenvalues (an odd number, where they are not counted)."""
    return (p.n_negative > 0) | ((p.n_negative < 0) & _has_odd_count(p))


def eigenvalue_crossed(p: PathPoint, a: PathPoint) -> Bool[Array, ""]:
    """Whether two points differ in their number of negative eigenvalues (or in its parity)."""
    counted = (p.n_negative >= 0) & (a.n_negative >= 0)
    return jnp.where(counted, p.n_negative != a.n_negative, _has_odd_count(p) != _has_odd_count(a))


def count_crossings(
    p: BracketEnd, a: PathPoint, is_first: Bool[Array, ""]
) -> tuple[Int[Array, ""], Int[Array, ""]]:
    """Count the eigenvalues that cross zero between two points.

    Returns:
        The number if there is a bifurcation between them, and if there is a limit point, which has
        at least 1; `linear.NOT_COUNTED` where eigenvalues are not counted.
    """
    counted = (p.n_negative >= 0) & (a.n_negative >= 0)
    many = jnp.abs(p.n_negative - jnp.where(is_first, 0, a.n_negative))
    many = jnp.where(counted, many, linear.NOT_COUNTED)
    # at a limit point the inertia may change, by rounding, just outside of the bracket
    return many, jnp.where(counted, jnp.maximum(many, 1), many)


def load_alignment(p: PathPoint) -> Float[Array, ""]:
    """Return ``|phi.F| / (|phi| |F|)`` of the left null vector phi and load F; 1 if F is zero."""
    size = jnp.linalg.norm(p.residual_by_factor)
    return jnp.where(
        size > 0, jnp.abs(p.left_phi @ p.residual_by_factor) / jnp.where(size > 0, size, 1.0), 1.0
    )
