"""Influence, objectives, distance to slackening: against NumPy and closed forms."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from oracles.convergence import converged
from oracles.traced import traced
from scipy.special import logsumexp

import jaxcable as jc
from jaxcable import design

TIGHT = jc.Newton(tol=1e-13)
FREE = np.array([3, 4, 7, 8])
EA, EXPANSION, N = 97.97e3, 1.2e-5, 12
FLAT, (_, LOADING) = jc.scenes.flat_net(load=15.0, increments=(1, 1))
LINKS = np.asarray(FLAT.elements.links)
GROUPS = {
    "x": jc.Cables(LINKS[:6], axial_stiffness=EA, expansion=EXPANSION),
    "y": jc.Bars(LINKS[6:], axial_stiffness=EA),
}
NET = jc.replace(FLAT, elements=GROUPS)
STATED = jc.Phase(pretension={"x": 200.0, "y": None}, prestrain={"x": None, "y": 2e-3})


def split(values):
    return {"x": values[:6], "y": values[6:]}


def flat(tree):
    return np.concatenate([np.asarray(tree["x"]), np.asarray(tree["y"])], axis=-1)


ZERO = split(jnp.zeros(N))


@functools.cache
def loaded():
    return converged(jc.solve(NET, [STATED, LOADING], TIGHT))


@functools.cache
def influence(wrt, phase=None):
    found = jc.influence(NET, [STATED, LOADING], wrt=wrt, phase=phase, method=TIGHT)
    return found if wrt != "shortening" else (found, design.flat_matrix(found, ZERO))


@traced
def _turned(shortening):
    phases = [STATED, LOADING, jc.Phase(shortening=split(shortening))]
    solution = jc.solve(NET, phases, TIGHT)
    return jnp.concatenate(jax.tree.leaves(solution.tension)), solution.status


def turned(shortening):
    """Tensions after turnbuckles are turned in the loaded net."""
    tension, code = _turned(jnp.asarray(shortening))
    assert int(code) == 0
    return tension


# --- influence


@pytest.mark.slow
def test_influence_of_shortening():
    """Central differences of 1 um (0.25 N): their error is of third order, and rounding. Betti.

    Shortening j by d strains it by (1 + e_j) d at fixed nodes; the rest is symmetric.
    """
    matrix, whole = influence("shortening")
    assert matrix["x"]["y"].shape == (6, 6)
    h = 1e-6
    expected = np.stack([(turned(h * e) - turned(-h * e)) / (2 * h) for e in np.eye(N)], axis=1)
    assert np.abs(whole - expected).max() < 1e-6 * np.abs(expected).max()
    symmetric = whole / (1 + flat(loaded().tension) / EA)[None, :]
    assert jnp.abs(symmetric - symmetric.T).max() < 1e-12 * jnp.abs(symmetric).max()
    assert (jnp.diagonal(symmetric) < EA / flat(loaded().rest_length)).all()


@pytest.mark.slow
def test_influence_of_statements_and_of_an_earlier_phase():
    """Elastic nets do not care in which phase, and by what, an unstressed length changed."""
    matrix, _ = influence("shortening")
    heat = influence("temperature", 0)
    assert heat["x"]["y"] is None and heat["y"]["y"] is None  # bars that do not expand
    # a kelvin is a lengthening by expansion times unstressed length
    expected = -EXPANSION * matrix["y"]["x"] * loaded().rest_length["x"][None, :]
    assert jnp.abs(heat["y"]["x"] - expected).max() < 1e-8 * jnp.abs(expected).max()
    strain = influence("prestrain")
    assert strain["x"]["x"] is None and strain["y"]["x"] is None
    # an element of 0.4 m is cut to 0.4 / (1 + strain)
    expected = 0.4 / (1 + 2e-3) ** 2 * matrix["x"]["y"]
    assert jnp.abs(strain["x"]["y"] - expected).max() < 1e-8 * jnp.abs(expected).max()
    method = jc.Newton(tol=1e-13, max_steps=1)
    failed = jc.influence(NET, [STATED, LOADING], wrt="prestrain", method=method)
    assert all(jnp.isnan(leaf).all() for leaf in jax.tree.leaves(failed))


@pytest.mark.slow
def test_influence_of_load_is_reciprocal():
    """Maxwell: displacement at a by a force at b is that at b by a force at a; reverse mode."""
    found = jc.influence(
        NET, [STATED, LOADING], lambda s: s.displacement[FREE], "load", method=TIGHT
    )
    assert found.shape == (4, 3, N, 3)
    square = found[:, :, FREE].reshape(12, 12)
    assert jnp.abs(square - square.T).max() < 1e-12 * jnp.abs(square).max()
    assert (jnp.linalg.eigvalsh(square) > 0).all()
    push = jc.Phase(loads=jc.NodalLoads(FREE, (0.0, 0.0, -15.0 - 1e-3)))
    more = converged(jc.solve(NET, [STATED, push], TIGHT))
    # 1 mN of 15 N: second order is 1e-4 of it at most
    change = (more.displacement - loaded().displacement)[FREE]
    expected = -1e-3 * found[:, :, FREE, 2].sum(-1)
    assert jnp.abs(change - expected).max() < 1e-4 * jnp.abs(expected).max()


def test_retensioning_converges_quickly():
    """Wrong lengths are undone, with a matrix that is never renewed: linear, but fast."""
    wrong = 1e-4 * np.random.default_rng(0).normal(size=N)
    target, turns, off = flat(loaded().tension), jnp.zeros(N), []
    for _ in range(5):
        tension = turned(turns - wrong)
        off.append(float(jnp.abs(tension / target - 1).max()))
        change = split(target - tension)
        turns = turns + flat(design.adjustment(influence("shortening")[0], change))
    assert off[0] > 0.05 and off[2] < 1e-3 and off[4] < 1e-6
    # singular values of the matrix reach down to 1e-3 of its largest one
    assert jnp.abs(turns - wrong).max() < 1e-8


def test_scatter_of_tolerances():
    matrix, whole = influence("shortening")
    tolerance = 1e-5 * (1 + np.arange(N) % 3)
    worst, random = design.propagate_tolerances(matrix, split(jnp.asarray(tolerance)))
    np.testing.assert_allclose(flat(worst), np.abs(whole) @ tolerance, rtol=1e-12)
    np.testing.assert_allclose(flat(random), np.sqrt(whole**2 @ tolerance**2), rtol=1e-12)
    extreme = turned(tolerance * jnp.sign(whole[0]))[0] - loaded().tension["x"][0]
    assert abs(float(extreme / worst["x"][0]) - 1) < 0.05  # first order


# --- load cases and objectives

CASES = np.random.default_rng(2).normal(size=(3, 4, 3)) * [5, 300, 20]


@functools.cache
def cases():
    phases = [jc.Phase(loads=jc.NodalLoads(FREE, force)) for force in CASES]
    solutions = design.solve_cases(NET, [STATED], phases, TIGHT)
    assert solutions.status.tolist() == [0, 0, 0]
    assert (solutions.tension["y"] < 0).any()  # some bars are pressed
    return solutions


def test_envelope_of_values_by_case():
    """By NumPy; the cases themselves are compared in `test_combinations`."""
    tension, found = flat(cases().tension), design.envelope(cases().tension)
    assert (flat(found.lowest) == tension.min(0)).all()
    assert (flat(found.highest) == tension.max(0)).all()
    assert (flat(found.lowest_case) == tension.argmin(0)).all()
    assert (flat(found.highest_case) == tension.argmax(0)).all()


def test_utilisation():
    law = jc.Polygonal([-0.01, 0.0, 0.02], [-100e6, 0.0, 400e6])
    cables = jc.replace(GROUPS["x"], strength=1000.0)
    strong = jc.replace(NET, elements={**GROUPS, "x": cables})
    used = design.utilization(strong, cases().tension)
    assert used["y"] is None and jnp.abs(used["x"] - cases().tension["x"] / 1000).max() < 1e-15
    mixed = jc.replace(FLAT, elements=[jc.Bars(LINKS[:6], area=1e-6, law=law), GROUPS["x"]])
    used, unknown = design.utilization(mixed, [jnp.array([200.0, -50.0] * 3), jnp.zeros(6)])
    assert unknown is None and np.allclose(used[:2], [0.5, 0.5], rtol=1e-12)


def test_objectives():
    """Of one solution, of a batch, and of its case with pressed bars, by NumPy."""
    solution, batch, target = loaded(), cases(), np.asarray(FLAT.nodes)
    pressed = int(np.asarray(batch.tension["y"]).min(axis=1).argmin())
    for found in (solution, batch, jax.tree.map(lambda leaf: leaf[pressed], batch)):
        positions, tension = np.asarray(found.positions), flat(found.tension)
        gap = ((positions - target) ** 2).sum()
        close = functools.partial(pytest.approx, rel=1e-9)
        assert float(design.shape_distance(found, target)) == close(gap)
        assert float(design.shape_distance(found, target[FREE], FREE)) == close(gap)
        spread = tension.var() / tension.mean() ** 2
        assert float(design.tension_spread(found)) == close(spread)
        far = ((tension - 200) ** 2).sum()
        assert float(design.tension_distance(found, 200.0)) == close(far)
        off = ((tension - flat(solution.tension)) ** 2).sum()
        assert float(design.tension_distance(found, solution.tension)) == close(off)
        length = flat(found.rest_length).reshape(-1, N)[0]
        volume = np.abs(tension).reshape(-1, N).max(0) @ length / 1e9
        assert float(design.material_use(found, 1e9)) == close(volume)
    stated = 6 * 200.0 + 6 * 2e-3 * EA
    assert float(design.total_prestress(solution)) == pytest.approx(stated, rel=1e-9)

    moved = np.linalg.norm(np.asarray(batch.phases[-1].displacement_in_phase), axis=-1)
    for width in (1e-3, 1e-4):
        bound = float(design.largest_deflection(batch, width))
        assert bound == close(width * np.sqrt(logsumexp((moved / width) ** 2)))
        assert bound <= np.sqrt(moved.max() ** 2 + width**2 * np.log(moved.size)) * (1 + 1e-12)
    values = np.array([1.0, 2.0, 4.0])
    assert float(design.smooth_max(values, 5.0)) == close(5 * logsumexp(values / 5))
    assert float(design.smooth_min(values, 5.0)) == close(-5 * logsumexp(-values / 5))
    mean = design.mean_over_cases(batch.tension)
    assert np.abs(flat(mean) - flat(batch.tension).mean(0)).max() < 1e-9


# --- distance to slackening

PULL = 600.0  # N, on the node between two cables of 1 m in a line
LINE = jc.Structure(
    [[-1.0, 0, 0], [0, 0, 0], [1.0, 0, 0]],
    jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5),
    jc.pinned([0, 2]) + jc.restrained([1], "yz"),
)


def pulled(tension, method=TIGHT):
    load = jc.NodalLoads([1], (PULL, 0.0, 0.0))
    return jc.solve(LINE, [jc.Phase(pretension=tension), jc.Phase(loads=load)], method)


@traced
def distance_at(tension):
    return design.slack_distance(LINE, pulled(tension))


@pytest.mark.slow_cases("500.0")
@pytest.mark.parametrize("tension", [500.0, 200.0])
def test_distance_to_slackening(tension):
    """The second cable is slack where the pull is more than twice the pretension.

    Its strain is (2 T - P) / 2 EA where it is taut, and (2 T - P) / EA where it is slack.
    """
    solution = converged(pulled(tension))
    excess = (2 * tension - PULL) / 1e5
    assert (float(solution.tension[1]) == 0) == (excess < 0)
    distance = design.slack_distance(LINE, solution)
    expected = excess if excess < 0 else excess / 2
    assert float(distance[1]) == pytest.approx(expected, rel=1e-9)
    assert float(distance[0]) == pytest.approx(float(solution.tension[0]) / 1e5, rel=1e-9)
    margin = float(design.slack_margin(LINE, solution, 1e-6))
    assert expected - 1e-6 * np.log(2) - 1e-15 <= margin <= expected
    way = -np.sign(excess)
    steps = design.nearest_kink(distance_at, jnp.array(tension), jnp.array(way))
    assert float(steps[1]) == pytest.approx(abs(tension - PULL / 2), rel=1e-8)
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), solution)
    for both in (batch, batch.last):
        assert (design.slack_distance(LINE, both)[1] == distance).all()


def test_a_cable_that_hangs_is_not_slack():
    """However it sags: at the ends ``T = w S / 2 coth(w l / 2 H)``, sinh(w l / 2 H) = w S / 2 H."""
    length, span, weight, stiffness = 10.5, 10.0, 5.0, 1e5
    cable = jc.Catenaries([[0, 1]], axial_stiffness=stiffness, rest_length=length, weight=weight)
    structure = jc.Structure([[0.0, 0, 0], [span, 0, 0]], cable, supports=jc.pinned([0, 1]))
    solution = converged(jc.solve(structure, jc.Phase(loads=jc.SelfWeight())))
    a = scipy.optimize.brentq(lambda a: np.sinh(a) / a - length / span, 0.1, 2.0)  # w l / 2 H
    expected = weight * length / 2 / np.tanh(a) / stiffness
    found = design.slack_distance(structure, solution)[0]
    # its own strain of 5e-4 makes it longer by 1 % of what it is longer than the span
    assert float(found) == pytest.approx(expected, rel=1e-2)
    assert float(solution.rest_length[0]) > 1.04 * span  # control: the chord is not strained


def test_distance_of_a_failed_analysis_and_known_kinks():
    failed = pulled(500.0, jc.Newton(max_steps=1, tol=1e-16))
    assert int(failed.status) != 0
    assert jnp.isnan(design.slack_distance(LINE, failed)).all()
    assert jnp.isfinite(design.slack_distance(LINE, failed.last)).all()
    at, way = jnp.array([0.0, 0.0, 2.0, -1.0, jnp.nan]), jnp.array([-1.0, 1.0, -4.0, -1.0, 1])
    known = design.nearest_kink(lambda x: x, at, way)
    np.testing.assert_array_equal(known, [0, np.inf, 0.5, np.inf, np.nan])
