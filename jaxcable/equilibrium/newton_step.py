"""The direction of a step of Newton's method."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common.types import Array, Bool, Float
from ..linear import Matrix
from ..linear.sparse import Factored
from ..mechanics.assembly import System

WORTH = 12  # steps of an iterative linear solve that a factorisation is worth
_INEXACT = 1e-2  # residual that it may leave, at most


def direction(
    working: System,
    matrix: Matrix,
    it: Any,  # the `iteration.Iterate`, which makes use of this
    sprinting: Bool[Array, ""],
    tol: Float[Array, ""],
    wanted: Bool[Array, ""],
) -> tuple[Float[Array, " n_free"], Bool[Array, ""], Factored | None]:
    """The step of Newton's method: solution, whether it can be used, what was factored."""
    # Conjugate gradients cannot tell that a matrix is indefinite; a convex energy has no such.
    # They leave what the next step of Newton's method will leave anyway; the bounds steer effort
    # and hide nothing, since the residual of the step is judged as ever.
    relative = largest(it.residual) / it.scale
    forcing = jnp.clip(relative, 0.1 * tol / relative, _INEXACT)
    limit = jnp.where(working.convex, WORTH, 0)
    step, definite, factored = linear.solve_next(
        matrix, -it.residual, it.factored, forcing, limit, wanted
    )
    if working.space.rotates or working.followers is not None:
        # Moments and following loads have no potential, hence no definite tangent to ask for. In a
        # batch both are done: after each other, as LAPACK's batched calls can wait for each other.
        after, _ = lax.optimization_barrier((-it.residual, step))
        step, definite = lax.cond(
            sprinting & working.unsymmetric(),
            lambda matrix, rhs, _: linear.solve_general(matrix, rhs),
            lambda matrix, rhs, found: found,
            matrix,
            after,
            (step, definite),
        )
    return step, definite, factored


def largest(residual: Float[Array, " n_free"]) -> Float[Array, ""]:
    """Largest entry by size; 0 where nothing is free."""
    return jnp.max(jnp.abs(residual), initial=0.0)
