"""`run_search`: a loop of Python over programs, called plainly, mapped, and by other programs."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxcable as jc
from jaxcable.programs.program_calls import as_program
from jaxcable.programs.search_call import run_search

VALUES = np.array([8.0, 3.0, 0.5])
STARTED = []


@as_program
def excess(x, a):
    return x**3 - a


def bisect(problem):
    """The root of x^3 = a between zero and a limit, and the number of halvings."""
    STARTED.append(float(problem["a"]))
    low, high, count = 0.0, float(problem["limit"]), 0
    while high - low > 1e-12:
        middle, count = 0.5 * (low + high), count + 1
        above = np.asarray(excess(np.float64(middle), problem["a"])) > 0
        low, high = (low, middle) if above else (middle, high)
    return {"root": np.float64(low), "count": np.int32(count)}


LIKE = {"root": np.zeros(()), "count": np.zeros((), np.int32)}


def search(a, limit=4.0, **options):
    return run_search(bisect, {"a": a, "limit": limit}, LIKE, **options)


def check(found, a):
    """Roots to the width of the last interval; 4 / 2^42 is the first one below 1e-12."""
    np.testing.assert_allclose(found["root"], np.cbrt(a), atol=2e-12)
    assert np.all(np.asarray(found["count"]) == 42)
    assert found["count"].dtype == np.int32


def test_plain_and_mapped_searches():
    check(search(np.float64(8.0)), 8.0)
    mapped = jax.vmap(search)(jnp.asarray(VALUES))
    check(mapped, VALUES)
    assert isinstance(mapped["root"], jax.Array)
    both = jax.vmap(jax.vmap(search, (None, 0)), (0, None))(VALUES, np.array([4.0, 4.0]))
    check(both, np.column_stack([VALUES, VALUES]))


@pytest.mark.parametrize("way", ["numpy", "xla"])
def test_searches_within_programs(way):
    """One search, a batch, and one in a loop and a branch: by the call of a NumPy function."""

    @as_program
    def several(values):
        def step(total, a):
            found = lax.cond(a > 1.0, lambda: search(a)["root"], lambda: 0.0 * a)
            return total + found, found

        return search(values[0]), jax.vmap(search)(values), lax.scan(step, 0.0, values)

    with jc.evaluation(way):
        one, batch, (total, each) = several(VALUES)
    check(one, VALUES[0])
    check(batch, VALUES)
    roots = np.where(VALUES > 1.0, np.cbrt(VALUES), 0.0)
    np.testing.assert_allclose(each, roots, atol=2e-12)
    np.testing.assert_allclose(total, roots.sum(), atol=6e-12)


@pytest.mark.parametrize("way", ["numpy", "xla"])
def test_a_search_whose_program_has_a_search(way):
    """The cube root of the cube root: within a call of the host there is NumPy only."""

    @as_program
    def outer_excess(x, a):
        return x - search(a)["root"]

    def outer(a):
        low, high = 0.0, 2.0
        while high - low > 1e-12:
            middle = 0.5 * (low + high)
            above = np.asarray(outer_excess(np.float64(middle) ** 3, a)) > 0
            low, high = (low, middle) if above else (middle, high)
        return np.float64(low)

    run = as_program(lambda a: run_search(outer, a, np.zeros(())))
    with jc.evaluation(way):
        # the inner root is known to 2e-12, over the slope 3 x^2 = 4.8
        np.testing.assert_allclose(run(np.float64(8.0)), 8.0 ** (1 / 9), atol=3e-12)


@pytest.mark.parametrize("way", ["numpy", "xla"])
def test_searches_of_no_cases(way):
    with jc.evaluation(way):
        for found in (jax.vmap(search)(VALUES[:0]), as_program(jax.vmap(search))(VALUES[:0])):
            check(found, VALUES[:0])
            assert found["root"].shape == found["count"].shape == (0,)


def test_a_search_has_no_derivative():
    for differentiate in (jax.grad, jax.jacfwd, lambda f: jax.grad(jax.jit(f))):
        with pytest.raises(ValueError, match="has no derivative"):
            differentiate(lambda a: search(a)["root"])(8.0)

    def product(a):
        return a * search(lax.stop_gradient(a))["root"]

    assert jax.grad(product)(8.0) == pytest.approx(2.0, abs=2e-12)


def test_a_search_that_reports_runs_once():
    """A long call begins again, compiled, and so would the search: its reports would come twice."""

    @functools.partial(as_program, static=("reports",))
    def long_call(a, reports):
        root = search(a, reports=reports)["root"]
        return lax.fori_loop(0, 5000, lambda _, x: jnp.sin(x) + root, 0.0 * root)

    for reports, count in ((True, 1), (False, 2)):
        STARTED.clear()
        with jc.evaluation("auto"):
            long_call(np.float64(8.0), reports=reports)
        assert STARTED == [8.0] * count
