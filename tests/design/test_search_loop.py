"""Searches are loops in Python, which other programs call; functions and progress of users."""

import weakref

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.traced import traced

import jaxcable as jc
from jaxcable.common import status

START = jnp.array([-1.2, 1.0])


def valley(x, height):
    """Rosenbrock's function on a plateau; beyond 0.5 in x the analysis is told to fail."""
    value = height * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2 + 1.0
    return value, jnp.where(x[0] > 0.5, status.MECHANISM, status.OK)


def residuals(x, height):
    return jnp.array([jnp.sqrt(height) * (x[1] - x[0] ** 2), 1 - x[0], 0.3 * x[1]])


SEARCHES = {
    "minimize": lambda **more: jc.minimize(valley, START, args=(20.0,), steps=40, **more),
    "fit": lambda **more: jc.fit(residuals, START, args=(20.0,), **more),
}


@pytest.mark.parametrize("name", SEARCHES)
def test_a_search_within_a_program_finds_the_same(name):
    """Same points to rounding, reports of the same numbers."""
    search, own, inside = SEARCHES[name], [], []
    found = search(progress=own.append)
    one = jax.block_until_ready(jax.jit(lambda: search(progress=inside.append))())
    for a, b in zip(*map(jax.tree.leaves, (found, one)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9)
    assert [news.number for news in own] == list(range(int(found.steps) + 1))
    assert len(own) == len(inside) > 3
    for a, b in zip(own, inside, strict=True):
        for field, value in a._asdict().items():
            assert getattr(b, field) == pytest.approx(value, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", SEARCHES)
def test_an_interrupt_ends_the_search(name):
    def interrupt(news):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        SEARCHES[name](progress=interrupt)


@pytest.mark.parametrize("search", [jc.fit, jc.minimize])
def test_functions_are_not_kept_alive(search, collect_young):
    def make():
        wanted = jnp.array([0.0, 2.0])
        return lambda p: p - wanted if search is jc.fit else ((p - wanted) ** 2).sum()

    function = make()
    search(function, START)
    gone = weakref.ref(function)
    del function
    collect_young()
    assert gone() is None


def test_what_a_function_captures_may_be_traced():
    """A derivative or a batch outside of jit: the search is a part of what jax does."""

    def nearest(wanted):
        return jc.fit(lambda x: x - wanted, START).params

    several = jnp.array([[1.0, 2.0], [3.0, -1.0]])
    np.testing.assert_allclose(jax.vmap(nearest)(several), several, atol=1e-9)
    with pytest.raises(ValueError, match="no derivative"):
        jax.jacfwd(nearest)(several[0])


def test_traced_input_that_breaks_a_rule_ends_a_search_at_once():
    @traced
    def run(low, tol):
        given = {"bounds": (low, None), "tol": tol, "steps": 4}
        return jc.minimize(valley, START, args=(20.0,), **given), jc.fit(
            lambda x: x, START, **given
        )

    for low, tol, code in (
        (0.0, 1e-6, status.OUTSIDE),
        (np.nan, 1e-6, status.OUTSIDE),
        (-2.0, -1.0, status.INVALID_INPUT),
    ):
        found, fitted = run(low, tol)
        assert int(found.status) == int(fitted.status) == code
        np.testing.assert_array_equal(found.params, START)
        np.testing.assert_array_equal(fitted.params, START)
        assert np.isnan(found.loss) and np.isnan(fitted.misfit) and np.isnan(found.gradient).all()
        assert int(found.evaluations) == int(fitted.steps) == 0
    found, fitted = run(-2.0, 1e-6)
    assert int(found.status) == int(fitted.status) == status.OUT_OF_STEPS
    assert found.history.loss.shape == fitted.history.misfit.shape == (5,)


def test_random_keys_belong_to_other_programs_too():
    """NumPy knows nothing of keys: searches get their data, and functions of users the keys."""

    def nearest(key):
        return jc.fit(lambda x, key: x - jax.random.normal(key, (2,)), START, args=(key,)).params

    keys = jax.random.split(jax.random.key(0), 2)
    drawn = jnp.stack([jax.random.normal(key, (2,)) for key in keys])
    np.testing.assert_allclose(jax.vmap(nearest)(keys), drawn, atol=1e-9)
    np.testing.assert_allclose(jax.jit(nearest)(keys[1]), drawn[1], atol=1e-9)


def norms(p):
    """Lengths of vectors, of which the first is zero: its length has no derivative."""
    return jnp.linalg.norm(
        jnp.array([[0.0, 0.0], [3.0, 4.0], [1.0, 0.0], [0.0, 1.0]]) * p["scale"][1], axis=1
    )


SCALES = {"other": jnp.array(1.0), "scale": jnp.array([2.0, 2.0])}
UNDEFINED = {
    "fit": (lambda: jc.fit(norms, SCALES), "of value 0 by"),
    "minimize": (lambda: jc.minimize(lambda p: jnp.sqrt(p["scale"][1] - 2.0), SCALES), "by"),
    "constrained": (
        lambda: jc.design.minimize_subject_to(lambda p: (p["scale"][1], norms(p)), SCALES),
        "of value 1 by",  # value 0 is the loss
    ),
    "first order": (
        lambda: jc.reliability.first_order(
            lambda x: 1.0 + jnp.sqrt(x["scale"][1] ** 2),
            {
                "other": jc.reliability.Normal(1.0, 0.1),
                "scale": jc.reliability.Normal([2.0, 0.0], 0.1),
            },
        ),
        "by",
    ),
}


@pytest.mark.parametrize("name", UNDEFINED)
def test_a_derivative_that_is_not_finite_names_the_parameter(name):
    """Where the value is finite: not a failed analysis, but a norm of zero."""
    search, words = UNDEFINED[name]
    with pytest.warns(
        jc.InputWarning, match=rf"{words} .*params.*'scale'\]\[1\].*is not finite"
    ) as told:
        found = search()
    assert int(found.status) == status.BAD_START and len(told) == 1
    assert "norm or a square root of zero" in str(told[0].message)
