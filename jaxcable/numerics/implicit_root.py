"""Implicit roots: a known root with the derivative of its equation, as a primitive of jax.

`lax.custom_root` is a custom rule. jax 0.10 drops custom rules when it takes a reverse-mode
derivative of a `lax.scan`, and derivatives of this derivative are then silently zero (jax 0.12 does
not). Primitives are not dropped.

The parameters of the equation are arguments of the primitive, so that the equation is traced only
if a derivative is taken. The derivative is a primitive, too, so that reverse mode stores the
parameters and no intermediate results of the linearization (except in batches of changes, where the
derivative is traced).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jax.flatten_util import ravel_pytree

from ..common import jax_internals as internals
from ..common.compilation import without_garbage_collection
from ..common.types import Array, Float, PyTree

Tree = TypeVar("Tree")


def implicit_root(
    function: Callable[[Float[Array, "*n"], PyTree[Any]], Float[Array, "*n"]],
    root: Float[Array, "*n"],
    parameters: PyTree[Any],
    tangent_solve: Callable[..., Float[Array, "*n"]] | None,
) -> Float[Array, "*n"]:
    """Return the known root x of ``f(x, p) = 0``, with its derivatives by p, of any order.

    The implicit function theorem gives ``dx = -f_x^-1 f_p dp``. f is traced only if a derivative is
    taken (where jax has no primitives to define, always).

    Args:
        function: ``f(x, p)``, an array like `x`; it depends on no other traced values.
        root: x, an array; the derivative of this argument is ignored.
        parameters: p, a pytree.
        tangent_solve: function of p, of ``f_x`` as a linear function and of a right side, which
            returns ``f_x^-1`` times the right side; None if ``f_x`` is the identity.
    """
    if _ROOT is None or _ROOT_TANGENT is None:
        internals.warn_missing_feature("primitives")
        return _implicit_root_by_custom_root(function, root, parameters, tangent_solve)
    leaves, tree = jax.tree.flatten(parameters)

    def equation(x, *leaves):
        return function(x, tree.unflatten(leaves))

    def solver(x, rhs, *leaves):
        if tangent_solve is None:
            return rhs
        _, linear = jax.linearize(lambda x: equation(x, *leaves), x)
        return tangent_solve(tree.unflatten(leaves), linear, rhs)

    arrays = map(jnp.asarray, leaves)
    return _ROOT.bind(lax.stop_gradient(root), *arrays, equation=equation, solver=solver)


def with_deferred_derivative(
    function: Callable[[PyTree[Any]], Tree], values: Tree, parameters: PyTree[Any]
) -> Tree:
    """Return known values of a function, which is traced only if their derivative is taken.

    Args:
        function: function of the parameters, which returns a pytree of floats of one dtype; it
            depends on no other traced values.
        values: ``function(parameters)``; the derivatives of this argument are ignored.
        parameters: a pytree.
    """
    flat, back = ravel_pytree(values)
    return back(
        implicit_root(lambda x, p: x - ravel_pytree(function(p))[0], flat, parameters, None)
    )


def _implicit_root_by_custom_root(function, root, parameters, tangent_solve):
    """Return a root with implicit derivatives by `lax.custom_root`, if jax has no primitives."""

    def solver(linear, rhs):
        return rhs if tangent_solve is None else tangent_solve(parameters, linear, rhs)

    root = lax.stop_gradient(root)
    return lax.custom_root(lambda x: function(x, parameters), root, lambda _, x: x, solver)


def _evaluate_root(root, *leaves, equation, solver):
    """Return the root, the first argument: value, and shape rule, of the primitive `_ROOT`."""
    return root


def _root_jvp(primals, tangents, *, equation, solver):
    """Forward derivative of `_ROOT`: return the root, and its tangent by `_ROOT_TANGENT`."""
    _, *leaves = primals
    found = _ROOT.bind(*primals, equation=equation, solver=solver)
    pairs = enumerate(zip(leaves, tangents[1:], strict=True))
    changes = {
        k: change
        for k, (x, change) in pairs
        if jnp.issubdtype(x.dtype, jnp.inexact) and not internals.is_zero_tangent(change)
    }
    if not changes:
        return found, internals.zero_tangent(found)
    given = {"equation": equation, "solver": solver, "moving": tuple(changes)}
    return found, _ROOT_TANGENT.bind(found, *leaves, *changes.values(), **given)


def _root_tangent(found, *leaves_and_changes, equation, solver, moving):
    """Return the tangent of a root, ``-f_x^-1 f_p dp``: the value of the primitive `_ROOT_TANGENT`.

    `found` is the root; `leaves_and_changes` are all parameters, then the tangents dp of those with
    the indices `moving`; `equation` is f, and `solver` solves with ``f_x``.
    """
    count = len(leaves_and_changes) - len(moving)
    leaves, changes = leaves_and_changes[:count], leaves_and_changes[count:]

    def residual(*some):
        at = list(leaves)
        for k, x in zip(moving, some, strict=True):
            at[k] = x
        return equation(found, *at)

    rhs = jax.jvp(residual, [leaves[k] for k in moving], list(changes))[1]
    return -solver(found, rhs, *leaves)


def _root_tangent_shape(found, *_, **__):
    """Return shape and dtype of the tangent of a root: those of the root."""
    return found


def _root_tangent_jvp(primals, tangents, *, moving, **given):
    """Forward derivative of `_ROOT_TANGENT`, which is linear in the tangents of parameters.

    A derivative by the parameters themselves is traced.
    """
    count = len(primals) - len(moving)
    evaluate = partial(_root_tangent, moving=moving, **given)
    out = _ROOT_TANGENT.bind(*primals, moving=moving, **given)
    if all(internals.is_zero_tangent(t) for t in tangents[:count]):
        further = [internals.instantiate_tangent(t) for t in tangents[count:]]
        return out, _ROOT_TANGENT.bind(*primals[:count], *further, moving=moving, **given)
    places = [k for k, t in enumerate(tangents) if not internals.is_zero_tangent(t)]

    def some(*values):
        at = list(primals)
        for k, x in zip(places, values, strict=True):
            at[k] = x
        return evaluate(*at)

    start, direction = [primals[k] for k in places], [tangents[k] for k in places]
    return out, jax.jvp(some, start, direction)[1]


@without_garbage_collection()
def _root_tangent_transpose(back, *arguments, moving, **given):
    """Transpose rule of `_ROOT_TANGENT`: return cotangents of parameters, by an adjoint solve."""
    count = len(arguments) - len(moving)
    if internals.is_zero_tangent(back):
        return [None] * len(arguments)
    known, changes = arguments[:count], arguments[count:]
    evaluate = partial(_root_tangent, *known, moving=moving, **given)
    pulled = jax.linear_transpose(evaluate, *(c.aval for c in changes))(back)
    return [None] * count + list(pulled)


def _root_tangent_batch_rule(arguments, axes, **given):
    """Rule for `jax.vmap` of `_ROOT_TANGENT`: trace `_root_tangent` for a batch."""
    return jax.vmap(partial(_root_tangent, **given), axes)(*arguments), 0


def _root_batch_rule(arguments, axes, *, equation, solver):
    """Rule for `jax.vmap` of `_ROOT`: the primitive again, with equation and solver mapped."""
    size = next(x.shape[a] for x, a in zip(arguments, axes, strict=True) if a is not None)
    arguments = [
        x if a is None else jnp.moveaxis(x, a, 0) for x, a in zip(arguments, axes, strict=True)
    ]
    leaf_axes = [None if a is None else 0 for a in axes[1:]]
    root, *leaves = arguments
    if axes[0] is None:
        root = jnp.broadcast_to(root, (size, *root.shape))
    found = _ROOT.bind(
        root,
        *leaves,
        equation=jax.vmap(equation, (0, *leaf_axes), axis_size=size),
        solver=jax.vmap(solver, (0, 0, *leaf_axes), axis_size=size),
    )
    return found, 0


_ROOT = internals.define_primitive(
    "rooted", _evaluate_root, _evaluate_root, _root_jvp, _root_batch_rule
)
# derivative of a root, linear in the changes of parameters
_ROOT_TANGENT = internals.define_primitive(
    "root_change",
    _root_tangent,
    _root_tangent_shape,
    _root_tangent_jvp,
    _root_tangent_batch_rule,
    _root_tangent_transpose,
)
