"""Derivatives of roots inside of scans: second and third ones, in every order of the modes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxcable.numerics.rooted import rooted
from jaxcable.numerics.roots import rising_root

AT, ALONG = jnp.array([1.0, 2.0]), jnp.array([0.3, 0.7])
LOADS = jnp.array([1.0, 2.0, 0.5])


def solve(_, linearized, rhs):
    """Of a residual that acts on each entry by itself."""
    return rhs / linearized(jnp.ones_like(rhs))


def by_jax(residual, x, p, solve):
    return lax.custom_root(
        lambda x: residual(x, p), lax.stop_gradient(x), lambda f, x: x, lambda *at: solve(p, *at)
    )


def cubic(q):
    """The root of x^3 + x = q, by Newton's method in a loop without derivative."""
    x = lax.fori_loop(0, 60, lambda _, x: x - (x**3 + x - q) / (3 * x**2 + 1), jnp.zeros_like(q))
    return lax.stop_gradient(x)


def chain(p, scan=True, attach=rooted):
    """Roots one after the other, each from the one before."""

    def step(x, load):
        q = 0.5 * x + p * load
        y = attach(lambda y, q: y**3 + y - q, cubic(lax.stop_gradient(q)), q, solve)
        return y, y

    if scan:
        x, _ = lax.scan(step, jnp.zeros(2), LOADS)
    else:
        x = jnp.zeros(2)
        for load in LOADS:
            x, _ = step(x, load)
    return jnp.sum(x**2)


def second(function):
    """Hessian times a direction, by all orders of forward and reverse mode."""
    gradient = jax.grad(function)
    return {
        "forward over reverse": jax.jvp(gradient, (AT,), (ALONG,))[1],
        "reverse over reverse": jax.jacrev(gradient)(AT) @ ALONG,
        "reverse over forward": jax.jacrev(jax.jacfwd(function))(AT) @ ALONG,
        "forward over forward": jax.jacfwd(jax.jacfwd(function))(AT) @ ALONG,
    }


@pytest.mark.parametrize("scan", [True, False])
def test_second_derivatives(scan):
    """By differences, whose first derivatives are those of jax's own roots without a loop."""
    h = 1e-5
    gradient = jax.grad(lambda p: chain(p, False, by_jax))
    expected = (gradient(AT + h * ALONG) - gradient(AT - h * ALONG)) / (2 * h)
    for order, found in second(lambda p: chain(p, scan)).items():
        # h^2 and rounding over h
        np.testing.assert_allclose(found, expected, rtol=1e-8, err_msg=order)


def test_third_derivatives_and_batches():
    def third(function):
        return jax.jit(jax.jacfwd(jax.hessian(function)))(AT)

    expected = third(lambda p: chain(p, False, by_jax))
    np.testing.assert_allclose(third(chain), expected, rtol=1e-11)

    def several(p, *options):
        return jnp.sum(jax.vmap(lambda p: chain(p, *options))(jnp.stack([p, 2 * p])))

    expected = jax.hessian(lambda p: several(p, False, by_jax))(AT)
    np.testing.assert_allclose(jax.hessian(several)(AT), expected, rtol=1e-12)
    found = jax.jit(jax.vmap(jax.hessian(chain)))(jnp.stack([AT, 2 * AT]))
    np.testing.assert_allclose(found[0] + 4 * found[1], expected, rtol=1e-11)


def test_roots_of_jax_lose_them():
    """Why there is `rooted`: jax 0.10 loses second derivatives, jax 0.12 does not."""
    found = jax.jvp(jax.grad(lambda p: chain(p, True, by_jax)), (AT,), (ALONG,))[1]
    if jax.__version_info__ < (0, 11):
        np.testing.assert_array_equal(found, 0.0)
    elif jax.__version_info__ >= (0, 12):
        expected = jax.jvp(jax.grad(chain), (AT,), (ALONG,))[1]
        np.testing.assert_allclose(found, expected, rtol=1e-11)


def test_values_first_derivatives_and_the_loop_that_finds_the_root():
    expected = jax.value_and_grad(lambda p: chain(p, False, by_jax))(AT)
    found = jax.value_and_grad(chain)(AT)
    for own, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-13)

    def square_root(p):
        return rising_root(lambda x: x * x - p, 1.0 + 0 * p, 0.1, 10.0)

    found = [float(f(2.0)) for f in (square_root, jax.grad(square_root), jax.hessian(square_root))]
    expected = [2**0.5, 0.5 * 2**-0.5, -0.25 * 2**-1.5]
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_an_equation_is_traced_only_for_derivatives():
    traced = []

    def equation(x, p):
        traced.append(1)
        return x * x - p

    def square_root(p):
        return rooted(equation, jnp.sqrt(lax.stop_gradient(p)), p, solve)

    jax.make_jaxpr(square_root)(2.0)
    assert not traced
    jax.make_jaxpr(jax.grad(square_root))(2.0)
    assert traced
