"""Two matrices on one pattern on the host, dense or sparse: products, and a factor of a sum."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy.linalg as la
from jax import lax

from ..common.types import Array, Bool, Float
from . import host, sparse
from .pattern import Matrix, SparseMatrix
from .solver import solver_named
from .spectrum import is_sparse_symmetric

ROUNDING = 16
"""In n eps, of stiffness that is given to what has neither stiffness nor mass."""


def host_arguments(stiffness: Matrix, mass: Matrix) -> tuple[tuple[str, str], list[Array]]:
    """Return the words and the arrays by which host functions know two matrices on one pattern."""
    if isinstance(stiffness, SparseMatrix) and not stiffness.pattern.solver.on_device:
        p = stiffness.pattern
        words = sparse.solver_and_storage_words(p)
        pattern, values = (p.digest, p.indptr, p.indices), [stiffness.values, mass.values]
    else:
        words, none = ("dense", "general"), jnp.zeros(1, jnp.int32)
        pattern = none, none, none
        values = [
            (a.dense() if isinstance(a, SparseMatrix) else a).reshape(-1) for a in (stiffness, mass)
        ]
    return words, [*pattern, *map(lax.stop_gradient, values)]


class SparsePair:
    """Host side of matrices on a sparsity pattern; `solver`, `stored` are words.

    `pattern` has digest, indptr and indices.
    """

    def __init__(self, solver: str, stored: str, pattern: Sequence[np.ndarray]):
        own = solver_named(solver), stored == "symmetric"
        self.analysed = host.analysis_of_pattern(*own, *pattern)
        self.diagonal = self.analysed.diagonal

    def without_loose(
        self,
        stiffness: Float[np.ndarray, " n_value"],
        mass: Float[np.ndarray, " n_value"],
        loose: Bool[np.ndarray, " n"],
    ) -> tuple[Float[np.ndarray, " n_value"], Float[np.ndarray, " n_value"]]:
        """Return the values of K and M without the `loose` unknowns.

        Their rows and columns become those of the identity in K, and zero in M.
        """
        a = self.analysed
        touched = loose[a.rows] | loose[a.indices]
        return host.with_identity_rows(a, stiffness, loose), np.where(touched, 0.0, mass)

    def matrix(self, values: Float[np.ndarray, " n_value"]) -> Any:
        """Return the SciPy matrix with these values, [n_value]."""
        a = self.analysed
        return host.full_scipy_matrix(values, a.indices, a.indptr, a.symmetric)

    def is_symmetric(self, matrix: Any, tol: float) -> bool:
        """Return whether a matrix is symmetric, to `tol` and the roots of its diagonal."""
        return self.analysed.symmetric or is_sparse_symmetric(matrix, tol)

    def factorize(self, values: Float[np.ndarray, " n_value"]) -> Callable[[Any], Any] | None:
        """Return the function that solves with the matrix of these values; None if not definite."""
        factor = self.analysed.find_or_make_factor(values, True)
        return None if factor is None else factor.solve


class DensePair:
    """Host side of dense matrices with n unknowns, whose values are [n * n]; like `SparsePair`."""

    def __init__(self, n: int):
        self.shape, self.diagonal = (n, n), np.arange(n) * (n + 1)

    def without_loose(
        self,
        stiffness: Float[np.ndarray, " n_value"],
        mass: Float[np.ndarray, " n_value"],
        loose: Bool[np.ndarray, " n"],
    ) -> tuple[Float[np.ndarray, " n_value"], Float[np.ndarray, " n_value"]]:
        """Return values of K with rows of the identity, and of M with zeros, for loose unknowns."""
        touched, one = (loose[:, None] | loose).ravel(), np.eye(len(loose)).ravel()
        return np.where(touched, one, stiffness), np.where(touched, 0.0, mass)

    def matrix(self, values: Float[np.ndarray, " n_value"]) -> Any:
        """Return the matrix [n, n] with these values."""
        return values.reshape(self.shape)

    def is_symmetric(self, matrix: Any, tol: float) -> bool:
        """Return whether a matrix is symmetric, to `tol` and the roots of its diagonal."""
        size = np.sqrt(np.abs(np.diagonal(matrix)))
        return not (np.abs(matrix - matrix.T) > tol * np.outer(size, size)).any()

    def factorize(self, values: Float[np.ndarray, " n_value"]) -> Callable[[Any], Any] | None:
        """Return the function that solves with the matrix of these values; None if not definite."""
        matrix = self.matrix(values)
        size = host.diagonal_scale(np.diagonal(matrix))
        scaled = 0.5 * (matrix + matrix.T) / np.outer(size, size)
        try:
            factor = la.cho_factor(scaled, lower=True, check_finite=False)
        except la.LinAlgError:
            return None
        pivots = np.diagonal(factor[0]) ** 2
        if not pivots.min() > len(size) * np.finfo(float).eps * pivots.max():
            return None
        return lambda b: (la.cho_solve(factor, (b.T / size).T, check_finite=False).T / size).T


def make_pair(
    solver: str, stored: str, pattern: Sequence[np.ndarray], n: int
) -> SparsePair | DensePair:
    """Return the `SparsePair` or `DensePair` of matrices with n unknowns, from host arguments.

    Args:
        solver: name of the direct solver; "dense" for a `DensePair`.
        stored: "symmetric" if the pattern has the upper triangle only, else "general".
        pattern: digest, row pointers and column indices.
        n: number of unknowns.
    """
    if solver == "dense":
        return DensePair(n)
    return SparsePair(solver, stored, host.take_first_case(*pattern))


def factorize_shifted(
    pair: SparsePair | DensePair,
    stiffness: Float[np.ndarray, " n_value"],
    mass: Float[np.ndarray, " n_value"],
    shift: float,
) -> Callable[[Any], Any] | None:
    """Return the function that solves with K + s M, of values and a `shift` s; None if indefinite.

    What has neither stiffness nor mass, such as the spin of a free beam about its own line, gets
    some rounding of the stiffness: it is no mode, whatever it gets.
    """
    values = stiffness + shift * mass if shift > 0 else stiffness
    solve = pair.factorize(values)
    if solve is None and shift > 0:
        own = stiffness[pair.diagonal]
        values[pair.diagonal] += ROUNDING * len(own) * np.finfo(float).eps * np.abs(own)
        solve = pair.factorize(values)
    return solve
