"""Sparse solvers against dense algebra: factors, batches, singular matrices, transformations."""

import itertools
import threading
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg as sla
import scipy.sparse as sp
from banks.problems import CHOLMOD, PARDISO
from extensions.own_solver import NUMPY
from jax import lax

import jaxcable as jc
from jaxcable import linear
from jaxcable.linear import choose_solver, host
from jaxcable.linear.banded import solve_banded

SPARSE = ["superlu", "banded", NUMPY, CHOLMOD, PARDISO]
EVERY = ["dense", "rolling", *SPARSE]
RNG = np.random.default_rng(0)


def chain(n, symmetric, solver):
    """A pattern of n unknowns in overlapping elements of three, and unknowns left out."""
    number = np.arange(n - 2)[:, None] + np.arange(3)
    number = np.concatenate([number, [[0, n, n - 1]]])  # one long element, its middle held
    definite = solver == "rolling"
    return linear.make_pattern([number], n, symmetric, solver, definite=definite), number


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
    sparse = linear.assemble_matrix([(jnp.asarray(blocks), number)], n, pattern)
    return sparse.add_to_diagonal(shift), dense[:n, :n] + shift * np.eye(n)


@jax.jit
def transformed(sparse, b, direction, scales):
    """x(scale, b) = A^-1 b / scale and its transformations, in one program."""

    def solution(scale, b):
        scaled = linear.SparseMatrix(scale * sparse.values, sparse.pattern)
        return linear.factorize(scaled).solve(b, lambda v: scaled @ v)

    def total(scale):
        return solution(scale, b).sum()

    return (
        solution(1.0, b),
        jax.jvp(solution, (1.0, b), (1.0, direction))[1],
        jax.jacfwd(solution, 1)(1.0, b),
        jax.jacrev(solution, 1)(1.0, b),
        jax.hessian(lambda s: solution(s, b) @ direction)(1.0),
        jax.vmap(solution, (0, None))(scales, b),
        jax.vmap(jax.grad(total))(scales),
        lax.scan(lambda c, s: (c, solution(s, b)), 0.0, scales)[1],
    )


@pytest.mark.slow_cases("banded", "cholmod", "dense", "numpy", "pardiso", "rolling")
@pytest.mark.parametrize("solver", EVERY)
def test_general_solve_and_its_transformations(solver):
    """Value, jvp, vjp, Hessian and batches of x(values, b) against NumPy's solve."""
    b, direction = RNG.normal(size=(2, 8))
    definite = solver == "rolling"  # nothing else; one of the others' batch is indefinite
    scales = np.array([1.0, 2.0, 3.0 if definite else -3.0])
    for symmetric in [True] if definite else [True, False]:
        sparse, dense = matrix(8, symmetric, solver)
        inverse = np.linalg.inv(dense)
        x = inverse @ b
        each = x / scales[:, None]
        expected = (
            *(x, inverse @ direction - x, inverse, inverse, 2 * x @ direction),
            *(each, -x.sum() / scales**2, each),
        )
        for found, true in zip(transformed(sparse, b, direction, scales), expected, strict=True):
            assert np.abs(found - true).max() < 1e-11 * np.abs(x).max()


@pytest.mark.slow_cases("dense", "rolling", "superlu")
@pytest.mark.parametrize("solver", EVERY)
def test_loose_and_singular(solver):
    sparse, dense = matrix(7, True, solver, shift=0.0)
    b, loose = RNG.normal(size=7), np.arange(7) == 2
    keep = ~loose
    factor = linear.factorize(sparse, jnp.asarray(loose))
    x = factor.solve(b, lambda v: sparse @ v)
    rest = np.linalg.solve(dense[np.ix_(keep, keep)], b[keep])
    assert bool(factor.regular) and np.isnan(x[2])
    assert np.abs(x[keep] - rest).max() < 1e-10 * np.abs(rest).max()

    def total(b):  # nobody asks about the loose unknown
        return jnp.sum(jnp.where(loose, 0.0, factor.solve(b, lambda v: sparse @ v)))

    assert np.isfinite(jax.grad(total)(b)[keep]).all()
    asked = jax.grad(lambda b: jnp.sum(factor.solve(b, lambda v: sparse @ v)))(b)
    assert np.isnan(asked).all()
    # nothing at all, and what is not a number
    nothing = linear.factorize(linear.SparseMatrix(jnp.zeros_like(sparse.values), sparse.pattern))
    assert not bool(nothing.regular)
    assert np.isnan(nothing.solve(b, lambda v: v)).all()
    same = nothing.identity_if_singular()
    assert np.abs(same.solve(b, lambda v: v) - b).max() < 1e-15
    wrong = linear.SparseMatrix(sparse.values.at[3].set(jnp.nan), sparse.pattern)
    assert not bool(linear.factorize(wrong).regular)


def springs(solver, stiffness):
    """A free chain of springs, singular to rounding."""
    n = len(stiffness) + 1
    number = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    pattern = linear.make_pattern([number], n, True, solver)
    blocks = stiffness[:, None, None] * np.array([[1.0, -1], [-1, 1]])
    return linear.assemble_matrix([(jnp.asarray(blocks), number)], n, pattern), pattern


@pytest.mark.slow_cases("superlu")
@pytest.mark.parametrize("solver", SPARSE)
def test_a_stiffness_of_rounding_is_singular_and_a_small_one_is_not(solver):
    """A chain of springs on nothing, and on a spring of 1e-10."""
    free, pattern = springs(solver, np.random.default_rng(1).uniform(0.5, 2, 19))
    assert not bool(linear.factorize(free).regular)
    held = linear.SparseMatrix(free.values.at[0].add(1e-10), pattern)
    assert bool(linear.factorize(held).regular)


@pytest.mark.slow_cases("banded", "dense", "numpy", "superlu")
@pytest.mark.parametrize("solver", EVERY)
def test_sequences_reuse_factors_and_say_what_is_not_definite(solver):
    first, _ = matrix(12, True, solver, seed=1)
    pattern = first.pattern
    b = jnp.asarray(RNG.normal(size=12))
    near = linear.SparseMatrix(
        first.values * (1 + 1e-3 * RNG.normal(size=len(first.values))), pattern
    )
    far, _ = matrix(12, True, solver, seed=5, shift=50.0)
    indefinite = first.add_to_diagonal(-20.0)
    next_ = jax.jit(linear.solve_reusing_factor, static_argnames="limit")
    factored, counts = linear.no_factored_matrix(pattern, b.dtype), []
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
    expected = {"dense": [None] * 5, "rolling": [None] * 5, "banded": [1, 2, 3, 4, 5]}
    assert counts == expected.get(solver, [1, 1, 2, 3, 4])
    assert not bool(next_(indefinite, b, factored, 1e-8, 0, True)[1])


@pytest.mark.slow_cases("superlu")
@pytest.mark.parametrize("solver", SPARSE)
def test_pivots_of_few_digits_are_taken_only_where_they_are_asked_for(solver):
    """A chain of springs on one of 16 roundings: its last pivot is below the bound of 20."""
    free, pattern = springs(solver, np.ones(19))
    soft = linear.SparseMatrix(free.values.at[0].add(2.0**-48), pattern)
    b = jnp.zeros(20).at[19].set(1.0)

    def taken(matrix, limit):
        nothing = linear.no_factored_matrix(pattern, b.dtype)
        x, definite, _ = linear.solve_reusing_factor(matrix, b, nothing, 1e-8, limit, True)
        return bool(definite), np.asarray(x)

    may = solver is not NUMPY  # which judges its matrices by itself
    assert not taken(soft, 0)[0]
    definite, x = taken(soft, -1)
    assert definite == may
    if may:  # the force over the soft spring, with the one digit that such a pivot has
        assert x == pytest.approx(2.0**48, rel=0.5)
    assert not taken(free.add_to_diagonal(-0.1), -1)[0]


@pytest.mark.parametrize("n", [1, 30])
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
    # several right sides of each matrix
    both = jax.jit(jax.vmap(jax.vmap(solve_banded), (None, 0)))(band, np.stack([rhs, 2 * rhs]))[0]
    assert np.abs(both[1] - 2 * x)[definite].max() < 1e-13
    one, fine = solve_banded(jnp.asarray(band[0]), jnp.asarray(rhs[0]))
    assert bool(fine) and np.abs(one - x[0]).max() < 1e-15


@pytest.mark.slow_cases("banded", "superlu")
@pytest.mark.parametrize("solver", SPARSE)
def test_a_batch_of_sparse_systems_is_solved_as_banded_ones_where_that_is_small(solver):
    own, _ = matrix(12, True, solver, seed=2)
    assert own.pattern.band is not None
    scales, b = np.array([1.0, 2.0, 4.0]), jnp.asarray(RNG.normal(size=12))
    factored = linear.no_factored_matrix(own.pattern, b.dtype)

    def solve(scale, factored):
        scaled = linear.SparseMatrix(scale * own.values, own.pattern)
        return linear.solve_reusing_factor(scaled, b, factored, 1e-8, 9, True)

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
        lambda s: linear.solve_reusing_factor(
            linear.SparseMatrix(s * values, pattern),
            jnp.ones(90),
            linear.no_factored_matrix(pattern, values.dtype),
            *(1e-8, 9, s < 3),
        )
    )(scales)
    assert np.array_equal(definite, [True, True, False])  # the last was not wanted
    assert np.abs(x[:2] - 0.5 / scales[:2, None]).max() < 1e-15


@pytest.mark.slow_cases("superlu-9")
@pytest.mark.parametrize(("solver", "n"), [("dense", 9), ("superlu", 9), ("superlu", 60)])
def test_the_eigenvalue_nearest_to_zero(solver, n):
    sparse, dense = matrix(n, True, solver, shift=-4.0)
    values, vectors = np.linalg.eigh(dense)
    nearest = np.abs(values).argmin()
    assert 0 < nearest < n - 1
    number, value, right, _ = linear.inertia_and_nearest_mode(sparse, jnp.zeros(n, bool))
    assert int(number) == np.count_nonzero(values < 0)
    assert float(value) == pytest.approx(values[nearest], rel=1e-9)
    assert abs(right @ vectors[:, nearest]) == pytest.approx(1.0, rel=1e-9)


def kept(n):
    """The analysis of a pattern on the host, and values of a diagonal matrix on it."""
    pattern = chain(n, True, "superlu")[0]
    numbers = (np.asarray(x) for x in (pattern.digest, pattern.indptr, pattern.indices))
    return host.analysis_of_pattern(pattern.solver, True, *numbers), np.isin(
        np.arange(len(pattern.indices)), pattern.diagonal
    ).astype(float)


@pytest.mark.slow
def test_factors_and_analyses_kept_are_bounded():
    jc.forget_programs()
    for n in range(5, 5 + host._MOST_ANALYSES + 3):
        analysed, one = kept(n)
        for k in range(1, host._MOST_FACTORS + 4):
            assert analysed.find_or_make_factor(k * one, True).solve(np.ones(n)) == pytest.approx(
                1 / k
            )
        assert len(analysed.factors) == host._MOST_FACTORS and analysed.count == k
        assert analysed.find_or_make_factor(k * one, True) and analysed.count == k  # is found again
    assert len(host._analyses) == host._MOST_ANALYSES
    analysed, one = kept(5)  # one that was dropped is analysed again
    assert analysed.count == 0 and analysed.find_or_make_factor(one, True).solve(
        np.ones(5)
    ) == pytest.approx(1)
    jc.forget_programs()
    assert not host._analyses


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="Linux tells a process its size")
def test_factors_that_are_made_and_freed_in_other_threads_give_their_memory_back():
    """SciPy frees SuperLU's memory only in the thread that has allocated it."""
    side = sp.diags([-1.0, 2.1, -1.0], [-1, 0, 1], (60, 60))
    grid = sp.csr_matrix(sp.kron(side, sp.eye(60)) + sp.kron(sp.eye(60), side))
    analysis = linear.solver_named("superlu").analyze(3600, grid.indptr, grid.indices)

    def resident():
        return 4096 * int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])

    sizes = []
    for _ in range(20):
        made = []
        thread = threading.Thread(
            target=lambda m=made: m.append(analysis.factorize(grid.data, True))
        )
        thread.start()
        thread.join()
        made.pop().release()
        sizes.append(resident())
    assert sizes[-1] - sizes[4] < 5e6  # each takes a megabyte


def test_the_way_back_from_another_device_gives_the_same(monkeypatch):
    """The callback that programs on other devices use, here on the host's own."""
    own, dense = matrix(9, True, "superlu")
    b = RNG.normal(size=9)
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    x = jax.jit(lambda b: linear.factorize(own).solve(b, lambda v: own @ v))(b)
    assert np.abs(dense @ x - b).max() < 1e-12
    factored = linear.no_factored_matrix(own.pattern, x.dtype)
    y, definite, _ = linear.solve_reusing_factor(own, jnp.asarray(b), factored, 1e-8, 9, True)
    assert bool(definite) and np.abs(y - x).max() < 1e-12


def test_solver_by_size_and_by_name(monkeypatch):
    assert chain(48, True, None)[0].solver.name == "dense"
    assert chain(48, True, "superlu")[0].solver.name == "superlu"
    assert choose_solver(300, True).name == "banded"
    pardiso, cholmod = (type(linear.solver_named(name)) for name in ("pardiso", "cholmod"))
    monkeypatch.setattr(pardiso, "is_installed", lambda self: False)
    monkeypatch.setattr(cholmod, "is_installed", lambda self: False)
    assert choose_solver(5000, False).name == "superlu"
    with pytest.raises(ValueError, match=r"linear_solver = 'cholmod': cvxopt is not installed"):
        jc.Newton(linear_solver="cholmod")
    monkeypatch.setattr(cholmod, "is_installed", lambda self: True)
    assert choose_solver(5000, False).name == "cholmod"
    with pytest.raises(ValueError, match=r"linear_solver = 'pardiso': pypardiso is not installed"):
        jc.Newton(linear_solver="pardiso")
    monkeypatch.setattr(pardiso, "is_installed", lambda self: True)
    assert choose_solver(5000, False).name == "pardiso"
    assert choose_solver(5000, False, exchanges_rows=True).name == "cholmod"
    for method in (jc.Newton, jc.Incremental):
        with pytest.raises(ValueError, match="linear_solver = 'umfpack': expected None or one of"):
            method(linear_solver="umfpack")


@pytest.mark.slow_cases("0.0-dense", "0.0-superlu", "1e-15-dense")
@pytest.mark.parametrize("solver", ["dense", *SPARSE])
@pytest.mark.parametrize("softest", [0.0, 1e-15, 1e-6])
def test_a_bordered_matrix_is_regular_where_its_block_is_singular(solver, softest):
    """Against SciPy on the whole dense matrix, whose condition is 1e3 whatever the block's is."""
    rng = np.random.default_rng(0)
    matrix, pattern = springs(solver, rng.uniform(1, 9, 11))
    matrix = linear.SparseMatrix(matrix.values.at[0].add(softest), pattern)
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
