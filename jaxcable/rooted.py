"""A root with the derivative of its equation, as a primitive of jax of its own.

`lax.custom_root` is a custom rule, which jax 0.10 drops while it takes a reverse-mode derivative of
a `lax.scan`: derivatives of such a derivative are then silently zero. Primitives it leaves alone.
What the equation depends on is handed over, so that nothing of it is traced unless somebody takes a
derivative.
"""

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

_ROOT = Primitive("rooted")


def rooted(function, root, parameters, tangent_solve):
    """Return a root with derivatives of any order of what it is a root of.

    With ``f(x, p) = 0`` its derivative is ``-f_x^-1 f_p dp``.

    Args:
        function: ``f(x, p)``, an array as `x`; it depends on nothing else that is traced.
        root: where it is zero, an array; its own derivative does not count.
        parameters: p, a pytree.
        tangent_solve: function of p, a linear function and a right side that solves.
    """
    leaves, tree = jax.tree.flatten(parameters)

    def equation(x, *leaves):
        return function(x, tree.unflatten(leaves))

    def solver(x, rhs, *leaves):
        _, linear = jax.linearize(lambda x: equation(x, *leaves), x)
        return tangent_solve(tree.unflatten(leaves), linear, rhs)

    leaves = map(jnp.asarray, leaves)
    return _ROOT.bind(lax.stop_gradient(root), *leaves, equation=equation, solver=solver)


@_ROOT.def_impl
def _root(root, *leaves, equation, solver):
    return root


@_ROOT.def_abstract_eval
def _shape(root, *leaves, equation, solver):
    return root


def _derivative(primals, tangents, *, equation, solver):
    _, *leaves = primals
    found = _ROOT.bind(*primals, equation=equation, solver=solver)
    changes = dict(enumerate(tangents[1:]))
    floats = [k for k, x in enumerate(leaves) if jnp.issubdtype(x.dtype, jnp.inexact)]
    moving = [k for k in floats if not isinstance(changes[k], ad.Zero)]
    if not moving:
        return found, ad.Zero.from_primal_value(found)

    def residual(*some):
        at = list(leaves)
        for k, x in zip(moving, some, strict=True):
            at[k] = x
        return equation(found, *at)

    start, direction = [leaves[k] for k in moving], [changes[k] for k in moving]
    rhs = jax.jvp(residual, start, direction)[1]
    return found, -solver(found, rhs, *leaves)


def _batched(arguments, axes, *, equation, solver):
    size = next(x.shape[a] for x, a in zip(arguments, axes, strict=True) if a is not None)
    arguments = [
        x if a is None else jnp.moveaxis(x, a, 0) for x, a in zip(arguments, axes, strict=True)
    ]
    own = [None if a is None else 0 for a in axes[1:]]
    root, *leaves = arguments
    if axes[0] is None:
        root = jnp.broadcast_to(root, (size, *root.shape))
    found = _ROOT.bind(
        root,
        *leaves,
        equation=jax.vmap(equation, (0, *own), axis_size=size),
        solver=jax.vmap(solver, (0, 0, *own), axis_size=size),
    )
    return found, 0


ad.primitive_jvps[_ROOT] = _derivative
batching.primitive_batchers[_ROOT] = _batched
mlir.register_lowering(_ROOT, lambda ctx, root, *leaves, **_: [root])
