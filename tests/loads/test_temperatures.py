"""Changes of temperature of several phases add, and increments do not compound.

Between ends that are held, an element of unstressed length L (1 + a sum(dt)) has the force
``EA (l / (L (1 + a sum(dt))) - 1)``.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged
from oracles.traced import traced

import jaxcable as jc

EA, ALPHA = 1e8, 1.2e-5
CHANGES = np.array([100.0, -160.0, 35.0])  # K


def all_kinds():
    """Five elements between ends that are held, 10 m apart, in one structure."""
    nodes = np.zeros((5, 3, 3))
    nodes[:, 1:, 0], nodes[:, :, 1] = [5.0, 10.0], np.arange(5)[:, None]
    more, at = {"expansion": ALPHA}, [[[3 * k, 3 * k + 2]] for k in range(5)]
    steel = jc.Section.rectangle(0.02, 0.025, jc.Elastic(2e11))  # EA again
    groups = {
        "bar": jc.Bars(at[0], EA, **more),
        "cable": jc.Cables(at[1], area=5e-4, law=jc.Elastic(2e11), **more),
        "catenary": jc.Catenaries(at[2], EA, **more),
        "rope": jc.SlidingCables([[9, 10, 11]], EA, **more),
        "beam": jc.Beams(at[4], section=steel, **more),
    }
    held = jc.clamped(np.ravel(at)) + jc.pinned([1, 4, 7, 10, 13])
    return jc.Structure(nodes.reshape(-1, 3), groups, supports=held)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:phases.*supports")  # all nodes are held on purpose
def test_temperatures_add_in_every_order_for_every_kind():
    """Closed form at every phase; permutations end in the same; back at zero nothing is left."""
    structure = all_kinds()
    tension = {"bar": 2e5, "cable": 2e5, "catenary": 2e5, "rope": 2e5, "beam": 2e5}

    def forces(changes):
        phases = [jc.Phase(pretension=tension), *(jc.Phase(temperature=dt) for dt in changes)]
        solution = jc.solve(structure, phases)
        of_phases = [jnp.stack(jax.tree.leaves(p.tension))[:, 0] for p in solution.phases]
        return jnp.stack(of_phases), solution.status

    orders = np.array([*itertools.permutations(CHANGES), [100.0, -100.0, 0.0], [0.0, -80.0, 80.0]])
    found, codes = traced(jax.vmap(forces))(orders)
    assert not codes.any()
    heat = ALPHA * np.cumsum(np.pad(orders, ((0, 0), (1, 0))), axis=1)
    expected = EA * ((1 + 2e5 / EA) / (1 + heat) - 1)
    assert np.ptp(expected) > 1e5 and expected.min() > 0  # nothing is slack
    # some roundings of EA (the lengths that heat changes are those of 10 m)
    np.testing.assert_allclose(found, np.tile(expected[..., None], 5), atol=32 * 2.3e-16 * EA)
    # factors that multiply would be EA a^2 dt^2 = 144 N off
    np.testing.assert_allclose(found[6:, -1], 2e5, atol=32 * 2.3e-16 * EA)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:phases.*supports")  # all nodes are held on purpose
def test_statements_shortenings_jacks_and_new_elements_between_changes():
    """One bar stated anew, one jacked, one that comes later, one that goes and comes again."""
    bars = jc.Bars([[0, 1], [1, 2], [2, 3], [3, 4]], EA, expansion=ALPHA, weight=50.0)
    nodes = [[3.0 * k, 4.0 * (k % 2), 0.0] for k in range(5)]  # 5 m each
    structure = jc.Structure(nodes, bars, supports=jc.pinned(range(5)))
    phases = [
        jc.Phase(pretension=1e5, temperature=60.0, removes=jc.only([2]), loads=jc.SelfWeight()),
        jc.Phase(shortening=jc.only([0, 1], 1e-3)),
        jc.Phase(adds=jc.only([2]), temperature=-25.0),
        jc.Phase(pretension=jc.only([0], 7e4), removes=jc.only([3])),
        jc.Phase(jacking=jc.only([1], 9e4)),
        jc.Phase(temperature=40.0, shortening=jc.only([0], 5e-4)),
        jc.Phase(adds=jc.only([3]), temperature=10.0),
        jc.Phase(temperature=-85.0),
    ]
    solution = converged(jc.solve(structure, phases))
    cold, heat = np.full(4, 5.0), np.zeros(4)  # L at the reference temperature, a sum(dt)
    there = np.ones(4, bool)

    def state(force, *which):
        for k in which:
            cold[k] = 5.0 / (1 + force / EA) / (1 + heat[k])

    def cut(length, *which):
        for k in which:
            cold[k] -= length / (1 + heat[k])

    def come(k):
        there[k], cold[k], heat[k] = True, 5.0, 0.0

    def go(k):
        there[k] = False

    def warm(change):
        heat[there] += ALPHA * change

    steps = (
        lambda: (go(2), state(1e5, 0, 1, 3), warm(60)),
        lambda: cut(1e-3, 0, 1),
        lambda: (come(2), warm(-25)),
        lambda: (state(7e4, 0), go(3)),
        lambda: state(9e4, 1),
        lambda: (cut(5e-4, 0), warm(40)),
        lambda: (come(3), warm(10)),
        lambda: warm(-85),
    )
    for step, phase in zip(steps, solution.phases, strict=True):
        step()
        expected = np.where(there, EA * (5.0 / (cold * (1 + heat)) - 1), 0.0)
        np.testing.assert_allclose(phase.tension, expected, atol=1e-6)
    # heat has no weight; the jack had taken in what it weighs from then on as before
    np.testing.assert_allclose(heat, ALPHA * np.array([0.0, 0.0, -60.0, -75.0]), atol=1e-18)
    table = jc.report(structure, solution).tables["cutting_list"]
    np.testing.assert_allclose([row[4] for row in table.rows], cold, rtol=1e-14)
    assert "of added elements at the temperature of the phase that added them" in table.notes[0]


@pytest.mark.filterwarnings("ignore:phases.*supports")  # all nodes are held on purpose
def test_derivatives_by_temperatures_are_the_same_for_every_phase():
    """``dN/d(dt) = -EA a (l/L) / (1 + a sum(dt))^2``, in forward and reverse mode."""
    bars = jc.Bars([[0, 1]], EA, expansion=ALPHA)
    structure = jc.Structure([[0.0, 0, 0], [3.0, 4.0, 0]], bars, supports=jc.pinned([0, 1]))

    def force(changes):
        phases = [jc.Phase(pretension=2e5), *(jc.Phase(temperature=dt) for dt in changes)]
        return jc.solve(structure, phases).tension[0]

    heat = ALPHA * CHANGES.sum()
    expected = -EA * ALPHA * (1 + 2e5 / EA) / (1 + heat) ** 2
    for mode in (jax.jacfwd, jax.jacrev):
        slope = np.asarray(traced(mode(force))(jnp.asarray(CHANGES)))
        np.testing.assert_allclose(slope, np.full(3, expected), rtol=1e-10)
