"""Eigenvalues that cross zero: from the inertia of two points, or a null vector and the load."""

from __future__ import annotations

import jax.numpy as jnp

from .. import linear
from ..common.types import Array, Bool, Float, Int
from .run import Beyond, Point


def _odd(p):
    """Whether the number of negative eigenvalues is odd, also where they are not counted."""
    return jnp.where(p.negative < 0, p.stiffness < 0, p.negative % 2 == 1)


def unstable(p: Point) -> Bool[Array, ""]:
    """Whether there are negative eigenvalues, or an odd number of them where not counted."""
    return (p.negative > 0) | ((p.negative < 0) & _odd(p))


def crossed(p: Point, a: Point) -> Bool[Array, ""]:
    """Whether the number of negative eigenvalues differs, or its parity where not counted."""
    counted = (p.negative >= 0) & (a.negative >= 0)
    return jnp.where(counted, p.negative != a.negative, _odd(p) != _odd(a))


def multiplicity(
    p: Beyond, a: Point, fresh: Bool[Array, ""]
) -> tuple[Int[Array, ""], Int[Array, ""]]:
    """How many eigenvalues cross between two points: at a bifurcation, at a limit point."""
    counted = (p.negative >= 0) & (a.negative >= 0)
    many = jnp.abs(p.negative - jnp.where(fresh, 0, a.negative))
    many = jnp.where(counted, many, linear.NOT_COUNTED)
    # at a limit point the inertia may change, by rounding, just outside of the bracket
    return many, jnp.where(counted, jnp.maximum(many, 1), many)


def alignment(p: Point) -> Float[Array, ""]:
    """``|phi.F| / (|phi| |F|)`` of the left null vector phi and the load F; 1 if F is zero."""
    size = jnp.linalg.norm(p.pull)
    return jnp.where(size > 0, jnp.abs(p.left @ p.pull) / jnp.where(size > 0, size, 1.0), 1.0)
