"""Tension-only nets under dead load converge from any start, to one energy."""

import numpy as np
import pytest
from banks.problems import random_net, unbalanced

import jaxcable as jc

# structures of random forces, some of which move far
pytestmark = pytest.mark.filterwarnings("ignore:node .* has moved")

SPREAD = 3.0  # m, standard deviation of a random start; the nets are 2 to 6 m wide


def starts(seed, nodes, free):
    """The nodes as drawn, and twice with the free ones thrown about."""
    rng = np.random.default_rng(1000 + seed)
    for start in range(3):
        begin = nodes.copy()
        if start:
            begin[free] += SPREAD * rng.normal(size=(len(free), 3))
        yield begin


@pytest.mark.filterwarnings("ignore:phases.*loads")  # some of them are soft
@pytest.mark.parametrize("count", [5, pytest.param(100, marks=pytest.mark.slow)])
def test_random_nets_converge_from_random_starts_to_one_energy(count):
    with_slack = steps = 0
    for seed in range(count):
        nodes, links, stiffness, rest, forces, anchors, free = random_net(seed)
        cables = jc.Cables(links, axial_stiffness=stiffness, rest_length=rest)
        load = jc.Phase(loads=jc.NodalLoads(free, forces))
        energies = []
        for begin in starts(seed, nodes, free):
            solution = jc.solve(jc.Structure(begin, cables, jc.pinned(anchors)), [load])
            path = solution.phases[0].path
            assert int(solution.status) == 0, (seed, jc.describe(solution.status))
            steps = max(steps, int(path.iterations[0]))

            positions, loads = np.asarray(solution.positions), np.asarray(solution.load)
            out, force = unbalanced(nodes, links, stiffness, rest, positions, loads)
            scale = np.abs(force).max() + np.abs(forces).max()
            # tol 1e-10 of at least this scale, and EA eps of lengths of 10 m for the oracle
            assert np.abs(out[free]).max() < 1e-8 * scale, seed

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
