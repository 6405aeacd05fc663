"""`PhaseResult.load`: all loads that act at the end of every phase."""

import functools
import itertools

import numpy as np
import pytest
from oracles.convergence import converged
from oracles.taylor import TIGHT

import jaxcable as jc

UP = (0.0, 0.0, 1.0)


def halves(links, forces, n_node):
    """Half of the force of each element at each of its ends, [n_node, 3]."""
    total = np.zeros((n_node, 3))
    np.add.at(total, links, 0.5 * np.asarray(forces)[:, None])
    return total


def arch_under_pressure():
    """Cables under a pressure that follows them, then a gust, then a load across."""
    nodes = np.array([[0.0, 0, 0], [1, 0.6, 0], [2, 0.8, 0], [3, 0.6, 0], [4, 0, 0]])
    cables = jc.Cables([[0, 1], [1, 2], [2, 3], [3, 4]], axial_stiffness=1e5)
    structure = jc.Structure(
        nodes, cables, supports=jc.pinned([0, 4]) + jc.restrained([1, 2, 3], "z")
    )
    push = np.array([30.0, 0.0, 0.0])
    phases = [
        jc.Phase(pretension=1e3, loads=jc.CablePressure(300.0, UP)),
        jc.Phase(loads=jc.CablePressure(100.0, UP), increments=2),
        jc.Phase(loads=jc.NodalLoads([2], push)),
    ]

    def by_hand(k, phase):  # p (axis x chord), by the chords at the end of that phase
        chords = np.diff(np.asarray(phase.positions), axis=0)
        load = halves(cables.links.array, (300.0, 400.0, 400.0)[k] * np.cross(UP, chords), 5)
        load[2] += push * (k == 2)
        return load

    return structure, phases, by_hand


def freed_and_propped():
    """A net whose node is propped in its first two phases: what the prop carried is set free."""
    structure, (_, loading) = jc.scenes.flat_net(load=15.0)
    prop = structure.supports + jc.restrained([3], "z")
    phases = [
        jc.Phase(pretension=200.0, supports=prop),
        jc.Phase(loads=loading.loads, supports=prop, increments=2),
        jc.Phase(supports=structure.supports, increments=2),
        jc.Phase(loads=loading.loads, supports=prop),
    ]
    given = np.zeros((12, 3))
    given[[3, 4, 7, 8], 2] = -15.0

    def by_hand(k, phase):
        again = given * (k == 3)
        again[3] = 0.0  # the prop is a support again: it takes what is added
        held = given.copy()
        return held * (k > 0) + again

    return structure, phases, by_hand


def stages():
    """Cables that come and go under weight and a load along all of them."""
    nodes = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -0.3]])
    cables = jc.Cables([[0, 4], [1, 4], [2, 4], [3, 4]], axial_stiffness=1e5, weight=20.0)
    structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 1, 2, 3]))
    line = np.array([0.0, 3.0, -20.0])
    phases = [
        jc.Phase(pretension=1e3, adds=jc.only([3]), loads=jc.SelfWeight(), increments=2),
        jc.Phase(loads=jc.LineLoads(line, per="initial")),
        jc.Phase(removes=jc.only([2]), increments=2),
    ]

    def by_hand(k, phase):
        there = np.array([1, 1, k < 2, 1])[:, None]
        weight = np.asarray(phase.rest_length)[:, None] * [0.0, 0.0, -20.0]
        along = np.hypot(1.0, 0.3) * line * (k > 0)
        return halves(cables.links.array, there * (weight + along), 5)

    return structure, phases, by_hand


CASES = {"pressure": arch_under_pressure, "freed": freed_and_propped, "stages": stages}


@functools.lru_cache
def solved(name):
    structure, phases = CASES[name]()[:2]
    solution = converged(jc.solve(structure, phases, TIGHT))
    return solution


@pytest.mark.quick_cases("stages")
@pytest.mark.parametrize("name", CASES)
def test_loads_of_every_end_are_in_balance_with_reactions(name):
    """Of the whole structure, whatever is inside; and they change from phase to phase."""
    loads = [np.asarray(phase.load) for phase in solved(name).phases]
    for load, phase in zip(loads, solved(name).phases, strict=True):
        parts = np.asarray(phase.reactions) + load
        assert np.abs(parts.sum(axis=0)).max() < 1e-8 * np.abs(parts).sum()
    np.testing.assert_array_equal(loads[-1], solved(name).load)
    assert max(np.abs(a - b).max() for a, b in itertools.pairwise(loads)) > 1.0


@pytest.mark.quick_cases("stages")
@pytest.mark.parametrize("name", CASES)
def test_sums_by_hand(name):
    by_hand = CASES[name]()[2]
    for k, phase in enumerate(solved(name).phases):
        np.testing.assert_allclose(phase.load, by_hand(k, phase), atol=1e-9, err_msg=f"phase {k}")


def test_phases_that_failed_have_none():
    structure, phases = jc.scenes.flat_net(load=15.0)
    failed = jc.solve(structure, phases, jc.Newton(max_steps=1))
    assert int(failed.status) != 0
    assert np.isfinite(failed.phases[0].load).all() and np.isnan(failed.phases[1].load).all()
