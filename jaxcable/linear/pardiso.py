"""PARDISO of Intel's MKL, by way of `pypardiso`: analysed once, factorised many times.

The functions of `pypardiso` repeat the analysis with every factorisation and treat all matrices as
unsymmetric. Here a pattern is analysed once per matrix type, several factors exist side by side
(PARDISO's `mnum`), and symmetric positive definite matrices are treated as such.
"""

from __future__ import annotations

import ctypes
import functools
import threading
from typing import Any

import numpy as np

from ..common.types import Float, Int
from . import solver

_DEFINITE, _GENERAL = 2, 11  # PARDISO's matrix types
_SLOTS = (
    8  # factors of a pattern that can exist side by side; `host` keeps four, and makes new ones
)
_ONE_THREAD_UNKNOWNS = 3000  # up to which one thread is as fast as several (`benchmark.py scaling`)
# Entries per row of the upper triangle up to which minimum degree gives the better ordering, as in
# nets with one unknown per node (a third less time at 5 000 to 40 000 unknowns).
_THIN_ROW = 4
# Right sides up to which it is faster to solve one after the other (3 sides: 4 times as fast).
_FEW_RIGHT_SIDES = 16
_ARGUMENT_COUNT = 16  # of MKL's function `pardiso`, all of them addresses


@functools.cache
def load_mkl() -> Any:
    """Load the MKL library with PARDISO and return it; raise ImportError if it is not installed."""
    from pypardiso.pardiso_wrapper import PyPardisoSolver

    mkl = PyPardisoSolver().libmkl
    mkl.pardiso.argtypes = [ctypes.c_void_p] * _ARGUMENT_COUNT
    mkl.pardiso.restype = None
    mkl.pardiso_getdiag.argtypes = [ctypes.c_void_p] * 5
    mkl.pardiso_getdiag.restype = None
    mkl.MKL_Set_Num_Threads_Local.argtypes = [ctypes.c_int]
    mkl.MKL_Set_Num_Threads_Local.restype = ctypes.c_int
    return mkl


class _PardisoAnalysis(solver.Analysis):
    """Analysis of a sparsity pattern by PARDISO, for definite and general matrices separately."""

    def __init__(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ):
        super().__init__(n, indptr, indices)
        self.handles = {}

    def factorize(
        self, values: Float[np.ndarray, " n_value"], definite: bool
    ) -> _PardisoFactor | None:
        """Factorise a matrix (its entries): Cholesky if `definite`, else LU; None if singular."""
        kind = _DEFINITE if definite else _GENERAL
        if kind not in self.handles:
            self.handles[kind] = _PardisoHandle(kind, *self.arguments)
        return self.handles[kind].factorize(values)

    def release(self) -> None:
        """Free the memory that PARDISO holds for this pattern and its factors."""
        for handle in self.handles.values():
            handle.call_pardiso(-1, 1, None)
        self.handles.clear()


class _PardisoHandle:
    """PARDISO's memory for one sparsity pattern and one matrix type, with `_SLOTS` slots.

    `factorize` fills a free slot with a factor; `_PardisoFactor.release` frees it for another one.
    """

    def __init__(
        self,
        kind: int,
        n: int,
        indptr: Int[np.ndarray, " n+1"],
        indices: Int[np.ndarray, " n_value"],
    ):
        self.kind, self.n = kind, n
        rows = np.repeat(np.arange(n), np.diff(indptr))
        # PARDISO takes the upper triangle of a symmetric matrix
        self.take = np.flatnonzero(indices >= rows) if kind == _DEFINITE else slice(None)
        self.indices = indices[self.take].astype(np.int32)
        self.indptr = np.searchsorted(rows[self.take], np.arange(n + 1)).astype(np.int32)
        self.memory = np.zeros(64, np.int64)
        self.iparm = np.zeros(64, np.int32)  # indices from zero; the manual counts from one
        self.iparm[0] = 1  # no defaults
        thin = len(self.indices) <= _THIN_ROW * n
        self.iparm[1] = 0 if thin else 2  # minimum degree, or nested dissection
        self.iparm[9] = 13  # pivots below 1e-13 of the matrix are perturbed and counted
        self.iparm[17] = -1  # count the entries of the factor
        self.iparm[34] = 1  # indices from zero
        self.iparm[55] = 1  # keep the diagonal of the factor readable
        self.free = list(range(_SLOTS, 0, -1))
        self.alone = n <= _ONE_THREAD_UNKNOWNS
        # maximum of slots, slot, matrix type, phase, unknowns, right sides, messages, error, unused
        self.numbers = np.array([_SLOTS, 0, kind, 0, n, 1, 0, 0, 0], np.int32)
        self.pointer = _address_of(self.numbers)
        self.constant = tuple(
            map(_address_of, (self.memory, self.indptr, self.indices, self.iparm))
        )
        self.call_pardiso(11, 1, np.ones(len(self.indices)))

    def factorize(self, values: Float[np.ndarray, " n_value"]) -> _PardisoFactor | None:
        """Factorise the matrix with these entries in a free slot; return None if it is singular."""
        values, slot = values[self.take], self.free.pop()
        error = self.call_pardiso(22, slot, values)
        factor = _PardisoFactor(self, slot, values)
        if self.kind == _DEFINITE:
            factor.pivots = self.read_pivots(slot)
        elif self.iparm[13] != 0:  # a pivot was perturbed
            error = 1
        if error == 0:
            return factor
        factor.release()
        return None

    def read_pivots(self, slot: int) -> Float[np.ndarray, " n"]:
        """Return the pivots, [n], of the Cholesky factor in a slot."""
        pivots, diagonal, numbers = (
            np.empty(self.n),
            np.empty(self.n),
            np.array([slot, 0], np.int32),
        )
        first = _address_of(numbers)
        arrays = (
            _address_of(self.memory),
            _address_of(pivots),
            _address_of(diagonal),
        )
        load_mkl().pardiso_getdiag(*arrays, first, first + 4)
        return pivots

    def call_pardiso(
        self,
        phase: int,
        slot: int,
        values: Float[np.ndarray, " n_value"] | None,
        b: Float[np.ndarray, "n ..."] | None = None,
        x: Float[np.ndarray, "n ..."] | None = None,
    ) -> int:
        """Call PARDISO for the factor in a slot; return its error number, 0 for none.

        `phase` says what to do (11 analysis, 22 factors, 33 solution), `values` are the entries of
        the matrix, `b` right sides [n] or [n, m]; the solution is written to `x`.
        """
        mkl, numbers, at = load_mkl(), self.numbers, self.pointer
        numbers[[1, 3, 5]] = slot, phase, 1 if b is None or b.ndim == 1 else b.shape[1]
        numbers[7] = 0
        # addresses of the numbers; ctypes would take as long to make pointers as MKL to solve
        most, number, kind, what, n, count, silent, error, unused = range(at, at + 36, 4)
        memory, indptr, indices, iparm = self.constant
        values_at, b_at, x_at = (unused if a is None else _address_of(a) for a in (values, b, x))
        before = mkl.MKL_Set_Num_Threads_Local(1) if self.alone else None
        mkl.pardiso(
            *(memory, most, number, kind, what, n, values_at, indptr, indices, unused, count),
            *(iparm, silent, b_at, x_at, error),
        )
        if before is not None:
            mkl.MKL_Set_Num_Threads_Local(before)
        return int(numbers[7])


def _address_of(array):
    """Return the memory address of the first entry of a NumPy array, an integer."""
    return array.__array_interface__["data"][0]


class _PardisoFactor(solver.NumericFactor):
    """A factor that PARDISO keeps in a slot of a `_PardisoHandle`."""

    def __init__(self, handle, slot, values):
        self.handle, self.slot, self.values = handle, slot, values
        self.n_bytes = 8 * (int(handle.iparm[17]) + len(values))

    def solve(
        self, b: Float[np.ndarray, "n ..."], transposed: bool = False
    ) -> Float[np.ndarray, "n ..."]:
        """Solve for right sides [n] or [n, m], with the matrix or its transpose."""
        handle = self.handle
        handle.iparm[11] = 2 if transposed and handle.kind == _GENERAL else 0
        b = np.asfortranarray(b)
        x = np.empty_like(b, order="F")
        few = b.ndim == 2 and b.shape[1] <= _FEW_RIGHT_SIDES
        for side, solution in zip(b.T, x.T, strict=True) if few else [(b, x)]:
            error = handle.call_pardiso(33, self.slot, self.values, side, solution)
            if error != 0:
                raise RuntimeError(f"PARDISO: the solution failed with error {error}")
        return x

    def release(self) -> None:
        """Free PARDISO's memory of the factor, and its slot for another one."""
        self.handle.call_pardiso(0, self.slot, self.values)
        self.handle.free.append(self.slot)


class Pardiso(solver.Solver):
    """Linear solver PARDISO of Intel's MKL, available where `pypardiso` is installed."""

    name = "pardiso"
    package = "pypardiso"
    analysis = _PardisoAnalysis
    exchanges_rows = False  # it exchanges only rows that are near each other

    def begin_loading_library(self) -> None:
        """Begin to load MKL in another thread, and return at once.

        The program is compiled, or read from disk, meanwhile.
        """
        threading.Thread(target=load_mkl, daemon=True).start()

    def is_suitable_for(self, n: int, banded: bool) -> bool:
        """Return True: PARDISO suits matrices of any size and bandwidth."""
        return True
