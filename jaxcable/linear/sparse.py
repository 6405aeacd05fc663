"""Sparse direct solves on the host, called from a compiled program (`common.host_calls`)."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap
from jax.typing import DTypeLike

from ..common import host_calls
from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from . import host
from .banded import solve_banded
from .direct import MatrixFactor, OnDeviceFactor
from .pattern import Pattern, SparseMatrix
from .solver import solver_named

# Solves without conjugate gradients after they have failed: while cables change between slack and
# taut, matrices differ for some steps, and every attempt is lost.
_SOLVES_TO_PAUSE = 3


def solver_and_storage_words(pattern: Pattern) -> tuple[str, str]:
    """Return the solver's name and "symmetric" or "general" storage, words for host functions."""
    return pattern.solver.name, "symmetric" if pattern.symmetric else "general"


@host_calls.register_host_function_family
def make_host_solver(solver, stored, kind):
    """Return the NumPy function that solves all sparse systems of a batch, for `call_on_host`.

    `solver` is a name; `stored` is "symmetric" (upper triangle) or "general"; `kind` is "as it is",
    "transposed", or "next" for definite matrices in a sequence. The function's last argument is a
    mask of loose unknowns; for "next", whether the result is wanted.
    """
    solver, symmetric = solver_named(solver), stored == "symmetric"
    following, transposed = kind == "next", kind == "transposed"

    def function(digest, indptr, indices, rhs, values, stale, usable, tol, limit, last):
        scalars = usable, tol, limit
        if following:
            batch, flat = host.flatten_batch((values, stale, rhs), (*scalars, last))
            values, stale, rhs, *scalars, wanted = flat
            loose, matrix_index = None, np.arange(len(rhs))
        else:
            matrices, flat = host.flatten_batch((values, stale, last), scalars)
            values, stale, loose, *scalars = flat
            matrix_index = np.arange(len(values)).reshape(matrices)
            batch, (rhs, matrix_index) = host.flatten_batch((rhs,), (matrix_index,))
            # of an adjoint nothing is asked where its right side is zero
            wanted = rhs.any(axis=1) if transposed else np.ones(len(rhs), bool)
        values, stale, rhs = (a.astype(np.float64, copy=False) for a in (values, stale, rhs))
        x, regular, fresh = host.solve_sparse_batch(
            (solver, symmetric, *host.take_first_case(digest, indptr, indices)),
            *(following, transposed, values, loose, stale, *scalars, rhs, matrix_index, wanted),
        )
        x = x.reshape(*batch, -1)
        if following:
            return x, regular.reshape(batch), fresh.reshape(batch)
        return x, (regular | ~wanted).reshape(batch)

    return function


def _solve_sparse_on_host(pattern, kind, rhs, n_flag, *arrays):
    """Call `make_host_solver`'s function: return the solution [n], and `n_flag` scalar booleans.

    Args:
        pattern: `Pattern` of the matrix.
        kind: "next", "transposed" or "as it is".
        rhs: right side, [n].
        n_flag: number of booleans that the function returns: 2 for "next", else 1.
        arrays: the further arguments of the function.
    """
    flag = jax.ShapeDtypeStruct((), bool)
    shapes = jax.ShapeDtypeStruct(rhs.shape, rhs.dtype), *[flag] * n_flag
    arrays = pattern.digest, pattern.indptr, pattern.indices, rhs, *arrays
    return host_calls.call_on_host(
        (make_host_solver, *solver_and_storage_words(pattern), kind), shapes, *arrays
    )


@pytree
class FactorRecord:
    """Record of the last matrix factorised on the host; later solves may use its factor again.

    Attributes:
        values: values of that matrix, [n_value].
        usable: whether there is such a matrix, and its factor may be used, scalar bool.
        count: number of factorisations so far.
        pause: number of solves during which conjugate gradients are not tried, because they have
            failed before.
    """

    values: Float[Array, " n_value"]
    usable: Bool[Array, ""]
    count: Int[Array, ""]
    pause: Int[Array, ""]


def no_factored_matrix(pattern: Pattern | None, dtype: DTypeLike) -> FactorRecord | None:
    """Return the `FactorRecord` before a first solve; None for solvers inside of the program."""
    if pattern is None or pattern.solver.on_device:
        return None
    values = jnp.zeros(pattern.indices.shape, dtype)
    return FactorRecord(values, jnp.zeros((), bool), jnp.int32(0), jnp.int32(0))


def with_unusable_factor(factored: FactorRecord | None) -> FactorRecord | None:
    """Return a `FactorRecord` with the same count whose factor is not used; None stays None."""
    return None if factored is None else copy_with(factored, usable=jnp.zeros((), bool))


@custom_vmap
def solve_reusing_factor(
    matrix: SparseMatrix,
    rhs: Float[Array, " n"],
    factored: FactorRecord | None,
    tol: Float[Array, ""],
    limit: Int[Array, ""],
    wanted: Bool[Array, ""],
) -> tuple[Float[Array, " n"], Bool[Array, ""], FactorRecord | None]:
    """Solve the next of a sequence of similar, definite systems; not differentiable.

    `factored` is the matrix factorised last (None if the solver is in the compiled program), with
    whose factor conjugate gradients try to solve: `tol` is the relative residual, `limit` the
    number of steps allowed. `wanted` is False if the result does not matter. Returns the solution
    [n], whether the matrix is positive definite, and the `FactorRecord` for the next solve.
    """
    p = matrix.pattern
    if p.solver.on_device:
        return *p.solver.solve_definite(matrix, rhs), factored
    tried = factored.usable & (limit > 0) & (factored.pause == 0)
    arrays = matrix.values, factored.values, tried, tol, limit, wanted
    x, definite, fresh = _solve_sparse_on_host(p, "next", rhs, 2, *arrays)
    after = FactorRecord(
        values=jnp.where(fresh, matrix.values, factored.values),
        usable=factored.usable | fresh,
        count=factored.count + fresh,
        pause=jnp.where(tried & fresh, _SOLVES_TO_PAUSE, jnp.maximum(factored.pause - 1, 0)),
    )
    return x, definite, after


def is_definite(matrix: SparseMatrix) -> Bool[Array, ""]:
    """Return whether a sparse matrix (or its symmetric part) is positive definite, scalar bool."""
    zero = jnp.zeros(matrix.shape[0], matrix.values.dtype)
    factored = no_factored_matrix(matrix.pattern, zero.dtype)
    return solve_reusing_factor(matrix, zero, factored, zero[0], jnp.int32(0), jnp.ones((), bool))[
        1
    ]


@solve_reusing_factor.def_vmap
def _solve_reusing_factor_batch_rule(axis_size, mapped, *arguments):
    """Rule for `jax.vmap`: solve in jax if the bandwidth is small, else case by case on the host.

    `axis_size` is the number of cases, `mapped` says which arrays in `arguments` have their
    axis. Returns the results, and which of them are mapped.
    """
    matrix, rhs, factored, *_ = arguments
    axes = jax.tree.map(lambda is_mapped: 0 if is_mapped else None, mapped)
    out = (0, 0, jax.tree.map(lambda _: 0, factored))
    if matrix.pattern.band is None:
        results = jax.vmap(solve_reusing_factor.fun, in_axes=tuple(axes), out_axes=out)(*arguments)
        return results, jax.tree.map(lambda _: True, results)

    def one(matrix, rhs):
        x, definite = solve_banded(matrix.banded(), rhs[matrix.pattern.order])
        return x[matrix.pattern.place], definite

    x, definite = jax.vmap(one, in_axes=tuple(axes[:2]), out_axes=0, axis_size=axis_size)(
        matrix, rhs
    )
    after = factored if factored is None else copy_with(factored, count=factored.count + 1)
    return (x, definite, after), (True, True, mapped[2])


@pytree
class SparseFactor(MatrixFactor):
    """Factor of a general sparse matrix, computed on the host when it is first needed.

    Attributes:
        matrix: the matrix.
        loose: unknowns with empty rows and columns, which have no solution, [n] bool.
        factored, tol, limit: for conjugate gradients with an earlier factor, as in
            `linear.factorize`.
    """

    matrix: SparseMatrix
    loose: Bool[Array, " n"]
    factored: FactorRecord | None = None
    tol: Float[ArrayLike, ""] = 0.0
    limit: Int[ArrayLike, ""] = 0

    @property
    def regular(self) -> Bool[Array, ""]:  # type: ignore[override]  # read only
        """Whether the matrix without loose unknowns is regular to working precision, a scalar."""
        return self.solve_with_status(jnp.zeros(self.loose.shape, self.matrix.values.dtype), False)[
            1
        ]

    def identity_if_singular(self) -> SparseFactor:
        """Return this factor, or that of the identity if the matrix is singular."""
        return copy_with(self, matrix=self.matrix.identity_unless(self.regular))

    def solve_with_status(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
        """Solve with the matrix or its transpose: return x [n], and whether it is regular."""
        p, dtype = self.matrix.pattern, b.dtype
        stale, usable = self.matrix.values, jnp.zeros((), bool)
        if self.factored is not None:
            stale, usable = self.factored.values, self.factored.usable & (self.limit > 0)
        b = jnp.where(self.loose, 0.0, b)
        known = stale, usable, jnp.asarray(self.tol, dtype), jnp.int32(self.limit)
        kind = "transposed" if transposed else "as it is"
        x, regular = _solve_sparse_on_host(p, kind, b, 1, self.matrix.values, *known, self.loose)
        return x, regular

    def solve_checked(
        self, b: Float[Array, " n"], transposed: bool
    ) -> tuple[Float[Array, " n"], Bool[Array, ""], Bool[Array, ""]]:
        """Solve with the matrix or its transpose: return x [n], whether it is regular, and True.

        The True says that x is accurate: the host has judged the pivots.
        """
        return *self.solve_with_status(b, transposed), jnp.ones((), bool)


def factorize(
    matrix: SparseMatrix,
    loose: Bool[Array, " n"] | None = None,
    factored: FactorRecord | None = None,
    tol: Float[ArrayLike, ""] = 0.0,
    limit: Int[ArrayLike, ""] = 0,
) -> OnDeviceFactor | SparseFactor:
    """Return a factor of a sparse general matrix, without the unknowns `loose`, [n] bool.

    `factored`, `tol` and `limit` are for conjugate gradients with an earlier factor: its matrix,
    the relative residual that they may leave, and the number of steps allowed.
    """
    if loose is None:
        loose = jnp.zeros(matrix.shape[0], bool)
    matrix = lax.stop_gradient(matrix)
    if matrix.pattern.solver.on_device:
        return matrix.pattern.solver.factorize(matrix, loose)
    return SparseFactor(matrix, loose, factored, tol, limit)
