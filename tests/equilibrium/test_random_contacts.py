"""Structures with contacts of one kind, many seeds: in balance by a potential in NumPy."""

import numpy as np
import pytest
from banks.contact_bank import drawn, judged
from oracles.contact_potential import ContactPotential

import jaxcable as jc

# structures of random forces, some of which move far, or turn freely under none
pytestmark = pytest.mark.filterwarnings(
    "ignore:node .* has moved", "ignore::jaxcable.UnstableWarning"
)

LOOSE = 9, 95, 152
"""Seeds below 200 of "mixed" in which no bar, cable or spring holds a node that is loaded."""


def solved(kind, seed, **settings):
    one = drawn(kind, seed)
    return one, jc.solve(one.structure, one.phases, jc.Newton(**settings))


# 62: contacts that close within a step; 113: cables go slack and contacts open in turn; 77 and 180:
# nodes slide along contacts; 167: the second increment
@pytest.mark.slow_cases("77", "180", "113")
@pytest.mark.parametrize("seed", [62, 113, 77, 180, 167])
def test_an_equilibrium_is_found_where_nodes_slide_along_contacts(seed):
    """The potential in NumPy has a minimum where the analysis ends: no force, all curvatures up."""
    one, solution = solved("mixed", seed)
    assert int(solution.status) == jc.status.OK
    displacement = np.asarray(solution.displacement)
    potential = ContactPotential(one.structure, one.phases)
    left, size = potential.gradient(displacement)
    # the tolerance of Newton's method is 1e-10 of the forces at a node; NumPy subtracts lengths,
    # which leaves 1e-16 EA / force
    assert np.abs(left).max() < 1e-8 * size
    curvatures = np.linalg.eigvalsh(potential.hessian(displacement))
    assert curvatures[0] > 1e-9 * curvatures[-1]  # roundings are 1e-15 of the largest


@pytest.mark.parametrize("seed", [9, pytest.param(95, marks=pytest.mark.slow)])
def test_a_node_that_only_contacts_hold_is_a_mechanism(seed):
    """Its load moves it away without end: the potential falls by the load times the way."""
    one, solution = solved("mixed", seed)
    assert int(solution.status) == jc.status.MECHANISM
    bears = [one.structure.elements[name].links.array for name in ("bars", "cables", "springs")]
    (node,) = set(range(5, 10)) - set(np.concatenate([links.ravel() for links in bears]))
    potential = ContactPotential(one.structure, one.phases)
    force, far = potential.load[node], np.zeros((10, 3))
    far[node] = force / np.linalg.norm(force)
    # a kilometre away all contacts are open; roundings of 1e-16 of the energies that cancel
    fall = potential.energy(1e3 * far) - potential.energy(2e3 * far)
    assert fall == pytest.approx(1e3 * np.linalg.norm(force), rel=1e-9)


@pytest.mark.slow
def test_all_random_structures_that_have_an_equilibrium_converge():
    for seed in range(200):
        one, solution = solved("mixed", seed)
        result = judged(one, solution)
        expected = jc.status.MECHANISM if seed in LOOSE else jc.status.OK
        assert result.code == expected and not result.wrong, (seed, result)
        if result.code == jc.status.OK:
            check_forces(one, solution)


def check_forces(one, solution):
    """Forces are those of the potential, and an open bearing has none."""
    displacement = np.asarray(solution.displacement)
    _, force = ContactPotential(one.structure, one.phases).forces(displacement)
    told = [np.asarray(solution.tension[name]) for name in ("bars", "cables", "contacts")]
    opening = np.asarray(solution.element_results["opening"]["ground"])
    pressure = np.asarray(solution.tension["ground"])
    size = max(np.abs(force).max(), np.abs(pressure).max(), 1.0)
    assert np.abs(force - np.concatenate(told)).max() < 1e-8 * size  # as in the test above
    assert (pressure <= 0).all() and (pressure[opening > 0] == 0).all()
