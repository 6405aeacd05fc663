"""Factorise and solve: the only place that knows matrix formats.

A matrix is a jax array [n, n], or a `Sparse` on a `Pattern`. The functions here take both.
"""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import copy
from ..common.types import Array, ArrayLike, Bool, Float, Int
from . import choice, dense, sparse
from .assembly_map import Gathering, gathering, with_zero
from .bordered import solve_bordered
from .dense import solve_definite
from .direct import Direct
from .pattern import Matrix, Pattern, Sparse, assemble, make_pattern
from .solver import Analysis, NumericFactor, Solver, check, choose, named, offered, register
from .sparse import Factored, SparseFactor, forgotten, nothing_factored
from .spectrum import NOT_COUNTED, is_symmetric, spectrum

__all__ = [
    "NOT_COUNTED",
    "Analysis",
    "Direct",
    "Gathering",
    "Matrix",
    "NumericFactor",
    "Pattern",
    "Solver",
    "Sparse",
    "SparseFactor",
    "assemble",
    "check",
    "choice",
    "choose",
    "diagonal",
    "factorize",
    "forgotten",
    "gathering",
    "held_at",
    "is_definite",
    "is_symmetric",
    "make_pattern",
    "named",
    "nothing_factored",
    "offered",
    "or_identity",
    "or_nan",
    "plus_diagonal",
    "plus_entry",
    "register",
    "solve_bordered",
    "solve_definite",
    "solve_general",
    "solve_next",
    "spectrum",
    "with_zero",
]


def diagonal(matrix: Matrix) -> Float[Array, " n"]:
    """Return the diagonal of a matrix, [n]."""
    return matrix.diagonal() if isinstance(matrix, Sparse) else dense.diagonal(matrix)


def plus_diagonal(matrix: Matrix, shift: Float[ArrayLike, ""]) -> Matrix:
    """Return the matrix with `shift`, a scalar, added to its diagonal."""
    if isinstance(matrix, Sparse):
        return matrix.add_to_diagonal(shift)
    return matrix + shift * jnp.eye(len(matrix), dtype=matrix.dtype)


def plus_entry(matrix: Matrix, place: Int[ArrayLike, ""], value: Float[ArrayLike, ""]) -> Matrix:
    """Return the matrix with `value` added to entry `place` of its diagonal, both scalars."""
    if isinstance(matrix, Sparse):
        return matrix.add_to_diagonal_entry(place, value)
    return matrix.at[place, place].add(value)


def held_at(matrix: Matrix, held: Bool[Array, " n"]) -> Matrix:
    """Return the matrix with the rows and columns of unknowns `held`, [n] bool, emptied.

    Only their diagonal stays: the largest entry of the matrix's, so that its scale does not change.
    """
    stiffness = jnp.max(jnp.abs(diagonal(matrix)))
    if isinstance(matrix, Sparse):
        return matrix.hold_unknowns(held, stiffness)
    touched = held[:, None] | held[None, :]
    return jnp.where(touched, jnp.diag(jnp.where(held, stiffness, 0.0)), matrix)


def or_identity(matrix: Matrix, valid: Bool[ArrayLike, ""]) -> Matrix:
    """Return the matrix if `valid`, else the identity."""
    if isinstance(matrix, Sparse):
        return matrix.identity_unless(valid)
    return jnp.where(valid, matrix, jnp.eye(len(matrix), dtype=matrix.dtype))


def or_nan(matrix: Matrix, defined: Bool[ArrayLike, ""]) -> Matrix:
    """Return the matrix if `defined`, else one of NaN, which counts as singular."""
    factor = jnp.where(defined, 1.0, jnp.nan)
    if isinstance(matrix, Sparse):
        return copy(matrix, values=matrix.values * factor.astype(matrix.values.dtype))
    return matrix * factor.astype(matrix.dtype)


def factorize(
    matrix: Matrix,
    loose: Bool[Array, " n"] | None = None,
    factored: Factored | None = None,
    tol: Float[ArrayLike, ""] = 0.0,
    limit: Int[ArrayLike, ""] = 0,
) -> Direct | SparseFactor:
    """Factorise a general (indefinite or unsymmetric) matrix.

    If it is sparse, positive semidefinite and near to a matrix factorised before, conjugate
    gradients solve with it. They do not see that a matrix is singular in a direction that the right
    side does not touch: then the solution is finite, where that of a factorisation is NaN.

    Args:
        matrix: [n, n]; it is not differentiated.
        loose: unknowns with empty rows and columns, [n] bool, left out of the solve.
        factored: as for `solve_next`.
        tol: residual that conjugate gradients may leave, relative to the right side.
        limit: conjugate gradient steps allowed before a factorisation; 0 unless the matrix is
            known to be positive semidefinite.

    Returns:
        `Direct` or `SparseFactor`; `direct.MatrixFactor` says what they can do.
    """
    if isinstance(matrix, Sparse):
        return sparse.factorize(matrix, loose, factored, tol, limit)
    return dense.factorize(matrix, loose)


def solve_general(
    matrix: Matrix, rhs: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
    """Solve with a general matrix: return the solution [n], and whether the matrix is regular."""
    factor = factorize(matrix)
    return factor.solve(rhs, lambda v: matrix @ v), factor.regular


def is_definite(matrix: Matrix) -> Bool[Array, ""]:
    """Return whether a matrix has no negative eigenvalue, to rounding; not differentiable.

    For an unsymmetric matrix: whether its symmetric part has none.
    """
    if isinstance(matrix, Sparse):
        return sparse.is_definite(matrix)
    return solve_definite(matrix, jnp.zeros(len(matrix), matrix.dtype))[1]


def solve_next(
    matrix: Matrix,
    rhs: Float[Array, " n"],
    factored: Factored | None,
    tol: Float[ArrayLike, ""],
    limit: Int[ArrayLike, ""],
    wanted: Bool[ArrayLike, ""],
) -> tuple[Float[Array, " n"], Bool[Array, ""], Factored | None]:
    """Solve the next of a sequence of similar, positive definite systems; not differentiable.

    A dense matrix is factorised. A sparse matrix is factorised only if conjugate gradients with the
    factor of an earlier matrix would take too many steps.

    Args:
        matrix: [n, n].
        rhs: right side, [n].
        factored: the `Factored` of the solve before, `nothing_factored` at first; None for dense
            matrices.
        tol: residual that conjugate gradients may leave, relative to the right side.
        limit: conjugate gradient steps allowed before a factorisation; 0 always factorises,
            and less than 0 also takes a factor whose pivots have few digits.
        wanted: False if the result does not matter (a finished case of a batch).

    Returns:
        Solution [n]; whether the matrix is positive definite (conjugate gradients see this in the
        directions of their steps only); `Factored` for the next solve.
    """
    if isinstance(matrix, Sparse):
        tol, limit = jnp.asarray(tol, rhs.dtype), jnp.int32(limit)
        return sparse.solve_next(matrix, rhs, factored, tol, limit, jnp.asarray(wanted))
    return *solve_definite(matrix, rhs), factored
