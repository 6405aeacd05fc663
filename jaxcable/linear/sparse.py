"""Sparse direct solves on the host, called from a compiled program (`common.foreign`)."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap
from jax.typing import DTypeLike

from ..common import foreign
from ..common.tree import copy, pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from . import host
from .banded import solve_banded
from .direct import Direct, Factor
from .pattern import Pattern, Sparse
from .solver import named

_PAUSE = 3  # solves: where cables change between slack and taut, matrices differ for some steps


def words(pattern: Pattern) -> tuple[str, str]:
    """What a host function for a pattern is made from: solver, and what is stored."""
    return pattern.solver.name, "symmetric" if pattern.symmetric else "general"


@foreign.family
def solve(solver, stored, kind):
    """The callback for `host.solve`: flattens the axes of batches of matrices and right sides.

    The last array says which unknowns are loose; for the "next" matrix of a sequence, which should
    be positive definite, it says whether the result matters.
    """
    solver, symmetric = named(solver), stored == "symmetric"
    following, transposed = kind == "next", kind == "transposed"

    def function(digest, indptr, indices, rhs, values, stale, usable, tol, limit, last):
        scalars = usable, tol, limit
        if following:
            batch, flat = host.flattened((values, stale, rhs), (*scalars, last))
            values, stale, rhs, *scalars, wanted = flat
            loose, group = None, np.arange(len(rhs))
        else:
            matrices, flat = host.flattened((values, stale, last), scalars)
            values, stale, loose, *scalars = flat
            group = np.arange(len(values)).reshape(matrices)
            batch, (rhs, group) = host.flattened((rhs,), (group,))
            # of an adjoint nothing is asked where its right side is zero
            wanted = rhs.any(axis=1) if transposed else np.ones(len(rhs), bool)
        values, stale, rhs = (a.astype(np.float64, copy=False) for a in (values, stale, rhs))
        x, regular, fresh = host.solve(
            (solver, symmetric, *host.first(digest, indptr, indices)),
            *(following, transposed, values, loose, stale, *scalars, rhs, group, wanted),
        )
        x = x.reshape(*batch, -1)
        if following:
            return x, regular.reshape(batch), fresh.reshape(batch)
        return x, (regular | ~wanted).reshape(batch)

    return function


def _called(pattern, kind, rhs, n_flag, *arrays):
    """Solution [n] by the host, and flags; the arguments of `solve` from `rhs` on."""
    flag = jax.ShapeDtypeStruct((), bool)
    shapes = jax.ShapeDtypeStruct(rhs.shape, rhs.dtype), *[flag] * n_flag
    arrays = pattern.digest, pattern.indptr, pattern.indices, rhs, *arrays
    return foreign.call((solve, *words(pattern), kind), shapes, *arrays)


@pytree
class Factored:
    """The last matrix that was factorised, for use in later solves.

    Attributes:
        values: values of that matrix, [n_value].
        usable: whether there is such a matrix, and its factor may be used.
        count: factorisations so far.
        pause: number of solves during which conjugate gradients are not tried, because they have
            failed before.
    """

    values: Float[Array, " n_value"]
    usable: Bool[Array, ""]
    count: Int[Array, ""]
    pause: Int[Array, ""]


def nothing_factored(pattern: Pattern | None, dtype: DTypeLike) -> Factored | None:
    """The `Factored` before the first solve on a pattern; None for dense matrices."""
    if pattern is None or pattern.solver.on_device:
        return None
    values = jnp.zeros(pattern.indices.shape, dtype)
    return Factored(values, jnp.zeros((), bool), jnp.int32(0), jnp.int32(0))


def forgotten(factored: Factored | None) -> Factored | None:
    """The `Factored` without use of its matrix, with its count; None stays None."""
    return None if factored is None else copy(factored, usable=jnp.zeros((), bool))


@custom_vmap
def solve_next(
    matrix: Sparse,
    rhs: Float[Array, " n"],
    factored: Factored | None,
    tol: Float[Array, ""],
    limit: Int[Array, ""],
    wanted: Bool[Array, ""],
) -> tuple[Float[Array, " n"], Bool[Array, ""], Factored | None]:
    """`linear.solve_next` for a `Sparse`; `factored` is None if its solver is on the device."""
    p = matrix.pattern
    if p.solver.on_device:
        return *p.solver.solve_definite(matrix, rhs), factored
    tried = factored.usable & (limit > 0) & (factored.pause == 0)
    arrays = matrix.values, factored.values, tried, tol, limit, wanted
    x, definite, fresh = _called(p, "next", rhs, 2, *arrays)
    after = Factored(
        values=jnp.where(fresh, matrix.values, factored.values),
        usable=factored.usable | fresh,
        count=factored.count + fresh,
        pause=jnp.where(tried & fresh, _PAUSE, jnp.maximum(factored.pause - 1, 0)),
    )
    return x, definite, after


def is_definite(matrix: Sparse) -> Bool[Array, ""]:
    """See `linear.is_definite`; an unsymmetric matrix is judged by its symmetric part."""
    zero = jnp.zeros(matrix.shape[0], matrix.values.dtype)
    factored = nothing_factored(matrix.pattern, zero.dtype)
    return solve_next(matrix, zero, factored, zero[0], jnp.int32(0), jnp.ones((), bool))[1]


@solve_next.def_vmap
def _solve_batch(axis_size, mapped, *arguments):
    """Solve a batch: in jax if the bandwidth is small, else one after the other on the host."""
    matrix, rhs, factored, *_ = arguments
    axes = jax.tree.map(lambda is_mapped: 0 if is_mapped else None, mapped)
    out = (0, 0, jax.tree.map(lambda _: 0, factored))
    if matrix.pattern.band is None:
        results = jax.vmap(solve_next.fun, in_axes=tuple(axes), out_axes=out)(*arguments)
        return results, jax.tree.map(lambda _: True, results)

    def one(matrix, rhs):
        x, definite = solve_banded(matrix.banded(), rhs[matrix.pattern.order])
        return x[matrix.pattern.place], definite

    x, definite = jax.vmap(one, in_axes=tuple(axes[:2]), out_axes=0, axis_size=axis_size)(
        matrix, rhs
    )
    after = factored if factored is None else copy(factored, count=factored.count + 1)
    return (x, definite, after), (True, True, mapped[2])


@pytree
class SparseFactor(Factor):
    """A general matrix that is factorised on the host when it is first solved with.

    Attributes:
        matrix: `Sparse`.
        loose: unknowns without a value, [n] bool.
        factored, tol, limit: see `linear.factorize`.
    """

    matrix: Sparse
    loose: Bool[Array, " n"]
    factored: Factored | None = None
    tol: Float[ArrayLike, ""] = 0.0
    limit: Int[ArrayLike, ""] = 0

    @property
    def regular(self) -> Bool[Array, ""]:  # type: ignore[override]  # read only
        """Whether the matrix without loose unknowns is regular to working precision."""
        return self.answered(jnp.zeros(self.loose.shape, self.matrix.values.dtype), False)[1]

    def or_identity(self) -> SparseFactor:
        """This factor, or that of the identity if the matrix is singular."""
        return copy(self, matrix=self.matrix.or_identity(self.regular))

    def answered(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
        """See `direct.Factor`."""
        p, dtype = self.matrix.pattern, b.dtype
        stale, usable = self.matrix.values, jnp.zeros((), bool)
        if self.factored is not None:
            stale, usable = self.factored.values, self.factored.usable & (self.limit > 0)
        b = jnp.where(self.loose, 0.0, b)
        known = stale, usable, jnp.asarray(self.tol, dtype), jnp.int32(self.limit)
        kind = "transposed" if transposed else "as it is"
        x, regular = _called(p, kind, b, 1, self.matrix.values, *known, self.loose)
        return x, regular

    def checked(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""], Bool[Array, ""]]:
        """See `direct.Factor`; the host has judged its pivots."""
        return *self.answered(b, transposed), jnp.ones((), bool)


def factorize(
    matrix: Sparse,
    loose: Bool[Array, " n"] | None = None,
    factored: Factored | None = None,
    tol: Float[ArrayLike, ""] = 0.0,
    limit: Int[ArrayLike, ""] = 0,
) -> Direct | SparseFactor:
    """See `linear.factorize`."""
    if loose is None:
        loose = jnp.zeros(matrix.shape[0], bool)
    matrix = lax.stop_gradient(matrix)
    if matrix.pattern.solver.on_device:
        return matrix.pattern.solver.factorize(matrix, loose)
    return SparseFactor(matrix, loose, factored, tol, limit)
