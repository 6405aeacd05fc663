"""Cholesky's method with a rolling window, against NumPy's dense solves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcable import linear
from jaxcable.common.fusion import fuses
from jaxcable.linear import rolling

RNG = np.random.default_rng(3)
SIZES = [(1, 0), (4, 0), (2, 1), (9, 2), (40, 13), (30, 29), (5, 12)]


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


@pytest.mark.parametrize(("n", "b"), SIZES)
def test_solutions_and_products(n, b):
    full, band = banded(n, b)
    rhs, other = RNG.normal(size=(2, n))
    factor, x = jax.jit(rolling.solve)(band, rhs)
    room = 1e-15 * n  # well conditioned: some roundings of the solution
    np.testing.assert_allclose(x, np.linalg.solve(full, rhs), rtol=0, atol=room)
    np.testing.assert_allclose(
        rolling.substitute(factor, other), np.linalg.solve(full, other), rtol=0, atol=room
    )
    np.testing.assert_allclose(rolling.times(band, rhs), full @ rhs, rtol=0, atol=100 * room)
    lower = np.linalg.cholesky(full)
    for k in range(n):
        own = lower[k : k + b + 1, k]
        np.testing.assert_allclose(factor[k, : len(own)], own, rtol=1e-13, atol=1e-14)


def test_single_precision():
    full, band = banded(40, 6)
    rhs = RNG.normal(size=40)
    _, x = rolling.solve(band.astype(jnp.float32), jnp.asarray(rhs, jnp.float32))
    assert x.dtype == jnp.float32
    np.testing.assert_allclose(x, np.linalg.solve(full, rhs), rtol=0, atol=1e-6)


def pattern(n):
    """A pattern of overlapping elements of three, for the solver in the program."""
    number = np.arange(n - 2)[:, None] + np.arange(3)
    return linear.make_pattern([number], n, True, "rolling", definite=True), number


def matrix(n, shift=1.0):
    """A positive definite matrix on it, `Sparse`, and the same dense."""
    found, number = pattern(n)
    blocks = RNG.normal(size=(len(number), 3, 3))
    blocks = np.einsum("eij,ekj->eik", blocks, blocks)
    dense = shift * np.eye(n)
    for rows, block in zip(number, blocks, strict=True):
        dense[np.ix_(rows, rows)] += block
    sparse = linear.assemble([(jnp.asarray(blocks), number)], n, found)
    return sparse.plus_diagonal(shift), dense


def solved(sparse, rhs):
    x, definite, _ = linear.solve_next(sparse, jnp.asarray(rhs), None, 0.0, 0, True)
    return x, bool(definite)


def test_as_a_solver():
    sparse, dense = matrix(30)
    rhs = RNG.normal(size=30)
    x, definite = solved(sparse, rhs)
    room = 1e-15 * np.linalg.cond(dense) * np.abs(rhs).max()
    assert definite and np.abs(x - np.linalg.solve(dense, rhs)).max() < room
    many = RNG.normal(size=(5, 30))
    xs = jax.vmap(lambda b: linear.solve_next(sparse, b, None, 0.0, 0, True)[0])(many)
    assert np.abs(xs - np.linalg.solve(dense, many.T).T).max() < 10 * room


@pytest.mark.parametrize("shift", [-3.0, -100.0])
def test_an_indefinite_matrix_is_seen(shift):
    sparse, dense = matrix(30)
    assert np.linalg.eigvalsh(dense + shift * np.eye(30)).min() < 0
    assert not solved(sparse.plus_diagonal(shift), np.ones(30))[1]


def test_factors_know_what_has_no_value():
    sparse, dense = matrix(12)
    loose = np.zeros(12, bool)
    loose[4] = True
    cut = linear.held_at(sparse, jnp.asarray(loose))  # its row is empty
    rhs = RNG.normal(size=12)
    rhs[4] = 0.0
    factor = linear.factorize(cut, jnp.asarray(loose))
    assert bool(factor.regular)
    kept = np.delete(np.delete(dense, 4, 0), 4, 1)
    expected = np.linalg.solve(kept, np.delete(rhs, 4))
    answer, unknown = factor.marked(jnp.asarray(rhs))
    np.testing.assert_array_equal(unknown, loose)
    np.testing.assert_allclose(np.delete(answer, 4), expected, rtol=1e-10)
    assert answer[4] == 0
    np.testing.assert_allclose(np.delete(factor.adjoint(jnp.asarray(rhs)), 4), expected, rtol=1e-10)
    rhs[4] = 1.0
    assert np.isnan(factor.adjoint(jnp.asarray(rhs))).all()


def test_a_singular_matrix_has_no_solution():
    sparse, _ = matrix(12, shift=0.0)
    zero = sparse.pattern.rows == 5
    zero = zero | (sparse.pattern.indices == 5)
    singular = linear.or_identity(sparse, True)
    singular = type(sparse)(jnp.where(zero, 0.0, singular.values), sparse.pattern)
    factor = linear.factorize(singular)
    assert not bool(factor.regular)
    assert np.isnan(factor.adjoint(jnp.ones(12))).all()
    assert factor.marked(jnp.ones(12))[1].all()
    np.testing.assert_array_equal(factor.adjoint(jnp.zeros(12)), 0.0)
    rhs = jnp.arange(12.0)
    np.testing.assert_array_equal(factor.or_identity().solve(rhs, lambda v: v), rhs)
    regular = linear.factorize(sparse.plus_diagonal(1.0))
    same = regular.or_identity().marked(rhs)[0] - regular.marked(rhs)[0]
    np.testing.assert_array_equal(same, 0.0)


def test_only_matrices_known_to_be_definite():
    number = np.arange(10)[:, None] + np.arange(3)
    for definite in (False, True):
        chosen = linear.make_pattern([number], 12, True, definite=definite).solver.name
        assert chosen == ("rolling" if definite and fuses() else "dense")
