"""Sums that are gathered are those that a scatter makes, and so are their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcable.linear import gathering, with_zero

RNG = np.random.default_rng(7)
CASES = {
    "few of many": np.array([5, 1]),
    "one each": np.arange(6)[::-1].copy(),
    "several": RNG.integers(0, 9, 30),
    "left out": RNG.integers(0, 15, 40),
    "a hub": np.where(RNG.random(200) < 0.5, 3, RNG.integers(0, 40, 200)),
    "a great hub": np.zeros(5000, int),
    "all in twos": np.repeat(np.arange(7), 2),
}


def scattered(target, n, values):
    """The same by NumPy."""
    sums = np.zeros((max(n, target.max() + 1), *values.shape[1:]))
    np.add.at(sums, target, values)
    return sums[:n]


@pytest.mark.parametrize("shape", [(), (3,), (2, 2)])
@pytest.mark.parametrize("name", CASES)
def test_sums(name, shape):
    target = CASES[name]
    n = 9 if name in ("several", "left out") else int(target.max()) + 1
    values = RNG.normal(size=(len(target), *shape))
    sums = gathering(target, n)
    found = np.asarray(sums(jnp.asarray(values)))
    expected = scattered(target, n, values)
    assert found.shape == expected.shape
    # in another order: a rounding of the sum of sizes
    room = 4e-16 * len(target) * np.abs(values).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=room)
    weights = RNG.normal(size=expected.shape)
    slope = jax.grad(lambda v: jnp.sum(weights * sums(v)))(jnp.asarray(values))
    back = np.concatenate([weights, np.zeros((max(0, target.max() + 1 - n), *shape))])[target]
    np.testing.assert_allclose(slope, back, rtol=0, atol=0)


def test_whole_numbers_stay_so():
    sums = gathering(np.array([0, 0, 2, 2, 2]), 4)
    np.testing.assert_array_equal(sums(jnp.arange(1, 6, dtype=jnp.int32)), [3, 0, 12, 0])
    assert sums(jnp.arange(5, dtype=jnp.int32)).dtype == jnp.int32


def test_a_hub_costs_little():
    """Tables read some two numbers for each that is added, however many meet at a hub."""
    target = np.append(np.repeat(np.arange(300), 4), np.full(500, 300))
    sums = gathering(target, 301)
    read = sum(np.size(table) for table in sums.tables)
    assert len(target) < read < 2 * len(target)
    assert np.size(sums.tables[0]) > 0


def test_a_zero_after_the_end():
    np.testing.assert_array_equal(with_zero(jnp.array([1.0, 2.0]))[np.array([2, 0, 1])], [0, 1, 2])
    assert with_zero(jnp.ones((2, 3))).shape == (3, 3)
