"""Error-free arithmetic, and elongations by it, against rational numbers and 400 bits."""

import functools
import itertools
from fractions import Fraction

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from oracles.traced import traced

from jaxcable.elements.rebasing import elongation_and_moved_ends
from jaxcable.numerics import compensated

DTYPES = [np.float32, np.float64]


def spread(rng, dtype, *shape, decades=8):
    """Numbers of both signs over many decades, and some hard ones."""
    values = rng.normal(size=shape) * 10.0 ** rng.uniform(-decades / 2, decades / 2, shape)
    values = values.astype(dtype)
    eps = np.finfo(dtype).eps
    hard = np.array([0.0, 1.0, -1.0, 1 + eps, 1 - eps / 2, 3.0, 1 / 3, 2 - eps], dtype)
    values.reshape(-1)[: len(hard)] = hard
    return values


def ways(function):
    """A function as it is, compiled, and element by element in a compiled batch."""
    return function, traced(function), traced(jax.vmap(function))


def rational(values):
    return [Fraction(float(value)) for value in np.asarray(values).reshape(-1)]


def together(*arrays):
    """Entries of arrays as rational numbers, one after the other."""
    return zip(*map(rational, arrays), strict=True)


@pytest.mark.parametrize("dtype", DTYPES)
def test_sums_and_products_lose_nothing(dtype):
    """Also where the sum is one of a product, which compilers contract."""
    rng, eps = np.random.default_rng(0), Fraction(float(np.finfo(dtype).eps))
    a, b = spread(rng, dtype, 300), rng.permutation(spread(rng, dtype, 300))
    for run in ways(compensated.two_sum):
        high, low = run(a, b)
        np.testing.assert_array_equal(high, a + b)
        assert all(x + y == s + t for x, y, s, t in together(a, b, high, low))
    for run in ways(compensated.split_digits):
        parts = [np.asarray(part) for part in run(a)]
        assert all(x == y + z for x, y, z in together(a, *parts))
        for p, q in itertools.product(parts, parts):  # products of halves are exact
            assert all(x * y == z for x, y, z in together(p, q, p * q))
    for run in ways(compensated.two_product):
        for x, y, p, q in together(a, b, *run(a, b)):
            assert abs(x * y - p - q) <= eps**2 * abs(x * y) / 4
            assert abs(q) <= eps * abs(p)

    def product_and_sum(a, b, c):
        high, low = compensated.two_product(a, b)
        high, more = compensated.two_sum(high, c)
        return high, low + more

    a, b, c = (spread(rng, dtype, 300, decades=2) for _ in range(3))
    for run in ways(product_and_sum):
        for x, y, z, p, q in together(a, b, c, *run(a, b, c)):
            assert abs(x * y + z - p - q) <= 2 * eps**2 * (abs(x * y) + abs(z))


def scenes(dtype, n_end, count=200):
    """Elongations, ends and fine motions of chains, of which many cancel."""
    rng = np.random.default_rng(n_end)
    ends = rng.normal(size=(count, n_end, 3)) + 10 ** rng.uniform(-1, 2, size=(count, 1, 1))
    size = 10 ** rng.uniform(-6, 1, size=(count, 1, 1))
    motion = size * rng.normal(size=(count, n_end, 3))
    if n_end > 2:  # padding
        for values in (ends, motion):
            values[: count // 4, -1] = values[: count // 4, -2]
    ends, motion = ends.astype(dtype), motion.astype(dtype)
    low = (0.5 * np.finfo(dtype).eps * np.sin(motion) * motion).astype(dtype)
    motion = np.concatenate([motion, low], axis=-1)
    change = [longer(0, *at) for at in zip(ends, motion, strict=True)]
    nearly = np.where(np.arange(count) % 2, 1.0, 1.0001)
    elongation = [-float(c) * f for c, f in zip(change, nearly, strict=True)]
    return np.array(elongation, dtype), ends, motion


def longer(elongation, ends, motion):
    """The elongation after a motion, to 400 bits."""
    mpmath.mp.prec = 400
    ends, motion = (np.vectorize(lambda x: mpmath.mpf(float(x)))(v) for v in (ends, motion))
    chord, moved = np.diff(ends, axis=0), np.diff(motion[:, :3] + motion[:, 3:], axis=0)
    pairs = zip(chord + moved, chord, strict=True)
    norm = [mpmath.sqrt((v**2).sum()) - mpmath.sqrt((d**2).sum()) for v, d in pairs]
    return mpmath.mpf(float(elongation)) + sum(norm)


@pytest.mark.slow_cases("float32-5")
@pytest.mark.parametrize(("dtype", "n_end"), [(np.float64, 2), (np.float64, 5), (np.float32, 5)])
def test_elongations_are_exact_up_to_their_own_rounding(dtype, n_end):
    given = scenes(dtype, n_end)
    eps = float(np.finfo(dtype).eps)
    true = [longer(*at) for at in zip(*given, strict=True)]
    exactly = functools.partial(elongation_and_moved_ends, precise=jnp.ones((), bool))
    for run in (jax.vmap(exactly), traced(jax.vmap(exactly))):
        found, places = run(*given)
        assert found.dtype == dtype and places.dtype == dtype
        worst = 0.0
        for k, at in enumerate(true):
            error = abs(float(mpmath.mpf(float(found[k])) - at))
            moved = np.abs(given[2][k]).max()
            assert error <= eps * abs(float(at)) + 8 * eps**2 * moved
            worst = max(worst, eps * moved / max(error, 1e-300))
        assert worst > 1 / eps**0.5  # in working precision the rounding of displacements remains
    plain = np.asarray(given[0]) + np.sum(
        np.linalg.norm(np.diff(given[1] + given[2][..., :3], axis=1), axis=-1)
        - np.linalg.norm(np.diff(given[1], axis=1), axis=-1),
        axis=1,
    )
    short = [abs(float(mpmath.mpf(float(p)) - at)) for p, at in zip(plain, true, strict=True)]
    assert max(short) > 1e3 * eps**2  # the comparison can fail


@pytest.mark.slow_cases("4")
@pytest.mark.parametrize("n_end", [2, 4])
def test_derivatives_of_elongations(n_end):
    """By elongation, ends and motion, of first and second order, by the orders of remainders."""
    elongation, ends, motion = (v[77] for v in scenes(np.float64, n_end))
    rng = np.random.default_rng(3)
    way = 0.3, rng.normal(size=ends.shape), rng.normal(size=motion.shape)

    def along(t):
        moved = (v + t * w for v, w in zip((elongation, ends, motion), way, strict=True))
        long, places = elongation_and_moved_ends(*moved, True)
        return long + jnp.sum(jnp.sin(places))

    def slope(t):
        return jax.jvp(along, (t,), (1.0,))[1]

    terms = traced(lambda t: (along(t), slope(t), 0.5 * jax.grad(slope)(t), jax.grad(along)(t)))
    start, first, second, back = map(float, terms(0.0))
    assert abs(back - first) <= 1e-12 * abs(first)
    steps = 1e-3 * 0.5 ** np.arange(4)
    off = np.array([float(terms(h)[0]) for h in steps]) - start
    remainders = off - first * steps, off - first * steps - second * steps**2
    for order, remainder in enumerate([off - 1.01 * first * steps, *remainders], start=1):
        rates = -np.diff(np.log2(np.abs(remainder)))
        # the first can fail
        assert rates[-1] < 1.5 if order == 1 else abs(rates[-1] - order) < 0.05, (order, rates)
