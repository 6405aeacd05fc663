"""A root with the derivative of its equation, as a primitive of jax of its own.

`lax.custom_root` is a custom rule, which jax 0.10 drops while it takes a reverse-mode derivative of
a `lax.scan`: derivatives of such a derivative are then silently zero. Primitives it leaves alone.
"""

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir

_ROOT = Primitive("rooted")


def rooted(function, root, tangent_solve, solve=None):
    """Return a root with derivatives of any order of what it is a root of.

    With ``f(x, p) = 0`` its derivative is ``-f_x^-1 f_p dp``.

    Args:
        function: ``f(x)``, an array as `x`; it may depend on anything around it.
        root: where it is zero, an array; its own derivative does not count.
        tangent_solve: function of a linear function and a right side that solves.
        solve: function of ``f``, which has no derivative by then, and of a start, in the place of
            `root`, that finds the root.
    """

    def solved(x, rhs):
        _, linear = jax.linearize(function, x)
        return tangent_solve(linear, rhs)

    root = lax.stop_gradient(root)
    equation, solver = jax.make_jaxpr(function)(root), jax.make_jaxpr(solved)(root, root)
    if solve is not None:
        frozen = _with(equation.jaxpr, lax.stop_gradient(equation.consts))
        root = solve(lambda x: frozen(x)[0], root)
    return _ROOT.bind(
        root,
        *map(jnp.asarray, equation.consts),
        *map(jnp.asarray, solver.consts),
        equation=equation.jaxpr,
        solver=solver.jaxpr,
        count=len(equation.consts),
    )


def _with(jaxpr, consts):
    return jaxpr_as_fun(ClosedJaxpr(jaxpr, consts))


@_ROOT.def_impl
def _root(root, *consts, equation, solver, count):
    return root


@_ROOT.def_abstract_eval
def _shape(root, *consts, equation, solver, count):
    return root


def _derivative(primals, tangents, *, equation, solver, count):
    _, *consts = primals
    own, others = consts[:count], consts[count:]
    found = _ROOT.bind(*primals, equation=equation, solver=solver, count=count)
    changes = [ad.instantiate_zeros(t) for t in tangents[1 : 1 + count]]
    moving = [k for k, x in enumerate(own) if jnp.issubdtype(x.dtype, jnp.inexact)]

    def residual(*some):
        at = list(own)
        for k, x in zip(moving, some, strict=True):
            at[k] = x
        return _with(equation, at)(found)[0]

    start, direction = [own[k] for k in moving], [changes[k] for k in moving]
    if not moving:
        return found, jnp.zeros_like(found)
    rhs = jax.jvp(residual, start, direction)[1]
    return found, -_with(solver, others)(found, rhs)[0]


def _batched(arguments, axes, *, equation, solver, count):
    size = next(x.shape[a] for x, a in zip(arguments, axes, strict=True) if a is not None)
    arguments = [
        x if a is None else jnp.moveaxis(x, a, 0) for x, a in zip(arguments, axes, strict=True)
    ]
    axes = [None if a is None else 0 for a in axes]
    if axes[0] is None:
        arguments[0] = jnp.broadcast_to(arguments[0], (size, *arguments[0].shape))
    root, *consts = arguments
    own, others = axes[1 : 1 + count], axes[1 + count :]

    def evaluated(x):
        run = jax.vmap(lambda x, c: _with(equation, c)(x)[0], (0, own), axis_size=size)
        return run(x, consts[:count])

    def solved(x, rhs):
        run = jax.vmap(lambda x, b, c: _with(solver, c)(x, b)[0], (0, 0, others), axis_size=size)
        return run(x, rhs, consts[count:])

    new, newer = jax.make_jaxpr(evaluated)(root), jax.make_jaxpr(solved)(root, root)
    found = _ROOT.bind(
        root,
        *new.consts,
        *newer.consts,
        equation=new.jaxpr,
        solver=newer.jaxpr,
        count=len(new.consts),
    )
    return found, 0


ad.primitive_jvps[_ROOT] = _derivative
batching.primitive_batchers[_ROOT] = _batched
mlir.register_lowering(_ROOT, lambda ctx, root, *consts, **_: [root])
