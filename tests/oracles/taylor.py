"""Taylor's test of a gradient: with the right one the remainder falls with slope 2, else with 1."""

import functools
import weakref

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from oracles.traced import traced

import jaxcable as jc

TIGHT = jc.Newton(tol=1e-13)
"""Newton's method to rounding, so that what is left of its iteration is no part of a remainder."""


STEPS = np.array([4e-4, 5e-5])
"""Steps of a Taylor test, relative to the numbers that change.

Two give the slope: that of a fit through these and some between them differs only by what the
remainder has of higher orders and of rounding, and each is one more analysis."""


def slope(value, p, gradient, size=1.0, start=None):
    """Slope of log remainder over log step, in a random direction; `size` scales the steps.

    `start` is the value at `p` if it is known.
    """
    p, value_at = np.asarray(p), remembered(value)
    direction = np.random.default_rng(1).normal(size=p.shape) * np.max(np.abs(p))
    f0 = value_at(p) if start is None else start
    rate = np.sum(np.asarray(gradient) * direction)
    steps = size * STEPS
    remainder = [abs(float(value_at(p + h * direction) - f0 - h * rate)) for h in steps]
    return np.subtract(*np.log(remainder)) / np.subtract(*np.log(steps))


def assert_gradient(function, p, size=1.0, by=None, corrupted=1.01):
    """Assert that jax has the gradient of a function, and that the test would see a wrong one.

    Args:
        function: of `p`, returns a number, or a number, the status of its analysis and others.
        p: numbers, or a dict of them, each of which is tested by itself.
        size: of the steps (`slope`); a dict by names of `p` where some are not 1.
        by: names of `p` that are tested; without it all.
        corrupted: what the wrong gradient is multiplied with.

    Returns:
        The gradient.
    """

    program = value_and_gradient(function)
    named = isinstance(p, dict)
    p = {k: jnp.asarray(x, float) for k, x in p.items()} if named else jnp.asarray(p, float)
    (start, (code, *_)), gradient = program(p)
    assert int(code) == jc.status.OK
    for name in (p if by is None else by) if named else (None,):
        at, rate = (p[name], gradient[name]) if named else (p, gradient)

        def value(x, name=name):
            return program({**p, name: x} if named else x)[0][0]

        steps = size.get(name, 1.0) if isinstance(size, dict) else size
        assert np.isfinite(rate).all() and (np.asarray(rate) != 0).any(), name
        right, wrong = (
            slope(value, at, factor * rate, steps, start) for factor in (1.0, corrupted)
        )
        assert abs(right - 2) < 0.1 and wrong < 1.5, (name, right, wrong)
    return gradient


def joined(function, p, size=1.0):
    """Return a function of all numbers of a dict in one array, and this array, which is all ones.

    Args:
        function: of `p`, as of `assert_gradient`.
        p: a dict of numbers.
        size: of the steps of each; a dict by names of `p` where some are not 1.

    Returns:
        The arguments of an `assert_gradient` that takes one step of all, each of its own size: it
        needs as many analyses as one by a single name.
    """
    sizes = size if isinstance(size, dict) else dict.fromkeys(p, size)
    p = {k: jnp.asarray(x, float) for k, x in p.items()}
    steps = {k: jnp.full(x.shape, sizes.get(k, 1.0) * jnp.abs(x).max()) for k, x in p.items()}
    (start, as_dict), (each, _) = ravel_pytree(p), ravel_pytree(steps)
    return lambda x: function(as_dict(start + each * (x - 1))), jnp.ones_like(start)


@functools.lru_cache(maxsize=2)  # of tests of one function, name by name
def value_and_gradient(function):
    """Program of `p` to ((number, [status, ...]), gradient), as `assert_gradient` runs it."""

    def number_and_others(p):
        found = function(p)
        return (found[0], list(found[1:])) if isinstance(found, tuple) else (found, [jc.status.OK])

    return traced(jax.value_and_grad(number_and_others, has_aux=True))


_known = weakref.WeakKeyDictionary()


def remembered(value):
    """The function, computed once at a point: wrong gradients are tried at the same points."""
    known = _known.setdefault(value, {})

    def value_at(p):
        if p.tobytes() not in known:
            known[p.tobytes()] = value(p)
        return known[p.tobytes()]

    return value_at
