"""The lowest modes of a stiffness and a mass matrix, with their derivatives.

The derivative of a mode follows from its equation and its scale,

    (K - w^2 M) dv + M v d(w^2) = -(dK - w^2 dM) v,     v M dv = -1/2 v dM v,

a symmetric system, regular where w is simple, by which derivatives of any order follow (Nelson,
AIAA J. 14 (1976) 1201). Where frequencies are equal the modes are any basis of a plane, and small
changes select another one: derivatives are NaN.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common.tree import copy_with
from ..common.types import Array, Bool, Float
from ..numerics.nan_marks import nan_unless_valid

# Frequencies squared that differ by less, over the larger one, are equal: their difference has few
# correct digits (rounding of a stiffness is some eps times the ratio of its eigenvalues).
_EQUAL_SQUARES = 1e-6


class ModesWithDerivatives(NamedTuple):
    """Lowest modes, differentiable where their frequency is simple: the result of `find_modes`.

    Attributes:
        squared: w^2, [n], ascending; inf for modes without mass, NaN if none were found.
        vectors: unknowns, [n, n_free], with ``v M v = 1``; zero for modes without mass.
        repeated: whether another mode has the same frequency, so that derivatives are NaN, [n].
        symmetric: whether K is symmetric to rounding; if not, no modes are sought.
        found: the same and further modes without derivatives, `linear.FoundModes`.
    """

    squared: Float[Array, " n"]
    vectors: Float[Array, "n n_free"]
    repeated: Bool[Array, " n"]
    symmetric: Bool[Array, ""]
    found: linear.FoundModes


@functools.partial(jax.custom_jvp, nondiff_argnums=(3,))
def find_modes(
    stiffness: linear.Matrix, mass: linear.Matrix, loose: Bool[Array, " n_free"], n: int
) -> ModesWithDerivatives:
    """Find the `n` lowest modes, ``K v = w^2 M v``, with derivatives where w is not repeated.

    Args:
        stiffness, mass: K and M, on one pattern.
        loose: unknowns without stiffness, left out of all modes, [n_free] bool.
        n: number of modes, at most that of the unknowns.
    """
    found = linear.lowest_modes(stiffness, mass, loose, n)
    squared = found.squared
    gaps = jnp.abs(squared[:n, None] - squared[None, :])
    sizes = jnp.maximum(jnp.abs(squared[:n, None]), jnp.abs(squared[None, :]))
    others = jnp.arange(n)[:, None] != jnp.arange(len(squared))[None, :]
    # (two modes without mass are no equal ones: inf - inf is NaN)
    equal = gaps <= _EQUAL_SQUARES * sizes + found.rounding
    repeated = jnp.any(others & equal & jnp.isfinite(squared)[:n, None], axis=1)
    return ModesWithDerivatives(squared[:n], found.vectors[:n], repeated, found.symmetric, found)


def multiply(matrix: linear.Matrix, vectors: Float[Array, "n n_free"]) -> Float[Array, "n n_free"]:
    """Return the products of a matrix and each of n vectors, [n, n_free]."""
    return jax.vmap(lambda v: matrix @ v)(vectors)


@find_modes.defjvp
def _find_modes_jvp(n, primals, tangents):
    """Return modes and their derivatives along `tangents` of K and M; NaN where w is repeated."""
    stiffness, mass, loose = primals
    modes = find_modes(*primals, n)
    changes = [
        copy_with(a, values=change.values) if isinstance(a, linear.SparseMatrix) else change
        for a, change in zip(primals[:2], tangents[:2], strict=True)
    ]
    finite = jnp.isfinite(modes.squared)
    squared, vectors = jnp.where(finite, modes.squared, 0.0), modes.vectors
    of_mass = multiply(changes[1], vectors)
    forces = multiply(changes[0], vectors) - squared[:, None] * of_mass
    rates = jnp.sum(vectors * forces, axis=1)
    heavy = multiply(mass, vectors)

    def bordered(unknowns):
        x, y = unknowns
        product = multiply(stiffness, x) - squared[:, None] * multiply(mass, x)
        return product + heavy * y[:, None], jnp.sum(heavy * x, axis=1)

    def solve(_, given):
        known = lax.stop_gradient((stiffness, mass, loose, modes.found))
        return linear.solve_beside_modes(*known, *given)

    given = -forces, -0.5 * jnp.sum(vectors * of_mass, axis=1)
    moved, _ = lax.custom_linear_solve(bordered, given, solve, symmetric=True)
    simple, no_probe = ~modes.repeated, jnp.zeros((), squared.dtype)
    rates, moved = nan_unless_valid(simple, [rates, moved], no_probe)
    nothing = jax.tree.map(_zero_tangent, modes)
    return modes, nothing._replace(squared=rates, vectors=moved)


def _zero_tangent(x):
    """Return the zero tangent of an array of floats or booleans, as `jax.custom_jvp` wants it."""
    if jnp.issubdtype(x.dtype, jnp.floating):
        return jnp.zeros_like(x)
    return jnp.zeros(x.shape, jax.dtypes.float0)
