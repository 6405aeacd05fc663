"""Nets with large slack regions: few steps, whatever their size, to the state of least energy."""

import numpy as np
import pytest
from banks.slack_nets import KINDS, scene
from oracles.convex_oracle import WIDE, Element, Scene, find

import jaxcable as jc

MAX_STEPS = (
    40  # steps: 20 to 31 are measured; without cones 36 to 65, and 770 for 40 nodes on a side
)


def steps_of(solution):
    jc.raise_if_failed(solution)
    return int(solution.phases[0].path.iterations[0])


@pytest.mark.slow
def test_steps_do_not_grow_with_slack_regions():
    assert steps_of(jc.solve(*scene("half", 40))) <= MAX_STEPS


@pytest.mark.slow
def test_tensions_are_those_of_least_energy():
    """In both precisions, by a cone program in extended precision."""
    structure, phase = scene("half", 12, ratio=1e3)
    links, n = structure.elements.links.array, structure.n_node
    stiffness = float(np.max(structure.elements.axial_stiffness))
    free = np.repeat(~np.isin(np.arange(n), [0, 11, 132, 143])[:, None], 3, axis=1)
    cables = [
        Element("cable", tuple(link), stiffness, WIDE(rest))
        for link, rest in zip(links, np.asarray(phase.rest_length), strict=True)
    ]
    found = find(Scene(np.asarray(structure.nodes), free, np.asarray(phase.loads.forces), cables))
    assert found.found
    exact = np.array(found.tension, float)
    assert (exact < 1e-9 * exact.max()).sum() > 100  # a large slack region
    for dtype, allowed in ((np.float64, 1e-7), (np.float32, 1e-3)):
        solution = jc.solve(*scene("half", 12, ratio=1e3, dtype=dtype))
        assert steps_of(solution) <= MAX_STEPS
        assert solution.tension.dtype == dtype
        tension = np.asarray(solution.tension, float)
        assert np.abs(tension - exact).max() < allowed * exact.max()
        assert np.abs((1 + 10 * allowed) * tension - exact).max() > allowed * exact.max()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("ratio", [1e2, 1e6])
def test_steps_are_few_for_any_stiffness_and_pattern(kind, ratio):
    assert steps_of(jc.solve(*scene(kind, 20, ratio))) <= MAX_STEPS
