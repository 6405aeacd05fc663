"""The host side of sparse solves: analyses and factors for reuse, conjugate gradients.

Everything is NumPy: a callback that calls jax can wait for itself for ever. Results depend on the
arguments only; the stored analyses of patterns and last factors only save work.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..common.compilation import on_forget_programs
from ..common.types import Bool, Float, Int
from .solver import NumericFactor, Solver

_MOST_ANALYSES = 8  # stored at most: those of structures that are analysed in turn
# Factors stored per pattern at most: an analysis asks again for the last ones only (adjoints).
_MOST_FACTORS = 4
# Memory of the factors of a pattern at most, except that the last one is stored in any case.
_MOST_FACTOR_BYTES = 1 << 29
# Conjugate gradient steps before the rate of convergence is judged: the first tell little.
_STEPS_TO_JUDGE = 4

analyses_lock = threading.RLock()
_analyses = OrderedDict()


def analysis_of_pattern(
    solver: Solver,
    symmetric: bool,
    digest: Int[np.ndarray, " 4"],
    indptr: Int[np.ndarray, " n+1"],
    indices: Int[np.ndarray, " n_value"],
) -> AnalysedPattern:
    """Return a solver's analysis of a pattern in compressed rows, stored before or made now.

    With `symmetric` only the upper triangle is stored; `digest`, 128 bits that stand for the
    pattern, is the key under which the analysis is found again.
    """
    key = (solver.name, symmetric, digest.tobytes())
    if key not in _analyses:
        while len(_analyses) >= _MOST_ANALYSES:
            _analyses.popitem(last=False)[1].release()
        _analyses[key] = AnalysedPattern(solver, symmetric, indptr, indices)
    _analyses.move_to_end(key)
    return _analyses[key]


@on_forget_programs
def forget_analyses() -> None:
    """Free the memory of all stored analyses of sparsity patterns, and of their factors."""
    with analyses_lock:
        while _analyses:
            _analyses.popitem()[1].release()


class AnalysedPattern:
    """A sparsity pattern analysed by a linear solver, with the factors of the last matrices on it.

    Args:
        solver: the linear solver.
        symmetric: whether only the upper triangle is stored.
        indptr, indices: the stored entries in compressed rows, columns ascending.
    """

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
        numbers = np.arange(1, len(indices) + 1)
        whole = full_scipy_matrix(numbers, indices, indptr, symmetric)
        # the stored entries as a matrix and as its transpose; `make_multiplier` puts the values in
        self.stored = sp.csr_matrix((np.ones(len(indices)), self.indices, self.indptr), shape)
        self.flipped = self.stored.T
        if symmetric:  # solvers get both triangles
            whole.sort_indices()
            self.take = whole.data - 1
        else:
            self.take, self.transposed = slice(None), whole.T.tocsr().data - 1
        self.analysis = solver.analyze(self.n, whole.indptr, whole.indices)
        self.factors = OrderedDict()  # number -> (values, whether taken as definite, Factor)
        self.count = 0

    def make_multiplier(
        self, values: Float[np.ndarray, " n_value"]
    ) -> Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]]:
        """Return the function ``v -> A v`` of the symmetric matrix A with these entries.

        It is valid until the next call of this method.
        """
        self.stored.data = self.flipped.data = values
        diagonal = values[self.diagonal]
        return lambda v: self.stored @ v + self.flipped @ v - diagonal * v

    def find_or_make_factor(
        self, values: Float[np.ndarray, " n_value"], definite: bool, small_pivots: bool = False
    ) -> HostFactor | None:
        """Return a factor of the matrix with these entries, stored or new; None if it is singular.

        With `definite` it must be positive definite, and an unsymmetric matrix is replaced by its
        symmetric part; with `small_pivots` its pivots may have few correct digits.
        """
        for number, (known, kind, factor) in reversed(self.factors.items()):
            serves = kind == definite or (kind and self.symmetric)
            serves = serves and (factor.regular or small_pivots)
            if serves and np.array_equal(known, values):
                self.factors.move_to_end(number)
                return factor
        if not np.isfinite(values).all():
            return None
        self._release_old_factors()
        kinds = [True] * (definite or self.symmetric) + [False] * (not definite)
        for kind in kinds:
            factor = self._make_factor(values, kind, small_pivots)
            if factor is not None:
                self.count += 1
                self.factors[self.count] = values.copy(), kind, factor
                return factor
        return None

    def _make_factor(self, values, definite, small_pivots):
        """Return the `HostFactor` of the matrix with these entries [n_value]; None if singular.

        The matrix is scaled to unit diagonal before. Arguments as of `find_or_make_factor`.
        """
        if definite and not self.symmetric:
            values = 0.5 * (values + values[self.transposed])
        size = diagonal_scale(values[self.diagonal])
        values = values / (size[self.rows] * size[self.indices])
        made = self.analysis.factorize(values[self.take], definite)
        if made is None:
            return None
        factor = HostFactor(made, size, definite)
        if factor.regular or (small_pivots and factor.least > 0):
            return factor
        factor.release()
        return None

    def _release_old_factors(self):
        """Release the oldest factors until there is room for another one, in number and memory."""
        while self.factors:
            sizes = [factor.made.n_bytes for _, _, factor in self.factors.values()]
            if len(sizes) < _MOST_FACTORS and sum(sizes) + sizes[-1] <= _MOST_FACTOR_BYTES:
                return
            self.factors.popitem(last=False)[1][2].release()

    def release(self) -> None:
        """Free the memory of the analysis and of all stored factors."""
        for _, _, factor in self.factors.values():
            factor.release()
        self.factors.clear()
        self.analysis.release()


def diagonal_scale(diagonal: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the root of the absolute diagonal, [n], 1 where it is zero, to scale a matrix by."""
    size = np.sqrt(np.abs(diagonal))
    size[size == 0] = 1.0
    return size


class HostFactor:
    """A factor on the host, which solves with a matrix that was scaled to unit diagonal before.

    Args:
        made: the linear solver's factor of the scaled matrix.
        size: what its rows and columns were divided by, [n].
        definite: whether the matrix must be positive definite: a negative pivot makes it singular.

    Attributes:
        least: the smallest pivot.
        regular: whether every pivot is larger than rounding.
    """

    def __init__(self, made: NumericFactor, size: Float[np.ndarray, " n"], definite: bool):
        self.made, self.size = made, size
        self.least, self.regular = 0.0, True
        if made.pivots is not None:
            pivots = made.pivots if definite else np.abs(made.pivots)
            self.least = pivots.min(initial=np.inf)
            limit = len(size) * np.finfo(float).eps * pivots.max(initial=0.0)
            self.regular = bool(self.least > limit)

    def solve(
        self, b: Float[np.ndarray, "n ..."], transposed: bool = False
    ) -> Float[np.ndarray, "n ..."]:
        """Solve for right sides [n] or [n, m], with the unscaled matrix or its transpose."""
        size = self.size if b.ndim == 1 else self.size[:, None]
        return self.made.solve(b / size, transposed) / size

    def release(self) -> None:
        """Free the memory of the factor."""
        self.made.release()


def conjugate_gradients(
    times: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]],
    precondition: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]],
    b: Float[np.ndarray, " n"],
    tol: float,
    limit: int,
) -> Float[np.ndarray, " n"] | None:
    """Solve A x = b, positive definite, by preconditioned conjugate gradients from x = 0.

    Args:
        times: function ``v -> A v``.
        precondition: function that multiplies a vector by an approximate inverse of A.
        b: right side, [n].
        tol: residual at which to stop, over the norm of `b`.
        limit: number of steps allowed.

    Returns:
        x [n]; None if A is not positive definite along a step, or if at the rate of the first steps
        more than `limit` steps would be needed.
    """
    goal = tol * _euclidean_norm(b)
    x, r = np.zeros_like(b), b
    z = precondition(r)
    p, rz = z, _inner_product(r, z)
    for step in range(1, limit + 1):
        q = times(p)
        curvature = _inner_product(p, q)
        if not (curvature > 0 and rz > 0):
            return None
        a = rz / curvature
        x, r = x + a * p, r - a * q
        size = _euclidean_norm(r)
        if size <= goal:
            return x
        if step >= _STEPS_TO_JUDGE:
            pace = np.log(size / _euclidean_norm(b)) / step
            if not (pace < 0 and np.log(tol) / pace <= limit):
                return None
        z = precondition(r)
        rz, before = _inner_product(r, z), rz
        p = z + rz / before * p
    return None


def _inner_product(a, b):
    """Return the inner product of two vectors, without BLAS, whose threads slow down others."""
    return np.add.reduce(a * b)


def _euclidean_norm(a):
    """Return the Euclidean norm of a vector, without BLAS."""
    return np.sqrt(_inner_product(a, a))


def solve_sparse_batch(
    pattern: tuple[Any, ...],
    definite: bool,
    transposed: bool,
    values: Float[np.ndarray, "g n_value"],
    loose: Bool[np.ndarray, "g n"] | None,
    stale: Float[np.ndarray, "g n_value"],
    usable: Bool[np.ndarray, " g"],
    tol: Float[np.ndarray, " g"],
    limit: Int[np.ndarray, " g"],
    rhs: Float[np.ndarray, "m n"],
    matrix_index: Int[np.ndarray, " m"],
    wanted: Bool[np.ndarray, " m"],
) -> tuple[Float[np.ndarray, "m n"], Bool[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
    """Solve a batch of sparse systems on the host.

    If a matrix has one right side only, and a similar one is factorised, conjugate gradients are
    tried first.

    Args:
        pattern: arguments of `analysis_of_pattern`.
        definite: whether only positive definite matrices count as regular.
        transposed: whether to solve with the transposed matrices.
        values: stored entries of the g matrices, [g, n_value].
        loose: unknowns whose rows and columns are replaced by those of the identity, [g, n] bool,
            or None.
        stale: similar matrices that were factorised earlier, [g, n_value].
        usable: whether to try conjugate gradients with the factor of the `stale` matrix, [g] bool.
        tol, limit: for `conjugate_gradients`, [g]; a limit below 0 allows small pivots of definite
            matrices.
        rhs: right sides, [m, n].
        matrix_index: index of the matrix of each right side, [m].
        wanted: the right sides that are solved for, [m] bool.

    Returns:
        x: solutions, [m, n]; zero where none is wanted.
        regular: whether the matrices are regular, as far as seen, [m].
        fresh: whether the matrix itself was factorised, [m].
    """
    x = np.zeros(rhs.shape)
    regular, fresh = np.zeros(len(rhs), bool), np.zeros(len(rhs), bool)
    with analyses_lock:
        analysed = analysis_of_pattern(*pattern)
        # the factors of a larger batch would not all be stored: factorise every matrix anew
        usable = usable & (len(values) < _MOST_FACTORS) & analysed.iterates
        for g in range(len(values)):
            sides = np.flatnonzero((matrix_index == g) & wanted)
            if not len(sides):
                continue
            one = len(sides) == 1
            at = sides[0] if one else sides
            b = rhs[at].T
            entries = (
                values[g] if loose is None else with_identity_rows(analysed, values[g], loose[g])
            )
            answer = None
            old = analysed.find_or_make_factor(stale[g], True) if usable[g] and one else None
            if old is not None:
                times = analysed.make_multiplier(entries)
                answer = conjugate_gradients(times, old.solve, b, tol[g], int(limit[g]))
            if answer is None:
                factor = analysed.find_or_make_factor(entries, definite, definite and limit[g] < 0)
                if factor is None:
                    continue
                answer, fresh[at] = factor.solve(b, transposed), True
            x[at], regular[at] = answer.T, True
    return x, regular, fresh


def with_identity_rows(analysed, values, loose):
    """Return the entries of a matrix, [n_value], changed so that some unknowns are left out.

    Rows and columns of the unknowns `loose`, [n] bool, become those of the identity. `analysed` is
    the `AnalysedPattern` of the matrix.
    """
    if not loose.any():
        return values
    touched = loose[analysed.rows] | loose[analysed.indices]
    return np.where(touched, analysed.rows == analysed.indices, values)


def full_scipy_matrix(
    values: Float[np.ndarray, " n_value"],
    indices: Int[np.ndarray, " n_value"],
    indptr: Int[np.ndarray, " n+1"],
    symmetric: bool,
) -> Any:
    """Return the SciPy matrix with these entries in compressed rows.

    If `symmetric`, they are those of the upper triangle, and the lower one is added.
    """
    n = len(indptr) - 1
    stored = sp.csr_matrix((values, indices, indptr), (n, n))
    return (stored + sp.triu(stored, 1).T).tocsr() if symmetric else stored


def flatten_batch(
    vectors: Sequence[np.ndarray], scalars: Sequence[np.ndarray]
) -> tuple[tuple[int, ...], list[np.ndarray]]:
    """Flatten the batch axes of arrays to one; return their lengths, and the list of flat arrays.

    Args:
        vectors: arrays [..., k], which become [n_case, k].
        scalars: arrays [...], which become [n_case].
    """
    if all(v.ndim == 1 for v in vectors) and all(s.ndim == 0 for s in scalars):  # fast path
        return (), [array[None] for array in (*vectors, *scalars)]
    batch = np.broadcast_shapes(*(v.shape[:-1] for v in vectors), *(s.shape for s in scalars))
    flat = [np.broadcast_to(v, (*batch, v.shape[-1])).reshape(-1, v.shape[-1]) for v in vectors]
    return batch, flat + [np.broadcast_to(s, batch).reshape(-1) for s in scalars]


def take_first_case(*arrays: np.ndarray) -> list[np.ndarray]:
    """Return one vector [k] of each array [..., k] that is the same in all cases of a batch."""
    return [array.reshape(-1, array.shape[-1])[0] for array in arrays]
