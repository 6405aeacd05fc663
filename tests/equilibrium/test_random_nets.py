"""Tension-only nets under dead load converge from any start, to one energy."""

import numpy as np
import pytest
from banks.problems import random_net, unbalanced

import jaxcable as jc

SPREAD = 3.0  # m, standard deviation of a random start; the nets are 2 to 6 m wide


@pytest.mark.filterwarnings("ignore:loads of phases")  # some of them are soft
@pytest.mark.parametrize("count", [10, pytest.param(100, marks=pytest.mark.slow)])
def test_random_nets_converge_from_random_starts_to_one_energy(count):
    with_slack = steps = 0
    for seed in range(count):
        nodes, links, stiffness, rest, forces, anchors, free = random_net(seed)
        rng = np.random.default_rng(1000 + seed)
        load = jc.Phase(loads=jc.NodalLoads(free, forces))
        energies = []
        for start in range(3):
            begin = nodes.copy()
            if start:
                begin[free] += SPREAD * rng.normal(size=(len(free), 3))
            cables = jc.Cables(links, axial_stiffness=stiffness, rest_length=rest)
            solution = jc.solve(jc.Structure(begin, cables, jc.pinned(anchors)), [load])
            path = solution.phases[0].path
            assert int(solution.status) == 0, (seed, start, jc.describe(solution.status))
            steps = max(steps, int(path.iterations[0]))

            positions = np.asarray(solution.positions)
            out, force = unbalanced(
                nodes, links, stiffness, rest, positions, np.asarray(solution.load)
            )
            scale = np.abs(force).max() + np.abs(forces).max()
            # tol 1e-10 of at least this scale, and EA eps of lengths of 10 m for the oracle
            assert np.abs(out[free]).max() < 1e-8 * scale, (seed, start)

            slack = force == 0
            tension = np.asarray(solution.tension)
            assert int(path.n_slack[0]) == slack.sum()
            assert (tension[slack] == 0.0).all() and (tension[~slack] > 0).all()
            with_slack += bool(slack.any())

            stored = (0.5 * force**2 * rest / stiffness).sum()
            work = (forces * positions[free]).sum()
            energies.append(stored - work)
        assert np.ptp(energies) < 1e-9 * (stored + abs(work)), (seed, energies)
    assert with_slack > count
    assert steps <= 200


def test_a_start_with_every_cable_slack_is_found_taut():
    """Rest lengths twice the chords: the net falls until it hangs."""
    structure, _ = jc.scenes.flat_net()
    slack = jc.replace(structure, elements=jc.replace(structure.elements, rest_length=0.8))
    load = jc.Phase(loads=jc.NodalLoads([3, 4, 7, 8], (0, 0, -10.0)), increments=2)
    solution = jc.solve(slack, [load])
    jc.raise_if_failed(solution)
    assert (np.asarray(solution.displacement)[[3, 4, 7, 8], 2] < -0.3).all()


def test_stiff_swing_needs_the_soft_detour():
    """EA/N near 1e5 and a long way to swing: stays within the default number of steps."""
    nodes = np.array([[0.0, 0, 0], [0, 0, 1.0], [0, 0.1, 2.0], [0.1, 0, 3.0]])
    chain = jc.Cables([[0, 1], [1, 2], [2, 3]], axial_stiffness=1e6)
    solution = jc.solve(
        jc.Structure(nodes, chain, jc.pinned([0])),
        [jc.Phase(loads=jc.NodalLoads([1, 2, 3], [(0, 0.1, -1.0), (0.1, 0, -2.0), (0, 0, -9.0)]))],
    )
    jc.raise_if_failed(solution)
    assert (np.asarray(solution.positions)[1:, 2] < 0).all()
    assert np.allclose(solution.tension[2], 9.0, rtol=1e-8)


@pytest.mark.slow
def test_nets_of_catenaries_ropes_and_cables_converge_from_random_starts():
    """Their energies are convex, too: one equilibrium whatever the start.

    A rope runs between three anchors over two free nodes, which it cannot draw onto each other
    (there its energy has a kink and the equilibrium no tangent).
    """
    for seed in range(10):
        nodes, links, stiffness, rest, forces, anchors, free = random_net(seed)
        rng = np.random.default_rng(2000 + seed)
        half = len(links) // 2
        over = rng.choice(free, 2, replace=False)
        chain = [anchors[0], over[0], anchors[1], over[1], anchors[2]]
        length = np.linalg.norm(np.diff(nodes[chain], axis=0), axis=1).sum()
        elements = {
            "hanging": jc.Catenaries(
                links[:half],
                axial_stiffness=stiffness[:half],
                rest_length=rest[:half],
                weight=10 ** rng.uniform(-1, 2, half),
            ),
            "straight": jc.Cables(
                links[half:], axial_stiffness=stiffness[half:], rest_length=rest[half:]
            ),
            "rope": jc.SlidingCables(
                [chain], axial_stiffness=1e4, rest_length=length * rng.uniform(0.8, 1.2)
            ),
        }
        phase = jc.Phase(loads=[jc.SelfWeight(), jc.NodalLoads(free, forces)])
        tensions = []
        for start in range(3):
            begin = nodes.copy()
            if start:
                begin[free] += SPREAD * rng.normal(size=(len(free), 3))
            # weight of ropes and straight cables is left out: it would depend on initial places
            solution = jc.solve(jc.Structure(begin, elements, jc.pinned(anchors)), [phase])
            assert int(solution.status) == 0, (seed, start, jc.describe(solution.status))
            parts = [solution.tension[name] for name in elements]
            tensions.append(np.concatenate(parts))
        size = np.abs(tensions[0]).max()
        # the residual, 1e-10 of the forces, over the softest way to move (weights of 0.1 N/m)
        assert np.ptp(tensions, axis=0).max() < 1e-6 * size, seed
