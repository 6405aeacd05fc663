"""Solutions with ``K - w^2 M``, singular along a mode, beside the modes that are known.

Derivatives of modes ask for them. What modes do to a right side is known in closed form; beside
them K - w^2 M is definite, and conjugate gradients with the factor of K + s M solve all at once.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import numpy as np

from ..common import host_calls
from ..common.types import Array, Bool, Float
from . import host
from .eigenmodes import FoundModes
from .matrix_pair import factorize_shifted, host_arguments, make_pair
from .pattern import Matrix

_RESIDUAL = 1e-13  # of solutions beside the modes, over the right side, in the energy norm
_LARGEST_RESIDUAL = 1e-6  # with which a solution counts
_STEPS = 400  # conjugate gradient steps at most


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
    words, matrices = host_arguments(stiffness, mass)
    shapes = [jax.ShapeDtypeStruct(x.shape, rhs.dtype) for x in (rhs, along)]
    flat = [loose, found.squared, found.vectors.reshape(-1), rhs.reshape(-1), along, found.shift]
    x, y = host_calls.call_on_host((make_beside_solver, *words), shapes, *matrices, *flat)
    return x, y


@host_calls.register_host_function_family
def make_beside_solver(solver, stored):
    """Return the NumPy function of `solve_beside_modes` for all cases of a batch.

    `solver` and `stored` are as of `make_pair`. The function takes digest and pattern of the
    matrices, their values, and what `solve_beside_modes` passes beside them; it returns x and y.
    """

    def function(digest, indptr, indices, *arrays):
        batch, rows = host.flatten_batch(arrays[:-1], arrays[-1:])
        with host.analyses_lock:
            pair = make_pair(solver, stored, (digest, indptr, indices), arrays[2].shape[-1])
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
    solve = factorize_shifted(pair, stiffness, mass, shift)
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
        np.einsum("ni,ni->i", rhs, solve(rhs)),
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
    size: Float[np.ndarray, " k"],
) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, " k"]]:
    """Solve ``A_i x_i = b_i`` for all columns at once, from zero; return x and relative residuals.

    Columns that are solved, or no longer improve, stay as they are. Residuals are those in the
    norm of the preconditioner, over `size`, [k], squares of norms.
    """
    x, r = np.zeros_like(b), b
    p = z = precondition(r)
    rz = np.einsum("ni,ni->i", r, z)
    for _ in range(_STEPS):
        going = rz > _RESIDUAL**2 * size
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
    return x, np.sqrt(np.maximum(rz, 0.0) / np.where(size > 0, size, 1.0))
