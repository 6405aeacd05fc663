"""Functions computed as a whole, and linear functions with a given transpose, as primitives.

The same functions without the primitives are the reference; slopes are checked by differences.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxcable.linear import gathering
from jaxcable.numerics.one_function import as_one

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


WHOLE = as_one(plain)


def close(one, other):
    """Trees agree to rounding: two compilations of some ten operations each."""
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13), one, other)


def of_floats(function, name="z"):
    return lambda *arguments: jnp.sum(function(*arguments)[name] ** 3)


@pytest.mark.parametrize("jit", [False, True])
def test_values(jit):
    wrap = jax.jit if jit else lambda f: f
    close(wrap(WHOLE)(X, SHIFT), plain(X, SHIFT))
    assert wrap(WHOLE)(X, SHIFT)["count"].dtype == plain(X, SHIFT)["count"].dtype


@pytest.mark.parametrize(
    "transform",
    [
        lambda f: jax.grad(of_floats(f), (0, 1)),
        lambda f: jax.jacfwd(of_floats(f), (0, 1)),
        lambda f: jax.hessian(of_floats(f)),
        lambda f: jax.jacrev(jax.jacfwd(of_floats(f)), 1),
        lambda f: jax.grad(lambda x, s: jnp.sum(jax.grad(of_floats(f))(x, s) ** 2)),
        lambda f: jax.jacfwd(jax.hessian(of_floats(f, "y"))),
        lambda f: lambda x, s: jax.jvp(f, (x, s), (s, x))[0],
        lambda f: lambda x, s: jax.jvp(of_floats(f), (x, s), (s, x)),
        lambda f: (
            lambda x, s: jax.grad(
                lambda x: lax.scan(lambda c, _: (f(c, s)["z"], 0), x, None, 3)[0][0]
            )(x)
        ),
    ],
)
@pytest.mark.parametrize("jit", [False, True])
def test_derivatives(transform, jit):
    wrap = jax.jit if jit else lambda f: f
    close(wrap(transform(WHOLE))(X, SHIFT), transform(plain)(X, SHIFT))


def test_slopes_are_those_of_the_values():
    function, direction = of_floats(WHOLE), jnp.array([0.2, -0.5, 1.0])
    slope = jnp.vdot(jax.grad(function)(X, SHIFT), direction)
    errors = []
    for h in (1e-2, 1e-3):
        difference = (function(X + h * direction, SHIFT) - function(X - h * direction, SHIFT)) / (
            2 * h
        )
        errors.append(abs(difference - slope))
    assert 1.9 < np.log10(errors[0] / errors[1]) < 2.1
    assert errors[1] < 1e-4 * abs(slope)


@pytest.mark.parametrize("axes", [(0, None), (None, 0), (0, 0), (1, 0)])
@pytest.mark.parametrize(
    "transform",
    [lambda f: f, lambda f: jax.grad(of_floats(f)), lambda f: jax.hessian(of_floats(f))],
)
def test_batches(axes, transform):
    many = jnp.stack([X, 2 * X, X - 1, 0 * X])
    x = many if axes[0] == 0 else many.T if axes[0] == 1 else X
    shift = SHIFT[None] * jnp.arange(1.0, 5)[:, None] if axes[1] == 0 else SHIFT
    mapped = [jax.jit(jax.vmap(transform(f), axes))(x, shift) for f in (WHOLE, plain)]
    close(*mapped)


def test_the_gradient_of_a_batch():
    many = jnp.stack([X, 2 * X, X - 1])

    def total(f):
        return lambda many: jnp.sum(jax.vmap(of_floats(f), (0, None))(many, SHIFT))

    close(jax.grad(total(WHOLE))(many), jax.grad(total(plain))(many))
    nested = [jax.vmap(jax.vmap(f, (0, None)), (None, 0))(many, many) for f in (WHOLE, plain)]
    close(*nested)


def test_a_case_computes_what_it_needs():
    """Under `jax.vmap` a branch runs for the cases that take it, and for no other."""

    def function(x):
        return lax.cond(x > 0, jnp.sin, lambda x: x, x)

    x = jnp.array([1.0, -1.0, 2.0, -3.0])
    whole, mapped = (jax.jit(jax.vmap(f)) for f in (as_one(function), function))
    assert "stablehlo.case" in whole.lower(x).as_text()
    assert "stablehlo.case" not in mapped.lower(x).as_text()  # both branches for all cases
    close(whole(x), mapped(x))


def test_no_sums_at_all():
    sums = jax.tree.map(jnp.asarray, gathering(np.zeros(4, int), 0))
    assert sums(np.ones((4, 2))).shape == (0, 2)
    np.testing.assert_array_equal(sums.spread(jnp.zeros((0, 2))), np.zeros((4, 2)))


TARGETS = {
    "hub": [0, 3, 3, 1, 3, 3, 3, 5, 3, 9, 3],  # 2 and 4 have none; 9 is no sum
    "each_one": [2, 0, 1, 4, 3, 5],
    "some_left_out": [6, 0, 6, 4, 2, 6, 1, 3, 5],
}


@pytest.mark.parametrize("name", TARGETS)
def test_sums_and_copies_are_transposes(name):
    target = np.array(TARGETS[name])
    sums = jax.tree.map(jnp.asarray, gathering(target, 6))
    matrix = (np.arange(6)[:, None] == target).astype(float)  # [sum, row]
    rng = np.random.default_rng(3)
    rows, back = rng.normal(size=(len(target), 2)), rng.normal(size=(6, 2))
    close(sums(rows), matrix @ rows)
    close(sums.spread(back), matrix.T @ back)
    close(jax.vjp(sums, rows)[1](back)[0], matrix.T @ back)
    close(jax.vjp(sums.spread, back)[1](rows)[0], matrix @ rows)
    close(jax.jvp(sums, (rows,), (2 * rows,))[1], 2 * matrix @ rows)
    close(jax.vmap(sums, 1, 1)(rows), matrix @ rows)
    close(
        jax.vmap(jax.grad(lambda r: jnp.sum(sums(r) ** 2)), 1, 1)(rows),
        2 * matrix.T @ matrix @ rows,
    )
    for function, x in ((sums, rows), (sums.spread, back)):
        pulled = jax.jit(lambda x, f=function: jax.vjp(f, x)[1](f(x))[0])
        assert "scatter" not in pulled.lower(x).as_text()
    assert (
        "scatter" in jax.jit(jax.grad(lambda b: jnp.sum(b[target % 6] ** 2))).lower(back).as_text()
    )
