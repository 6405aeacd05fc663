"""When `fit`, `minimize` and `minimize_subject_to` say converged: closed forms, near and far."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.common import status

# --- misfits

RNG = np.random.default_rng(3)
A, NOISE = RNG.normal(size=(8, 2)), RNG.normal(size=8)
B = A @ [3.0, -2.0] + 0.1 * RNG.normal(size=8)


def beside(p, size):
    """Linear in p[1:]; p[0] has a derivative of `size` and an effect that no derivative shows."""
    wild = jnp.where(jnp.abs(p[0] - 100.0) > 1.0, 1e3, 0.0)
    return A @ p[1:] - B + size * NOISE * (p[0] - 100.0) + wild


def in_units(p, units, size):
    return beside(jnp.stack(p) * units, size)


@pytest.mark.parametrize("unit", [1.0, 1e9])
def test_a_column_of_rounding_is_left_out(unit):
    """It would lead anywhere, and every step would be refused; the others are those of NumPy."""
    units = jnp.array([1.0, 1.0, 1.0 / unit])
    start = [jnp.array(100.0), jnp.array(0.5), jnp.array(0.5 * unit)]  # an array each: a size each
    fit = jc.fit(in_units, start, args=(units, 1e-15))
    assert int(fit.status) == status.OK and int(fit.history.accepted[1]) == 1
    assert [bool(idle) for idle in fit.without_influence] == [True, False, False]
    expected = np.linalg.lstsq(A, B)[0]
    # tol is 1e-6 of the misfit, whose gain is linear in the step
    np.testing.assert_allclose((jnp.stack(fit.params) * units)[1:], expected, rtol=1e-5)
    assert float(fit.params[0]) == 100.0
    sure = jc.design.confidence(fit)
    assert np.isinf(sure.half_width[0]) and np.isfinite(sure.half_width[1:]).all()
    assert sure.rank == 2 and sure.degrees == 6


def test_fits_that_do_not_converge():
    """A derivative that is wrong, by more than rounding: no step is accepted; and no influence."""
    fit = jc.fit(beside, jnp.array([100.0, 0.5, 0.5]), args=(1e-6,), steps=200)
    assert int(fit.status) == status.STALLED and not fit.without_influence.any()
    nothing = jc.fit(lambda p, value: 0.0 * p + value, jnp.ones(2), args=(1.0,))
    assert int(nothing.status) == status.STALLED and nothing.without_influence.all()
    assert "no parameter has an influence" in jc.describe(nothing.status)
    converged(jc.fit(lambda p: 0.0 * p, jnp.ones(2)))


def test_fits_beside_a_large_misfit():
    """The start is within tol of a misfit that cannot fall, a step is tried; a zero from afar."""
    fit = jc.fit(lambda x: jnp.stack([1e6 + 0.0 * x, x - 1.0]), jnp.array(1.9))
    assert int(fit.status) == status.OK and abs(float(fit.params) - 1.0) < 1e-2
    flat = jc.fit(lambda x: (x - 1.0) ** 2, jnp.array(1e4))
    assert int(flat.status) == status.OK and abs(float(flat.params) - 1.0) < 1e-8


@pytest.mark.parametrize("seed", range(2))
def test_a_zero_that_noise_hides(seed):
    """Equations of a condition of 1e4, known to 3e-10 as results of an analysis are.

    At the end no step lowers the misfit, and steps of 1e-6 are promised to make it zero.
    """
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
    matrix, exact = left @ np.diag([1.0, 1e-2, 1e-4]) @ right, np.array([3.0, -2.0, 1.0])

    def equations(p, matrix):
        noise = 3e-10 * jnp.sin(1e9 * jax.lax.stop_gradient(p) * jnp.array([1.0, 1.7, 2.3]))
        return matrix @ (p - exact) + noise

    fit = jc.fit(equations, jnp.full(3, 0.5), args=(matrix,))
    assert int(fit.status) == status.OK and int(fit.history.accepted[fit.steps]) == 0
    assert float(fit.misfit) < 1e-9
    np.testing.assert_allclose(fit.params, exact, atol=1e-5)  # noise over 1e-4


# --- losses


def family(x, offset=0.0, power=4.0, weights=(1.0, 1.0), slope=0.0):
    """``offset + sum(weights |x - 1|^power + slope x)``."""
    away = jnp.asarray(weights) * ((x - 1) ** 2) ** (power / 2)
    return offset + jnp.sum(away + slope * x)


def rosenbrock(x):
    return jnp.sum(100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2)


def twisted(x):
    return 1e4 * (x[0] + x[1] - 2) ** 2 + 1e-4 * (x[0] - x[1]) ** 2


ALIKE = np.ones(2)
PROBLEMS = {  # loss, start, args, bounds; those of `family` are one program
    "quartic from far": (family, [1e5, 24.0], (0.0, 4.0, ALIKE, 0.0), None),
    "quartic beside a million": (family, [1e3, 24.0], (1e6, 4.0, ALIKE, 0.0), None),
    "power 10": (family, [24.0, 3.0], (0.0, 10.0, ALIKE, 0.0), None),
    "two scales": (family, [0.0, 0.0], (0.0, 2.0, np.array([1e8, 1e-8]), 0.0), None),
    "at its bounds": (family, [24.0, 9.0], (0.0, 4.0, ALIKE, 1.0), (1.0, None)),
    "rosenbrock from far": (rosenbrock, [100.0, -50.0], (), None),
    "twisted scales": (twisted, [30.0, -7.0], (), None),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_converged_means_near_the_minimum(name):
    """All have their minimum at 1; steps are within 1e-3 of that, a flat minimum some steps on."""
    loss, start, args, bounds = PROBLEMS[name]
    found = converged(jc.minimize(loss, jnp.array(start), bounds, args=args, steps=300))
    # a factor of 0.9 a step, as at a power of 10, leaves ten times the last step
    near = 1e-3 if "scales" in name else 2e-2
    assert np.abs(np.asarray(found.params) - 1.0).max() < near


@pytest.mark.parametrize(
    ("loss", "start", "optimizer"),
    [(family, [1e3, 1e3], optax.adam(5.0)), (rosenbrock, [-1.2, 1.0], optax.sgd(1e-3))],
    ids=["adam", "gradient descent"],
)
def test_crawling_is_not_converged(loss, start, optimizer):
    found = jc.minimize(loss, jnp.array(start), optimizer=optimizer, steps=200)
    assert int(found.status) == status.OUT_OF_STEPS
    assert jc.describe(found.status).startswith("maximum number of optimization steps reached")


def wavy(x, offset, wave, first, second, slope):
    return offset + wave * jnp.cos(x[0]) + first * x[0] ** 2 + second * x[1] ** 2 + slope * x.sum()


HILL = (2.0, 1.0, 0.0, -1.0, 0.0)  # highest at zero: f(0) = 3, f(1, 0) < 3
SADDLE = (5.0, 0.0, 1.0, -1.0, 0.0)
FLAT = (4.0, 0.0, 0.0, 0.0, 0.0)
BOWL = (1.125, 0.0, 1.0, 1.0, -0.5)  # 1 + |x - 1/4|^2
TILTED = (3.0, 0.0, 0.0, 0.0, 1.0)


def test_a_start_without_slope_is_not_called_converged():
    """Nothing shows whether it is a minimum; what has been come to is one."""
    start = jnp.zeros(2)
    several = jax.vmap(lambda x, args: jc.minimize(wavy, x, args=args).status, (0, None))
    for args in (HILL, SADDLE, FLAT):
        # no minimum, or none alone
        assert wavy(start + 0.1 * jnp.array([0.0, 1.0]), *args) <= wavy(start, *args)
        found = jc.minimize(wavy, start, args=args)
        assert found.status == status.STATIONARY and found.steps == 0
        np.testing.assert_array_equal(found.params, start)
        both = several(jnp.array([[0.0, 0.0], [0.3, 0.2]]), args)
        assert both[0] == status.STATIONARY and (args is FLAT) == (both[1] == both[0])
    text = jc.describe(found.status)
    assert text.startswith("the start is stationary") and "minimum" in text and "maximum" in text
    assert "converged" not in text
    with pytest.raises(jc.AnalysisError, match="the start is stationary"):
        jc.raise_if_failed(found)
    found = jc.minimize(wavy, start, args=HILL, optimizer=optax.adam(0.1))
    assert found.status == status.STATIONARY
    at_the_minimum = jc.minimize(wavy, jnp.full(2, 0.25), args=BOWL)
    assert at_the_minimum.status == status.STATIONARY and int(at_the_minimum.evaluations) == 1
    for start in ([0.5, 0.3], [0.251, 0.249], [0.25, 0.25 + 1e-9]):
        found = jc.minimize(wavy, jnp.array(start), args=BOWL)
        assert found.status == status.OK and 0 < int(found.evaluations) < 20
        np.testing.assert_allclose(found.params, 0.25, atol=1e-6)


def test_a_start_that_its_bounds_hold_is_a_minimum():
    """The slope is not zero there, and every way inside goes up."""
    start = jnp.array([1.0, 2.0])
    found = jc.minimize(wavy, start, (start, None), args=TILTED)
    assert found.status == status.OK and found.steps == 0 and found.params.tolist() == [1.0, 2.0]
    one = (3.0, 0.0, 0.0, -1.0, 0.0)  # held by a bound in one number, flat in the other
    found = jc.minimize(wavy, jnp.array([0.5, 1.0]), (0.0, 1.0), args=one)
    assert found.status == status.STATIONARY


def test_the_top_of_a_misfit_is_not_called_converged():
    """x^2 + (3 - x^2)^2 has a maximum at zero, 9, and minima of 2.75 where x^2 = 2.5."""

    def residuals(x):
        return jnp.array([x[0], 3.0 - x[0] ** 2])

    assert (residuals(jnp.array([0.1])) ** 2).sum() < 9.0
    assert jc.fit(residuals, jnp.array([0.0])).status == status.STATIONARY
    found = converged(jc.fit(residuals, jnp.array([0.5])))
    np.testing.assert_allclose(found.params**2, 2.5, rtol=1e-4)
    exact = jc.fit(lambda x: x - 1.0, jnp.array([1.0]))
    assert exact.status == status.OK  # no misfit is less than none


def test_limits_with_a_start_without_slope():
    def problem(x, *args):
        return wavy(x, *args), jnp.array([x[0] - 10.0])

    found = jc.design.minimize_subject_to(problem, jnp.zeros(2), args=HILL)
    assert found.status == status.STATIONARY and found.kkt_residual <= 1e-6
    found = converged(jc.design.minimize_subject_to(problem, jnp.zeros(2), args=BOWL))
    np.testing.assert_allclose(found.params, 0.25, atol=1e-4)
    # a limit holds the start: its slope is not zero
    found = jc.design.minimize_subject_to(
        lambda x: (3.0 + x.sum(), -x - 1e-6), jnp.zeros(2), bounds=(-1.0, 1.0)
    )
    assert found.status == status.OK


@pytest.mark.slow
def test_a_target_that_is_met_already_is_no_failure(tmp_path, monkeypatch, capsys):
    """But for rounding: of a sum of squares nothing is below zero."""
    monkeypatch.chdir(tmp_path)
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]
    structure = jc.Structure(nodes, jc.Cables([[0, 1], [1, 2]], 1e5), jc.pinned([0, 2]))
    jc.save_scene("met.json", (structure, [jc.Phase(pretension=128.0)]))
    assert main(["optimize", "met.json", "--target", "128", "--save", "t.json"]) == 0
    assert "status 0: converged" in capsys.readouterr().out
    np.testing.assert_allclose(jc.load_scene("t.json").phases[0].pretension, 128.0)


# --- tolerances, and texts of statuses


def test_every_event_has_its_text():
    texts = [jc.describe(code) for code in range(status.NOT_NEAREST + 1)]
    assert len(set(texts)) == len(texts)
    for code, words in {
        status.OUT_OF_STEPS: "maximum number of optimization steps reached",
        status.OUT_OF_POINTS: "maximum number of path points reached",
        status.OUT_OF_EVENTS: "maximum number of events of a path reached",
        status.OUT_OF_TIME_STEPS: "maximum number of time steps",
        status.NOT_CONVERGED: "within the allowed Newton steps",
    }.items():
        assert [words in text for text in texts] == [k == code for k in range(len(texts))]
