"""When `fit` and `minimize` say converged: closed-form optima, from starts near and far."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import jaxcable as jc
from jaxcable.common import status

RNG = np.random.default_rng(3)
A, NOISE = RNG.normal(size=(8, 2)), RNG.normal(size=8)
B = A @ [3.0, -2.0] + 0.1 * RNG.normal(size=8)


def beside(p, size):
    """Linear in p[1:]; p[0] has a derivative of `size` and an effect that no derivative shows."""
    wild = jnp.where(jnp.abs(p[0] - 100.0) > 1.0, 1e3, 0.0)
    return A @ p[1:] - B + size * NOISE * (p[0] - 100.0) + wild


@pytest.mark.parametrize("unit", [1.0, 1e9])
def test_a_column_of_rounding_is_left_out(unit):
    """It would lead anywhere, and every step would be refused; the others are those of NumPy."""
    units = jnp.array([1.0, 1.0, 1.0 / unit])
    start = [jnp.array(100.0), jnp.array(0.5), jnp.array(0.5 * unit)]  # an array each: a size each
    fit = jc.fit(lambda p: beside(jnp.stack(p) * units, 1e-15), start)
    assert int(fit.status) == status.OK and int(fit.history.accepted[1]) == 1
    assert [bool(idle) for idle in fit.without_influence] == [True, False, False]
    expected = np.linalg.lstsq(A, B)[0]
    # tol is 1e-6 of the misfit, whose gain is linear in the step
    np.testing.assert_allclose((jnp.stack(fit.params) * units)[1:], expected, rtol=1e-5)
    assert float(fit.params[0]) == 100.0
    sure = jc.design.confidence(fit)
    assert np.isinf(sure.half_width[0]) and np.isfinite(sure.half_width[1:]).all()
    assert sure.rank == 2 and sure.degrees == 6


def test_a_gradient_without_a_step_is_no_minimum():
    """The same, of a size that is no rounding: the derivative is wrong, and no step is accepted."""
    fit = jc.fit(lambda p: beside(p, 1e-6), jnp.array([100.0, 0.5, 0.5]), steps=200)
    assert int(fit.status) == status.STALLED and not fit.without_influence.any()
    nothing = jc.fit(lambda p: 0.0 * p + 1.0, jnp.ones(2))
    assert int(nothing.status) == status.STALLED and nothing.without_influence.all()
    assert "no parameter has an influence" in jc.describe(nothing.status)
    done = jc.fit(lambda p: 0.0 * p, jnp.ones(2))
    assert int(done.status) == status.OK


def test_fits_beside_a_large_misfit():
    """The start is within tol of a misfit that cannot fall, a step is tried; a zero from afar."""
    fit = jc.fit(lambda x: jnp.stack([1e6 + 0.0 * x, x - 1.0]), jnp.array(1.9))
    assert int(fit.status) == status.OK and abs(float(fit.params) - 1.0) < 1e-2
    flat = jc.fit(lambda x: (x - 1.0) ** 2, jnp.array(1e4))
    assert int(flat.status) == status.OK and abs(float(flat.params) - 1.0) < 1e-8


def rosenbrock(x):
    return jnp.sum(100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2)


def quartic(x):
    return jnp.sum((x - 1) ** 4)


PROBLEMS = {
    "quartic": (quartic, [24.0], {}),
    "quartic from far": (quartic, [1e5, 24.0], {}),
    "quartic beside a million": (lambda x: 1e6 + quartic(x), [1e3, 24.0], {}),
    "power 10": (lambda x: jnp.sum((x - 1) ** 10), [24.0], {}),
    "rosenbrock from far": (rosenbrock, [100.0, -50.0], {}),
    "two scales": (lambda x: 1e8 * (x[0] - 1) ** 2 + 1e-8 * (x[1] - 1) ** 2, [0.0, 0.0], {}),
    "twisted scales": (
        lambda x: 1e4 * (x[0] + x[1] - 2) ** 2 + 1e-4 * (x[0] - x[1]) ** 2,
        [30.0, -7.0],
        {},
    ),
    "at its bounds": (lambda x: quartic(x - 2.0 * (x - 1)) + jnp.sum(x), [24.0, 9.0], (1.0, None)),
    "adam": (quartic, [1e3], {"optimizer": optax.adam(5.0), "steps": 1000}),
    "gradient descent": (rosenbrock, [-1.2, 1.0], {"optimizer": optax.sgd(1e-3), "steps": 1000}),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_converged_means_near_the_minimum(name):
    """All have their minimum at 1; steps are within 1e-3 of that, a flat minimum some steps on."""
    loss, start, options = PROBLEMS[name]
    options = {"bounds": options} if isinstance(options, tuple) else dict(options)
    found = jc.minimize(loss, jnp.array(start), **{"steps": 300, **options})
    if "optimizer" in options:  # it crawls
        assert int(found.status) == status.OUT_OF_STEPS
        assert jc.describe(found.status).startswith("maximum number of optimization steps reached")
        return
    assert int(found.status) == status.OK
    # a factor of 0.9 a step, as at a power of 10, leaves ten times the last step
    assert np.abs(np.asarray(found.params) - 1.0).max() < 2e-2
    if "scales" in name:
        assert np.abs(np.asarray(found.params) - 1.0).max() < 1e-3


def test_tolerances_are_refused_or_fail():
    x = jnp.ones(2) * 2
    for call in (
        lambda tol: jc.minimize(quartic, x, tol=tol),
        lambda tol: jc.fit(lambda p: p, x, tol=tol),
        lambda tol: jc.design.minimize_subject_to(lambda p: (quartic(p), 1 - p), x, tol=tol),
    ):
        for tol in (-1.0, 1.0, np.nan):
            with pytest.raises(ValueError, match=r"tol = .*: must be at least 0 and below 1"):
                call(tol)
        with pytest.raises(ValueError, match=r"tol: expected a scalar, got shape \(2,\)"):
            call(np.ones(2))
    traced = jax.jit(lambda tol: jc.minimize(quartic, x, tol=tol).status)
    assert int(traced(2.0)) == status.INVALID_INPUT and int(traced(1e-6)) == status.OK


def test_every_event_has_its_text():
    texts = [jc.describe(code) for code in range(status.STATIONARY + 1)]
    assert len(set(texts)) == len(texts)
    for code, words in {
        status.OUT_OF_STEPS: "maximum number of optimization steps reached",
        status.OUT_OF_POINTS: "maximum number of path points reached",
        status.OUT_OF_EVENTS: "maximum number of events of a path reached",
        status.OUT_OF_TIME_STEPS: "maximum number of time steps",
        status.NOT_CONVERGED: "within the allowed Newton steps",
    }.items():
        assert [words in text for text in texts] == [k == code for k in range(len(texts))]


def test_events_of_a_path_that_are_too_many():
    """Six cables that slacken one after the other, in a record with room for two."""
    nodes = [[0.0, 0, 0], *([0, 0, 1.0 + 0.1 * k] for k in range(6))]
    links = [[0, k] for k in range(1, 7)]
    structure = jc.Structure(
        nodes,
        {"ropes": jc.Cables(links, axial_stiffness=1e3), "post": jc.Bars([[0, 6]], 1e4)},
        supports=jc.pinned(range(1, 7)) + jc.restrained([0], "xy"),
    )
    tight = jc.Phase(pretension={"ropes": 10.0 * np.arange(1, 7), "post": None})
    push = jc.Phase(loads=jc.NodalLoads([0], (0, 0, 2000.0)))
    path = jc.trace_path(structure, [tight, push], events=2)
    assert int(path.status) == status.OUT_OF_EVENTS and len(path.events) == 2
