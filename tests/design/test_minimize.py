"""`minimize`: against SciPy within bounds, with every kind of optimizer, with failing analyses."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from banks.shapes import cross
from oracles.traced import traced
from scipy import optimize

import jaxcable as jc
from jaxcable.common import status
from jaxcable.design.descent import LBFGS

X0 = jnp.array([-1.2, 1.0, -1.2, 1.0])
UPPER = jnp.array([0.5, 2.0, 0.3, 2.0])


def rosenbrock(x):
    return jnp.sum(100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2)


@functools.cache
def by_scipy():
    slope = jax.grad(rosenbrock)
    return optimize.minimize(
        lambda x: float(rosenbrock(x)),
        np.clip(X0, -2, UPPER),
        jac=lambda x: np.asarray(slope(x)),
        bounds=[(-2, u) for u in UPPER],
        method="L-BFGS-B",
        options={"ftol": 0, "gtol": 1e-9},
    )


@pytest.mark.parametrize(
    ("optimizer", "steps"),
    [(None, 100), (optax.lbfgs(), 100), (optax.adam(0.02), 3000)],
    ids=["default", "lbfgs", "adam"],
)
def test_bounded_minimum_is_that_of_scipy(optimizer, steps):
    start = jnp.clip(X0, -2.0, UPPER)
    design = jc.minimize(rosenbrock, start, (-2.0, UPPER), optimizer, steps=steps, tol=1e-7)
    assert int(design.status) == 0
    # a gradient of tol times the loss leaves tol^2 of it, over the curvature, to gain
    assert abs(float(design.loss) - by_scipy().fun) < 1e-9
    assert jnp.abs(design.params - by_scipy().x).max() < 1e-5
    assert float(design.params[0]) == 0.5  # at its bound exactly
    assert float(design.gradient_norm) <= 1e-7
    n = int(design.steps)
    loss = np.asarray(design.history.loss)
    assert np.isfinite(loss[: n + 1]).all() and np.isnan(loss[n + 1 :]).all()
    assert loss[n] == float(design.loss)
    if optimizer is None:
        assert (np.diff(loss[: n + 1]) <= 1e-9 * loss[:n]).all()  # it only falls


@pytest.mark.parametrize("seed", range(3))
def test_random_quadratics_within_a_box(seed):
    """Most entries end at a bound; the optimality conditions are checked by NumPy."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(30, 30)))
    matrix = q @ np.diag(np.logspace(0, 3, 30)) @ q.T
    vector = matrix @ rng.normal(size=30) * 2
    design = jc.minimize(
        lambda x: 0.5 * x @ matrix @ x - vector @ x, jnp.zeros(30), (-1.0, 1.0), steps=300
    )
    assert int(design.status) == 0
    x = np.asarray(design.params)
    assert (np.abs(x) <= 1).all() and (np.abs(x) == 1).sum() > 5
    slope = matrix @ x - vector
    inside = np.abs(x) < 1
    # sizes are 1 here, and tol is 1e-6 of the loss
    assert np.abs(slope[inside]).max() <= 1e-6 * abs(float(design.loss)) * (1 + 1e-9)
    assert (slope[~inside] * x[~inside] <= 0).all()


def test_units_do_not_matter():
    """Metres or millimetres, newtons or meganewtons: the default takes the same steps."""

    def loss(p, a, b):
        return b * rosenbrock(jnp.stack([p["x"] / a, p["y"]]))

    def run(a, b):
        start = {"x": jnp.asarray(-1.2 * a), "y": jnp.asarray(1.0)}
        return jc.minimize(loss, start, steps=60, args=(a, b))

    one, other = run(1.0, 1.0), run(2.0**10, 2.0**-20)
    assert int(one.status) == int(other.status) == 0
    assert int(one.steps) == int(other.steps)
    assert abs(float(other.params["x"]) / 2**10 - float(one.params["x"])) < 1e-9


@pytest.mark.parametrize("optimizer", [None, optax.adam(0.1)], ids=["default", "adam"])
def test_starts_that_tell_no_size(optimizer):
    """The parameters at the start are next to nothing, their change is what matters."""
    for start in (0.0, 1e-6, 1e-9, 1e-13):
        given = {"optimizer": optimizer, "steps": 2000}
        design = jc.minimize(lambda x: jnp.sum((x - 3) ** 2), start * jnp.ones(2), **given)
        assert int(design.status) == 0 and jnp.abs(design.params - 3).max() < 1e-6


def test_quasi_newton_steps_are_those_of_optax():
    """With more steps than are in the memory."""
    rng = np.random.default_rng(0)
    peer, memory = optax.lbfgs(linesearch=None), LBFGS()
    state, update = peer.init(jnp.zeros(4)), traced(peer.update)
    matrix = np.diag([1.0, 4.0, 9.0, 16.0]) + 0.5
    for x in rng.normal(size=(13, 4)):
        expected, state = update(matrix @ x, state, x)
        # rounding, over the smallest differences of points, 0.1
        np.testing.assert_allclose(memory.step(x, matrix @ x), expected, rtol=1e-9)
    assert len(memory.changes) == 10


# --- where the loss fails


def wall(x):
    """A loss that is defined beyond x = 0 only."""
    return jnp.sum(x - 1e-3 * jnp.log(x))


@pytest.mark.parametrize(
    "optimizer", [None, optax.lbfgs(), optax.sgd(2.0)], ids=["default", "lbfgs", "sgd"]
)
def test_steps_into_nowhere_are_shortened(optimizer):
    design = jc.minimize(wall, jnp.array([1.0, 2.0]), optimizer=optimizer, steps=400)
    history, n = design.history, int(design.steps)
    assert np.isfinite(np.asarray(history.loss)[: n + 1]).all()
    failed, codes = (np.asarray(v)[: n + 1] for v in (history.failures, history.status))
    assert (codes[failed > 0] == status.NONFINITE).all() and (codes[failed == 0] == 0).all()
    # a fixed step of 2 only comes near; its evaluations: the accepted points and the failures
    plain = optimizer is not None and int(design.status) == status.OUT_OF_STEPS
    assert plain or int(design.status) == 0
    assert jnp.abs(design.params - 1e-3).max() < (5e-4 if plain else 1e-6)
    if plain:
        assert failed.sum() > 0 and int(design.evaluations) == n + 1 + failed.sum()
    if optimizer is None:
        assert failed.sum() > 0


def test_bad_start():
    design = jc.minimize(wall, jnp.array([-1.0, 2.0]), steps=400)
    assert int(design.status) == status.BAD_START
    assert int(design.history.status[0]) == status.NONFINITE
    assert np.isnan(float(design.loss)) and int(design.evaluations) == int(design.failures) == 1
    assert (np.asarray(design.params) == [-1.0, 2.0]).all()
    unknown = jc.minimize(wall, jnp.array([jnp.nan, 2.0]), (0.0, None), steps=400)
    assert int(unknown.status) == status.BAD_START


@pytest.mark.slow
def test_many_starts_at_once_and_under_jit():
    starts = jnp.array([[1.0, 2.0], [-1.0, 2.0], [0.1, 0.1]])
    designs = jax.vmap(lambda x: jc.minimize(wall, x, steps=400))(starts)
    alone = [jc.minimize(wall, x, steps=400) for x in starts]
    assert designs.status.tolist() == [int(d.status) for d in alone] == [0, status.BAD_START, 0]
    for k in (0, 2):
        # the same steps but for the order of sums
        assert jnp.abs(designs.params[k] - alone[k].params).max() < 1e-9
    within = traced(lambda low: jc.minimize(wall, jnp.array([1.0, 2.0]), (low, None)).status)
    assert int(within(1.5)) == status.OUTSIDE and int(within(0.5)) == 0


def test_no_way_on_is_said():
    """No step crosses a cliff at x = 0.5, nor lowers a kink at 1: that is not converged."""

    def cliff(x):
        return jnp.sum(jnp.where(x[0] < 0.5, jnp.nan, x))

    design = jc.minimize(cliff, jnp.array([1.0, 1.0]), steps=1000)
    kink = jc.minimize(lambda x: jnp.sum(jnp.abs(x - 1.0)), jnp.array([3.3]))
    assert int(design.status) == int(kink.status) == status.STALLED
    assert abs(float(design.params[0]) - 0.5) < 1e-8 and abs(float(kink.params[0]) - 1) < 1e-6
    assert int(design.failures) > 0 and float(design.gradient_norm) > 0.1
    with pytest.raises(jc.AnalysisError, match="no step, however short"):
        jc.raise_if_failed(design)


@pytest.mark.parametrize(("start", "falls"), [([1e-3, 3.0], True), ([1.0, 1.0], False)])
def test_steps_that_are_too_long_give_the_best_point(start, falls):
    """Too long for one curvature: the loss falls at first, and then blows up, or blows up at once.

    A growing loss makes any change small beside it: that is not converged.
    """

    def loss(x):
        return 50 * x[0] ** 2 + 0.1 * (x[1] - 1) ** 2

    design = jc.minimize(loss, jnp.array(start), optimizer=optax.sgd(0.021), steps=200)
    history = np.asarray(design.history.loss)
    assert int(design.status) == status.OUT_OF_STEPS and history[-1] > 1e6
    assert float(design.loss) == history.min()
    assert float(design.loss) < history[0] if falls else design.params.tolist() == start


# --- optimizers, trees and dtypes

OTHERS = {
    "schedule": optax.adam(optax.exponential_decay(0.1, 50, 0.5)),
    "injected": optax.inject_hyperparams(optax.adam)(learning_rate=0.05),
    "decay": optax.chain(optax.clip_by_global_norm(1.0), optax.adamw(0.05, weight_decay=1e-6)),
    "two rates": optax.multi_transform(
        {"fast": optax.adam(0.1), "slow": optax.sgd(0.1)}, {"a": "fast", "b": "slow"}
    ),
    "backtracking": optax.chain(optax.sgd(1.0), optax.scale_by_backtracking_linesearch(20)),
}


def hollow(p):
    return jnp.sum((p["a"] - jnp.array([1.0, -1.0])) ** 2) + (p["b"] - 3) ** 2 + 1


@pytest.mark.parametrize("name", OTHERS)
def test_optax_transformations(name):
    start = {"a": jnp.array([0.0, 2.0]), "b": jnp.asarray(5.0)}
    bounds = ({"a": jnp.array([0.0, 0.5]), "b": None}, None)
    design = jc.minimize(hollow, start, bounds, OTHERS[name], steps=400)
    assert int(design.status) in (status.OK, status.OUT_OF_STEPS)
    # what a decaying rate and a decay of weights leave
    assert jnp.abs(design.params["a"] - jnp.array([1.0, 0.5])).max() < 1e-3
    assert abs(float(design.params["b"]) - 3) < 1e-3
    assert float(design.params["a"][1]) == 0.5


def test_float32_and_scalars_in_a_tree():
    start = {"a": jnp.float32(0.0), "b": jnp.ones(2, jnp.float32)}
    bounds = ({"a": None, "b": 0.5}, None)
    design = jc.minimize(
        lambda p: (p["a"] - 3) ** 2 + jnp.sum((p["b"] + 1) ** 2) - 4, start, bounds
    )
    assert int(design.status) == 0
    assert design.params["a"].dtype == jnp.float32
    assert design.params["b"].tolist() == [0.5, 0.5]
    assert abs(float(design.params["a"]) - 3) < 1e-2


def test_no_derivative():
    def distance(x, a):
        return jnp.sum((x - a) ** 2)

    for differentiate in (
        lambda: jax.jacfwd(lambda a: jc.minimize(distance, jnp.ones(2), args=(a,)).params),
        lambda: jax.grad(lambda a: jc.minimize(lambda x: distance(x, a), jnp.ones(2)).loss),
        lambda: jax.grad(lambda a: jc.fit(lambda x: x - a, jnp.ones(2)).misfit),
    ):
        with pytest.raises(ValueError, match="has no derivative"):
            differentiate()(2.0)


@pytest.mark.slow
def test_what_is_traced_does_not_leak():
    with jax.checking_leaks():
        inner = traced(lambda a: jc.minimize(lambda x: jnp.sum((x - a) ** 2), jnp.ones(2)).params)
        assert jnp.abs(inner(2.0) - 2).max() < 1e-6


# --- with an analysis

CROSS = cross()
LOAD = 2e3  # N, on the node in the middle
TRACES = []


def tension_missed(pretension, target, least):
    """Squared distance of a tension under load, kN2; below `least` the analysis is told to fail."""
    TRACES.append(1)
    phases = [jc.Phase(pretension=pretension), jc.Phase(loads=CROSS.load(LOAD))]
    solution = jc.solve(CROSS.structure, phases)
    code = jnp.where(pretension < least, status.MECHANISM, solution.status)
    return jc.design.tension_distance(solution, target) / 4e6, code


def by_hand(pretension, target):
    _, force = cross(pretension=float(pretension)).known(LOAD)
    return (force[0] - float(target)) ** 2 / 1e6


@pytest.mark.slow
def test_pretension_of_a_net_and_one_trace():
    """The pretension that leads to a tension under load, in closed form, through two phases."""
    run = functools.partial(jc.minimize, tension_missed, steps=100)
    _, wanted = cross(pretension=4e3).known(LOAD)
    found = run(jnp.array(1e3), (0.0, None), args=(wanted[0], 0.0))
    assert int(found.status) == 0
    # the loss falls to zero: 1e-6 of the gradient at the start is left
    assert float(found.params) == pytest.approx(4e3, rel=1e-3)
    count = len(TRACES)
    # where analyses are told to fail nothing is found; what is returned has its loss and gradient
    held = run(jnp.array(5e3), (0.0, 9e3), args=(wanted[0], 4.5e3))
    assert len(TRACES) == count + 1  # once in every call, as `minimize` says
    assert int(held.status) in (status.STALLED, status.OUT_OF_STEPS) and int(held.failures) > 0
    seen = np.asarray(held.history.status)[: int(held.steps) + 1]
    assert set(seen.tolist()) <= {0, status.MECHANISM}
    at = float(held.params)
    assert 4.5e3 <= at < 4.6e3
    assert float(held.loss) == pytest.approx(by_hand(at, wanted[0]), rel=1e-7)
    slope = (by_hand(at + 1.0, wanted[0]) - by_hand(at - 1.0, wanted[0])) / 2
    # differences of 1 N: third order 1e-7 of it, and rounding
    assert float(held.gradient) == pytest.approx(slope, rel=1e-5)
