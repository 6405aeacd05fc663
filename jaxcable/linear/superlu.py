"""SciPy's SuperLU as a direct solver of a fixed pattern: ordered once, factorised many times."""

from __future__ import annotations

import contextlib
import functools
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from ..common.types import Float, Int
from . import solver

_SYMMETRIC = {"SymmetricMode": True}


@functools.cache
def _worker(process):
    """The thread of a process in which factors are made and freed.

    SciPy 1.17 frees the memory of a factor only in the thread that has made it; programs call
    solvers from any thread.
    """
    return ThreadPoolExecutor(1, thread_name_prefix="superlu")


class SuperLU(solver.Solver):
    """SciPy's SuperLU: always installed, chosen where no other solver suits."""

    name = "superlu"
    small_pivots = True

    def suits(self, n: int, banded: bool) -> bool:
        """True: any matrix."""
        return True

    def analyse(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ) -> solver.Analysis:
        """See `solver.Solver`."""
        return _Analysis(n, indptr, indices)


class _Analysis(solver.Analysis):
    """A pattern in an order of the unknowns that is found once."""

    def __init__(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ):
        self.n = n
        pattern = sp.csr_matrix((np.ones(len(indices)), indices, indptr), shape=(n, n))
        # minimum degree on a matrix that needs no pivots; only the ordering is kept
        easy = (pattern + sp.diags(np.full(n, float(n)))).tocsc()
        ordered = sla.splu(
            easy, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=_SYMMETRIC
        )
        self.order = np.argsort(ordered.perm_c)
        numbered = sp.csr_matrix((np.arange(len(indices)), indices, indptr), shape=(n, n))
        permuted = numbered[self.order][:, self.order].tocsc()
        permuted.sort_indices()
        self.take, self.rows = permuted.data, permuted.indices
        self.columns = np.repeat(np.arange(n, dtype=np.int32), np.diff(permuted.indptr))
        self.diagonal = np.flatnonzero(self.rows == self.columns)
        self.matrix = permuted.astype(float)  # every factorisation puts its values in

    def factorize(
        self, values: Float[np.ndarray, " n_value"], definite: bool, small_pivots: bool = False
    ) -> _Factor | None:
        """See `solver.Analysis`; `definite` allows no pivoting, else rows may be exchanged."""
        task = _worker(os.getpid()).submit(self._factorize, values, definite, small_pivots)
        return task.result()

    def _factorize(self, values, definite, small_pivots):
        """`factorize`, in the thread of the worker."""
        values = values[self.take]
        if not np.isfinite(values).all():
            return None
        # scaled to unit diagonal, so that pivots can be compared
        size = np.sqrt(np.abs(values[self.diagonal]))
        size[size == 0] = 1.0
        values /= size[self.rows] * size[self.columns]
        self.matrix.data = values
        try:
            lu = sla.splu(
                self.matrix,
                permc_spec="NATURAL",
                diag_pivot_thresh=0.0 if definite else 1e-3,
                options=_SYMMETRIC,
            )
        except RuntimeError as error:
            if "singular" not in str(error):
                raise
            return None
        pivots = lu.U.diagonal()
        if definite and not (pivots > 0).all():
            return None
        pivots = np.abs(pivots)
        if not small_pivots and not pivots.min() > self.n * np.finfo(float).eps * pivots.max():
            return None
        return _Factor(self, lu, size)


class _Factor(solver.NumericFactor):
    """A numeric factor."""

    def __init__(self, symbolic, lu, size):
        self.order, self.lus, self.size = symbolic.order, [lu], size
        self.n_bytes = 40 * lu.nnz  # with the copies of its triangles that SciPy keeps

    def solve(
        self, b: Float[np.ndarray, "n ..."], transposed: bool = False
    ) -> Float[np.ndarray, "n ..."]:
        """Solve for right-hand sides [n] or [n, m]."""
        size = self.size if b.ndim == 1 else self.size[:, None]
        x = np.empty_like(b)
        x[self.order] = self.lus[0].solve(b[self.order] / size, "T" if transposed else "N") / size
        return x

    def release(self) -> None:
        """Free the memory, in the thread that has allocated it."""
        _worker(os.getpid()).submit(self.lus.clear).result()

    def __del__(self):
        with contextlib.suppress(RuntimeError):  # the process ends
            if self.lus:
                _worker(os.getpid()).submit(self.lus.clear)
