"""LAPACK's banded solvers, for nets of some hundred unknowns and small bandwidth.

`banded` has figures of this way and of the two in the program. Of the solvers for any pattern
CHOLMOD and PARDISO take twice as long for 200 unknowns, and SuperLU five times.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.linalg import lapack

from ..common.types import Float, Int
from . import solver
from .pattern import narrow_band_order


class _LapackAnalysis(solver.Analysis):
    """Analysis of a sparsity pattern for LAPACK's banded solvers: an order of small bandwidth."""

    def __init__(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ):
        super().__init__(n, indptr, indices)
        pattern = sp.csr_matrix((np.ones(len(indices)), indices, indptr), (n, n))
        self.order, place = narrow_band_order(pattern)
        row, column = place[np.repeat(np.arange(n), np.diff(indptr))], place[indices]
        self.b = int(np.max(np.abs(row - column), initial=0))
        self.lower = np.flatnonzero(row >= column)
        # positions of the values in the Fortran arrays of LAPACK, column by column
        high = self.b + 1
        self.lower_at = (row - column + column * high)[self.lower]
        self.general_at = row - column + 2 * self.b + column * (3 * self.b + 1)

    def factorize(
        self, values: Float[np.ndarray, " n_value"], definite: bool
    ) -> _LapackFactor | None:
        """Factorise a matrix (its entries): Cholesky if `definite`, else LU; None if singular."""
        if definite:
            band = np.zeros((self.n, self.b + 1))
            band.ravel()[self.lower_at] = values[self.lower]
            band, info = lapack.dpbtrf(band.T, lower=1, overwrite_ab=1)
            pivots, pivot = band[0] ** 2, None
        else:
            band = np.zeros((self.n, 3 * self.b + 1))
            band.ravel()[self.general_at] = values
            band, pivot, info = lapack.dgbtrf(band.T, self.b, self.b, overwrite_ab=1)
            pivots = band[2 * self.b]
        return _LapackFactor(self, band, pivot, pivots) if info == 0 else None


class _LapackFactor(solver.NumericFactor):
    """A banded Cholesky factor, or LU factors with the row exchanges `pivot`, by LAPACK."""

    def __init__(self, symbolic, band, pivot, pivots):
        self.symbolic, self.band, self.pivot, self.pivots = symbolic, band, pivot, pivots
        self.n_bytes = band.nbytes

    def solve(
        self, b: Float[np.ndarray, "n ..."], transposed: bool = False
    ) -> Float[np.ndarray, "n ..."]:
        """Solve for right sides [n] or [n, m], with the matrix or its transpose."""
        order, half = self.symbolic.order, self.symbolic.b
        x = np.empty_like(b)
        if self.pivot is None:
            x[order], _ = lapack.dpbtrs(self.band, b[order], lower=1)
        else:
            banded = self.band, half, half, b[order], self.pivot
            x[order], _ = lapack.dgbtrs(*banded, trans=int(transposed))
        return x


class LapackBanded(solver.Solver):
    """Linear solver with LAPACK's banded factors: for matrices of small bandwidth."""

    name = "banded"
    analysis = _LapackAnalysis
    offered = False
    iterates = False  # a new factor is cheaper than iterations

    def is_suitable_for(self, n: int, banded: bool) -> bool:
        """Tell whether the solver suits a matrix: if its bandwidth is small (`banded`)."""
        return banded
