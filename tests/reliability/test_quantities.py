"""Distributions in both tails beside SciPy, moments by quadrature, correlations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.traced import traced
from scipy import integrate, special, stats

import jaxcable as jc
from jaxcable import reliability
from jaxcable.reliability import Gumbel, Lognormal, Normal, Quantities, Uniform

MEAN, DEVIATION = 3.0, 0.6
ZETA = np.sqrt(np.log(1 + (DEVIATION / MEAN) ** 2))
KINDS = {
    "normal": (Normal, stats.norm(MEAN, DEVIATION)),
    "lognormal": (
        Lognormal,
        stats.lognorm(ZETA, scale=MEAN / np.sqrt(1 + (DEVIATION / MEAN) ** 2)),
    ),
    "gumbel": (
        Gumbel,
        stats.gumbel_r(
            MEAN - np.euler_gamma * DEVIATION * np.sqrt(6) / np.pi, DEVIATION * np.sqrt(6) / np.pi
        ),
    ),
    "uniform": (Uniform, stats.uniform(MEAN - np.sqrt(3) * DEVIATION, 2 * np.sqrt(3) * DEVIATION)),
}
U = np.concatenate([np.linspace(-8, 8, 65), [-1e-9, 1e-9, 0.3]])


@pytest.mark.parametrize("kind", KINDS)
def test_values_in_both_tails_are_those_of_scipy(kind):
    """SciPy from the smaller probability, so that its own values keep their digits."""
    make, known = KINDS[kind]
    expected = np.where(U < 0, known.ppf(special.ndtr(U)), known.isf(special.ndtr(-U)))
    value = traced(jax.vmap(make(MEAN, DEVIATION).value_at_normal))(U)
    # some roundings of either side, of values and of the mean
    np.testing.assert_allclose(value, expected, rtol=2e-14, atol=1e-15)
    for one in (make(MEAN, DEVIATION), make(MEAN, variation=DEVIATION / MEAN)):
        assert known.mean() == pytest.approx(MEAN, rel=1e-14)
        np.testing.assert_allclose(
            one.value_at_normal(1.5), known.isf(special.ndtr(-1.5)), rtol=1e-14
        )


@pytest.mark.parametrize("kind", KINDS)
def test_back_to_the_normal_variable(kind):
    """A value has the digits of u that its own rounding leaves: eps |x| / (dx/du)."""
    make = KINDS[kind][0]
    one = make(MEAN, DEVIATION)
    x, slope = traced(jax.vmap(lambda u: jax.jvp(one.value_at_normal, (u,), (1.0,))))(U)
    back = traced(jax.vmap(one.normal_at_value))(x)
    allowed = 8 * np.finfo(float).eps * (np.abs(x) / slope + np.abs(U) + 1)
    assert np.isfinite(slope).all() and (slope > 0).all()
    resolved = allowed < 0.1  # a uniform quantity near its upper bound has no more digits
    assert resolved.sum() > 0.6 * len(U) and resolved[np.abs(U) <= 5].all()
    assert (np.abs(back - U) <= allowed)[resolved].all()


@pytest.mark.parametrize("kind", KINDS)
def test_the_derivative_is_the_ratio_of_the_densities(kind):
    make, known = KINDS[kind]
    u = U[np.abs(U) <= 5]
    one = make(MEAN, DEVIATION)
    x, slope = traced(jax.vmap(lambda u: jax.jvp(one.value_at_normal, (u,), (1.0,))))(u)
    np.testing.assert_allclose(slope, stats.norm.pdf(u) / known.pdf(x), rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_far_beyond_the_tails_values_are_finite(kind):
    """A step of a search may go there."""
    make = KINDS[kind][0]
    for u in (-39.0, 39.0):
        x, slope = traced(lambda u: jax.jvp(make(MEAN, DEVIATION).value_at_normal, (u,), (1.0,)))(u)
        assert np.isfinite(x) and np.isfinite(slope)


def test_derivatives_by_mean_and_scatter():
    """With a coefficient of variation the deviation follows the mean."""
    u = 1.7
    by_mean = jax.grad(lambda m: Normal(m, DEVIATION).value_at_normal(u))(MEAN)
    following = jax.grad(lambda m: Normal(m, variation=0.2).value_at_normal(u))(MEAN)
    assert by_mean == 1.0 and following == pytest.approx(1 + 0.2 * u, rel=1e-15)


def test_a_dict_keeps_its_order_in_transformations():
    """jax sorts dicts; the matrix of correlations has the order in which they were given."""
    quantities = Quantities(
        {"z": Normal(0.0, 1.0), "a": Normal(np.zeros(2), 2.0), "m": Normal(0.0, 1.0)},
        correlation={("z", "m"): 0.8},
    )
    assert quantities.layout == (("z", ()), ("a", (2,)), ("m", ()))
    u = jnp.array([1.0, 0.5, -0.5, 2.0])
    for function in (Quantities.values_at_normals, traced(Quantities.values_at_normals)):
        values = function(quantities, u)
        assert values["z"] == 1.0 and values["a"].tolist() == [1.0, -1.0]
        assert values["m"] == pytest.approx(0.8 * 1.0 + 0.6 * 2.0, rel=1e-14)  # Cholesky by hand
    np.testing.assert_allclose(quantities.normal_at_value(values), u, rtol=1e-14)
    changed = jc.replace(jax.tree.map(lambda x: x, quantities), correlation=np.eye(4))
    assert changed.layout == quantities.layout


def double_integral(first, second, rho):
    """Correlation of two quantities by the double integral over their normal variables."""

    def inner(x, y):
        density = np.exp(-(x**2 - 2 * rho * x * y + y**2) / (2 * (1 - rho**2)))
        return first(x) * second(y) * density / (2 * np.pi * np.sqrt(1 - rho**2))

    return integrate.dblquad(inner, -8, 8, -8, 8, epsabs=1e-7)[0]


def test_correlation_of_the_values():
    """Beside closed forms and, for a Gumbel and a uniform quantity, the double integral."""
    quantities = Quantities(
        {
            "a": Lognormal(2.0, variation=0.5),
            "b": Lognormal(3.0, variation=0.3),
            "c": Uniform(0.0, 1.0),
            "d": Uniform(1.0, 1.0),
            "e": Gumbel(0.0, 1.0),
        }
    )
    wanted = np.eye(5)
    pairs = {(0, 1): -0.4, (2, 3): 0.6, (2, 4): 0.5}
    for (i, j), value in pairs.items():
        wanted[i, j] = wanted[j, i] = value
    found = reliability.normal_correlation(quantities, wanted)
    lognormal = np.log(1 - 0.4 * 0.5 * 0.3) / np.sqrt(np.log(1.25) * np.log(1.09))
    assert found[0, 1] == pytest.approx(lognormal, rel=1e-10)
    assert found[2, 3] == pytest.approx(2 * np.sin(np.pi * 0.6 / 6), rel=1e-10)  # Pearson 1907
    gumbel = stats.gumbel_r(-np.euler_gamma * np.sqrt(6) / np.pi, np.sqrt(6) / np.pi)
    reached = double_integral(
        lambda x: np.sqrt(12) * (special.ndtr(x) - 0.5),
        lambda y: gumbel.isf(special.ndtr(-y)),
        float(found[2, 4]),
    )
    assert reached == pytest.approx(0.5, abs=1e-6)  # of the integral
    assert (np.asarray(found) == np.asarray(found).T).all() and (np.diag(found) == 1).all()
    slope = jax.grad(
        lambda r: reliability.normal_correlation(quantities, wanted.at[0, 1].set(r))[0, 1]
    )
    wanted = jnp.asarray(wanted)
    by_hand = 0.15 / (1 - 0.4 * 0.15) / np.sqrt(np.log(1.25) * np.log(1.09))
    assert slope(-0.4) == pytest.approx(by_hand, rel=1e-9)


def test_a_correlation_that_cannot_be_is_nan():
    """Two lognormal quantities have one of at least (exp(-ab) - 1) / (V W)."""
    quantities = Quantities({"a": Lognormal(1.0, 1.0), "b": Lognormal(1.0, 1.0)})
    least = (np.exp(-np.log(2)) - 1) / 1.0
    near, beyond = (
        reliability.normal_correlation(quantities, [[1.0, r], [r, 1.0]])[0, 1]
        for r in (least + 1e-3, least - 1e-3)
    )
    assert -1 < near < -0.99 and np.isnan(beyond)
