"""The direction of a step of Newton's method."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common.types import Array, Bool, Float
from ..linear import Matrix
from ..linear.sparse import Factored
from ..mechanics.assembly import System

WORTH = 12  # conjugate gradient steps that cost as much as a factorisation
_ZERO = 64  # eigenvalues below so many roundings (eps) of the largest stiffness count as zero
_INEXACT = 1e-2  # largest relative residual that conjugate gradients may leave


def direction(
    system: System,
    matrix: Matrix,
    it: Any,  # an `iteration.Iterate`; that module imports this one
    rhs: Float[Array, " n_free"],
    tol: Float[Array, ""],
    wanted: Bool[Array, ""],
) -> tuple[Float[Array, " n_free"], Bool[Array, ""], Factored | None]:
    """The step of Newton's method.

    Args:
        system: `System`.
        matrix: its tangent with the Levenberg shift.
        it: `iteration.Iterate`.
        rhs: right side of the equations, the negative residual or a similar one, [n_free], N.
        tol: relative residual that counts as converged.
        wanted: False if the result does not matter (a finished case of a batch).

    Returns:
        step, NaN if an unsymmetric matrix is singular; whether the symmetric part of the matrix is
        positive definite; what was factored.
    """
    # Conjugate gradients cannot see that a matrix is indefinite, so they are used only where the
    # energy is convex. Their tolerance is about the residual that the next Newton step leaves
    # anyway. It steers the effort only: convergence is judged by the residual of the system.
    relative = largest(it.residual) / it.scale
    forcing = jnp.clip(relative, 0.1 * tol / relative, _INEXACT)
    similar, least = system.convex, 0
    if it.tensions is not None:  # matrices of interior steps differ too much from each other
        similar, least = similar & ~it.tensions.bounded, it.tensions.inner.least
    limit = jnp.where(similar, WORTH, least)
    step, definite, factored = linear.solve_next(matrix, rhs, it.factored, forcing, limit, wanted)
    if system.may_be_unsymmetric:
        # Moments, following loads and elements that say so have no potential. Where the symmetric
        # part is definite, the step by the whole tangent leads downhill, too: R.p = -p.(sym K)p.
        # Steps by the symmetric part alone converge linearly, or not at all beside a large rest.
        # In a batch both branches are computed. The barrier puts them one after the other, because
        # batched calls of LAPACK can wait for each other for ever.
        after, _ = lax.optimization_barrier((rhs, step))
        step = lax.cond(
            system.unsymmetric(),
            lambda matrix, rhs, _: linear.solve_general(matrix, rhs)[0],
            lambda matrix, rhs, found: found,
            matrix,
            after,
            step,
        )
    return step, definite, factored


@jax.jit  # one function in a program
def largest(residual: Float[Array, " n_free"]) -> Float[Array, ""]:
    """Largest entry by size; 0 without unknowns."""
    return jnp.max(jnp.abs(residual), initial=0.0)


def no_stiffness(matrix: Matrix) -> Float[Array, ""]:
    """Bound of the eigenvalues that rounding makes of a zero one in a tangent, N/m; positive."""
    size = jnp.max(jnp.abs(linear.diagonal(matrix)), initial=0.0)
    return _ZERO * jnp.finfo(size.dtype).eps * size + jnp.finfo(size.dtype).tiny
