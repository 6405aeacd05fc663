"""`PhaseResult.load`: all loads that act at the end of every phase."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc

TIGHT = jc.Newton(tol=1e-13)
SECTION = jc.Section.rectangle(0.04, 0.1, jc.Elastic(20e9))


def arch_under_pressure():
    """Cables under a pressure that follows them, then a gust, then a load across."""
    nodes = np.array([[0.0, 0, 0], [1, 0.6, 0], [2, 0.8, 0], [3, 0.6, 0], [4, 0, 0]])
    cables = jc.Cables([[0, 1], [1, 2], [2, 3], [3, 4]], axial_stiffness=1e5)
    structure = jc.Structure(
        nodes, cables, supports=jc.pinned([0, 4]) + jc.restrained([1, 2, 3], "z")
    )
    return structure, [
        jc.Phase(pretension=1e3, loads=jc.CablePressure(300.0, (0.0, 0.0, 1.0))),
        jc.Phase(loads=jc.CablePressure(100.0, (0.0, 0.0, 1.0)), increments=2),
        jc.Phase(loads=jc.NodalLoads([2], (30.0, 0.0, 0.0))),
    ]


def beams_under_line_loads():
    """A cantilever of two beams: its weight, a load along one of them, a moment at its tip."""
    beams = jc.Beams([[0, 1], [1, 2]], section=SECTION, weight=40.0)
    structure = jc.Structure([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], beams, supports=jc.clamped([0]))
    line = jc.LineLoads((0.0, 5.0, -20.0), per="initial", elements=jc.only([1]))
    moment = jc.NodalLoads([2], (0.0, 0.0, -10.0), moments=(0.0, 5.0, 0.0))
    return structure, [
        jc.Phase(loads=jc.SelfWeight()),
        jc.Phase(loads=line),
        jc.Phase(loads=moment),
    ]


def freed_and_propped():
    """A net whose node is propped in its first two phases: what the prop carried is set free."""
    structure, (_, loading) = jc.scenes.flat_net(load=15.0)
    prop = structure.supports + jc.restrained([3], "z")
    return structure, [
        jc.Phase(pretension=200.0, supports=prop),
        jc.Phase(loads=loading.loads, supports=prop, increments=2),
        jc.Phase(supports=structure.supports, increments=2),
        jc.Phase(loads=loading.loads, supports=prop),
    ]


def stages():
    """Cables that come and go under weight and a load along all of them."""
    nodes = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -0.3]])
    cables = jc.Cables([[0, 4], [1, 4], [2, 4], [3, 4]], axial_stiffness=1e5, weight=20.0)
    structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 1, 2, 3]))
    line = jc.LineLoads((0.0, 3.0, -20.0), per="initial")
    return structure, [
        jc.Phase(pretension=1e3, adds=jc.only([3]), loads=jc.SelfWeight(), increments=2),
        jc.Phase(loads=line),
        jc.Phase(removes=jc.only([2]), increments=2),
    ]


CASES = {
    "cables": lambda: jc.scenes.flat_net(load=15.0),
    "beams": beams_under_line_loads,
    "pressure": arch_under_pressure,
    "catenaries": jc.scenes.suspended_cable,
    "mast": jc.scenes.guyed_mast,
    "freed": freed_and_propped,
    "stages": stages,
}


@pytest.mark.parametrize("name", CASES)
def test_loads_of_every_end_are_those_of_an_analysis_up_to_there(name):
    structure, phases = CASES[name]()[:2]
    whole = jc.solve(structure, phases, TIGHT)
    assert int(whole.status) == 0
    seen = []
    for k, phase in enumerate(whole.phases):
        alone = jc.solve(structure, phases[: k + 1], TIGHT)
        assert int(alone.status) == 0
        load, expected = np.asarray(phase.load), np.asarray(alone.last.load)
        # two programs for one sum; loads that follow differ by the rounding of the equilibrium
        size = max(np.abs(expected).max(), 1.0)
        np.testing.assert_allclose(load, expected, atol=1e-9 * size, err_msg=f"{k}")
        # of the whole structure: what supports and loads exert is in balance, whatever is inside
        parts = np.asarray(phase.reactions) + load
        assert np.abs(parts.sum(axis=0)).max() < 1e-8 * np.abs(parts).sum()
        seen.append(load)
    np.testing.assert_array_equal(seen[-1], whole.load)
    assert max(np.abs(a - b).max() for a, b in itertools.pairwise(seen)) > 1.0


def test_sums_by_hand():
    """Weights and loads along initial lengths go to the ends by halves."""
    structure, phases = beams_under_line_loads()
    weight, line, tip = jc.solve(structure, phases).phases
    np.testing.assert_allclose(weight.load, [[0, 0, -20], [0, 0, -40], [0, 0, -20]], rtol=1e-12)
    expected = np.array([[0, 0, -20], [0, 2.5, -50], [0, 2.5, -30]])
    np.testing.assert_allclose(line.load, expected, rtol=1e-12)
    expected[2, 2] -= 10
    np.testing.assert_allclose(tip.load, expected, rtol=1e-12)


def test_nothing_is_left_of_a_prop_at_the_end_of_the_phase_that_frees_it():
    structure, phases = freed_and_propped()
    whole = jc.solve(structure, phases, TIGHT)
    given = np.zeros((12, 3))
    given[[3, 4, 7, 8], 2] = -15.0
    _, loaded, freed, _ = (np.asarray(phase.load) for phase in whole.phases)
    np.testing.assert_allclose(loaded, given, atol=1e-12)
    np.testing.assert_allclose(freed[4:], given[4:], atol=1e-12)
    assert float(whole.phases[1].reactions[3, 2]) > 1.0  # the prop has carried something


def test_phases_that_failed_have_none():
    structure, phases = jc.scenes.flat_net(load=15.0)
    failed = jc.solve(structure, phases, jc.Newton(max_steps=1))
    assert int(failed.status) != 0
    assert np.isfinite(failed.phases[0].load).all() and np.isnan(failed.phases[1].load).all()


@pytest.mark.parametrize("name", ["pressure", "beams", "stages"])
def test_gradients_at_the_end_of_a_phase(name):
    """Of the loads of a phase in the middle: those of the analysis up to there, and Taylor."""
    structure, phases = CASES[name]()
    nodes = jnp.asarray(np.asarray(structure.nodes, float))
    random = np.random.default_rng(3)
    weight = jnp.asarray(random.normal(size=nodes.shape))
    direction = jnp.asarray(random.normal(size=nodes.shape))

    def inside(nodes):
        solution = jc.solve(jc.replace(structure, nodes=nodes), phases, TIGHT)
        return jnp.sum(weight * solution.phases[1].load)

    def alone(nodes):
        solution = jc.solve(jc.replace(structure, nodes=nodes), phases[:2], TIGHT)
        return jnp.sum(weight * solution.load)

    there = jax.jit(jax.value_and_grad(inside))
    value, gradient = there(nodes)
    expected = jax.jit(jax.grad(alone))(nodes)
    assert np.abs(expected).max() > 1.0
    np.testing.assert_allclose(gradient, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    rate = float(jnp.sum(gradient * direction))
    steps = np.array([1e-3, 5e-4, 2.5e-4])
    change = np.array([float(there(nodes + h * direction)[0] - value) for h in steps])
    order = np.diff(np.log(np.abs(change - steps * rate))) / np.diff(np.log(steps))
    assert np.abs(order - 2).max() < 0.15  # Taylor
    wrong = np.diff(np.log(np.abs(change - 1.05 * steps * rate))) / np.diff(np.log(steps))
    assert wrong.max() < 1.7  # a gradient 5 % off
