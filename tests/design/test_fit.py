"""`fit` and `confidence`: certified results of NIST, SciPy within bounds, degenerate, failing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize

import jaxcable as jc
from jaxcable import design
from jaxcable.common import status

# NIST StRD, Misra1a (dental research, monomolecular adsorption): data and certified values
X, Y = np.array(
    [
        (77.6, 10.07), (114.9, 14.73), (141.1, 17.94), (190.8, 23.93), (239.9, 29.61),
        (289.0, 35.18), (332.8, 40.02), (378.4, 44.82), (434.8, 50.76), (477.3, 55.05),
        (536.8, 61.01), (593.1, 66.40), (689.1, 75.47), (760.0, 81.78),
    ]
).T  # fmt: skip
CERTIFIED = np.array([2.3894212918e02, 5.5015643181e-04])
DEVIATIONS = np.array([2.7070075241e00, 7.2668688436e-06])
SQUARES, RESIDUAL_DEVIATION = 1.2455138894e-01, 1.0187876330e-01


def misra(p):
    return Y - p[0] * (1 - jnp.exp(-p[1] * X))


def rosenbrock(x):
    return jnp.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])


@pytest.mark.parametrize("start", [(500.0, 1e-4), (250.0, 5e-4)])
def test_certified_values(start):
    """Both starts of NIST; ten digits of the sum, six of the parameters (the sum is flat there)."""
    fit = jc.fit(misra, jnp.array(start))
    assert int(fit.status) == 0 and int(fit.steps) < 20
    assert abs(float(fit.misfit) ** 2 / SQUARES - 1) < 1e-9
    assert np.abs(np.asarray(fit.params) / CERTIFIED - 1).max() < 1e-6
    interval = design.confidence(fit, level=0.95)
    assert np.abs(np.asarray(interval.standard_error) / DEVIATIONS - 1).max() < 1e-5
    assert abs(interval.deviation / RESIDUAL_DEVIATION - 1) < 1e-9
    assert interval.rank == 2 and interval.degrees == 12
    # Student's t at 0.975 and 12 degrees of freedom, from a table
    assert np.abs(np.asarray(interval.half_width) / (2.17881 * DEVIATIONS) - 1).max() < 1e-5


@pytest.mark.parametrize("seed", [0, 2])
def test_bounds_as_scipy(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(30, 8)), rng.normal(size=30) * 3

    def residuals(p):
        return jnp.tanh(a @ p) * 3 + 0.1 * (a @ p) - b

    fit = jc.fit(residuals, jnp.zeros(8), (-0.5, 0.5))
    slope = jax.jacfwd(residuals)
    peer = optimize.least_squares(
        lambda p: np.asarray(residuals(p)),
        np.zeros(8),
        jac=lambda p: np.asarray(slope(p)),
        bounds=(-0.5, 0.5),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-12,
    )
    assert int(fit.status) == 0
    # stops when 1e-6 of the misfit is left to gain along any direction, 1e-12 of its square
    assert abs(float(fit.misfit) - np.sqrt(2 * peer.cost)) < 1e-10
    assert np.abs(np.asarray(fit.params) - peer.x).max() < 1e-5
    at_bound = np.abs(np.asarray(fit.params)) == 0.5
    assert at_bound.any() and (at_bound == (peer.active_mask != 0)).all()
    assert (np.asarray(fit.free) == ~at_bound).all()
    interval = design.confidence(fit)
    assert np.isnan(np.asarray(interval.half_width))[at_bound].all()
    assert np.isfinite(np.asarray(interval.half_width))[~at_bound].all()


def test_misfit_only_falls_and_history_ends():
    fit = jc.fit(rosenbrock, jnp.array([-1.2, 1.0]), steps=40)
    assert int(fit.status) == 0
    assert jnp.abs(fit.params - 1).max() < 1e-9
    n = int(fit.steps)
    history = fit.history
    misfit = np.asarray(history.misfit)
    accepted = np.asarray(history.accepted)
    assert (accepted[: n + 1] >= 0).all() and (accepted[n + 1 :] == -1).all()
    taken = misfit[accepted == 1]
    assert (np.diff(taken) < 0).all() and taken[-1] == float(fit.misfit)


def test_what_data_do_not_determine():
    """Only a sum, and nothing of the third: both modes of the Jacobian, and of the intervals."""

    def residuals(p):
        return jnp.stack([p["a"] + p["b"] - 1, p["a"] + p["b"] - 2, 2 * (p["a"] + p["b"])])

    start = {"a": jnp.asarray(3.0), "b": jnp.asarray(-1.0), "c": jnp.asarray(7.0)}
    fit = jc.fit(residuals, start)
    assert int(fit.status) == 0
    total = float(fit.params["a"] + fit.params["b"])
    assert abs(total - 0.5) < 1e-6  # normal equations: 6 s = 3
    assert float(fit.params["c"]) == 7.0
    assert abs(float(fit.params["a"] - fit.params["b"]) - 4.0) < 1e-6  # moved no more than needed
    interval = design.confidence(fit)
    assert interval.rank == 1 and all(np.isinf(v) for v in interval.half_width.values())
    one = jc.fit(lambda p: jnp.array([jnp.sum(p) - 1]), jnp.zeros(3))
    assert int(one.status) == 0 and jnp.abs(one.params - 1 / 3).max() < 1e-9
    with pytest.raises(ValueError, match="deviation: 1 residuals cannot tell"):
        design.confidence(one)
    assert design.confidence(one, deviation=0.1).rank == 1


def test_failures_are_avoided_and_said():
    def residuals(x):
        x = jnp.where(x[0] < 0.2, jnp.nan, x)
        return jnp.array([10 * (x[1] - x[0] ** 2), 1 - x[0], 3 * jnp.log(x[0])])

    def coded(x):
        return residuals(jnp.maximum(x, 0.2)), jnp.where(x[0] < 0.2, status.MECHANISM, 0)

    start = jnp.array([3.0, 20.0])
    fit = jc.fit(residuals, start, args=())
    assert int(fit.status) == 0 and jnp.abs(fit.params - 1).max() < 1e-6
    assert set(np.unique(fit.history.status)) <= {-1, 0, status.NONFINITE}
    assert int(jc.fit(coded, start).status) == 0
    bad = jc.fit(coded, jnp.array([0.1, 1.0]))
    assert int(bad.status) == status.BAD_START
    assert int(bad.history.status[0]) == status.MECHANISM
    assert np.isnan(float(bad.misfit))

    def cliff(x):
        return jnp.where(x < 0.5, jnp.nan, x)

    stuck = jc.fit(cliff, jnp.array([2.0]), steps=1000)
    assert int(stuck.status) == status.STALLED
    assert int(jc.fit(rosenbrock, jnp.array([-1.2, 1.0]), steps=3).status) == status.OUT_OF_STEPS


@pytest.mark.slow
def test_a_net_within_bounds():
    """Tensions that no net has, pretensions that all want to leave their bounds: as SciPy."""
    structure, (_, loading) = jc.scenes.flat_net(load=15.0, increments=(1, 1))

    def residuals(tension, target):
        solution = jc.solve(structure, [jc.Phase(pretension=tension), loading])
        return solution.tension - target, solution

    start = 200.0 * jnp.ones(12)
    value = jax.jit(lambda p, target: residuals(p, target)[0])
    slope = jax.jit(jax.jacfwd(lambda p, target: residuals(p, target)[0]))
    for seed in (1, 2):
        target = jnp.asarray(np.random.default_rng(seed).uniform(50, 500, 12))
        fit = jc.fit(residuals, start, (50.0, 400.0), args=(target,))
        peer = optimize.least_squares(
            lambda p, t=target: np.asarray(value(p, t)),
            np.asarray(start),
            jac=lambda p, t=target: np.asarray(slope(p, t)),
            bounds=(50, 400),
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
        )
        assert int(fit.status) == 0 and int(fit.steps) < 30
        assert abs(float(fit.misfit) / np.sqrt(2 * peer.cost) - 1) < 1e-8
        assert np.abs(np.asarray(fit.params) - peer.x).max() < 1e-2


def test_a_vanishing_sensitivity_is_no_minimum():
    """The Jacobian falls by 1e13 on the way: exp(p) = 1 from p = 30."""
    fit = jc.fit(lambda p: jnp.exp(p) - 1, jnp.array([30.0]), tol=1e-9, steps=200)
    assert int(fit.status) == 0
    assert abs(float(fit.params[0])) < 5e-3  # the rounding of the first residual, 1e13, is 2e-3


@pytest.mark.parametrize("tol", [None, 1e-9])
def test_noise_ends_an_iteration(tol):
    """Residuals with a noise of 1e-9, as an analysis has, and less to gain than that."""
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(4, 2)), rng.normal(size=4)
    fit = jc.fit(lambda p: a @ p - b + 1e-9 * jnp.sin(1e6 * p[0]), jnp.zeros(2), tol=tol)
    assert int(fit.status) == 0
    assert np.abs(np.asarray(fit.params) - np.linalg.lstsq(a, b)[0]).max() < 1e-3


def test_batches_float32_and_units():
    starts = jnp.array([[-1.2, 1.0], [3.0, 3.0], [0.0, 0.0]])
    fits = jax.vmap(lambda x: jc.fit(rosenbrock, x))(starts)
    assert fits.status.tolist() == [0, 0, 0]
    assert jnp.abs(fits.params - 1).max() < 1e-9
    small = jc.fit(rosenbrock, starts[0].astype(jnp.float32))
    assert int(small.status) == 0 and small.params.dtype == jnp.float32
    assert jnp.abs(small.params - 1).max() < 1e-3
    scaled = jc.fit(
        lambda p: rosenbrock(jnp.array([p[0] * 2.0**20, p[1]])), jnp.array([-1.2 * 2.0**-20, 1.0])
    )
    assert int(scaled.steps) == int(fits.steps[0])


def test_progress_is_that_of_the_history():
    reports = []
    fit = jc.fit(rosenbrock, jnp.array([-1.2, 1.0]), progress=reports.append)
    jax.effects_barrier()
    reports.sort(key=lambda news: news.number)
    n = int(fit.steps)
    assert [news.number for news in reports] == list(range(n + 1))
    assert [news.misfit for news in reports] == fit.history.misfit[: n + 1].tolist()
    assert [news.accepted for news in reports] == fit.history.accepted[: n + 1].tolist()
    assert str(reports[0]).startswith("trial 0 of 100: misfit ")
    refused = next(news for news in reports if not news.accepted)
    assert str(refused).endswith(", not accepted")


def test_wrong_arguments():
    x = jnp.array([-1.2, 1.0])
    with pytest.raises(ValueError, match="residuals: expected a function"):
        jc.fit(x, x)
    with pytest.raises(ValueError, match="residuals: expected arrays of floats"):
        jc.fit(lambda p: jnp.zeros(0), x)
    with pytest.raises(ValueError, match=r"params\[1\] = 1: the start is below its lower bound, 2"):
        jc.fit(rosenbrock, x, (jnp.array([-2.0, 2.0]), None))
    with pytest.raises(ValueError, match="steps = 0"):
        jc.fit(rosenbrock, x, steps=0)
    short = jc.fit(misra, jnp.array([500.0, 1e-4]), steps=2)
    with pytest.raises(ValueError, match="fit: has not converged"):
        design.confidence(short)
    with pytest.raises(ValueError, match=r"level = 2"):
        design.confidence(jc.fit(misra, jnp.array([250.0, 5e-4])), level=2)
