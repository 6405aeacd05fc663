"""CHOLMOD of SuiteSparse, by way of `cvxopt`: supernodal Cholesky factors of definite matrices.

Matrices that are not definite go to SuperLU.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..common.types import Float, Int
from . import solver
from .superlu import SuperLU

_SUPERNODAL = 2  # by blocks, and with a diagonal that can be read
# Entries of a factor over n log2(n), for a guess of its memory: 4.1 to 5.5 were counted for plane
# grids of 7 500 to 120 000 unknowns.
_FILL = 6


@functools.cache
def library() -> Any:
    """The module `cvxopt`; raises ImportError if it is not installed."""
    import cvxopt
    import cvxopt.cholmod

    return cvxopt


class Cholmod(solver.Solver):
    """CHOLMOD, where `cvxopt` is installed."""

    name = "cholmod"
    small_pivots = True

    def available(self) -> bool:
        """Whether `cvxopt` is installed."""
        return importlib.util.find_spec("cvxopt") is not None

    def missing(self) -> str:
        """Text of the error where `cvxopt` is not installed."""
        return 'cvxopt is not installed; use "superlu", or install the extra jaxcable[cholmod]'

    def suits(self, n: int, banded: bool) -> bool:
        """True: any matrix."""
        return True

    def analyse(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ) -> solver.Analysis:
        """See `solver.Solver`."""
        return _Analysis(n, indptr, indices)


class _Analysis(solver.Analysis):
    """A pattern; it is analysed once for each of the factors that exist side by side."""

    def __init__(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ):
        self.n, self.arguments = n, (n, indptr, indices)
        # the upper triangle by rows is the lower one by columns
        columns = np.repeat(np.arange(n), np.diff(indptr))
        self.take = np.flatnonzero(indices >= columns)
        self.rows, self.columns = indices[self.take].astype(np.int64), columns[self.take]
        self.diagonal = np.flatnonzero(self.rows == self.columns)
        matrix = library().matrix
        positions = matrix(self.rows), matrix(self.columns.astype(np.int64))
        self.matrix = library().spmatrix(1.0, *positions, (n, n))  # takes the values of each factor
        self.free = []

    def factorize(
        self, values: Float[np.ndarray, " n_value"], definite: bool, small_pivots: bool = False
    ) -> solver.NumericFactor | None:
        """See `solver.Analysis`."""
        if not definite:
            return self.general.factorize(values, False)
        if not np.isfinite(values).all():
            return None
        values = values[self.take]
        size = np.sqrt(np.abs(values[self.diagonal]))  # so that pivots can be compared
        size[size == 0] = 1.0
        self.matrix.V = library().matrix(values / (size[self.rows] * size[self.columns]))
        with _supernodal() as cholmod:
            handle = self.free.pop() if self.free else cholmod.symbolic(self.matrix)
            factor = _Factor(self, handle, size)
            try:
                cholmod.numeric(self.matrix, handle)
            except ArithmeticError:  # the matrix is not positive definite
                factor.release()
                return None
            pivots = np.asarray(cholmod.diag(handle)) ** 2
        if not small_pivots and not pivots.min() > self.n * np.finfo(float).eps * pivots.max():
            factor.release()
            return None
        return factor

    @functools.cached_property
    def general(self) -> solver.Analysis:
        """Analysis for matrices that are not definite."""
        return SuperLU().analyse(*self.arguments)

    def release(self) -> None:
        """Free the memory of factors that are not in use."""
        self.free.clear()


@contextlib.contextmanager
def _supernodal() -> Iterator[Any]:
    """The module `cholmod`, set to factors by blocks meanwhile."""
    cholmod = library().cholmod
    before = dict(cholmod.options)
    cholmod.options["supernodal"] = _SUPERNODAL
    try:
        yield cholmod
    finally:
        cholmod.options.clear()
        cholmod.options.update(before)


class _Factor(solver.NumericFactor):
    """A numeric factor of a matrix scaled to unit diagonal."""

    def __init__(self, symbolic, handle, size):
        self.symbolic, self.handle, self.size = symbolic, handle, size
        n = symbolic.n
        self.n_bytes = 8 * max(len(symbolic.rows), int(_FILL * n * np.log2(n + 1)))

    def solve(
        self, b: Float[np.ndarray, "n ..."], transposed: bool = False
    ) -> Float[np.ndarray, "n ..."]:
        """Solve for right-hand sides [n] or [n, m]; the matrix is symmetric."""
        size = self.size if b.ndim == 1 else self.size[:, None]
        x = library().matrix(b / size)
        library().cholmod.solve(self.handle, x)
        return np.asarray(x).reshape(b.shape) / size

    def release(self) -> None:
        """Give the memory of the factor back: the analysis keeps one for the next factor."""
        self.symbolic.free[:] = [self.handle]
