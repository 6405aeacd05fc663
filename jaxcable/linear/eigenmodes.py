"""The lowest modes of a stiffness and a mass matrix, ``K v = w^2 M v``, on the host.

It is solved as ``M v = mu (K + s M) v`` with ``mu = 1 / (w^2 + s)``: unknowns without mass have
mu = 0 and need no special treatment, and slow modes, with the largest mu, are the most precise. The
shift s is zero where K is positive definite. One factor of K + s M serves all: Lanczos's method
(ARPACK), or all modes of the few unknowns that have mass; and derivatives, which ask for solutions
with K - w^2 M, singular along the mode, but definite beside the modes that are known.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as sla
from jax import lax

from ..common import host_calls
from ..common.types import Array, Bool, Float
from . import host, sparse
from .pattern import Matrix, SparseMatrix
from .solver import solver_named
from .spectrum import is_sparse_symmetric

# Smallest w^2, over a mean w^2, for which no shift is needed: a slower mode, such as a mechanism,
# would drown the others in rounding.
_SLOW = 1e-6
_SHIFT = 1e-4  # smallest shift, over a mean w^2: modes a million times slower keep ten digits
# A mode has no mass if its mu, which is 1 / w^2, is below this times eps and the largest mu: it is
# then rounding. Modes faster than the slowest by 1 / sqrt(1e3 eps), two million, are lost with it.
_MASSLESS = 1e3
# Unknowns with mass up to which all their modes are computed: Lanczos's method needs more of them
# than vectors, and is faster beyond.
_ALL_MODES = 300
# Modes found beside those asked for: they show whether the last of these is a repeated one, and
# make solutions beside the modes converge faster.
_MORE = 4
_RESIDUAL = 1e-13  # of solutions beside the modes, over the right side, in the energy norm
_LARGEST_RESIDUAL = 1e-6  # with which a solution counts
_STEPS = 400  # conjugate gradient steps at most


class FoundModes(NamedTuple):
    """Lowest modes of a matrix pair; not differentiable.

    Attributes:
        squared: w^2, [m], ascending; inf for modes without mass, NaN if none were found.
        vectors: unknowns, [m, n], with ``v M v = 1``; zero for modes without mass.
        shift: shift s with which K + s M was factorised.
        symmetric: whether K is symmetric to rounding; if not, no modes are sought.
    """

    squared: Float[Array, " m"]
    vectors: Float[Array, "m n"]
    shift: Float[Array, ""]
    symmetric: Bool[Array, ""]


def lowest_modes(stiffness: Matrix, mass: Matrix, loose: Bool[Array, " n"], n: int) -> FoundModes:
    """Find the lowest `n` modes of two matrices on one pattern, and some more; not differentiable.

    Args:
        stiffness, mass: K and M, [n, n]; M is positive semidefinite.
        loose: unknowns without stiffness, which are left out of all modes, [n] bool.
        n: number of modes asked for.
    """
    size = stiffness.shape[0]
    m = min(n + _MORE, size)
    dtype = (stiffness.values if isinstance(stiffness, SparseMatrix) else stiffness).dtype
    floats = [jax.ShapeDtypeStruct(shape, dtype) for shape in ((m,), (m, size), ())]
    shapes = *floats, jax.ShapeDtypeStruct((), bool)
    words, matrices = _host_arguments(stiffness, mass)
    found = host_calls.call_on_host(
        (make_mode_finder, *words, str(m)), shapes, *matrices, loose
    )
    return FoundModes(*found)


def solve_beside_modes(
    stiffness: Matrix,
    mass: Matrix,
    loose: Bool[Array, " n"],
    found: FoundModes,
    rhs: Float[Array, "k n"],
    along: Float[Array, " k"],
) -> tuple[Float[Array, "k n"], Float[Array, " k"]]:
    """Solve ``(K - w_i^2 M) x_i + y_i M v_i = b_i, v_i M x_i = e_i`` for the first k modes.

    Not differentiable. Solutions of modes without mass are zero; those of repeated modes have no
    part along the modes with the same w.

    Args:
        stiffness, mass, loose: as for `lowest_modes`.
        found: its result.
        rhs, along: b_i, [k, n], and e_i, [k].
    """
    words, matrices = _host_arguments(stiffness, mass)
    shapes = jax.ShapeDtypeStruct(rhs.shape, rhs.dtype), jax.ShapeDtypeStruct(along.shape, rhs.dtype)
    flat = found.vectors.reshape(-1), rhs.reshape(-1)
    return host_calls.call_on_host(
        (make_beside_solver, *words), shapes, *matrices, loose, found.squared, *flat, along,
        found.shift,
    )


def _host_arguments(stiffness, mass):
    """Return the words and the arrays by which host functions know two matrices on one pattern."""
    if isinstance(stiffness, SparseMatrix) and not stiffness.pattern.solver.on_device:
        p = stiffness.pattern
        words = sparse.solver_and_storage_words(p)
        pattern, values = (p.digest, p.indptr, p.indices), (stiffness.values, mass.values)
    else:
        words, none = ("dense", "general"), jnp.zeros(1, jnp.int32)
        pattern = none, none, none
        values = [
            (a.dense() if isinstance(a, SparseMatrix) else a).reshape(-1) for a in (stiffness, mass)
        ]
    return words, [*pattern, *map(lax.stop_gradient, values)]


class _SparsePair:
    """Host side of matrices on a sparsity pattern; `solver`, `stored` are words.

    `pattern` has digest, indptr and indices.
    """

    def __init__(self, solver, stored, pattern):
        self.analysed = host.analysis_of_pattern(solver_named(solver), stored == "symmetric", *pattern)

    def without_loose(self, stiffness, mass, loose):
        """Return values of K with rows of the identity, and of M with zeros, for loose unknowns."""
        a = self.analysed
        touched = loose[a.rows] | loose[a.indices]
        return host.with_identity_rows(a, stiffness, loose), np.where(touched, 0.0, mass)

    def matrix(self, values):
        """Return the SciPy matrix with these values, [n_value]."""
        a = self.analysed
        return host.full_scipy_matrix(values, a.indices, a.indptr, a.symmetric)

    def is_symmetric(self, matrix, tol):
        """Return whether a matrix of `matrix` is symmetric, to `tol` and the roots of its diagonal."""
        return self.analysed.symmetric or is_sparse_symmetric(matrix, tol)

    def factorize(self, values):
        """Return the function that solves with the matrix of these values; None if not definite."""
        factor = self.analysed.find_or_make_factor(values, True)
        return None if factor is None else factor.solve


class _DensePair:
    """Host side of dense matrices with n unknowns, whose values are [n * n]; like `_SparsePair`."""

    def __init__(self, n):
        self.shape = n, n

    def without_loose(self, stiffness, mass, loose):
        """Return values of K with rows of the identity, and of M with zeros, for loose unknowns."""
        touched = (loose[:, None] | loose).ravel()
        return np.where(touched, np.eye(len(loose)).ravel(), stiffness), np.where(touched, 0.0, mass)

    def matrix(self, values):
        """Return the matrix [n, n] with these values."""
        return values.reshape(self.shape)

    def is_symmetric(self, matrix, tol):
        """Return whether a matrix is symmetric, to `tol` and the roots of its diagonal."""
        size = np.sqrt(np.abs(np.diagonal(matrix)))
        return not (np.abs(matrix - matrix.T) > tol * np.outer(size, size)).any()

    def factorize(self, values):
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


def _make_pair(solver, stored, pattern, n):
    """Return the `_SparsePair` or `_DensePair` of matrices with n unknowns, from host arguments."""
    if solver == "dense":
        return _DensePair(n)
    return _SparsePair(solver, stored, host.take_first_case(*pattern))


@host_calls.register_host_function_family
def make_mode_finder(solver, stored, count):
    """Return the NumPy function that finds the lowest modes of all cases of a batch.

    `solver` is a name, or "dense"; `stored` is "symmetric" (upper triangle) or "general"; `count`
    is the number of modes.
    """

    def function(digest, indptr, indices, stiffness, mass, loose):
        eps = np.finfo(stiffness.dtype).eps
        batch, rows = host.flatten_batch((stiffness, mass, loose), ())
        with host.analyses_lock:
            pair = _make_pair(solver, stored, (digest, indptr, indices), loose.shape[-1])
            found = [_modes_of_case(pair, eps, int(count), *case) for case in zip(*rows, strict=True)]
        columns = zip(*found, strict=True)
        return [np.array(column).reshape((*batch, *np.shape(column[0]))) for column in columns]

    return function


def _modes_of_case(pair, eps, m, stiffness, mass, loose):
    """Return the fields of `FoundModes` for one case of a batch.

    `eps` is the precision of the values of the matrices `stiffness` and `mass`.
    """
    n = len(loose)
    nothing = np.full(m, np.nan), np.full((m, n), np.nan), 0.0
    stiffness, mass = stiffness.astype(float), mass.astype(float)
    if not (np.isfinite(stiffness).all() and np.isfinite(mass).all()):
        return *nothing, True
    if loose.any():
        stiffness, mass = pair.without_loose(stiffness, mass, loose)
    inertia = pair.matrix(mass)
    whole = pair.matrix(stiffness)
    if not pair.is_symmetric(whole, eps ** (2 / 3)):
        return *nothing, False
    total = inertia.trace()
    if not total > 0:
        return np.full(m, np.inf), np.zeros((m, n)), 0.0, True
    size, shift = np.abs(whole.diagonal())[~loose].sum() / total, 0.0
    while True:
        solve = pair.factorize(stiffness + shift * mass)
        last = not shift < size / _SLOW
        if solve is not None:
            found = _slowest_modes(solve, whole, inertia, shift, m)
            if found is not None and (last or found[0][0] * size * _SLOW < 1):
                break
        if last:  # not definite by any shift, or not converged
            return *nothing, True
        shift = 10 * shift if shift > 0 else _SHIFT * size
    mu, vectors = found
    massive = mu > _MASSLESS * np.finfo(float).eps * mu[0]
    squared = np.where(massive, 1 / np.where(massive, mu, 1.0) - shift, np.inf)
    return squared, np.where(massive[:, None], vectors, 0.0), shift, True


def _slowest_modes(solve, whole, inertia, shift, m):
    """Return the largest `m` mu, descending, with vectors [m, n], ``v M v = 1``; None if not found.

    Args:
        solve: solves with K + s M for [n] or [n, k].
        whole, inertia: K and M, dense or of SciPy.
        shift: s.
        m: number of modes.
    """
    n = len(inertia.diagonal())
    massive = np.flatnonzero(inertia.diagonal())
    if n <= _ALL_MODES or len(massive) <= max(_ALL_MODES, 3 * m):
        part = inertia[massive][:, massive]
        part = part.toarray() if sp.issparse(part) else part
        return _modes_of_massive_unknowns(solve, part, massive, n, m)
    start = solve(inertia @ np.random.default_rng(0).standard_normal(n))  # without symmetry
    inverse = sla.LinearOperator((n, n), solve, dtype=float)
    try:
        squared, vectors = sla.eigsh(whole, m, inertia, -shift, v0=start, OPinv=inverse)
    except (sla.ArpackNoConvergence, sla.ArpackError):
        return None
    order = np.argsort(squared)
    return 1 / (squared[order] + shift), vectors.T[order]


def _modes_of_massive_unknowns(solve, part, massive, n, m):
    """Return mu and vectors as `_slowest_modes`, from all modes of the unknowns with mass.

    `part` is M among the unknowns `massive`. With ``M = L L^T`` they are those of
    ``L^T (K + s M)^-1 L``.
    """
    values, axes = np.linalg.eigh(0.5 * (part + part.T))
    root = np.zeros((n, len(massive)))
    root[massive] = axes * np.sqrt(np.maximum(values, 0.0))
    moved = solve(root)
    reduced = root[massive].T @ moved[massive]
    mu, own = np.linalg.eigh(0.5 * (reduced + reduced.T))
    mu, own = mu[::-1][:m], own[:, ::-1][:, :m]
    scale = np.where(mu > 0, mu, np.inf)
    found = np.zeros(m), np.zeros((m, n))
    found[0][: len(mu)], found[1][: len(mu)] = mu, (moved @ own / scale).T
    return found


@host_calls.register_host_function_family
def make_beside_solver(solver, stored):
    """Return the NumPy function of `solve_beside_modes` for all cases of a batch."""

    def function(digest, indptr, indices, *arrays):
        batch, rows = host.flatten_batch(arrays[:-1], arrays[-1:])
        with host.analyses_lock:
            pair = _make_pair(solver, stored, (digest, indptr, indices), arrays[2].shape[-1])
            found = [_solve_beside_case(pair, *case) for case in zip(*rows, strict=True)]
        x, y = (np.array(part) for part in zip(*found, strict=True))
        return x.reshape((*batch, *x.shape[1:])), y.reshape((*batch, -1))

    return function


def _solve_beside_case(pair, stiffness, mass, loose, squared, vectors, rhs, along, shift):
    """Return x [k, n] and y [k] of one case, NaN where they are not found: `solve_beside_modes`.

    What modes do to a right side is known in closed form; beside them K - w^2 M is definite, and
    conjugate gradients with the factor of K + s M solve all columns at once.
    """
    n, k = len(loose), len(along)
    numbers = (stiffness, mass, squared, vectors, rhs, along, shift)
    stiffness, mass, squared, vectors, rhs, along, shift = (np.asarray(a, float) for a in numbers)
    stiffness, mass = pair.without_loose(stiffness, mass, loose)
    vectors, rhs = vectors.reshape(-1, n).T, np.where(loose, 0.0, rhs.reshape(k, n)).T
    own = vectors[:, :k]
    massive, squared = np.isfinite(squared), np.where(np.isfinite(squared), squared, 0.0)
    failed = np.full((k, n), np.nan), np.full(k, np.nan)
    if not (np.isfinite(vectors).all() and np.isfinite(rhs).all()):
        return failed
    solve = pair.factorize(stiffness + shift * mass)
    if solve is None:
        return failed
    whole, inertia = pair.matrix(stiffness), pair.matrix(mass)
    heavy = inertia @ vectors
    y = np.einsum("ni,ni->i", own, rhs)
    left = rhs - heavy[:, :k] * y
    parts = vectors.T @ left
    gaps = squared[:, None] - squared[:k]
    apart = (gaps != 0) & massive[:, None]
    parts, onto = np.where(apart, parts / np.where(apart, gaps, 1.0), 0.0), heavy @ parts
    x = own * along + vectors @ parts
    found, error = _conjugate_gradients_beside(
        lambda v: whole @ v - (inertia @ v) * squared[:k],
        lambda v: _beside(solve(v), vectors, heavy),
        left - onto,
    )
    x = np.where(massive[:k], x + found, 0.0)
    x[:, ~(error < _LARGEST_RESIDUAL)] = np.nan
    return x.T, np.where(massive[:k], y, 0.0)


def _beside(v: Float[np.ndarray, "n k"], vectors, heavy) -> Float[np.ndarray, "n k"]:
    """Return vectors without their parts along the modes `vectors`, of which `heavy` is M times."""
    return v - vectors @ (heavy.T @ v)


def _conjugate_gradients_beside(
    times: Callable[[Float[np.ndarray, "n k"]], Float[np.ndarray, "n k"]],
    precondition: Callable[[Float[np.ndarray, "n k"]], Float[np.ndarray, "n k"]],
    b: Float[np.ndarray, "n k"],
) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, " k"]]:
    """Solve ``A_i x_i = b_i`` for all columns at once, from zero; return x and relative residuals.

    Columns that are solved, or no longer improve, stay as they are. Residuals are those in the
    norm of the preconditioner.
    """
    x, r = np.zeros_like(b), b
    p = z = precondition(r)
    first = rz = np.einsum("ni,ni->i", r, z)
    for _ in range(_STEPS):
        going = rz > _RESIDUAL**2 * first
        if not going.any():
            break
        q = times(p)
        curvature = np.einsum("ni,ni->i", p, q)
        going &= curvature > 0
        a = np.where(going, rz / np.where(going, curvature, 1.0), 0.0)
        if not going.any():
            break
        x, r = x + a * p, r - a * q
        z = precondition(r)
        rz, before = np.where(going, np.einsum("ni,ni->i", r, z), rz), rz
        p = z + np.where(before > 0, rz / np.where(before > 0, before, 1.0), 0.0) * p
    scale = np.where(first > 0, first, 1.0)
    return x, np.sqrt(np.maximum(rz, 0.0) / scale)
