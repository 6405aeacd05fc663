"""Derivatives of roots inside of scans: second and third ones, in every order of the modes."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from oracles.traced import traced

from jaxcable.numerics.implicit_root import TangentSolver, implicit_root
from jaxcable.numerics.roots import bracketed_root

AT, ALONG = jnp.array([1.0, 2.0]), jnp.array([0.3, 0.7])
LOADS = jnp.array([1.0, 2.0, 0.5])


def solve(_, linearized, rhs):
    """Of a residual that acts on each entry by itself."""
    return rhs / linearized(jnp.ones_like(rhs))


SOLVER = TangentSolver(solve, solve)


def by_jax(residual, x, p, _):
    return lax.custom_root(
        lambda x: residual(x, p), lax.stop_gradient(x), lambda f, x: x, lambda *at: solve(p, *at)
    )


def cubic(q):
    """The root of x^3 + x = q, by Newton's method in a loop without derivative."""
    x = lax.fori_loop(0, 60, lambda _, x: x - (x**3 + x - q) / (3 * x**2 + 1), jnp.zeros_like(q))
    return lax.stop_gradient(x)


def chain(p, scan=True, attach=implicit_root):
    """Roots one after the other, each from the one before."""

    def step(x, load):
        q = 0.5 * x + p * load
        y = attach(lambda y, q: y**3 + y - q, cubic(lax.stop_gradient(q)), q, SOLVER)
        return y, y

    if scan:
        x, _ = lax.scan(step, jnp.zeros(2), LOADS)
    else:
        x = jnp.zeros(2)
        for load in LOADS:
            x, _ = step(x, load)
    return jnp.sum(x**2)


def without_loop(p):
    """The reference: jax's own roots, which have all derivatives outside of a scan."""
    return chain(p, False, by_jax)


def derivatives(function, orders):
    """Value, gradient, Hessian by orders of the modes, third derivative, one program."""
    return traced(
        lambda p: (
            function(p),
            jax.grad(function)(p),
            [outer(inner(function))(p) for outer, inner in orders],
            jax.jacfwd(jax.hessian(function))(p),
        )
    )


MODES = [(outer, inner) for outer in (jax.jacfwd, jax.jacrev) for inner in (jax.jacfwd, jax.jacrev)]


def test_derivatives_in_every_order_of_the_modes():
    value, gradient, (hessian,), third = derivatives(without_loop, MODES[1:2])(AT)
    found = derivatives(chain, MODES)(AT)
    np.testing.assert_allclose(found[0], value, rtol=1e-13)
    np.testing.assert_allclose(found[1], gradient, rtol=1e-13)
    for own in found[2]:
        np.testing.assert_allclose(own, hessian, rtol=1e-12)
    np.testing.assert_allclose(found[3], third, rtol=1e-11)
    # and the reference by differences: h^2, and rounding over h
    h, slope = 1e-5, traced(jax.grad(without_loop))
    difference = (slope(AT + h * ALONG) - slope(AT - h * ALONG)) / (2 * h)
    np.testing.assert_allclose(hessian @ ALONG, difference, rtol=1e-8)


def test_batches():
    def several(function):
        return lambda p: jnp.sum(jax.vmap(function)(jnp.stack([p, 2 * p])))

    expected = traced(jax.hessian(several(without_loop)))(AT)
    np.testing.assert_allclose(traced(jax.hessian(several(chain)))(AT), expected, rtol=1e-12)
    found = traced(jax.vmap(jax.hessian(chain)))(jnp.stack([AT, 2 * AT]))
    np.testing.assert_allclose(found[0] + 4 * found[1], expected, rtol=1e-11)


def test_the_loop_that_finds_a_root_in_an_interval():
    def square_root(p):
        return bracketed_root(lambda x: x * x - p, 1.0 + 0 * p, 0.1, 10.0)

    found = [f(2.0) for f in (square_root, jax.grad(square_root), jax.hessian(square_root))]
    expected = [2**0.5, 0.5 * 2**-0.5, -0.25 * 2**-1.5]
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_an_equation_is_traced_only_for_derivatives():
    traced = []

    def equation(x, p):
        traced.append(1)
        return x * x - p

    def square_root(p):
        return implicit_root(equation, jnp.sqrt(lax.stop_gradient(p)), p, SOLVER)

    jax.make_jaxpr(square_root)(2.0)
    assert not traced
    jax.make_jaxpr(jax.grad(square_root))(2.0)
    assert traced
