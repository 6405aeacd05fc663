"""Factorise and solve: the only place that knows matrix formats.

A matrix is a jax array [n, n], or a `SparseMatrix` on a `Pattern`. The functions here take both.
"""

from __future__ import annotations

import jax.numpy as jnp

from ..common.tree import copy_with
from ..common.types import Array, ArrayLike, Bool, Float, Int
from . import choice, dense, sparse
from .assembly_map import AssemblyMap, append_zero, make_assembly_map
from .beside_modes import solve_beside_modes
from .bordered import solve_bordered
from .dense import solve_definite
from .direct import OnDeviceFactor
from .eigenmodes import FoundModes, lowest_modes
from .pattern import Matrix, Pattern, SparseMatrix, assemble_matrix, make_pattern
from .solver import (
    Analysis,
    NumericFactor,
    Solver,
    check_solver_name,
    choose_solver,
    register,
    selectable_solver_names,
    solver_named,
)
from .sparse import FactorRecord, SparseFactor, no_factored_matrix, with_unusable_factor
from .spectrum import NOT_COUNTED, inertia_and_nearest_mode, is_symmetric

__all__ = [
    "NOT_COUNTED",
    "Analysis",
    "AssemblyMap",
    "FoundModes",
    "Matrix",
    "NumericFactor",
    "OnDeviceFactor",
    "Pattern",
    "Solver",
    "SparseFactor",
    "SparseMatrix",
    "add_to_diagonal",
    "add_to_diagonal_entry",
    "append_zero",
    "assemble_matrix",
    "check_solver_name",
    "choice",
    "choose_solver",
    "diagonal",
    "factorize",
    "hold_unknowns",
    "identity_unless",
    "inertia_and_nearest_mode",
    "is_definite",
    "is_symmetric",
    "lowest_modes",
    "make_assembly_map",
    "make_pattern",
    "nan_unless",
    "no_factored_matrix",
    "register",
    "selectable_solver_names",
    "solve_beside_modes",
    "solve_bordered",
    "solve_definite",
    "solve_general",
    "solve_reusing_factor",
    "solver_named",
    "with_unusable_factor",
]


def diagonal(matrix: Matrix) -> Float[Array, " n"]:
    """Return the diagonal of a matrix, [n]."""
    return matrix.diagonal() if isinstance(matrix, SparseMatrix) else dense.diagonal(matrix)


def add_to_diagonal(matrix: Matrix, shift: Float[ArrayLike, ""]) -> Matrix:
    """Return the matrix with `shift`, a scalar, added to its diagonal."""
    if isinstance(matrix, SparseMatrix):
        return matrix.add_to_diagonal(shift)
    return matrix + shift * jnp.eye(len(matrix), dtype=matrix.dtype)


def add_to_diagonal_entry(
    matrix: Matrix, place: Int[ArrayLike, ""], value: Float[ArrayLike, ""]
) -> Matrix:
    """Return the matrix with `value`, a scalar, added to its diagonal entry of index `place`."""
    if isinstance(matrix, SparseMatrix):
        return matrix.add_to_diagonal_entry(place, value)
    return matrix.at[place, place].add(value)


def hold_unknowns(matrix: Matrix, held: Bool[Array, " n"]) -> Matrix:
    """Return the matrix with zero rows and columns for the unknowns `held`, [n] bool.

    Their diagonal entries become the largest one of the matrix, so that it stays regular and its
    scale does not change.
    """
    stiffness = jnp.max(jnp.abs(diagonal(matrix)), initial=0.0)
    if isinstance(matrix, SparseMatrix):
        return matrix.hold_unknowns(held, stiffness)
    touched = held[:, None] | held[None, :]
    return jnp.where(touched, jnp.diag(jnp.where(held, stiffness, 0.0)), matrix)


def identity_unless(matrix: Matrix, valid: Bool[ArrayLike, ""]) -> Matrix:
    """Return the matrix if the scalar `valid` is true, else the identity."""
    if isinstance(matrix, SparseMatrix):
        return matrix.identity_unless(valid)
    return jnp.where(valid, matrix, jnp.eye(len(matrix), dtype=matrix.dtype))


def nan_unless(matrix: Matrix, defined: Bool[ArrayLike, ""]) -> Matrix:
    """Return the matrix if `defined`, a scalar, else a matrix of NaN, which counts as singular."""
    factor = jnp.where(defined, 1.0, jnp.nan)
    if isinstance(matrix, SparseMatrix):
        return copy_with(matrix, values=matrix.values * factor.astype(matrix.values.dtype))
    return matrix * factor.astype(matrix.dtype)


def factorize(
    matrix: Matrix,
    loose: Bool[Array, " n"] | None = None,
    factored: FactorRecord | None = None,
    tol: Float[ArrayLike, ""] = 0.0,
    limit: Int[ArrayLike, ""] = 0,
) -> OnDeviceFactor | SparseFactor:
    """Factorise a general (indefinite or unsymmetric) matrix, for solves with it and its transpose.

    If the matrix is sparse, positive semidefinite and near to a matrix factorised before, conjugate
    gradients with that factor solve instead. They do not notice a singular matrix if the right side
    has no part along the singular direction: the solution is then finite, where that of a
    factorisation would be NaN.

    Args:
        matrix: [n, n]; it is not differentiated.
        loose: unknowns without stiffness (empty rows and columns), left out of the solve, [n]
            bool.
        factored: the `FactorRecord` of an earlier `solve_reusing_factor`; None for none.
        tol: residual that conjugate gradients may leave, relative to the right side.
        limit: conjugate gradient steps allowed before a factorisation; 0 unless the matrix is known
            to be positive semidefinite.

    Returns:
        The factor, with methods such as `solve` and `solve_adjoint`: `OnDeviceFactor` in the
        compiled program, or `SparseFactor` on the host.
    """
    if isinstance(matrix, SparseMatrix):
        return sparse.factorize(matrix, loose, factored, tol, limit)
    return dense.factorize(matrix, loose)


def solve_general(
    matrix: Matrix, rhs: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
    """Solve A x = b with a general matrix, differentiable.

    Returns x, [n], NaN if A is singular, and whether A is regular, scalar bool.
    """
    factor = factorize(matrix)
    return factor.solve(rhs, lambda v: matrix @ v), factor.regular


def is_definite(matrix: Matrix) -> Bool[Array, ""]:
    """Return whether a symmetric matrix is positive definite to rounding; not differentiable.

    For an unsymmetric matrix: whether its symmetric part is.
    """
    if isinstance(matrix, SparseMatrix):
        return sparse.is_definite(matrix)
    return solve_definite(matrix, jnp.zeros(len(matrix), matrix.dtype))[1]


def solve_reusing_factor(
    matrix: Matrix,
    rhs: Float[Array, " n"],
    factored: FactorRecord | None,
    tol: Float[ArrayLike, ""],
    limit: Int[ArrayLike, ""],
    wanted: Bool[ArrayLike, ""],
) -> tuple[Float[Array, " n"], Bool[Array, ""], FactorRecord | None]:
    """Solve one of a sequence of similar, positive definite systems; not differentiable.

    A dense matrix is factorised. A sparse matrix is factorised only if conjugate gradients with the
    factor of an earlier matrix would take too many steps.

    Args:
        matrix: positive definite, [n, n].
        rhs: right side, [n].
        factored: the `FactorRecord` that the solve before has returned, `no_factored_matrix` at
            first; None for dense matrices.
        tol: residual that conjugate gradients may leave, relative to the right side.
        limit: conjugate gradient steps allowed before a factorisation; 0 always factorises, and
            less than 0 also accepts a factor whose pivots have few correct digits.
        wanted: False if the result does not matter (a finished case of a batch).

    Returns:
        Solution [n]; whether the matrix is positive definite (conjugate gradients see this in the
        directions of their steps only); `FactorRecord` for the next solve.
    """
    if isinstance(matrix, SparseMatrix):
        tol, limit = jnp.asarray(tol, rhs.dtype), jnp.int32(limit)
        return sparse.solve_reusing_factor(matrix, rhs, factored, tol, limit, jnp.asarray(wanted))
    return *solve_definite(matrix, rhs), factored
