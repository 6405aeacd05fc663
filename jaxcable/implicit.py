"""The derivative of an equilibrium: the implicit function theorem, apart from the iteration.

With ``R(x, p) = 0`` the derivative of ``x`` is ``dx = -K^-1 R_p dp``, whatever iteration found
``x`` and however many increments it took. `lax.custom_root` whose solver returns its start attaches
it; derivatives of any order and both modes follow from `lax.custom_linear_solve`.
"""

import jax
import jax.numpy as jnp
from jax import lax

from . import linear


def gate(open_, tree):
    """Let derivatives of `tree` through only where `open_`; values pass always.

    A select, so that a NaN on its way back is stopped and not multiplied by zero.
    """


    def one(x):
        x = jnp.asarray(x)
        floating = jnp.issubdtype(x.dtype, jnp.floating)
        return jnp.where(open_, x, lax.stop_gradient(x)) if floating else x

    return jax.tree.map(one, tree)


def attach(system, x, valid):
    """Return `x` with the derivative of the equilibrium of `system`.

    Args:
        system: `System`, differentiable.
        x: its equilibrium, [n_free]; its own derivative is ignored.
        valid: whether `x` is an equilibrium; if not, the result has derivative zero (and the caller
            must see to it that nobody takes that for an answer).
    """
    x = lax.stop_gradient(x)
    frozen = lax.stop_gradient(system)

    def tangent_solve(linearized, rhs):
        n = x.shape[0]
        matrix = jnp.where(valid, frozen.tangent(x), jnp.eye(n, dtype=x.dtype))
        node = frozen.freedoms.free // 3
        loose = frozen.loose_nodes(frozen.displacement(x))[node] & valid
        return linear.factorize(matrix, loose).solve(rhs, linearized)

    return lax.custom_root(system.residual, x, lambda f, start: start, tangent_solve)


def undifferentiated(x, parameters):
    """Return `x` with derivative NaN with respect to every one of `parameters`.

    For results whose derivative was not asked for: an honest NaN instead of a silent zero.
    """
    return jax.tree.map(lambda leaf: _opaque(leaf, touch(parameters)), lax.stop_gradient(x))


def nan_unless(ok, tree, parameters):
    """Make `tree` NaN, in value and in derivative, unless `ok`."""
    factor = jnp.where(ok, 1.0, jnp.nan * gate(~ok, touch(parameters)))
    return jax.tree.map(lambda x: x * factor.astype(x.dtype), tree)


def touch(parameters):
    """A number that depends on every float in `parameters`; only its derivative matters."""
    leaves = [jnp.asarray(x) for x in jax.tree.leaves(parameters)]
    floats = [x for x in leaves if jnp.issubdtype(x.dtype, jnp.floating)]
    return sum((jnp.sum(x) for x in floats), start=jnp.ones(()))


@jax.custom_jvp
def _opaque(x, touched):
    return x


@_opaque.defjvp
def _opaque_jvp(primals, tangents):
    return primals[0], jnp.full_like(primals[0], jnp.nan) * tangents[1].astype(primals[0].dtype)
