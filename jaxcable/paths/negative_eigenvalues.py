"""Eigenvalues of the tangent that cross zero between two points of a path.

They are counted by the inertia of the tangent, the number of its negative eigenvalues.
"""

from __future__ import annotations

import jax.numpy as jnp

from .. import linear
from ..common.types import Array, Bool, Float, Int
from .path_state import BracketEnd, PathPoint


def _has_odd_number_of_negatives(p):
    """Return whether the tangent at point `p` has an odd number of negative eigenvalues.

    Where they are not counted the sign of `p.stiffness`, which is that of the determinant, decides.
    """
    return jnp.where(p.n_negative < 0, p.stiffness < 0, p.n_negative % 2 == 1)


def is_unstable(p: PathPoint) -> Bool[Array, ""]:
    """Return whether the tangent stiffness at a point of the path has negative eigenvalues.

    Where eigenvalues are not counted, only an odd number of negative ones is seen.
    """
    return (p.n_negative > 0) | ((p.n_negative < 0) & _has_odd_number_of_negatives(p))


def eigenvalue_changed_sign(p: PathPoint, a: PathPoint) -> Bool[Array, ""]:
    """Return whether points `p` and `a` differ in the number of negative eigenvalues.

    Where eigenvalues are not counted: whether that number is odd at one of the points only.
    """
    counted = (p.n_negative >= 0) & (a.n_negative >= 0)
    return jnp.where(
        counted,
        p.n_negative != a.n_negative,
        _has_odd_number_of_negatives(p) != _has_odd_number_of_negatives(a),
    )


def count_eigenvalue_sign_changes(
    p: BracketEnd, a: PathPoint, is_first: Bool[Array, ""]
) -> tuple[Int[Array, ""], Int[Array, ""]]:
    """Count the eigenvalues of the tangent that change their sign from point `a` to point `p`.

    If the step is the first one of the path (`is_first`) there were no negative ones before.

    Returns:
        The multiplicity of a bifurcation between the points; that of a limit point there, at least
            1. Both are `linear.NOT_COUNTED` where eigenvalues are not counted.
    """
    counted = (p.n_negative >= 0) & (a.n_negative >= 0)
    many = jnp.abs(p.n_negative - jnp.where(is_first, 0, a.n_negative))
    many = jnp.where(counted, many, linear.NOT_COUNTED)
    # at a limit point the inertia may change, by rounding, just outside of the bracket
    return many, jnp.where(counted, jnp.maximum(many, 1), many)


def load_mode_alignment(p: PathPoint) -> Float[Array, ""]:
    """Return ``|phi.F| / (|phi| |F|)`` at a point: the cosine between left null vector and load.

    It is zero at a bifurcation, not at a limit point; 1 if the load F of the phase is zero.
    """
    size = jnp.linalg.norm(p.residual_by_factor)
    return jnp.where(
        size > 0, jnp.abs(p.left_phi @ p.residual_by_factor) / jnp.where(size > 0, size, 1.0), 1.0
    )
