"""Sparse solvers against dense algebra: patterns, factors, conjugate gradients, transformations."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg as sla
from banks.problems import CHOLMOD, PARDISO
from extensions.own_solver import NUMPY
from jax import lax

import jaxcable as jc
from jaxcable import linear
from jaxcable.linear import choose, host
from jaxcable.linear.banded import solve_banded

SPARSE = [
    "superlu",
    "banded",
    NUMPY,
    CHOLMOD,
    PARDISO,
]
RNG = np.random.default_rng(0)


def chain(n, symmetric, solver):
    """A pattern of n unknowns in overlapping elements of three, and unknowns left out."""
    number = np.arange(n - 2)[:, None] + np.arange(3)
    number = np.concatenate([number, [[0, n, n - 1]]])  # one long element, its middle held
    return linear.make_pattern([number], n, symmetric, solver), number


def matrix(n, symmetric, solver, seed=0, shift=3.0):
    """A random matrix on it, `Sparse`, and the same dense; positive definite if symmetric."""
    rng = np.random.default_rng(seed)
    pattern, number = chain(n, symmetric, solver)
    blocks = rng.normal(size=(len(number), 3, 3))
    if symmetric:
        blocks = np.einsum("eij,ekj->eik", blocks, blocks)
    dense = np.zeros((n + 1, n + 1))
    for rows, block in zip(number, blocks, strict=True):
        dense[np.ix_(rows, rows)] += block
    sparse = linear.assemble([(jnp.asarray(blocks), number)], n, pattern)
    return sparse.plus_diagonal(shift), dense[:n, :n] + shift * np.eye(n)


@pytest.mark.parametrize("symmetric", [True, False])
def test_assembly_product_and_diagonal(symmetric):
    sparse, dense = matrix(9, symmetric, "superlu")
    v = RNG.normal(size=9)
    assert np.abs(sparse.dense() - dense).max() < 1e-14 * np.abs(dense).max()
    assert np.abs(sparse @ jnp.asarray(v) - dense @ v).max() < 1e-13
    assert np.abs(linear.diagonal(sparse) - np.diag(dense)).max() < 1e-14
    assert np.array_equal(linear.or_identity(sparse, jnp.array(False)).dense(), np.eye(9))
    assert np.array_equal(linear.or_identity(sparse, jnp.array(True)).dense(), sparse.dense())


@pytest.mark.slow
@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("solver", [pytest.param("dense", marks=pytest.mark.slow), *SPARSE])
def test_general_solve_and_its_transformations(solver, symmetric):
    """Value, jvp, vjp, Hessian and batches of x(values, b) against NumPy's solve."""
    sparse, dense = matrix(8, symmetric, solver)
    b, direction = RNG.normal(size=(2, 8))

    def solution(scale, b):
        scaled = linear.Sparse(scale * sparse.values, sparse.pattern)
        return linear.factorize(scaled).solve(b, lambda v: scaled @ v)

    inverse = np.linalg.inv(dense)
    x = inverse @ b
    tol = 1e-12 * np.abs(x).max()
    assert np.abs(jax.jit(solution)(1.0, b) - x).max() < tol
    tangent = jax.jvp(solution, (1.0, b), (1.0, direction))[1]  # d(x / s) + A^-1 db
    assert np.abs(tangent - (inverse @ direction - x)).max() < 2 * tol
    assert np.abs(jax.jacfwd(solution, 1)(1.0, b) - inverse).max() < 1e-12
    assert np.abs(jax.jacrev(solution, 1)(1.0, b) - inverse).max() < 1e-12
    second = jax.hessian(lambda s: solution(s, b) @ direction)(1.0)
    assert np.abs(second - 2 * x @ direction) < 10 * tol
    scales = np.array([1.0, 2.0, -3.0])  # in a batch, one of them indefinite
    many = jax.vmap(solution, (0, None))(scales, b)
    assert np.abs(many - x / scales[:, None]).max() < tol
    gradients = jax.vmap(jax.grad(lambda s, b: solution(s, b).sum()), (0, None))(scales, b)
    assert np.abs(gradients + x.sum() / scales**2).max() < 10 * tol
    _, steps = lax.scan(lambda c, s: (c, solution(s, b)), 0.0, scales)
    assert np.abs(steps - x / scales[:, None]).max() < tol


@pytest.mark.parametrize("solver", ["dense", *SPARSE])
def test_loose_and_singular(solver):
    sparse, dense = matrix(7, True, solver, shift=0.0)
    b = RNG.normal(size=7)
    loose = np.zeros(7, bool)
    loose[2] = True
    factor = linear.factorize(sparse, jnp.asarray(loose))
    assert bool(factor.regular)
    keep = ~loose
    x = factor.solve(b, lambda v: sparse @ v)
    assert np.isnan(x[2])
    rest = np.linalg.solve(dense[np.ix_(keep, keep)], b[keep])
    assert np.abs(x[keep] - rest).max() < 1e-10 * np.abs(rest).max()

    def total(b, weight):
        return jnp.sum(weight * jnp.where(loose, 0.0, factor.solve(b, lambda v: sparse @ v)))

    gradient = jax.grad(total)(b, 1.0)  # nobody asks about the loose unknown
    assert np.isfinite(gradient[keep]).all()

    # an unknown whose row and column are almost those of another: no digits left
    values = jnp.zeros_like(sparse.values)
    nothing = linear.factorize(linear.Sparse(values, sparse.pattern))
    assert not bool(nothing.regular)
    assert np.isnan(nothing.solve(b, lambda v: v)).all()
    same = nothing.or_identity()
    assert np.abs(same.solve(b, lambda v: v) - b).max() < 1e-15
    wrong = linear.Sparse(sparse.values.at[3].set(jnp.nan), sparse.pattern)
    assert not bool(linear.factorize(wrong).regular)


@pytest.mark.parametrize("solver", SPARSE)
def test_a_stiffness_of_rounding_is_singular_and_a_small_one_is_not(solver):
    """A chain of springs on nothing (singular to rounding), and on a spring of 1e-10."""
    number = np.column_stack([np.arange(19), np.arange(1, 20)])
    pattern = linear.make_pattern([number], 20, True, solver)
    stiffness = np.random.default_rng(1).uniform(0.5, 2, 19)
    blocks = stiffness[:, None, None] * np.array([[1.0, -1], [-1, 1]])
    free = linear.assemble([(jnp.asarray(blocks), number)], 20, pattern)
    assert not bool(linear.factorize(free).regular)
    held = linear.Sparse(free.values.at[0].add(1e-10), pattern)
    assert bool(linear.factorize(held).regular)


@pytest.mark.parametrize("solver", ["dense", *SPARSE])
def test_sequences_reuse_factors_and_say_what_is_not_definite(solver):
    first, _ = matrix(12, True, solver, seed=1)
    pattern = first.pattern
    b = jnp.asarray(RNG.normal(size=12))
    near = linear.Sparse(first.values * (1 + 1e-3 * RNG.normal(size=len(first.values))), pattern)
    far, _ = matrix(12, True, solver, seed=5, shift=50.0)
    indefinite = first.plus_diagonal(-20.0)
    next_ = jax.jit(linear.solve_next, static_argnames="limit")
    factored, counts = linear.nothing_factored(pattern, b.dtype), []
    for k, (own, tol, limit) in enumerate(
        [(first, 1e-8, 9), (near, 1e-8, 9), (near, 1e-8, 0), (far, 1e-12, 2), (first, 1e-8, 0)]
    ):
        x, definite, factored = next_(own, b, factored, tol, limit, True)
        assert bool(definite)
        exact = np.linalg.solve(np.asarray(own.dense()), b)
        error = np.linalg.norm(own.dense() @ x - b) / np.linalg.norm(b)
        assert error < (1.1e-8 if k == 1 else 1e-13)
        assert np.abs(x - exact).max() < 1e-6 * np.abs(exact).max()
        counts.append(None if factored is None else int(factored.count))
    # conjugate gradients with a near matrix's factor, not with a far one's
    expected = {"dense": [None] * 5, "banded": [1, 2, 3, 4, 5]}
    assert counts == expected.get(solver, [1, 1, 2, 3, 4])
    assert not bool(next_(indefinite, b, factored, 1e-8, 0, True)[1])


@pytest.mark.parametrize("solver", SPARSE)
def test_pivots_of_few_digits_are_taken_only_where_they_are_asked_for(solver):
    """A chain of springs on one of 16 roundings: its last pivot is below the bound of 20."""
    number = np.column_stack([np.arange(19), np.arange(1, 20)])
    pattern = linear.make_pattern([number], 20, True, solver)
    blocks = np.ones((19, 1, 1)) * np.array([[1.0, -1], [-1, 1]])
    free = linear.assemble([(jnp.asarray(blocks), number)], 20, pattern)
    soft = linear.Sparse(free.values.at[0].add(2.0**-48), pattern)
    b = jnp.zeros(20).at[19].set(1.0)

    def taken(matrix, limit):
        nothing = linear.nothing_factored(pattern, b.dtype)
        x, definite, _ = linear.solve_next(matrix, b, nothing, 1e-8, limit, True)
        return bool(definite), np.asarray(x)

    may = pattern.solver.small_pivots
    assert may == (solver is not NUMPY)
    assert not taken(soft, 0)[0]
    definite, x = taken(soft, -1)
    assert definite == may
    if may:  # the force over the soft spring, with the one digit that such a pivot has
        assert x == pytest.approx(2.0**48, rel=0.5)
    assert not taken(free.plus_diagonal(-0.1), -1)[0]


@pytest.mark.parametrize("n", [1, 5, 30])
def test_batches_of_banded_systems(n):
    """In a batch the banded solver takes over; an indefinite case leaves the others alone."""
    rng = np.random.default_rng(n)
    width = min(n, 5)
    band = rng.normal(size=(70, n, width))
    band[:, :, 0] = 10.0
    band[7, n // 2, 0] = -1.0
    rhs = rng.normal(size=(70, n))
    x, definite = jax.jit(jax.vmap(solve_banded))(band, rhs)
    assert np.array_equal(np.flatnonzero(~definite), [7])
    for k in (0, 6, 8, 69):
        lower = np.zeros((width, n))
        for i, j in itertools.product(range(width), range(n)):
            lower[i, j] = band[k, j, i]
        peer = sla.solveh_banded(lower, rhs[k], lower=True)
        assert np.abs(x[k] - peer).max() < 1e-13
    one, fine = solve_banded(jnp.asarray(band[0]), jnp.asarray(rhs[0]))
    assert bool(fine) and np.abs(one - x[0]).max() < 1e-15


@pytest.mark.parametrize("solver", SPARSE)
def test_a_batch_of_sparse_systems_is_solved_as_banded_ones_where_that_is_small(solver):
    own, _ = matrix(12, True, solver, seed=2)
    assert own.pattern.band is not None
    scales, b = np.array([1.0, 2.0, 4.0]), jnp.asarray(RNG.normal(size=12))
    factored = linear.nothing_factored(own.pattern, b.dtype)

    def solve(scale, factored):
        scaled = linear.Sparse(scale * own.values, own.pattern)
        return linear.solve_next(scaled, b, factored, 1e-8, 9, True)

    x, definite, after = jax.vmap(solve, (0, None))(scales, factored)
    assert definite.all()
    expected = np.linalg.solve(np.asarray(own.dense()), b) / scales[:, None]
    assert np.abs(x - expected).max() < 1e-13
    assert np.all(np.asarray(after.count) == 1)
    wide = np.arange(90)[None]  # all in one element: no small band
    pattern = linear.make_pattern([wide], 90, True, solver)
    assert pattern.band is None
    values = jnp.zeros(len(pattern.indices)).at[pattern.diagonal].set(2.0)
    x, definite, _ = jax.vmap(
        lambda s: linear.solve_next(
            linear.Sparse(s * values, pattern),
            jnp.ones(90),
            linear.nothing_factored(pattern, values.dtype),
            *(1e-8, 9, s < 3),
        )
    )(scales)
    assert np.array_equal(definite, [True, True, False])  # the last was not wanted
    assert np.abs(x[:2] - 0.5 / scales[:2, None]).max() < 1e-15


def test_conjugate_gradients_give_up_where_they_do_not_pay():
    rng = np.random.default_rng(0)
    a = rng.normal(size=(50, 50))
    a = a @ a.T + 1e-3 * np.eye(50)
    b = rng.normal(size=50)
    exact = np.linalg.inv(a)
    x = host.conjugate_gradients(lambda v: a @ v, lambda r: exact @ r, b, 1e-9, 12)
    assert np.linalg.norm(a @ x - b) < 1e-9 * np.linalg.norm(b)
    calls = []

    def identity(r):
        calls.append(1)
        return r

    assert host.conjugate_gradients(lambda v: a @ v, identity, b, 1e-9, 12) is None
    assert len(calls) <= 5  # the pace is judged after four steps
    a[0, 0] -= 1e3
    assert host.conjugate_gradients(lambda v: a @ v, lambda r: exact @ r, b, 1e-9, 12) is None


@pytest.mark.slow
def test_factors_and_analyses_kept_are_bounded():
    b = jnp.ones(12)
    for seed in range(host._FACTORS + 3):
        own, dense = matrix(12, True, "superlu", seed=seed)
        x = linear.factorize(own).solve(b, lambda v, own=own: own @ v)
        assert np.abs(dense @ x - b).max() < 1e-12
    for n in range(5, 5 + host._PATTERNS + 3):
        own, dense = matrix(n, True, "superlu")
        x = linear.factorize(own).solve(jnp.ones(n), lambda v, own=own: own @ v)
        assert np.abs(dense @ x - 1).max() < 1e-12
    assert len(host._kept) <= host._PATTERNS
    assert all(len(one.factors) <= host._FACTORS for one in host._kept.values())
    own, dense = matrix(5, True, "superlu")  # one that was dropped is analysed again
    x = linear.factorize(own).solve(jnp.ones(5), lambda v: own @ v)
    assert np.abs(dense @ x - 1).max() < 1e-12


def test_the_way_back_from_another_device_gives_the_same(monkeypatch):
    """The callback that programs on other devices use, here on the host's own."""
    own, dense = matrix(9, True, "superlu")
    b = RNG.normal(size=9)
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    x = jax.jit(lambda b: linear.factorize(own).solve(b, lambda v: own @ v))(b)
    assert np.abs(dense @ x - b).max() < 1e-12
    factored = linear.nothing_factored(own.pattern, x.dtype)
    y, definite, _ = linear.solve_next(own, jnp.asarray(b), factored, 1e-8, 9, True)
    assert bool(definite) and np.abs(y - x).max() < 1e-12


def test_solver_by_size_and_by_name(monkeypatch):
    assert chain(48, True, None)[0].solver.name == "dense"
    assert chain(48, True, "superlu")[0].solver.name == "superlu"
    assert choose(300, True).name == "banded"
    pardiso, cholmod = (type(linear.named(name)) for name in ("pardiso", "cholmod"))
    monkeypatch.setattr(pardiso, "available", lambda self: False)
    monkeypatch.setattr(cholmod, "available", lambda self: False)
    assert choose(5000, False).name == "superlu"
    with pytest.raises(ValueError, match=r"linear_solver = 'cholmod': cvxopt is not installed"):
        jc.Newton(linear_solver="cholmod")
    monkeypatch.setattr(cholmod, "available", lambda self: True)
    assert choose(5000, False).name == "cholmod"
    with pytest.raises(ValueError, match=r"linear_solver = 'pardiso': pypardiso is not installed"):
        jc.Newton(linear_solver="pardiso")
    monkeypatch.setattr(pardiso, "available", lambda self: True)
    assert choose(5000, False).name == "pardiso"
    assert choose(5000, False, exchanges_rows=True).name == "cholmod"
    for method in (jc.Newton, jc.Incremental):
        with pytest.raises(ValueError, match="linear_solver = 'umfpack': expected None or one of"):
            method(linear_solver="umfpack")


@pytest.mark.parametrize("solver", ["dense", *SPARSE])
@pytest.mark.parametrize("softest", [0.0, 1e-15, 1e-12, 1e-6, 1.0])
def test_a_bordered_matrix_is_regular_where_its_block_is_singular(solver, softest):
    """Against SciPy on the whole dense matrix, whose condition is 1e3 whatever the block's is."""
    rng = np.random.default_rng(0)
    numbers = [np.array([[k, k + 1] for k in range(11)])]
    pattern = linear.make_pattern(numbers, 12, True, solver)
    # a chain: stiffness of differences, and of the first alone
    part = np.array([[1.0, -1.0], [-1.0, 1.0]])
    blocks = np.tile(part, (11, 1, 1)) * rng.uniform(1, 9, 11)[:, None, None]
    blocks[0, 0, 0] += softest
    matrix = linear.assemble([(jnp.asarray(blocks), jnp.asarray(numbers[0]))], 12, pattern)
    full = np.asarray(matrix.dense())
    column, row, rhs = rng.normal(size=(3, 12))
    loose = jnp.zeros(12, bool)
    x, y, regular = linear.solve_bordered(matrix, column, row, 0.3, rhs, 0.7, loose)
    whole = np.block([[full, column[:, None]], [row[None], np.array([[0.3]])]])
    exact = np.linalg.solve(whole, np.append(rhs, 0.7))
    assert bool(regular)
    # eps times the condition
    assert np.abs(np.append(x, y) - exact).max() < 1e-12 * np.abs(exact).max()
    # and where column and row see nothing of the softest direction, all of it is singular
    even = np.ones(12) / 12
    column, row = column - column.sum() * even, row - row.sum() * even
    if softest < 1e-12:
        assert not linear.solve_bordered(matrix, column, row, 0.3, rhs, 0.7, loose)[2]
