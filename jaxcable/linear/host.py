"""What runs on the host inside a compiled program: analyses, factors kept, conjugate gradients.

Everything is NumPy: a callback that calls jax can wait for itself. Results depend on nothing but
the arguments; what is kept here (analyses of patterns, the last factors) only saves work.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..common.types import Bool, Float, Int
from .solver import NumericFactor, Solver

_PATTERNS = 8  # analyses kept
_FACTORS = 4  # factors kept per pattern, and at most
_BYTES = 1 << 29  # of memory per pattern, but always the last
_PACE = 4  # conjugate gradient steps after which the pace is judged

_lock = threading.RLock()
_kept = OrderedDict()


def kept(
    solver: Solver,
    symmetric: bool,
    digest: Int[np.ndarray, " 4"],
    indptr: Int[np.ndarray, " n+1"],
    indices: Int[np.ndarray, " n_value"],
) -> Analysed:
    """The analysis of a pattern by a `solver.Solver`, made at its first use."""
    key = (solver.name, symmetric, digest.tobytes())
    if key not in _kept:
        while len(_kept) >= _PATTERNS:
            _kept.popitem(last=False)[1].release()
        _kept[key] = Analysed(solver, symmetric, indptr, indices)
    _kept.move_to_end(key)
    return _kept[key]


class Analysed:
    """A pattern made ready for a solver, with the factors of the last matrices on it."""

    def __init__(
        self,
        solver: Solver,
        symmetric: bool,
        indptr: Int[np.ndarray, " n+1"],
        indices: Int[np.ndarray, " n_value"],
    ):
        self.n, self.symmetric = len(indptr) - 1, symmetric
        self.iterates = symmetric and solver.iterates
        self.indptr, self.indices = indptr.copy(), indices.copy()
        self.rows = np.repeat(np.arange(self.n, dtype=np.int32), np.diff(indptr))
        self.diagonal = np.flatnonzero(self.rows == self.indices)
        shape = self.n, self.n
        whole = sp.csr_matrix((np.arange(1, len(indices) + 1), indices, indptr), shape)
        # the stored entries as a matrix and as its transpose; whoever uses them puts values in
        self.stored = sp.csr_matrix((np.ones(len(indices)), self.indices, self.indptr), shape)
        self.flipped = self.stored.T
        if symmetric:  # solvers are shown both triangles
            whole = (whole + sp.triu(whole, 1).T).tocsr()
            whole.sort_indices()
            self.take = whole.data - 1
        else:
            self.transposed = whole.T.tocsr().data - 1
        self.analysis = solver.analyse(self.n, whole.indptr, whole.indices)
        self.factors = OrderedDict()  # number -> (values, whether taken as definite, factor)
        self.count = 0

    def times(
        self, values: Float[np.ndarray, " n_value"]
    ) -> Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]]:
        """The function that multiplies a symmetric matrix by a vector, until the next call."""
        self.stored.data = self.flipped.data = values
        diagonal = values[self.diagonal]
        return lambda v: self.stored @ v + self.flipped @ v - diagonal * v

    def factor(self, values: Float[np.ndarray, " n_value"], definite: bool) -> NumericFactor | None:
        """Factor of a matrix, from those kept or made now; None if it is singular.

        `definite` demands a positive definite matrix, and of an unsymmetric one takes the symmetric
        part.
        """
        for number, (own, kind, factor) in reversed(self.factors.items()):
            if (kind == definite or (kind and self.symmetric)) and np.array_equal(own, values):
                self.factors.move_to_end(number)
                return factor
        if self.symmetric:
            whole = values[self.take]
        elif definite:
            whole = 0.5 * (values + values[self.transposed])
        else:
            whole = values
        self._make_room()
        kind, factor = True, None
        if definite or self.symmetric:
            factor = self.analysis.factorize(whole, True)
        if factor is None and not definite:
            kind, factor = False, self.analysis.factorize(whole, False)
        if factor is not None:
            self.count += 1
            self.factors[self.count] = values.copy(), kind, factor
        return factor

    def _make_room(self):
        while self.factors:
            sizes = [factor.n_bytes for _, _, factor in self.factors.values()]
            if len(sizes) < _FACTORS and sum(sizes) + sizes[-1] <= _BYTES:
                return
            self.factors.popitem(last=False)[1][2].release()

    def release(self) -> None:
        """Give all memory back."""
        for _, _, factor in self.factors.values():
            factor.release()
        self.factors.clear()
        self.analysis.release()


def conjugate_gradients(
    times: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]],
    precondition: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]],
    b: Float[np.ndarray, " n"],
    tol: float,
    limit: int,
) -> Float[np.ndarray, " n"] | None:
    """Solve a positive definite system from zero until ``|r| <= tol |b|``.

    Returns:
        The solution, or None if the matrix shows a direction without stiffness, or if at the pace
        of the first steps more than `limit` would be needed.
    """
    goal = tol * _norm(b)
    x, r = np.zeros_like(b), b
    z = precondition(r)
    p, rz = z, _dot(r, z)
    for step in range(1, limit + 1):
        q = times(p)
        curvature = _dot(p, q)
        if not (curvature > 0 and rz > 0):
            return None
        a = rz / curvature
        x, r = x + a * p, r - a * q
        size = _norm(r)
        if size <= goal:
            return x
        if step >= _PACE:
            pace = np.log(size / _norm(b)) / step
            if not (pace < 0 and np.log(tol) / pace <= limit):
                return None
        z = precondition(r)
        rz, before = _dot(r, z), rz
        p = z + rz / before * p
    return None


def _dot(a, b):
    """Inner product without BLAS, whose threads would fight with those of the program."""
    return np.add.reduce(a * b)


def _norm(a):
    return np.sqrt(_dot(a, a))


def step(
    pattern: tuple[Any, ...],
    values: Float[np.ndarray, "m n_value"],
    rhs: Float[np.ndarray, "m n"],
    stale: Float[np.ndarray, "m n_value"],
    usable: Bool[np.ndarray, " m"],
    tol: Float[np.ndarray, " m"],
    limit: Int[np.ndarray, " m"],
    wanted: Bool[np.ndarray, " m"],
) -> tuple[Float[np.ndarray, "m n"], Bool[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
    """Solutions of systems that should be positive definite, each as in `definite_step`.

    All but `pattern` have a leading axis. Returns x [m, n], definite [m], fresh [m].
    """
    x = np.zeros(rhs.shape)
    definite, fresh = np.zeros(len(rhs), bool), np.zeros(len(rhs), bool)
    with _lock:
        analysed = kept(*pattern)
        # as many factors as cases would not be kept: then each matrix has its own
        usable = usable & (len(rhs) < _FACTORS) & analysed.iterates
        for k in np.flatnonzero(wanted):
            answer = None
            if usable[k]:
                old = analysed.factor(stale[k], True)
                if old is not None:
                    answer = conjugate_gradients(
                        analysed.times(values[k]), old.solve, rhs[k], tol[k], int(limit[k])
                    )
            if answer is None:
                factor = analysed.factor(values[k], True)
                if factor is None:
                    continue
                answer, fresh[k] = factor.solve(rhs[k]), True
            x[k], definite[k] = answer, True
    return x, definite, fresh


def solve(
    pattern: tuple[Any, ...],
    transposed: bool,
    values: Float[np.ndarray, "g n_value"],
    loose: Bool[np.ndarray, "g n"],
    stale: Float[np.ndarray, "g n_value"],
    usable: Bool[np.ndarray, " g"],
    tol: Float[np.ndarray, " g"],
    limit: Int[np.ndarray, " g"],
    rhs: Float[np.ndarray, "m n"],
    group: Int[np.ndarray, " m"],
) -> tuple[Float[np.ndarray, "m n"], Bool[np.ndarray, " m"]]:
    """Solutions of general systems: x [m, n] and whether the matrix is regular [m].

    A single right side of a matrix like one that has been factorised is left to conjugate
    gradients; more are worth a factorisation.

    Args:
        pattern: arguments of `kept`.
        transposed: solve with the transposed matrices; then a right side of zeros costs nothing,
            and its matrix counts as regular.
        values: matrices, [g, n_value].
        loose: unknowns whose rows and columns are replaced by those of the identity, [g, n] bool.
        stale: matrices factorised earlier, [g, n_value].
        usable: whether there is such a matrix, and this one is positive semidefinite, [g] bool.
        tol, limit: for `conjugate_gradients`, [g].
        rhs: [m, n].
        group: the matrix that belongs to each right side, [m].
    """
    x, regular = np.zeros(rhs.shape), np.zeros(len(rhs), bool)
    idle = ~rhs.any(axis=1) if transposed else np.zeros(len(rhs), bool)
    regular[idle] = True
    with _lock:
        analysed = kept(*pattern)
        usable = usable & (len(values) < _FACTORS) & analysed.iterates
        for g in np.unique(group[~idle]):
            mine = np.flatnonzero((group == g) & ~idle)
            own = _without(analysed, values[g], loose[g])
            if usable[g] and len(mine) == 1:
                old = analysed.factor(stale[g], True)
                answer = None
                if old is not None:
                    times = analysed.times(own)
                    answer = conjugate_gradients(
                        times, old.solve, rhs[mine[0]], tol[g], int(limit[g])
                    )
                if answer is not None:
                    x[mine], regular[mine] = answer, True
                    continue
            factor = analysed.factor(own, False)
            if factor is not None:
                b = rhs[mine[0]] if len(mine) == 1 else rhs[mine].T
                x[mine], regular[mine] = factor.solve(b, transposed).T, True
    return x, regular


def _without(analysed, values, loose):
    """Values with the rows and columns of loose unknowns replaced by those of the identity."""
    if not loose.any():
        return values
    touched = loose[analysed.rows] | loose[analysed.indices]
    own = analysed.rows == analysed.indices
    return np.where(touched, np.where(own, 1.0, 0.0), values)
