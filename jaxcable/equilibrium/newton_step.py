"""The direction of a step of Newton's method, from its linear equations."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from .. import linear
from ..common.batch_conditions import cond_in_batch
from ..common.types import Array, Bool, Float
from ..linear import Matrix
from ..linear.sparse import FactorRecord
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
    rhs: Float[Array, " n_free"],
    relative_residual: Float[Array, ""],
    tol: Float[Array, ""],
    factored: FactorRecord | None,
    wanted: Bool[Array, ""],
    similar: Bool[Array, ""],
    min_limit: int = 0,
) -> tuple[Float[Array, " n_free"], Bool[Array, ""], FactorRecord | None]:
    """Solve the linear equations of a Newton step.

    Args:
        system: `System`.
        matrix: its tangent with the Levenberg shift.
        rhs: right side of the equations, the negative residual or a similar one, [n_free], N.
        relative_residual: largest residual at the point over the force it is compared with.
        tol: relative residual that counts as converged.
        factored: the last factored matrix.
        wanted: False if the result does not matter (a finished case of a batch).
        similar: whether the matrix is positive definite and like that of the step before, so that
            conjugate gradients may use its factor.
        min_limit: as `limit` of `linear.solve_reusing_factor`, where it is not.

    Returns:
        Step [n_free], NaN if an unsymmetric matrix is singular; whether the symmetric part of the
        matrix is positive definite; the last factored sparse matrix, or None.
    """
    # Conjugate gradients cannot see that a matrix is indefinite, so they are used only where the
    # energy is convex. Their tolerance is about the residual that the next Newton step leaves
    # anyway. It steers the effort only: convergence is judged by the residual of the system.
    forcing = jnp.clip(relative_residual, 0.1 * tol / relative_residual, _MAX_FORCING)
    limit = jnp.where(similar, CG_LIMIT, min_limit)
    step, definite, factored = linear.solve_reusing_factor(
        matrix, rhs, factored, forcing, limit, wanted
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


def stability_shift(bound: Float[Array, ""]) -> Float[Array, ""]:
    """Return the shift of a tangent that is positive definite if the equilibrium is stable, N/m.

    `bound` is `zero_eigenvalue_bound`. What turns freely, with an eigenvalue of zero, is not
    stable. In single precision slender beams have eigenvalues below the bound, too: there it is.
    """
    return -bound if jnp.finfo(bound.dtype).eps < 1e-12 else bound
