"""`fit` and `confidence`: certified results of NIST, SciPy within bounds, degenerate, failing."""

import contextlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged
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


def bent(p, a, b):
    return jnp.tanh(a @ p) * 3 + 0.1 * (a @ p) - b


@pytest.mark.parametrize("seed", [0, 2])
def test_bounds_as_scipy(seed):
    rng = np.random.default_rng(seed)
    args = jnp.asarray(rng.normal(size=(30, 8))), jnp.asarray(rng.normal(size=30) * 3)
    fit = jc.fit(bent, jnp.zeros(8), (-0.5, 0.5), args=args)
    peer = optimize.least_squares(
        lambda p: np.asarray(bent(p, *args)),
        np.zeros(8),
        jac=lambda p: np.asarray(jax.jacfwd(bent)(p, *args)),
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


def test_what_data_do_not_determine():
    """Only a sum, and nothing of the third: both modes of the Jacobian, and of the intervals."""

    def residuals(p):
        return jnp.stack([p["a"] + p["b"] - 1, p["a"] + p["b"] - 2, 2 * (p["a"] + p["b"])])

    fit = jc.fit(residuals, {"a": jnp.asarray(3.0), "b": jnp.asarray(-1.0), "c": jnp.asarray(7.0)})
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


def test_a_search_that_has_not_converged_shows_what_is_not_determined():
    """Of a sum and a third number the difference is not: its direction is 1, -1, 0."""
    matrix = jnp.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    fit = jc.fit(lambda p: jnp.exp(matrix @ p), jnp.array([1.0, 2.0, 3.0]), steps=1)
    assert int(fit.status) == status.OUT_OF_STEPS
    with pytest.warns(jc.InputWarning, match=r"not converged .OUT_OF_STEPS.*minimum only"):
        interval = design.confidence(fit, deviation=1.0)
    assert interval.rank == 2
    direction = interval.directions[2] * np.sign(interval.directions[2, 0])
    np.testing.assert_allclose(direction, [1.0, -1.0, 0.0], atol=1e-12)  # rounding of an SVD


@pytest.mark.parametrize(
    ("angle", "said"), [(0.0, "infinite"), (0.4, "more than twice as wide"), (0.6, None)]
)
def test_what_a_bound_hides(angle, said):
    """Two columns at an angle: without its bound the error of p[0] is 1 / sin(angle), not 1.

    At an angle of 0.6, 1 / sin is 1.8: no warning, which would be an error here.
    """
    columns = jnp.array([[1.0, np.cos(angle)], [0.0, np.sin(angle)]])
    high = jnp.array([jnp.inf, 1.0])
    fit = jc.fit(lambda p: columns @ p - 3.0 * columns[:, 1], jnp.zeros(2), (None, high))
    assert int(fit.status) == 0 and not bool(fit.free[1])
    words = rf"params\[1\] is at.*params\[0\] would be {said}"
    with pytest.warns(jc.InputWarning, match=words) if said else contextlib.nullcontext():
        interval = design.confidence(fit, deviation=1.0)
    assert float(interval.standard_error[0]) == pytest.approx(1.0, rel=1e-9)
    assert interval.rank == 1


def walled(x, code):
    """Zero at 1, 1; fails where x[0] < 0.2, whereto steps lead: NaN, or a status."""
    failed = x[0] < 0.2
    x = jnp.where(failed & (code == 0), jnp.nan, jnp.maximum(x, 0.2))
    return jnp.array([jnp.log(x[0]), x[1] - x[0]]), jnp.where(failed, code, 0)


@pytest.mark.parametrize("code", [0, status.MECHANISM])
def test_failures_are_avoided_and_said(code):
    told = code or status.NONFINITE
    fit = jc.fit(walled, jnp.array([5.0, 1.0]), args=(jnp.int32(code),))
    assert int(fit.status) == 0 and jnp.abs(fit.params - 1).max() < 1e-6
    assert set(np.unique(fit.history.status)) == {-1, 0, told}
    bad = jc.fit(walled, jnp.array([0.1, 1.0]), args=(jnp.int32(code),))
    assert int(bad.status) == status.BAD_START and int(bad.history.status[0]) == told
    assert np.isnan(float(bad.misfit))


def test_a_cliff_and_a_vanishing_sensitivity_are_no_minima():
    """The Jacobian falls by 1e13 on the way: exp(p) = 1 from p = 30."""
    stuck = jc.fit(lambda x: jnp.where(x < 0.5, jnp.nan, x), jnp.array([2.0]), steps=1000)
    assert int(stuck.status) == status.STALLED
    fit = converged(jc.fit(lambda p: jnp.exp(p) - 1, jnp.array([30.0]), tol=1e-9, steps=200))
    assert abs(float(fit.params[0])) < 5e-3  # the rounding of the first residual, 1e13, is 2e-3


def test_noise_ends_an_iteration():
    """Residuals with a noise of 1e-9, as an analysis has, and less to gain than that, or none."""
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(4, 2)), rng.normal(size=4)

    def residuals(p, b):
        return a @ p - b + 1e-9 * jnp.sin(1e6 * p[0])

    for wanted, tol in ((b, None), (b, 1e-9), (a @ [1.0, -2.0], 1e-9)):
        fit = converged(jc.fit(residuals, jnp.zeros(2), tol=tol, args=(jnp.asarray(wanted),)))
        # the slope of the noise, 1e-3, times a sum of four residuals with a norm of 1.5, at most 3,
        # over the least squared singular value of a, 0.45
        assert np.abs(np.asarray(fit.params) - np.linalg.lstsq(a, wanted)[0]).max() < 7e-3


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
    assert int(scaled.status) == 0 and int(scaled.steps) == int(fits.steps[0])


def test_history_and_progress():
    """The misfit only falls; what is told is the history, which ends with the last trial."""
    reports = []
    fit = jc.fit(rosenbrock, jnp.array([-1.2, 1.0]), progress=reports.append)
    assert int(fit.status) == 0 and jnp.abs(fit.params - 1).max() < 1e-9
    jax.effects_barrier()
    reports.sort(key=lambda news: news.number)
    n = int(fit.steps)
    misfit, accepted = np.asarray(fit.history.misfit), np.asarray(fit.history.accepted)
    assert (accepted[: n + 1] >= 0).all() and (accepted[n + 1 :] == -1).all()
    taken = misfit[accepted == 1]
    assert (np.diff(taken) < 0).all() and taken[-1] == float(fit.misfit)
    assert [news.number for news in reports] == list(range(n + 1))
    assert [news.misfit for news in reports] == misfit[: n + 1].tolist()
    assert [news.accepted for news in reports] == accepted[: n + 1].tolist()
    assert str(reports[0]).startswith("trial 0 of 100: misfit ")
    refused = next(news for news in reports if not news.accepted)
    assert str(refused).endswith(", not accepted")


def test_a_search_that_zigzags_across_a_kink_ends():
    """Residuals that are the larger of two: the least is at kinks, found by Nelder and Mead.

    Once 100 trial points; ten of which five are refused and the rest gain 1e-4 are enough.
    """

    def residuals(p, xp=jnp):
        one, other = xp.maximum(p[0], 2 * p[1]) + 3, 4 * xp.maximum(-p[0], -p[1]) + 2
        return xp.stack([one, other, p[0] * p[1] + 1])

    def squares(p):
        return np.sum(residuals(p, np) ** 2)

    found = jc.fit(residuals, jnp.array([2.0, -1.0]))
    best = optimize.minimize(squares, [0.0, 0.0], method="Nelder-Mead", tol=1e-9)
    assert int(found.status) == status.STALLED and int(found.steps) <= 20
    assert best.fun <= found.misfit**2 < best.fun * (1 + 1e-3)
