"""The derivative of an equilibrium: the implicit function theorem, apart from the iteration.

With ``R(x, p) = 0`` the derivative of ``x`` is ``dx = -K^-1 R_p dp``, whatever iteration found
``x`` and however many increments it took. `rooted` attaches it; derivatives of any order and both
modes follow from `lax.custom_linear_solve`.
"""

from __future__ import annotations

from typing import Any, TypeAlias, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .. import linear
from ..common.tree import fill, thaw
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..linear.sparse import Factored
from .rooted import rooted

Tree = TypeVar("Tree")
System: TypeAlias = Any
"""`mechanics.assembly.System`, which stands on this room."""


def gate(open_: Bool[ArrayLike, ""], tree: Tree) -> Tree:
    """Let derivatives of `tree` through only where `open_`; values pass always.

    A select, so that a NaN on its way back is stopped and not multiplied by zero.
    """

    def one(x):
        x = jnp.asarray(x)
        floating = jnp.issubdtype(x.dtype, jnp.floating)
        return jnp.where(open_, x, lax.stop_gradient(x)) if floating else x

    return jax.tree.map(one, tree)


def attach(
    system: System, x: Float[Array, "n_row n_motion"], valid: Bool[ArrayLike, ""]
) -> Float[Array, "n_row n_motion"]:
    """Return `x` with the derivative of the equilibrium of `system`: `attach_apart` as one."""
    return attach_apart(system, x, valid)[0]


def attach_apart(
    system: System,
    x: Float[Array, "n_row n_motion"],
    valid: Bool[ArrayLike, ""],
    factored: Factored | None = None,
    tol: Float[ArrayLike, ""] = 0.0,
    limit: Int[ArrayLike, ""] = 0,
) -> tuple[Float[Array, "n_row n_motion"], Float[Array, "n_row n_motion"], Float[Array, " n_row"]]:
    """Return `x` with the derivative of the equilibrium of `system`, and where it has none.

    Args:
        system: `System`, differentiable.
        x: its equilibrium, the point of an iteration; its own derivative is ignored.
        valid: whether `x` is an equilibrium; if not, the result has derivative zero (and the caller
            must see to it that nobody takes that for an answer). An equilibrium with a cable
            between taut and slack has no derivative: NaN.
        factored, tol, limit: see `linear.solve_marked`.

    Returns:
        x: with NaN for a derivative where it has none.
        bare: with zero there.
        marks: zero for every row of motion, [n_row], with NaN for a derivative where it has none.
            To what is read off `bare` it brings that NaN by a sum: were it in what is multiplied,
            second derivatives would meet it times the zero of who does not ask.
    """
    x = lax.stop_gradient(x)
    _, numbers, back = system.chart(system.carried(x))
    if not numbers.size:  # nothing is free
        return back(numbers), back(numbers), jnp.zeros(system.nodes.shape[0], x.dtype)
    # What has no derivative is marked beside the root: its NaN goes out to whoever asks, and not
    # into the residual at the root, where second derivatives would meet it times zero.
    start = jnp.concatenate([numbers, jnp.zeros_like(numbers)])
    problem = thaw((system, x, valid, factored, tol, limit))
    found = rooted(_marked, start, problem, _solved)
    found, mark = jnp.split(found, 2)
    marks = jnp.sum(jnp.append(mark, 0.0)[system.freedoms.number], axis=1)
    return back(found + mark), back(found), marks


def _marked(found, problem):
    """Residual of the system, and the marks themselves, at numbers of the unknowns and marks."""
    system, x, *_ = fill(*problem)
    residual, numbers, _ = system.chart(system.carried(x))
    return jnp.concatenate([residual(found[: numbers.size]), found[numbers.size :]])


def _solved(problem, linearized, rhs):
    """Solve with the derivative of `_marked`."""
    system, x, valid, factored, tol, limit = fill(*lax.stop_gradient(problem))

    def build():
        matrix = linear.or_identity(system.tangent(x), valid)
        matrix = linear.or_nan(matrix, ~(system.kinked(x) & valid))
        return matrix, system.loose_nodes(x)[system.freedoms.row_of_unknown] & valid

    return linear.solve_marked(build, rhs, linearized, factored, tol, limit)


def undifferentiated(tree: Tree, parameters: PyTree[Any]) -> Tree:
    """Return `tree` with derivative NaN with respect to every one of `parameters`.

    For results whose derivative was not asked for: an honest NaN instead of a silent zero.
    """
    touched = touch(parameters)

    def one(x):
        x = jnp.asarray(x)
        floating = jnp.issubdtype(x.dtype, jnp.floating)
        return _constant(lax.stop_gradient(x), touched) if floating else x

    return jax.tree.map(one, tree)


def first_order(tree: Tree) -> Tree:
    """Return `tree`; its first derivative passes, every higher one is NaN.

    For what is exact at first order only: an honest NaN instead of a silently wrong number.
    """

    def one(x):
        return _first_order(x) if jnp.issubdtype(jnp.asarray(x).dtype, jnp.floating) else x

    return jax.tree.map(one, tree)


def nan_unless(ok: Bool[ArrayLike, ""], tree: Tree, parameters: PyTree[Any]) -> Tree:
    """Make `tree` NaN, in value and in derivative, unless `ok`."""
    return nan_beside(ok, tree, touch(parameters))


def nan_beside(ok: Bool[ArrayLike, ""], tree: Tree, touched: Float[Array, ""]) -> Tree:
    """`nan_unless` with what `touch` gives, which is to be asked for outside of loops."""
    return jax.tree.map(lambda x: _poison(ok, x, touched), tree)


def touch(parameters: PyTree[Any]) -> Float[Array, ""]:
    """Zero, with a derivative by every float in `parameters`: only that matters."""
    leaves = [jnp.asarray(x) for x in jax.tree.leaves(parameters)]
    return _touch([x for x in leaves if jnp.issubdtype(x.dtype, jnp.floating)])


@jax.custom_jvp
def _touch(floats):
    # zero whatever they are, with the axes that they have in a batch
    return sum((jnp.where(x.ravel()[0] > 0, 0.0, 0.0) for x in floats if x.size), jnp.zeros(()))


@_touch.defjvp
def _touch_jvp(primals, tangents):
    return _touch(*primals), sum((jnp.sum(x) for x in tangents[0]), jnp.zeros(()))


def _poison(ok, x, touched):
    """A linear map: the identity on the array `x` where `ok`, else NaN.

    Backwards it is NaN, to `x` and through `touched` to every parameter, only where a cotangent is
    not zero. A product with NaN would spoil what a batch shares by 0 NaN for cases that nobody
    asked about. Such a pair of maps cannot be had by tracing; `lax.custom_linear_solve` of the
    identity takes it as a black box and has all transformations.
    """

    def identity(v):
        return v

    def forward(_, b):
        return jax.tree.map(lambda x: jnp.where(ok, x, jnp.nan), b)

    def backward(_, b):
        x, touched = b
        asked = jnp.any(x != 0)
        return jnp.where(ok | (x == 0), x, jnp.nan), jnp.where(ok | ~asked, touched, jnp.nan)

    def beside(x, other):
        """`x`, which has a derivative wherever `other` has one (jax 0.10 wants all or none)."""
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
