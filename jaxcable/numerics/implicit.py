"""The derivative of an equilibrium by the implicit function theorem, independent of the iteration.

With ``R(x, p) = 0`` the derivative of ``x`` is ``dx = -K^-1 R_p dp``, whatever iteration found
``x`` and however many increments it took. `rooted` attaches it to ``x``. Derivatives of any order
and both modes follow from `lax.custom_linear_solve`.
"""

from __future__ import annotations

from typing import Any, TypeAlias, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import linear
from ..common.tree import fill, thaw, where
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..linear.sparse import Factored
from .rooted import rooted

Tree = TypeVar("Tree")
System: TypeAlias = Any
"""`mechanics.assembly.System`, which cannot be imported here: it stands on this room."""


def gate(open_: Bool[ArrayLike, ""], tree: Tree) -> Tree:
    """Return `tree`, whose derivatives pass only where `open_`.

    By a select: a product with zero would let a NaN of a backward pass through.
    """

    def one(x):
        x = jnp.asarray(x)
        floating = jnp.issubdtype(x.dtype, jnp.floating)
        return where(open_, x, lax.stop_gradient(x)) if floating else x

    return jax.tree.map(one, tree)


def attach(
    system: System, x: Float[Array, "n_row n_motion"], valid: Bool[ArrayLike, ""]
) -> Float[Array, "n_row n_motion"]:
    """Return `x` with the derivative of the equilibrium of `system`, see `attach_apart`."""
    return attach_apart(system, x, valid)[0]


def attach_apart(
    system: System,
    x: Float[Array, "n_row n_motion"],
    valid: Bool[ArrayLike, ""],
    factored: Factored | None = None,
    tol: Float[ArrayLike, ""] = 0.0,
    limit: Int[ArrayLike, ""] = 0,
) -> tuple[Float[Array, "n_row n_motion"], Float[Array, "n_row n_motion"], Float[Array, " n_row"]]:
    """Return `x` with the derivative of the equilibrium of `system`, and marks where it has none.

    Args:
        system: `System`, differentiable.
        x: its equilibrium, a motion; the derivative of this argument is ignored.
        valid: whether `x` is an equilibrium. If not, the result has derivative zero, and the caller
            must make it NaN. An equilibrium with a cable exactly between taut and slack has no
            derivative: it is NaN.
        factored, tol, limit: see `linear.factorize`.

    Returns:
        x: the point, with derivative NaN where it has none.
        bare: the point, with derivative zero where it has none.
        marks: zero for every row of motion, [n_row], with derivative NaN where the row has none.
            Results are computed from `bare`, and the marks are added: their NaN must not be in a
            product, where second derivatives would multiply it by zero and become NaN everywhere.
    """
    x = lax.stop_gradient(x)
    _, numbers, back = system.chart(system.carried(x))
    if not numbers.size:  # nothing is free
        return back(numbers), back(numbers), jnp.zeros(system.nodes.shape[0], x.dtype)
    # Unknowns without a derivative are marked beside the root. A NaN in the root itself would enter
    # the residual there, where second derivatives would multiply it by zero.
    start = jnp.concatenate([numbers, jnp.zeros_like(numbers)])
    problem = thaw((system, x, valid, factored, tol, limit))
    found = rooted(_marked, start, problem, _solved)
    found, mark = jnp.split(found, 2)
    number, numbering = system.freedoms.number, system.freedoms.numbering
    if numbering is None:
        marks = linear.with_zero(mark)[number]
    else:  # whose transpose needs no scatter
        marks = numbering.spread(mark).reshape(number.shape)
    marks = jnp.sum(marks, axis=1)
    return back(found + mark), back(found), marks


def _marked(found, problem):
    """The equation of root and marks, [2 n]: residual at a step, and the marks themselves."""
    system, x, *_ = fill(*problem)
    residual, numbers, _ = system.chart(system.carried(x))
    return jnp.concatenate([residual(found[: numbers.size]), found[numbers.size :]])


def _solved(problem, linearized, rhs):
    """Solve with the derivative of `_marked`, `linearized`, for a right side."""
    problem = lax.stop_gradient(problem)
    pattern = fill(*problem)[0].freedoms.pattern
    if pattern is None or (pattern.solver.on_device and not pattern.solver.fused):
        factor = _factor(problem)  # one for both

        def answered(_, b):
            return factor.marked(b)

        def adjoint(_, b):
            return factor.adjoint(b)
    else:
        answered, adjoint = _answered, _adjoint

    def forward(_, both):
        b, mark = jnp.split(both, 2)
        answer, unknown = answered(problem, b)
        return jnp.concatenate([answer, jnp.where(unknown, jnp.nan, mark)])

    def backward(_, both):
        b, mark = jnp.split(both, 2)
        return jnp.concatenate([adjoint(problem, b), mark])

    return lax.custom_linear_solve(linearized, rhs, solve=forward, transpose_solve=backward)


def _answered(problem, b):
    return _factor(problem).marked(b)


def _adjoint(problem, b):  # nothing is assembled for phases without influence
    return lax.cond(jnp.any(b != 0), lambda b: _factor(problem).adjoint(b), jnp.zeros_like, b)


def _factor(problem):
    """The factor of the tangent in the problem of `_marked`."""
    system, x, valid, *known = fill(*problem)
    matrix = linear.or_identity(system.tangent(x), valid)
    matrix = linear.or_nan(matrix, ~(system.kinked(x) & valid))
    loose = system.loose_nodes(x)[system.freedoms.row_of_unknown] & valid
    return linear.factorize(matrix, loose, *known)


def undifferentiated(tree: Tree, parameters: PyTree[Any]) -> Tree:
    """Return `tree` with derivative NaN with respect to every one of `parameters`.

    For results whose derivative is not computed: a NaN is seen, a zero would be silently wrong.
    """
    touched = touch(parameters)

    def one(x):
        x = jnp.asarray(x)
        floating = jnp.issubdtype(x.dtype, jnp.floating)
        return _constant(lax.stop_gradient(x), touched) if floating else x

    return jax.tree.map(one, tree)


def first_order(tree: Tree) -> Tree:
    """Return `tree`, whose first derivative passes and whose higher derivatives are NaN.

    For results that are exact at first order only: a higher derivative would be silently wrong.
    """

    def one(x):
        return _first_order(x) if jnp.issubdtype(jnp.asarray(x).dtype, jnp.floating) else x

    return jax.tree.map(one, tree)


def nan_unless(ok: Bool[ArrayLike, ""], tree: Tree, parameters: PyTree[Any]) -> Tree:
    """Return `tree` if `ok`, else NaN with NaN derivatives with respect to `parameters`."""
    return nan_beside(ok, tree, touch(parameters))


def nan_beside(ok: Bool[ArrayLike, ""], tree: Tree, touched: Float[Array, ""]) -> Tree:
    """`nan_unless` with ``touch(parameters)``, which is cheaper outside of loops."""
    return jax.tree.map(lambda x: _poison(ok, x, touched), tree)


def touch(parameters: PyTree[Any]) -> Float[Array, ""]:
    """Zero, with derivative 1 with respect to every float in `parameters`."""
    leaves = [jnp.asarray(x) for x in jax.tree.leaves(parameters)]
    return _touch([x for x in leaves if jnp.issubdtype(x.dtype, jnp.floating)])


@jax.custom_jvp
def _touch(floats):
    # zero for all values, with the axes that the floats have in a batch
    return sum((jnp.where(x.ravel()[0] > 0, 0.0, 0.0) for x in floats if x.size), jnp.zeros(()))


@_touch.defjvp
def _touch_jvp(primals, tangents):
    return _touch(*primals), sum((jnp.sum(x) for x in tangents[0]), jnp.zeros(()))


def _poison(ok, x, touched):
    """A linear map: the identity on the array `x` if `ok`, else NaN.

    Its transpose gives NaN, to `x` and through `touched` to every parameter, only where a cotangent
    is not zero. A product with NaN would give 0 NaN for cases of a batch whose cotangent is zero,
    and pollute the parameters that the cases share. Tracing cannot yield such a pair of maps;
    `lax.custom_linear_solve` of the identity takes both as they are and has all transformations.
    """

    def identity(v):
        return v

    def forward(_, b):
        return jax.tree.map(lambda x: jnp.where(ok, x, jnp.nan), b)

    def backward(_, b):
        x, touched = b
        wanted = jnp.any(x != 0)
        return jnp.where(ok | (x == 0), x, jnp.nan), jnp.where(ok | ~wanted, touched, jnp.nan)

    def beside(x, other):
        """`x`, made differentiable wherever `other` is (jax 0.10 wants both or none)."""
        return x + jnp.where(np.False_, other, 0.0)

    if not x.size:
        return x
    touched = touched.astype(x.dtype)
    both = beside(x, touched), beside(touched, x.ravel()[0])
    return beside(*lax.custom_linear_solve(identity, both, forward, backward))


@jax.custom_jvp
def _constant(x, touched):
    return x


@_constant.defjvp
def _constant_jvp(primals, tangents):
    x = primals[0]
    return x, _poison(False, jnp.zeros_like(x), tangents[1])


@jax.custom_jvp
def _first_order(x):
    return x


@_first_order.defjvp
def _first_order_jvp(primals, tangents):
    (x,), (change,) = primals, tangents
    return x, change * _constant(jnp.ones((), x.dtype), jnp.sum(x))
