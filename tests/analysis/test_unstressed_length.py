"""Which length has weight and takes loads: under heat, jacks and inputs one after the other."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged

import jaxcable as jc

NODES = np.array([[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [5.0, 0.0, 3.5]])
LENGTH = np.linalg.norm(np.diff(NODES, axis=0), axis=1)


def two_cables(kind=jc.Cables, nodes=NODES, **more):
    values = {"axial_stiffness": 1e6, "weight": 20.0, "expansion": 1.2e-5, **more}
    return jc.Structure(nodes, kind([[0, 1], [1, 2]], **values), jc.pinned([0, 2]))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [jc.Cables, jc.Catenaries])
def test_heat_keeps_weight_and_mass(kind):
    """200 K are 2.4e-3 of the length: far above the rounding that is granted."""
    structure = two_cables(kind, rest_length=1.01 * LENGTH)
    phases = [jc.Phase(loads=jc.SelfWeight()), jc.Phase(temperature=200.0)]
    solution = converged(jc.solve(structure, phases))
    np.testing.assert_allclose(solution.rest_length, 1.01 * LENGTH * (1 + 2.4e-3), rtol=1e-14)
    weight = 20.0 * 1.01 * LENGTH.sum()
    for phase in solution.phases:  # cold, warm
        np.testing.assert_allclose(-phase.load[:, 2].sum(), weight, rtol=1e-14)
        np.testing.assert_allclose(phase.reactions[:, 2].sum(), weight, rtol=1e-9)


@pytest.mark.slow
def test_heat_keeps_mass():
    structure = two_cables(nodes=NODES * [1.0, 1.0, 0.0])
    for change in (0.0, -200.0):
        phase = jc.Phase(pretension=900.0, temperature=change)
        solution = converged(jc.solve(structure, phase))
        found = jc.dynamics.modes(structure, solution, distribution="lumped")
        stiffness = np.trace(jc.stiffness.tangent_stiffness(structure, solution))
        # half of each cable swings with the node, by the length that 900 N left of its chord
        mass = 20.0 * 9.0 / (1 + 900.0 / 1e6) / 2 / 9.80665
        np.testing.assert_allclose(stiffness / np.sum(found.squared), mass, rtol=1e-12)


def test_snow_on_the_area_after_prestress():
    """The plan area of the moved mesh, by the shoelace formula."""
    structure, _ = jc.scenes.flat_net()
    faces = [[3, 4, 8, 7]]  # the mesh between the free nodes
    uneven = jnp.linspace(100.0, 3000.0, len(structure.elements.links))
    snow = jc.AreaLoads(faces, (0.0, 0.0, -500.0), geometry="begun")
    phases = [jc.Phase(pretension=uneven), jc.Phase(loads=snow), jc.Phase()]
    solution = converged(jc.solve(structure, phases))
    areas = []
    for places in (structure.nodes, *(phase.positions for phase in solution.phases[:2])):
        x, y = np.asarray(places)[faces[0], :2].T
        areas.append(0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    assert abs(areas[2] / areas[1] - 1) > 1e-7  # which is not measured again
    assert abs(areas[1] / areas[0] - 1) > 1e-5  # ten million roundings
    np.testing.assert_allclose(-solution.load[:, 2].sum(), 500.0 * areas[1], rtol=1e-12)
