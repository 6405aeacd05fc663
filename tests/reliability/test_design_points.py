"""All design points: textbook problems, saddles, spheres, searches that end beside the nearest."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.traced import traced
from scipy import optimize, special, stats

from jaxcable import reliability, status
from jaxcable.reliability import Gumbel, Lognormal, Normal, Quantities, first_order

ONE = Normal(0.0, 1.0)
PAIR = {"a": ONE, "b": ONE}


def standard_to_value(kind, mean, deviation, z):
    """The value of a standard normal one as the textbooks transform it."""
    if kind == "normal":
        return mean + deviation * z
    if kind == "lognormal":
        scatter = np.sqrt(np.log(1 + (deviation / mean) ** 2))
        return mean * np.exp(scatter * z - scatter**2 / 2)
    scale = deviation * np.sqrt(6) / np.pi
    return mean - np.euler_gamma * scale - scale * np.log(-np.log(special.ndtr(z)))


def nearest_points(margin, kinds, factor):
    """Indices of all minima of the distance that SLSQP finds from several starts, sorted."""

    def limit_state(u):
        z = u if factor is None else factor @ u
        return margin([standard_to_value(*kind, x) for kind, x in zip(kinds, z, strict=True)])

    size, minima = abs(limit_state(np.zeros(len(kinds)))) or 1.0, []
    for start in np.random.default_rng(0).normal(size=(40 // len(kinds), len(kinds)), scale=1.5):
        found = optimize.minimize(
            lambda u: u @ u,
            start,
            jac=lambda u: 2 * u,
            method="SLSQP",
            constraints={"type": "eq", "fun": lambda u: limit_state(u) / size},
            options={"ftol": 1e-14, "maxiter": 300},
        )
        near = [np.linalg.norm(found.x - point) < 0.05 for point in minima]
        if found.success and not any(near):
            minima.append(found.x)
    return np.sort([np.linalg.norm(point) for point in minima])


# name: limit state, kinds with mean and deviation, correlation, number of design points, published
TEXTBOOK = {
    # Liu and Der Kiureghian, Optimization algorithms for structural reliability (1991)
    "six lognormals": (
        lambda x: x[0] + 2 * x[1] + 2 * x[2] + x[3] - 5 * x[4] - 5 * x[5],
        [*[("lognormal", 120.0, 12.0)] * 4, ("lognormal", 50.0, 15.0), ("lognormal", 40.0, 12.0)],
        *(None, 1, 2.348),
    ),
    # Choi, Grandhi and Canfield, Reliability-based structural design (2007)
    "cubes": (
        lambda x: x[0] ** 3 + x[1] ** 3 - 18.0,
        [("normal", 10.0, 5.0), ("normal", 10.0, 5.0)],
        *(None, 1, 2.2401),
    ),
    "fourth powers": (
        lambda x: x[0] ** 4 + 2 * x[1] ** 4 - 20.0,
        [("normal", 10.0, 5.0), ("normal", 10.0, 5.0)],
        *(None, 1, 2.3654),
    ),
    # Rajashekhar and Ellingwood, A new look at the response surface approach (1993)
    "cantilever": (
        lambda x: 18.46154 - 74769.23 * x[0] / (x[1] / 1e2) ** 3 * 1.0,
        [("normal", 0.001, 0.0002), ("normal", 250.0, 37.5)],
        *(None, 1, 2.331),
    ),
    # Ang and Tang, Probability concepts in engineering planning and design II (1984)
    "plastic moment": (
        lambda x: x[0] * x[1] - x[2],
        [("lognormal", 40.0, 5.0), ("lognormal", 50.0, 2.5), ("gumbel", 1000.0, 200.0)],
        *(None, 1, None),
    ),
    # the index 5.428 that is often printed for it is that of a saddle between two points
    "product": (
        lambda x: x[0] * x[1] - 146.14,
        [("normal", 78064.4, 11709.7), ("normal", 0.0104, 0.00156)],
        *(None, 2, None),
    ),
    # Kuschel and Rackwitz, Two basic problems in reliability-based optimization (1997)
    "short column": (
        lambda x: 1 - 4 * x[0] / (8.668 * 25**2 * x[2]) - (x[1] / (8.668 * 25 * x[2])) ** 2,
        [("normal", 2000.0, 400.0), ("normal", 500.0, 100.0), ("lognormal", 5.0, 0.5)],
        *([[1, 0.5, 0], [0.5, 1, 0], [0, 0, 1]], 1, None),
    ),
    # Der Kiureghian and Dakessian (1998)
    "parabola": (
        lambda x: 5.0 - x[1] - 0.5 * (x[0] - 0.1) ** 2,
        [("normal", 0.0, 1.0)] * 2,
        *(None, 2, 2.906),
    ),
    "symmetric parabola": (  # the search along the axis ends at a saddle
        lambda x: 3.0 - x[0] - 0.3 * x[1] ** 2,
        [("normal", 0.0, 1.0)] * 2,
        *(None, 2, np.sqrt((5 / 3) ** 2 + (3 - 5 / 3) / 0.3)),  # by hand: x = 1 / 0.6
    ),
    "hyperbola": (  # the gradient is zero at the medians; points on the diagonal, by hand
        lambda x: 4.5 - x[0] * x[1],
        [("normal", 0.0, 1.0)] * 2,
        *(None, 2, 3.0),
    ),
    "either side": (  # of a cable's own length: within 31 mm
        lambda x: 31.0**2 - x[0] ** 2,
        [("normal", 1.0, 10.0)],
        *(None, 2, 3.0),
    ),
}
KINDS = {"normal": Normal, "lognormal": Lognormal, "gumbel": Gumbel}


@pytest.mark.parametrize("name", TEXTBOOK)
def test_textbook_problem(name):
    """Beside SLSQP in NumPy, whose minima have 1e-6 and so their distances 1e-9 or better;
    published indices have the digits that are printed."""
    margin, kinds, correlation, count, published = TEXTBOOK[name]
    quantities = Quantities(
        {f"x{k}": KINDS[kind](mean, dev) for k, (kind, mean, dev) in enumerate(kinds)}, correlation
    )
    found = first_order(lambda x: margin([x[f"x{k}"] for k in range(len(kinds))]), quantities)
    assert found.status == status.OK and found.failures == 0
    factor = None if correlation is None else np.linalg.cholesky(correlation)
    exact = nearest_points(margin, kinds, factor)[:count]
    np.testing.assert_allclose(found.points.beta, exact, rtol=1e-7)
    assert found.beta == found.points.beta[0] and 0 < found.curvature
    if published is not None:
        digits = len(f"{published:.12g}".split(".")[-1])
        assert found.beta == pytest.approx(published, abs=10.0**-digits)


def test_a_saddle_is_left_and_both_sides_are_counted():
    """By hand: x = 1 / 0.6, and the curvature 1 - 0.6 beta / |dG/du|^3 across the gradient."""
    found = first_order(lambda x: 3.0 - x["a"] - 0.3 * x["b"] ** 2, PAIR, tol=1e-9)
    place = np.sqrt((3 - 5 / 3) / 0.3)
    assert found.status == status.OK
    np.testing.assert_allclose(np.sort(found.points.u["b"]), [-place, place], rtol=1e-8)
    np.testing.assert_allclose(found.points.u["a"], 5 / 3, rtol=1e-8)
    slope = np.hypot(1.0, 0.6 * place)
    curvature = 1 - 0.6 * float(found.beta) / slope**3
    assert found.curvature == pytest.approx(curvature, abs=1e-3)  # step of the difference
    cosine = (25 / 9 - place**2) / (25 / 9 + place**2)
    density = [[1.0, cosine], [cosine, 1.0]]
    both = stats.multivariate_normal([0, 0], density).cdf(-np.full(2, float(found.beta)))
    union = 2 * special.ndtr(-float(found.beta)) - both
    assert found.probability == pytest.approx(union, rel=1e-6)  # of the cdf of SciPy
    system = reliability.series_system(found)
    assert system.pairs.shape == (2, 2)
    assert system.high == pytest.approx(float(found.probability), rel=1e-12)


def test_unit_vectors_have_the_tolerance_that_is_stated():
    """Near a sphere the misalignment is a small part of the error: curvature 0.1."""

    def margin(x):
        return 3.0 - x["a"] - 0.15 * (x["b"] - 0.1) ** 2

    found = first_order(margin, PAIR, points=1, steps=300)
    # the nearest point by a cubic: the derivative of (3 - 0.15 (b - 0.1)^2)^2 + b^2
    line = 3 - 0.15 * np.polynomial.Polynomial([-0.1, 1.0]) ** 2
    squared = line**2 + np.polynomial.Polynomial([0, 0, 1])
    stationary = [root.real for root in squared.deriv().roots() if abs(root.imag) < 1e-9]
    place = min(stationary, key=squared)
    size = np.sqrt(squared(place))
    assert found.status == status.OK and 0.05 < found.curvature < 0.2
    assert abs(found.u["b"] - place) < 1e-6 * size and found.misalignment < 1e-6 * size
    assert found.alpha["b"] == pytest.approx(place / size, abs=1e-6)
    assert found.beta == pytest.approx(size, rel=1e-11)


def test_sphere_has_no_curvature_and_some_points():
    """Every point of it is nearest; curvature 0, and an exact index."""
    found = first_order(lambda x: 9.0 - x["a"] ** 2 - x["b"] ** 2, PAIR)
    assert found.status == status.OK and found.beta == pytest.approx(3.0, rel=1e-12)
    np.testing.assert_allclose(found.points.curvature, 0.0, atol=1e-3)  # step of the difference
    assert special.ndtr(-3.0) < found.probability < np.exp(-4.5)  # exact


def test_many_quantities_of_which_one_is_felt_twice():
    """A saddle in 200 quantities: the bend in one direction is found by ten products."""

    def margin(x):
        return 3.0 - x["load"][0] - 0.4 * x["load"][7] ** 2

    found = first_order(margin, {"load": Normal(np.zeros(200), 1.0)}, points=2)
    beta = np.sqrt(1.25**2 + (3 - 1.25) / 0.4)  # by hand, as above: x = 1 / 0.8
    assert found.status == status.OK
    np.testing.assert_allclose(found.points.beta, [beta, beta], rtol=1e-9)
    assert found.points.design_point["load"].shape == (2, 200)


def test_the_end_of_a_failed_slab_is_no_design_point():
    """Failure from 3 to 5: the point where it ends, seen from the median, has the other sign."""
    found = first_order(lambda x: (3.0 - x["a"]) * (5.0 - x["a"]), PAIR, start={"a": 6.0})
    assert found.status == status.OK
    np.testing.assert_allclose(found.points.beta, [3.0], rtol=1e-9)
    alone = first_order(lambda x: (3.0 - x["a"]) * (5.0 - x["a"]), {"a": ONE}, start={"a": 6.0})
    assert alone.beta == pytest.approx(3.0, rel=1e-9)


def test_a_nearer_point_that_fails_is_said():
    """Failure beyond 4, or in a wedge whose tip at 3 is a kink, where no search converges."""

    def margin(x):
        return jnp.minimum(4.0 - x["a"], 3.0 - x["b"] + 2 * abs(x["a"]))

    found = first_order(margin, PAIR, start={"a": 4.5})
    assert found.status == status.NOT_NEAREST and np.isnan(found.beta)
    assert np.isnan(found.points.beta).all() and np.isnan(found.probability)


def test_failed_median_counts_the_nearest_point_only():
    """Safe beyond either of two planes: the nearest half-plane holds all that fails."""
    found = first_order(lambda x: x["a"] ** 2 - 4.0, {"a": Normal(0.1, 1.0)})
    assert found.status == status.OK
    np.testing.assert_allclose(found.points.beta, [-1.9, -2.1], rtol=1e-9)
    assert found.probability == pytest.approx(special.ndtr(1.9), rel=1e-9)


def test_traced_search_finds_the_same_points():
    """Derivatives of both indices by the mean are those by hand; that of the union is NaN."""

    def result(mean):
        found = first_order(lambda x: 31.0**2 - x["a"] ** 2, {"a": Normal(mean, 10.0)}, points=2)
        return (found.points.beta, found.beta, found.probability), found.status

    (betas, _, probability), code = jax.jit(result)(1.0)
    assert code == status.OK
    np.testing.assert_allclose(betas, [3.0, 3.2], rtol=1e-9)
    exact = special.ndtr(-3.0) + special.ndtr(-3.2)
    assert probability == pytest.approx(exact, rel=1e-9)
    slopes = traced(jax.jacfwd(lambda mean: result(mean)[0]))(1.0)
    np.testing.assert_allclose(slopes[0], [-0.1, 0.1], rtol=1e-9)
    assert slopes[1] == pytest.approx(-0.1, rel=1e-9) and np.isnan(slopes[2])
