"""One step of Newton's method: its direction, and how far to go along it."""

import jax.numpy as jnp
from jax import lax

from . import linear
from .search import search

WORTH = 12  # steps of an iterative linear solve that a factorisation is worth
_INEXACT = 1e-2  # residual that it may leave, at most


def direction(working, matrix, it, tol, wanted):
    """The step of Newton's method: solution, whether it can be used, memory of sparse solves."""
    # Conjugate gradients cannot tell that a matrix is indefinite; a convex energy has no such.
    # They leave what the next step of Newton's method will leave anyway; the bounds steer effort
    # and hide nothing, since the residual of the step is judged as ever.
    relative = largest(it.residual) / it.scale
    forcing = jnp.clip(relative, 0.1 * tol / relative, _INEXACT)
    limit = WORTH if working.convex else 0
    step, definite, memory = linear.solve_next(
        matrix, -it.residual, it.memory, forcing, limit, wanted
    )
    if working.turning or working.followers is not None:
        # Moments and following loads have no potential, hence no definite tangent to ask for. In a
        # batch both are done: after each other, as LAPACK's batched calls can wait for each other.
        after, _ = lax.optimization_barrier((-it.residual, step))
        step, definite = lax.cond(
            it.sprint & working.unsymmetric(),
            lambda matrix, rhs, _: linear.solve_general(matrix, rhs),
            lambda matrix, rhs, found: found,
            matrix,
            after,
            (step, definite),
        )
    return step, definite, memory


def go_along(working, it, step, slope, usable):
    """Find a step length; returns the unknowns there, residual, scale, the length and success."""

    def evaluate(a):
        return working.residual_and_scale(working.move(it.x, a * step))

    if it.sprint is None:
        a, residual, scale, found = search(evaluate, step, slope, usable)
    else:  # plain steps are taken whole if they lead to numbers
        a, residual, scale, found = search(evaluate, step, slope, usable & ~it.sprint)
        found = found | (it.sprint & usable & jnp.isfinite(scale))

    def keep(new, old):
        return jnp.where(found, new, old)

    x = keep(working.move(it.x, a * step), it.x)
    return x, keep(residual, it.residual), keep(scale, it.scale), a, found


def largest(residual):
    """Largest entry by size; 0 where nothing is free."""
    return jnp.max(jnp.abs(residual), initial=0.0)
