"""The direction of a step of Newton's method, from its linear equations."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from .. import linear
from ..common.batch_conditions import cond_in_batch
from ..common.types import Array, Bool, Float
from ..linear import Matrix
from ..linear.sparse import FactoredMatrix
from ..mechanics.assembly import System

CG_LIMIT = 12  # conjugate gradient steps that cost as much as a factorisation
# Eigenvalues below so many roundings (eps) of the largest stiffness count as zero, because
# assembling and factorising a matrix rounds more than once.
_ZERO_ROUNDINGS = 64
# Largest relative residual that conjugate gradients may leave: a larger one would save some of
# their steps and cost Newton steps.
_MAX_FORCING = 1e-2


def newton_direction(
    system: System,
    matrix: Matrix,
    state: Any,  # a `newton_state.NewtonState`; that module imports this one
    rhs: Float[Array, " n_free"],
    tol: Float[Array, ""],
    wanted: Bool[Array, ""],
) -> tuple[Float[Array, " n_free"], Bool[Array, ""], FactoredMatrix | None]:
    """Solve the linear equations of a Newton step.

    Args:
        system: `System`.
        matrix: its tangent with the Levenberg shift.
        state: `newton_state.NewtonState`, the point and the last factor.
        rhs: right side of the equations, the negative residual or a similar one, [n_free], N.
        tol: relative residual that counts as converged.
        wanted: False if the result does not matter (a finished case of a batch).

    Returns:
        Step [n_free], NaN if an unsymmetric matrix is singular; whether the symmetric part of the
        matrix is positive definite; the last factored sparse matrix, or None.
    """
    # Conjugate gradients cannot see that a matrix is indefinite, so they are used only where the
    # energy is convex. Their tolerance is about the residual that the next Newton step leaves
    # anyway. It steers the effort only: convergence is judged by the residual of the system.
    relative = max_abs(state.residual) / state.scale
    forcing = jnp.clip(relative, 0.1 * tol / relative, _MAX_FORCING)
    similar, min_limit = system.convex, 0
    if (
        state.tension_unknowns is not None
    ):  # matrices of interior steps differ too much from each other
        similar = similar & ~state.tension_unknowns.has_interior_matrix
        min_limit = state.tension_unknowns.interior_point.min_cg_limit
    limit = jnp.where(similar, CG_LIMIT, min_limit)
    step, definite, factored = linear.solve_reusing_factor(
        matrix, rhs, state.factored, forcing, limit, wanted
    )
    if system.may_be_unsymmetric:
        # Moments, following loads and elements that say so have no potential. Where the symmetric
        # part is definite, the step by the whole tangent leads downhill, too: R.p = -p.(sym K)p.
        # Steps by the symmetric part alone converge linearly, or not at all beside a large rest.
        step = cond_in_batch(
            system.unsymmetric(), lambda _: linear.solve_general(matrix, rhs)[0], step
        )
    return step, definite, factored


def with_loose_nodes_held(
    system: System, matrix: Matrix, x: Float[Array, "n_row n_motion"]
) -> Matrix:
    """Return a tangent at motion `x` with the unknowns of loose nodes held.

    What only slack elements hold has no stiffness, and says nothing of the stability of the rest.
    """
    loose = system.nodes_without_stiffness(x)[system.dof_map.row_of_unknown]
    return linear.hold_unknowns(matrix, loose)


@jax.jit  # one function in a program
def max_abs(residual: Float[Array, " n_free"]) -> Float[Array, ""]:
    """Return the largest absolute value of an array; 0 without unknowns."""
    return jnp.max(jnp.abs(residual), initial=0.0)


def zero_eigenvalue_bound(matrix: Matrix) -> Float[Array, ""]:
    """Return how large rounding can make a zero eigenvalue of a tangent, N/m; positive."""
    size = jnp.max(jnp.abs(linear.diagonal(matrix)), initial=0.0)
    return _ZERO_ROUNDINGS * jnp.finfo(size.dtype).eps * size + jnp.finfo(size.dtype).tiny
