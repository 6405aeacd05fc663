"""LAPACK's banded solvers, for nets of some hundred unknowns and small bandwidth."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.linalg import lapack
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..common.types import Float, Int
from . import solver


class Banded(solver.Solver):
    """LAPACK for matrices of small bandwidth."""

    name = "banded"
    small_pivots = True
    offered = False
    iterates = False  # a new factor is cheaper than iterations

    def suits(self, n: int, banded: bool) -> bool:
        """True for a small bandwidth."""
        return banded

    def analyse(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ) -> solver.Analysis:
        """See `solver.Solver`."""
        return _Analysis(n, indptr, indices)


class _Analysis(solver.Analysis):
    """An order of small bandwidth for a pattern."""

    def __init__(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ):
        self.n = n
        pattern = sp.csr_matrix((np.ones(len(indices)), indices, indptr), (n, n))
        self.order = reverse_cuthill_mckee(pattern, symmetric_mode=True)
        place = np.empty(n, np.int64)
        place[self.order] = np.arange(n)
        row, column = place[np.repeat(np.arange(n), np.diff(indptr))], place[indices]
        self.b = int(np.max(np.abs(row - column), initial=0))
        self.lower = np.flatnonzero(row >= column)
        # positions of the values in the Fortran arrays of LAPACK, column by column
        high = self.b + 1
        self.lower_at = (row - column + column * high)[self.lower]
        self.general_at = row - column + 2 * self.b + column * (3 * self.b + 1)
        self.diagonal = np.flatnonzero(row == column)
        self.places = row, column
        self.diagonal = self.diagonal[np.argsort(row[self.diagonal])]

    def factorize(
        self, values: Float[np.ndarray, " n_value"], definite: bool, small_pivots: bool = False
    ) -> _Factor | None:
        """See `solver.Analysis`: Cholesky's factor if `definite`, which is faster, else LU."""
        diagonal = np.abs(values[self.diagonal])
        size = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))  # so that pivots can be compared
        row, column = self.places
        values = values / (size[row] * size[column])
        limit = 0.0 if small_pivots else self.n * np.finfo(float).eps
        if definite:
            band = np.zeros((self.n, self.b + 1))
            band.ravel()[self.lower_at] = values[self.lower]
            band, info = lapack.dpbtrf(band.T, lower=1, overwrite_ab=1)
            pivots, factor = band[0] ** 2, (band, None)
        else:
            band = np.zeros((self.n, 3 * self.b + 1))
            band.ravel()[self.general_at] = values
            band, pivot, info = lapack.dgbtrf(band.T, self.b, self.b, overwrite_ab=1)
            pivots, factor = np.abs(band[2 * self.b]), (band, pivot)
        if info != 0 or not pivots.min(initial=np.inf) > limit * pivots.max(initial=0.0):
            return None
        return _Factor(self, *factor, size)


class _Factor(solver.NumericFactor):
    """A numeric factor; `pivot` is None for a Cholesky factor."""

    def __init__(self, symbolic, band, pivot, size):
        self.symbolic, self.band, self.pivot, self.size = symbolic, band, pivot, size
        self.n_bytes = band.nbytes

    def solve(
        self, b: Float[np.ndarray, "n ..."], transposed: bool = False
    ) -> Float[np.ndarray, "n ..."]:
        """Solve for right-hand sides [n] or [n, m]."""
        order, half = self.symbolic.order, self.symbolic.b
        size = self.size if b.ndim == 1 else self.size[:, None]
        rhs = b[order] / size
        if self.pivot is None:
            y, _ = lapack.dpbtrs(self.band, rhs, lower=1)
        else:
            y, _ = lapack.dgbtrs(self.band, half, half, rhs, self.pivot, trans=int(transposed))
        x = np.empty_like(b)
        x[order] = y / size
        return x
