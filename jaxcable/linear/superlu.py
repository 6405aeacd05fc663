"""SciPy's SuperLU as a direct solver of a fixed pattern: ordered once, factorised many times."""

from __future__ import annotations

import contextlib
import functools
import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from ..common.types import Float, Int
from . import solver


@functools.cache
def _factor_thread(process):
    """Return the executor with the one thread of a process that makes and frees SuperLU factors.

    SciPy 1.17 frees the memory of a factor only in the thread that has made it; programs call
    solvers from any thread. `process` is the number of the process: a fork gets its own thread.
    """
    return ThreadPoolExecutor(1, thread_name_prefix="superlu")


def decompose_lu(matrix: Any, **options: Any) -> Any:
    """Factorise a SciPy matrix by SuperLU, with options of `splu`; None if it is singular."""
    try:
        return sla.splu(matrix, **options)
    except RuntimeError as error:
        if "singular" not in str(error):
            raise
        return None


def decompose_without_pivoting(
    matrix: Any, order: str = "MMD_AT_PLUS_A", threshold: float = 0.0
) -> Any:
    """Factorise by SuperLU, exchanging rows only for pivots below `threshold`; None if singular."""
    options = {"SymmetricMode": True}
    return decompose_lu(matrix, permc_spec=order, diag_pivot_thresh=threshold, options=options)


class _SuperLUAnalysis(solver.Analysis):
    """Analysis of a sparsity pattern for SuperLU: a fill-reducing order of the unknowns."""

    def __init__(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ):
        numbered = sp.csr_matrix((np.arange(len(indices)), indices, indptr), shape=(n, n))
        pattern = sp.csr_matrix((np.ones(len(indices)), indices, indptr), shape=(n, n))
        # minimum degree on a matrix that needs no pivots; only the ordering is kept
        easy = (pattern + sp.diags(np.full(n, float(n)))).tocsc()
        self.order = np.argsort(decompose_without_pivoting(easy).perm_c)
        permuted = numbered[self.order][:, self.order].tocsc()
        permuted.sort_indices()
        self.take = permuted.data
        self.matrix = permuted.astype(float)  # every factorisation puts its values in

    def factorize(
        self, values: Float[np.ndarray, " n_value"], definite: bool
    ) -> _SuperLUFactor | None:
        """Factorise a matrix (its entries), unpivoted if `definite`; None if it is singular."""
        return (
            _factor_thread(os.getpid())
            .submit(self._factorize_in_factor_thread, values, definite)
            .result()
        )

    def _factorize_in_factor_thread(self, values, definite):
        """Return the factor of a matrix as `factorize` does; runs in `_factor_thread`."""
        self.matrix.data = values[self.take]
        lu = decompose_without_pivoting(self.matrix, "NATURAL", 0.0 if definite else 1e-3)
        return None if lu is None else _SuperLUFactor(self.order, lu)


class _SuperLUFactor(solver.NumericFactor):
    """LU factors of a sparse matrix, computed by SuperLU."""

    def __init__(self, order, lu):
        self.order, self.lus, self.pivots = order, [lu], lu.U.diagonal()
        self.n_bytes = 40 * lu.nnz  # with the copies of its triangles that SciPy keeps

    def solve(
        self, b: Float[np.ndarray, "n ..."], transposed: bool = False
    ) -> Float[np.ndarray, "n ..."]:
        """Solve for right sides [n] or [n, m], with the matrix or its transpose."""
        x = np.empty_like(b)
        x[self.order] = self.lus[0].solve(b[self.order], "T" if transposed else "N")
        return x

    def release(self) -> None:
        """Free the memory of the factors, in the thread that has allocated it."""
        _factor_thread(os.getpid()).submit(self.lus.clear).result()

    def __del__(self):
        with contextlib.suppress(RuntimeError):  # the process ends
            if self.lus:
                _factor_thread(os.getpid()).submit(self.lus.clear)


class SuperLU(solver.Solver):
    """Linear solver SuperLU of SciPy: always installed, chosen where no other solver suits."""

    name = "superlu"
    analysis = _SuperLUAnalysis

    def is_suitable_for(self, n: int, banded: bool) -> bool:
        """Return True: SuperLU suits matrices of any size and bandwidth."""
        return True
