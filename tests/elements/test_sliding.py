"""Cables that slide without friction: pulleys, chains of them, closed loops."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient, joined
from scipy.optimize import brentq

import jaxcable as jc


def pulley(load=(0.0, 0.0, -1000.0), stiffness=1e6, length=10.0):
    """One pulley that hangs freely on a rope between two supports at different heights."""
    nodes = [[0.0, 0, 0], [3.0, 0, -2.5], [8.0, 0, 1.5]]
    rope = jc.SlidingCables([[0, 1, 2]], axial_stiffness=stiffness, rest_length=length)
    structure = jc.Structure(nodes, rope, jc.pinned([0, 2]))
    return structure, jc.Phase(loads=jc.NodalLoads([1], load))


def test_pulley_has_one_tension():
    """Both pieces pull with the same force, to rounding, and make equal angles with the load.

    Closed form: sin(angle to the vertical) = span / length, T = P / (2 cos(angle)).
    """
    structure, phase = pulley()
    solution = converged(jc.solve(structure, [phase], TIGHT))
    pulls = np.linalg.norm(solution.reactions[jnp.array([0, 2])], axis=1)
    tension = float(solution.tension[0])
    assert pulls == pytest.approx([tension, tension], rel=4e-16)  # two roundings
    length = 10.0 * (1 + tension / 1e6)
    assert tension == pytest.approx(500 / np.sqrt(1 - (8 / length) ** 2), rel=1e-12)
    places = np.asarray(solution.positions)
    pieces = np.diff(places, axis=0)
    assert np.linalg.norm(pieces, axis=1).sum() == pytest.approx(length, rel=1e-14)
    sines = np.abs(pieces[:, 0]) / np.linalg.norm(pieces, axis=1)
    assert sines == pytest.approx(8 / length, rel=1e-10)


def test_jack_pulls_a_running_rope():
    """Held at its force while it is jacked; anchored, nothing moves."""
    structure, phase = pulley()
    jacked = converged(jc.solve(structure, [jc.replace(phase, jacking=800.0), jc.Phase()], TIGHT))
    assert jnp.abs(jacked.tension - 800.0).max() < 1e-9
    assert jnp.abs(jacked.phases[1].displacement_in_phase).max() < 1e-12
    exact = 8 / np.sin(np.arccos(1000 / 1600))
    assert float(jacked.rest_length[0]) == pytest.approx(exact / (1 + 8e-4), rel=1e-12)


def test_weight_slides_with_the_rope():
    """A mass M on a rope over a fixed pulley, down to a support: what hangs where is statics.

    A rope of weight w per length as it hangs pulls with ``M + w (a - b)`` at the support, with the
    legs a of the mass and b of the support, and with the mean of what it pulls with along its
    length, ``M + w (a^2 + 2 a b - b^2) / 2 l``, it lengthens: one equation for a. The nodes stand
    far from there at first.
    """
    mass, weight, rest, b, stiffness = 300.0, 40.0, 10.0, 3.0, 2e4
    nodes = [[0.0, 0, -6.2], [0.0, 0, 0], [0.0, 0, -b]]
    rope = jc.SlidingCables([[0, 1, 2]], axial_stiffness=stiffness, rest_length=rest, weight=weight)
    structure = jc.Structure(nodes, rope, jc.pinned([1, 2]) + jc.restrained([0], "xy"))
    loads = [jc.NodalLoads([0], (0, 0, -mass)), jc.SelfWeight()]
    solution = converged(jc.solve(structure, [jc.Phase(loads=loads)], TIGHT))

    def mean(a):
        line = weight * rest / (a + b)
        return mass + line * (a**2 + 2 * a * b - b**2) / (2 * (a + b))

    a = brentq(lambda a: stiffness * ((a + b) / rest - 1) - mean(a), 6.0, 9.0, xtol=1e-14)
    line = weight * rest / (a + b)
    assert -float(solution.positions[0, 2]) == pytest.approx(a, rel=1e-12)
    assert float(solution.tension[0]) == pytest.approx(mean(a), rel=1e-10)  # EA/N of the rounding
    assert -float(solution.reactions[2, 2]) == pytest.approx(mass + line * (a - b), rel=1e-10)
    # loads, with the sum of all weight, and balance
    load = np.asarray(solution.load)
    assert load[:, 2].sum() == pytest.approx(-mass - weight * rest, rel=1e-13)
    assert np.asarray(solution.reactions + solution.load)[:, 2].sum() == pytest.approx(0, abs=1e-9)
    assert -load[0, 2] == pytest.approx(mean(a), rel=1e-10)  # the mass hangs still


def test_a_rope_that_balances_over_a_peg_is_unstable():
    """Legs of equal length of a heavy rope over a peg: whatever sinks goes on sinking."""
    nodes = [[-0.1, 0, -2.0], [0.0, 0, 0], [0.1, 0, -2.0]]
    rope = jc.SlidingCables([[0, 1, 2]], axial_stiffness=1e4, weight=10.0)
    structure = jc.Structure(nodes, rope, jc.pinned([1]) + jc.restrained([0, 2], "xy"))
    with pytest.warns(jc.UnstableWarning, match=r"phases\[0\]\) ends in an unstable equilibrium"):
        solution = jc.solve(structure, jc.Phase(loads=jc.SelfWeight()))
    assert int(solution.status) == 0 and not bool(solution.stable)
    z = np.asarray(solution.positions[:, 2])
    assert z[0] == pytest.approx(z[2], rel=1e-9)


def test_line_loads_per_initial_length_stay():
    structure, _ = pulley()
    load = jc.LineLoads((0, 0, -20.0), per="initial")
    solution = converged(jc.solve(structure, [jc.Phase(loads=load)], TIGHT))
    pieces = np.linalg.norm(np.diff(np.asarray(structure.nodes), axis=0), axis=1)
    share = 0.5 * np.array([pieces[0], pieces.sum(), pieces[1]])
    assert np.asarray(-solution.load[:, 2]) == pytest.approx(20.0 * share, rel=1e-14)


def weighed(p):
    """A pulley under a force, stiffness, length, positions of nodes and weight that slides."""
    structure, phase = pulley(p["force"], p["stretching"][0] * 1e6, p["stretching"][1] * 10)
    rope = jc.replace(structure.elements, weight=p["weight"])
    structure = jc.replace(structure, nodes=p["nodes"], elements=rope)
    solution = jc.solve(structure, [jc.replace(phase, loads=[phase.loads, jc.SelfWeight()])], TIGHT)
    value = jnp.sum(jnp.sin(jnp.arange(9.0)) * solution.positions.ravel())
    return value + jnp.log(solution.tension[0]), solution.status


def test_gradients():
    p = {
        "force": [300.0, 0.0, -1000.0],
        "stretching": np.ones(2),
        "nodes": pulley()[0].nodes,
        "weight": [60.0],
    }
    assert_gradient(*joined(weighed, p), corrupted=1.02)
