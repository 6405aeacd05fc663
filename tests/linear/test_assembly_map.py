"""Sums that are gathered are those that a scatter makes, and so are their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcable.linear import make_assembly_map

RNG = np.random.default_rng(7)
CASES = {  # the sum that each row goes to, and the number of sums; beyond them it is left out
    "few of many": ([5, 1], 6),
    "one each": ([2, 0, 1, 4, 3, 5], 6),
    "some left out": (RNG.integers(0, 15, 40), 9),
    "a hub": (np.where(RNG.random(200) < 0.5, 3, RNG.integers(0, 40, 200)), 40),
    "a great hub": (np.zeros(5000, int), 1),
    "all in twos": (np.repeat(np.arange(7), 2), 7),
}


def transformed(sums, rows, back):
    """Sums of rows, copies of sums, and what transformations make of both."""
    return {
        "sums": sums(rows),
        "jvp": jax.jvp(sums, (rows,), (rows,))[1],
        "transpose of copies": jax.vjp(sums.apply_transpose, back)[1](rows)[0],
        "batch of sums": jax.vmap(sums, 1, 1)(rows),
        "copies": sums.apply_transpose(back),
        "transpose of sums": jax.vjp(sums, rows)[1](back)[0],
        "batch of gradients": 0.5 * jax.vmap(jax.grad(lambda r: sums(r) @ sums(r)), 1, 1)(rows),
    }


@pytest.mark.parametrize("name", CASES)
def test_sums_and_copies_are_transposes(name):
    target, n = np.array(CASES[name][0]), CASES[name][1]
    matrix = (np.arange(n)[:, None] == target).astype(float)  # [sum, row]
    rows, back = RNG.normal(size=(len(target), 2)), RNG.normal(size=(n, 2))
    sums = jax.tree.map(jnp.asarray, make_assembly_map(target, n))
    program = jax.jit(transformed).lower(sums, rows, back)
    assert "scatter" not in program.as_text()
    found = program.compile()(sums, rows, back)
    # in another order: a rounding of the sum of sizes
    size = 4e-16 * len(target) * np.abs(rows).max()
    for key in ("sums", "jvp", "transpose of copies", "batch of sums"):
        np.testing.assert_allclose(found[key], matrix @ rows, rtol=0, atol=size, err_msg=key)
    np.testing.assert_array_equal(found["copies"], matrix.T @ back)
    np.testing.assert_array_equal(found["transpose of sums"], matrix.T @ back)
    gradient = matrix.T @ (matrix @ rows)
    np.testing.assert_allclose(found["batch of gradients"], gradient, rtol=0, atol=2 * size)
    plain = jax.jit(jax.grad(lambda b: jnp.sum(b[target % n] ** 2)))
    assert "scatter" in plain.lower(back).as_text()  # the control


def test_no_sums_at_all():
    sums = jax.tree.map(jnp.asarray, make_assembly_map(np.zeros(4, int), 0))
    assert sums(np.ones((4, 2))).shape == (0, 2)
    np.testing.assert_array_equal(sums.apply_transpose(jnp.zeros((0, 2))), np.zeros((4, 2)))


def test_a_hub_costs_little():
    """Tables read some two numbers for each that is added, however many meet at a hub."""
    target = np.append(np.repeat(np.arange(300), 4), np.full(500, 300))
    sums = make_assembly_map(target, 301)
    read = sum(np.size(table) for table in sums.tables)
    assert len(target) < read < 2 * len(target)
    assert np.size(sums.tables[0]) > 0
