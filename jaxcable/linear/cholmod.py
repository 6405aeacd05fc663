"""CHOLMOD of SuiteSparse, by way of `cvxopt`: supernodal Cholesky factors of definite matrices.

Matrices that are not definite go to SuperLU.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..common.types import Float, Int
from . import solver
from .superlu import SuperLU

_SUPERNODAL = 2  # by blocks, and with a diagonal that can be read
# Entries of a factor over n log2(n), for a guess of its memory: 4.1 to 5.5 were counted for plane
# grids of 7 500 to 120 000 unknowns.
_FILL_RATIO = 6


@functools.cache
def load_cvxopt() -> Any:
    """Import `cvxopt` and return the module; raise ImportError if it is not installed."""
    importlib.import_module("cvxopt.cholmod")
    return importlib.import_module("cvxopt")


class _CholmodAnalysis(solver.Analysis):
    """Symbolic analysis of a sparsity pattern by CHOLMOD; each factor in use has a copy of it."""

    def __init__(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ):
        super().__init__(n, indptr, indices)
        # the upper triangle by rows is the lower one by columns
        columns = np.repeat(np.arange(n), np.diff(indptr))
        self.take = np.flatnonzero(indices >= columns)
        positions = (
            load_cvxopt().matrix(i[self.take].astype(np.int64)) for i in (indices, columns)
        )
        self.matrix = load_cvxopt().spmatrix(
            1.0, *positions, (n, n)
        )  # takes the values of each factor
        self.free = []

    def factorize(
        self, values: Float[np.ndarray, " n_value"], definite: bool
    ) -> solver.NumericFactor | None:
        """Factorise the matrix with these entries, [n_value]; return None if it is singular.

        With `definite` by CHOLMOD, for which an indefinite matrix is singular, else by
        SuperLU.
        """
        if not definite:
            return self.indefinite_analysis.factorize(values, False)
        self.matrix.V = load_cvxopt().matrix(values[self.take])
        with _supernodal_cholmod() as cholmod:
            handle = self.free.pop() if self.free else cholmod.symbolic(self.matrix)
            try:
                cholmod.numeric(self.matrix, handle)
            except ArithmeticError:  # the matrix is not positive definite
                self.free[:] = [handle]
                return None
            return _CholmodFactor(self, handle, np.asarray(cholmod.diag(handle)) ** 2)

    @functools.cached_property
    def indefinite_analysis(self) -> solver.Analysis:
        """Analysis of the same pattern by SuperLU, for matrices that are not positive definite."""
        return SuperLU().analyze(*self.arguments)

    def release(self) -> None:
        """Free the memory of factors that are not in use."""
        self.free.clear()


@contextlib.contextmanager
def _supernodal_cholmod() -> Iterator[Any]:
    """Yield the module `cholmod`, set to supernodal factors while a ``with`` block runs."""
    cholmod = load_cvxopt().cholmod
    before = dict(cholmod.options)
    cholmod.options["supernodal"] = _SUPERNODAL
    try:
        yield cholmod
    finally:
        cholmod.options.clear()
        cholmod.options.update(before)


class _CholmodFactor(solver.NumericFactor):
    """A Cholesky factor of a positive definite matrix, computed by CHOLMOD."""

    def __init__(self, symbolic, handle, pivots):
        self.symbolic, self.handle, self.pivots = symbolic, handle, pivots
        n = symbolic.n
        self.n_bytes = 8 * max(len(symbolic.take), int(_FILL_RATIO * n * np.log2(n + 1)))

    def solve(
        self, b: Float[np.ndarray, "n ..."], transposed: bool = False
    ) -> Float[np.ndarray, "n ..."]:
        """Solve for right sides [n] or [n, m]; the matrix is symmetric, `transposed` or not."""
        x = load_cvxopt().matrix(b)
        load_cvxopt().cholmod.solve(self.handle, x)
        return np.asarray(x).reshape(b.shape)

    def release(self) -> None:
        """Return the factor's memory to the analysis, which reuses it for the next factor."""
        self.symbolic.free[:] = [self.handle]


class Cholmod(solver.Solver):
    """Linear solver CHOLMOD, available where the package `cvxopt` is installed."""

    name = "cholmod"
    package = "cvxopt"
    analysis = _CholmodAnalysis

    def is_suitable_for(self, n: int, banded: bool) -> bool:
        """Return True: CHOLMOD suits matrices of any size and bandwidth."""
        return True
