"""The lowest modes of a stiffness and a mass matrix, ``K v = w^2 M v``, on the host.

It is solved as ``M v = mu (K + s M) v`` with ``mu = 1 / (w^2 + s)``: unknowns without mass have
mu = 0 and need no special treatment, and slow modes, with the largest mu, are the most precise. The
shift s is zero where K is positive definite. One factor of K + s M serves all: Lanczos's method
(ARPACK), or all modes of the few unknowns that have mass; and their derivatives (`beside_modes`).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

from ..common import host_calls
from ..common.types import Array, Bool, Float
from . import host
from .matrix_pair import ROUNDING, factorize_shifted, host_arguments, make_pair
from .pattern import Matrix, SparseMatrix

# Slowest w^2, over the fastest that is sought, for which no shift is needed: a slower mode, such as
# a mechanism, would drown the others in rounding.
_SLOW = 1e-6
# Shifts, over a mean w^2, where K is not definite: a large one makes modes alike, and Lanczos's
# method slow.
_FIRST_SHIFT, _LAST_SHIFT = 1e-8, 1e6
_SHIFT = 1e-3  # shift that slow modes ask for, over the fastest w^2 that is sought
# A mode has no mass if its mu, which is 1 / w^2, is below this times eps and the largest mu: it is
# then rounding. Modes faster than the slowest by 1 / sqrt(1e3 eps), two million, are lost with it.
_MASSLESS = 1e3
# Unknowns with mass up to which all their modes are computed: Lanczos's method needs more of them
# than vectors, and is faster beyond.
_ALL_MODES = 300
# Modes found beside those asked for: they show whether the last of these is a repeated one, and
# make solutions beside the modes converge faster.
_MORE = 4


class FoundModes(NamedTuple):
    """Lowest modes of a matrix pair; not differentiable.

    Attributes:
        squared: w^2, [m], ascending; inf for modes without mass, NaN if none were found.
        vectors: unknowns, [m, n], with ``v M v = 1``; zero for modes without mass.
        shift: shift s with which K + s M was factorised, 1/s2; zero if K is definite.
        rounding: what rounding may leave of w^2 of a mechanism; zero without a shift.
        symmetric: whether K is symmetric to rounding; if not, no modes are sought.
    """

    squared: Float[Array, " m"]
    vectors: Float[Array, "m n"]
    shift: Float[Array, ""]
    rounding: Float[Array, ""]
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
    floats = [jax.ShapeDtypeStruct(shape, dtype) for shape in ((m,), (m, size), (), ())]
    shapes = *floats, jax.ShapeDtypeStruct((), bool)
    words, matrices = host_arguments(stiffness, mass)
    found = host_calls.call_on_host((make_mode_finder, *words, str(m)), shapes, *matrices, loose)
    return FoundModes(*found)


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
            pair = make_pair(solver, stored, (digest, indptr, indices), loose.shape[-1])
            cases = zip(*rows, strict=True)
            found = [_modes_of_case(pair, eps, int(count), *case) for case in cases]
        columns = zip(*found, strict=True)
        return [np.array(column).reshape((*batch, *np.shape(column[0]))) for column in columns]

    return function


def _modes_of_case(pair, eps, m, stiffness, mass, loose):
    """Return the fields of `FoundModes` for one case of a batch.

    `eps` is the precision of the values of the matrices `stiffness` and `mass`.
    """
    n = len(loose)
    nothing = np.full(m, np.nan), np.full((m, n), np.nan), 0.0, 0.0
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
        return np.full(m, np.inf), np.zeros((m, n)), 0.0, 0.0, True
    size, shift, again = np.abs(whole.diagonal())[~loose].sum() / total, 0.0, False
    while True:
        solve = factorize_shifted(pair, stiffness, mass, shift)
        if solve is None:
            if shift > _LAST_SHIFT * size:
                return *nothing, True
            shift = 10 * shift if shift > 0 else _FIRST_SHIFT * size
            continue
        found = _slowest_modes(solve, whole, inertia, shift, m)
        if found is None:
            return *nothing, True
        mu, vectors = found
        massive = mu > _MASSLESS * np.finfo(float).eps * mu[0]
        fastest = mu[massive].min(initial=np.inf)
        if again or mu[0] * _SLOW < fastest:
            break
        shift, again = max(10 * shift, _SHIFT / fastest), True
    squared = np.where(massive, 1 / np.where(massive, mu, 1.0) - shift, np.inf)
    rounding = 2 * ROUNDING * n * np.finfo(float).eps * size if shift > 0 else 0.0
    return squared, np.where(massive[:, None], vectors, 0.0), shift, rounding, True


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
