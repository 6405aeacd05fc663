"""Functions computed as a whole, as primitives.

The same functions without the primitives are the reference; slopes are checked by differences.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxcable.numerics.single_kernel import as_single_kernel

X = jnp.array([0.3, -1.2, 2.5])
SHIFT = jnp.array([0.5, 1.0, -0.7])


def plain(x, shift):
    """Floats, an integer and a boolean, with a loop whose length depends on the numbers."""

    def half(state):
        return 0.5 * state[0], state[1] + 1

    y = jnp.sin(x) * shift + jnp.sum(x**2)
    _, count = lax.while_loop(
        lambda s: jnp.max(jnp.abs(s[0])) > 0.1, half, (lax.stop_gradient(y), 0)
    )
    z, _ = lax.scan(lambda z, u: (jnp.cos(z) + u * y, z), y, shift)
    return {"z": z, "count": count, "big": jnp.any(z > 1), "y": y}


WHOLE = as_single_kernel(plain)


def close(one, other):
    """Trees agree to rounding: two compilations of some ten operations each."""
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13), one, other)


def of_floats(function):
    return lambda *arguments: jnp.sum(function(*arguments)["z"] ** 3)


def test_values():
    for found in (WHOLE(X, SHIFT), jax.jit(WHOLE)(X, SHIFT)):
        close(found, plain(X, SHIFT))
        assert found["count"].dtype == plain(X, SHIFT)["count"].dtype


def repeated(f):
    """The third of three calls in a row, each at the result of the one before."""
    return lambda x, s: lax.scan(lambda c, _: (f(c, s)["z"], 0), x, None, 3)[0][0]


TRANSFORMS = {
    "gradient": lambda f: jax.grad(of_floats(f), (0, 1)),
    "Hessian": lambda f: jax.hessian(of_floats(f)),
    "jvp": lambda f: lambda x, s: jax.jvp(of_floats(f), (x, s), (s, x)),
    "in a scan": lambda f: jax.grad(repeated(f)),
}


@pytest.mark.parametrize("name", TRANSFORMS)
def test_derivatives(name):
    transform = TRANSFORMS[name]
    close(*(jax.jit(transform(f))(X, SHIFT) for f in (WHOLE, plain)))
    if name == "gradient":
        close(transform(WHOLE)(X, SHIFT), transform(plain)(X, SHIFT))


@pytest.mark.parametrize("axes", [(0, None), (1, 0)])
def test_batches(axes):
    """Of values, gradients and Hessians."""
    many = jnp.stack([X, 2 * X, X - 1, 0 * X])
    x = many if axes[0] == 0 else many.T if axes[0] == 1 else X
    shift = SHIFT[None] * jnp.arange(1.0, 5)[:, None] if axes[1] == 0 else SHIFT

    def each(f):
        total = of_floats(f)
        return lambda x, s: (f(x, s), jax.grad(total)(x, s), jax.hessian(total)(x, s))

    close(*(jax.jit(jax.vmap(each(f), axes))(x, shift) for f in (WHOLE, plain)))


def test_the_gradient_of_a_batch():
    many = jnp.stack([X, 2 * X, X - 1])

    def total(f):
        return lambda many: jnp.sum(jax.vmap(of_floats(f), (0, None))(many, SHIFT))

    def both(f):
        nested = jax.vmap(jax.vmap(f, (0, None)), (None, 0))
        return jax.jit(lambda many: (jax.grad(total(f))(many), nested(many, many)))

    close(both(WHOLE)(many), both(plain)(many))


def test_a_case_computes_what_it_needs():
    """Under `jax.vmap` a branch runs for the cases that take it, and for no other."""

    def function(x):
        return lax.cond(x > 0, jnp.sin, lambda x: x, x)

    x = jnp.array([1.0, -1.0, 2.0, -3.0])
    whole, mapped = (jax.jit(jax.vmap(f)) for f in (as_single_kernel(function), function))
    assert "stablehlo.case" in whole.lower(x).as_text()
    assert "stablehlo.case" not in mapped.lower(x).as_text()  # both branches for all cases
    close(whole(x), mapped(x))
