"""Sampling, series systems and tolerance budgets beside integrals and SciPy."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, optimize, special, stats

import jaxcable as jc
from jaxcable.reliability import (
    Normal,
    Quantities,
    first_order,
    importance_sampling,
    series_system,
    tolerance_budget,
)

PAIR = {"R": Normal(30.0, 3.0), "S": Normal(18.0, 4.0)}
STANDARD = {"p": Normal(0.0, 1.0), "q": Normal(0.0, 1.0)}


def difference(x):
    return x["R"] - x["S"]


def parabola(x):
    return 5.0 - x["q"] - 0.5 * (x["p"] - 0.1) ** 2


def below_parabola():
    """The probability beyond the parabola of `parabola`, an integral over p."""

    def part(p):
        return stats.norm.pdf(p) * special.ndtr(-(5.0 - 0.5 * (p - 0.1) ** 2))

    return integrate.quad(part, -12, 12, epsabs=1e-14, epsrel=1e-10, limit=200)[0]


def test_importance_sampling_around_two_design_points():
    """Within three standard errors; one of the points alone misses a part, and does not know."""
    centers = [first_order(parabola, STANDARD, start={"p": p}) for p in (-2.0, 2.0)]
    result = importance_sampling(parabola, STANDARD, centers, samples=20_000)
    exact = below_parabola()
    assert abs(result.probability - exact) < 3 * result.standard_error
    assert result.variation < 0.02 and result.n_unknown == 0 and result.samples == 20_000
    assert result.low == result.high == result.probability == result.of_each[0]


def test_the_standard_error_is_that_of_repeated_runs():
    """40 runs: their scatter is known to 11 %, so that 0.6 to 1.5 are more than three of it."""
    found = first_order(difference, PAIR)
    runs = [importance_sampling(difference, PAIR, found, samples=200, key=k) for k in range(40)]
    scatter = np.std([run.probability for run in runs], ddof=1)
    told = np.mean([run.standard_error for run in runs])
    assert 0.6 < scatter / told < 1.5
    mean = np.mean([run.probability for run in runs])
    assert abs(mean - special.ndtr(-2.4)) < 3 * told / np.sqrt(40)


def test_crude_samples_in_several_rounds(monkeypatch):
    monkeypatch.setattr("jaxcable.reliability.sampling._ROUND", 4_000)
    result = importance_sampling(difference, PAIR, samples=10_001)
    p = special.ndtr(-2.4)
    assert result.samples == 10_001
    assert result.probability == pytest.approx(result.n_violated / 10_001, rel=1e-12)
    assert abs(result.probability - p) < 3 * np.sqrt(p * (1 - p) / 10_001)
    share = result.probability  # of a binomial variable
    assert result.standard_error == pytest.approx(np.sqrt(share * (1 - share) / 10_000), rel=1e-9)


def test_failed_analyses_are_bounds_not_counts():
    """Above 2 the analysis fails: what is unknown lies between the bounds, and is listed."""

    def limit_state(x):
        return jnp.where(x["p"] > 2.0, jnp.nan, x["q"] + 1.0)

    result = importance_sampling(limit_state, STANDARD, samples=20_000)
    assert np.isnan(result.probability) and np.isnan(result.of_each).all()
    violated, lost = special.ndtr(-1.0) * special.ndtr(2.0), special.ndtr(-2.0)
    for estimate, exact in ((result.low, violated), (result.high, violated + lost)):
        assert abs(estimate - exact) < 3 * np.sqrt(exact * (1 - exact) / 20_000)
    assert result.high - result.low == pytest.approx(result.n_unknown / 20_000, rel=1e-9)
    assert len(result.unknown_values["p"]) == 100 < result.n_unknown
    assert (result.unknown_values["p"] > 2.0).all()
    # a limit state that is violated for sure makes a sample known
    known = importance_sampling(
        lambda x: jnp.stack([limit_state(x), 2.0 - x["p"]]), STANDARD, samples=20_000
    )
    assert known.n_unknown == 0 and known.probability == pytest.approx(result.high, rel=1e-12)
    assert np.isnan(known.of_each[0]) and known.of_each[1] > 0


def test_no_violation_is_no_probability_of_zero_error():
    result = importance_sampling(lambda x: 20.0 - x["p"], STANDARD, samples=100)
    assert result.probability == 0.0 and np.isnan([result.standard_error, result.variation]).all()


def linear(angles, betas):
    """Linear limit states in the plane of `STANDARD`."""
    return lambda x: jnp.stack(
        [b - np.cos(a) * x["p"] - np.sin(a) * x["q"] for a, b in zip(angles, betas, strict=True)]
    )


@pytest.mark.parametrize("angle", [0.0, 0.02, 0.5, np.pi / 2, 2.5, np.pi])
def test_series_system_of_two(angle):
    """One minus the bivariate normal distribution function by SciPy."""
    betas = [2.0, 2.1]
    system = series_system(first_order(linear([0.0, angle], betas), STANDARD))
    rho = np.cos(angle)
    if abs(rho) < 1 - 1e-9:
        safe = stats.multivariate_normal([0, 0], [[1, rho], [rho, 1]]).cdf(betas)
    else:
        safe = special.ndtr(2.0) if rho > 0 else special.ndtr(2.0) - special.ndtr(-2.1)
    assert system.low == pytest.approx(1 - safe, rel=1e-9)  # of the subtraction: 1e-16 / 0.02
    assert system.high == pytest.approx(float(system.low), rel=1e-13)
    assert system.simple_low <= system.low * (1 + 1e-12)
    assert system.high <= system.simple_high * (1 + 1e-12)


def test_series_system_of_three_and_by_sampling():
    limit_state = linear([0.0, 1.0, 2.0], [1.5, 2.0, 1.8])
    found = first_order(limit_state, STANDARD)
    system = series_system(found)
    sampled = importance_sampling(limit_state, STANDARD, found, samples=40_000)
    assert system.low < system.high < system.simple_high
    margin = 3 * sampled.standard_error
    assert system.low - margin < sampled.probability < system.high + margin
    np.testing.assert_allclose(sampled.of_each, found.probability, rtol=0.1)  # some hundreds each
    separate = [
        first_order(linear([a], [b]), STANDARD) for a, b in ((0, 1.5), (1.0, 2.0), (2, 1.8))
    ]
    assert series_system(separate).low == pytest.approx(float(system.low), rel=1e-12)


# --- tolerances

RNG = np.random.default_rng(0)
MATRIX = RNG.normal(size=(4, 6)) * 1e4  # N/m
ALLOWED = np.array([100.0, 200.0, 150.0, np.inf])


@pytest.mark.parametrize("adding", ["random", "worst"])
def test_cheapest_tolerances_are_those_of_scipy(adding):
    cost = np.arange(1.0, 7.0)
    budget = tolerance_budget(
        MATRIX, ALLOWED, np.zeros(6), choice="cheapest", adding=adding, cost=cost
    )
    power = 2 if adding == "random" else 1
    rows = np.abs(MATRIX[:3] / ALLOWED[:3, None]) ** power * 1e-3**power  # tolerances in mm

    best = optimize.minimize(
        lambda t: np.sum(cost / t),
        np.full(6, 0.5),
        jac=lambda t: -cost / t**2,
        bounds=[(1e-3, None)] * 6,
        constraints={"type": "ineq", "fun": lambda t: 1 - rows @ t**power},
        method="SLSQP",
        options={"ftol": 1e-13, "maxiter": 500},
    )
    assert best.success
    np.testing.assert_allclose(
        1e3 * budget.tolerance, best.x, rtol=1e-4
    )  # flat minimum: sqrt(ftol)
    assert 1e-3 * budget.cost == pytest.approx(best.fun, rel=1e-7)
    equal = tolerance_budget(MATRIX, ALLOWED, np.zeros(6), adding=adding, cost=cost)
    assert budget.cost < 0.99 * equal.cost
    for one in (budget, equal):
        both = jc.design.propagate_tolerances(MATRIX, one.tolerance)
        np.testing.assert_allclose(one.deviation, both[power - 1], rtol=1e-12)
        assert (one.used <= 1 + 1e-9).all() and np.max(one.used) == pytest.approx(1.0, abs=1e-8)
        np.testing.assert_allclose(one.parts.sum(axis=1), 1.0, rtol=1e-12)


def test_equal_contributions_to_the_result_that_is_affected_most():
    budget = tolerance_budget(MATRIX, ALLOWED, np.zeros(6), adding="worst")
    scaled = np.abs(MATRIX[:3]) * np.asarray(budget.tolerance) / ALLOWED[:3, None]
    np.testing.assert_allclose(scaled.max(axis=0), scaled.max(axis=0)[0], rtol=1e-12)
    assert (np.asarray(budget.governing) == scaled.argmax(axis=0)).all()


def test_groups_and_inputs_without_influence():
    """Blocks of groups as `influence` returns them; a column of zeros allows anything."""
    jacobian = {"net": {"net": MATRIX[:2, :2], "guy": np.zeros((2, 1))}}
    like = {"net": np.zeros(2), "guy": np.zeros(1)}
    budget = tolerance_budget(jacobian, {"net": 100.0}, like)
    alone = tolerance_budget(MATRIX[:2, :2], 100.0, np.zeros(2))
    np.testing.assert_allclose(budget.tolerance["net"], alone.tolerance, rtol=1e-14)
    assert np.isinf(budget.tolerance["guy"]).all() and budget.used["net"].shape == (2,)


def test_quantities_of_another_kind_are_refused_by_a_center():
    found = first_order(difference, PAIR)
    other = Quantities({"R": Normal(0.0, 1.0), "T": Normal(0.0, 1.0)})
    with pytest.raises(ValueError, match="center: is for other quantities"):
        importance_sampling(lambda x: x["R"], other, found)
