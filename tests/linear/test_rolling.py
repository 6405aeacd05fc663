"""Cholesky's method with a rolling window, against NumPy's dense solves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcable import linear
from jaxcable.common.fusion import are_loops_fused
from jaxcable.linear import rolling

RNG = np.random.default_rng(3)
SIZES = [(1, 0), (9, 2), (40, 13), (30, 29), (5, 12)]


def banded(n, b, definite=True):
    """A symmetric matrix of half-bandwidth b, dense, and its band."""
    full = RNG.normal(size=(n, n))
    full = np.where(np.abs(np.subtract.outer(np.arange(n), np.arange(n))) <= b, full, 0)
    full = full + full.T + (4 * (b + 2) if definite else -1.0) * np.eye(n)
    band = np.zeros((n, b + 1))
    for k in range(n):
        column = full[k : k + b + 1, k]
        band[k, : len(column)] = column
    return full, jnp.asarray(band)


@pytest.mark.slow_cases("30-29", "40-13", "5-12")
@pytest.mark.parametrize(("n", "b"), SIZES)
def test_solutions_and_products(n, b):
    full, band = banded(n, b)
    rhs, other = RNG.normal(size=(2, n))
    factor, x = jax.jit(rolling.factorize_and_solve)(band, rhs)
    room = 1e-15 * n  # well conditioned: some roundings of the solution
    np.testing.assert_allclose(x, np.linalg.solve(full, rhs), rtol=0, atol=room)
    np.testing.assert_allclose(
        rolling.solve_with_factor(factor, other), np.linalg.solve(full, other), rtol=0, atol=room
    )
    np.testing.assert_allclose(
        rolling.multiply_by_vector(band, rhs), full @ rhs, rtol=0, atol=100 * room
    )
    lower = np.linalg.cholesky(full)
    for k in range(n):
        own = lower[k : k + b + 1, k]
        np.testing.assert_allclose(factor[k, : len(own)], own, rtol=1e-13, atol=1e-14)


def test_only_matrices_known_to_be_definite():
    number = np.arange(10)[:, None] + np.arange(3)
    for definite in (False, True):
        chosen = linear.make_pattern([number], 12, True, definite=definite).solver.name
        assert chosen == ("rolling" if definite and are_loops_fused() else "dense")
