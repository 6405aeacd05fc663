"""What goes on from a state has its topology, or is refused by the name of what differs."""

import numpy as np
import pytest
from banks.problems import pulls_on_nodes
from oracles.convergence import converged
from oracles.traced import traced

import jaxcable as jc

NODES = np.array([[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0], [0.0, 3.0, 3.0]])
LINKS = [[0, 1], [1, 2], [1, 3]]
WEIGHT = jc.NodalLoads([1], (0.0, 0.0, -600.0))


def net(links=LINKS, kind=jc.Cables, held=(0, 2, 3), nodes=NODES, wrap=None, **numbers):
    group = kind(links, **{"axial_stiffness": 1e5} | numbers)
    elements = {"net": group} if wrap is None else wrap(group)
    return jc.Structure(nodes, elements, supports=jc.pinned(held))


@pytest.fixture(scope="module")
def first():
    return converged(jc.solve(net(), jc.Phase(pretension=[500.0, 400.0, 100.0], loads=WEIGHT)))


REFUSED = {
    "renumbered": (
        lambda: net([[1, 2], [0, 1], [1, 3]]),
        r"elements\['net'\]: links\[0\] is \[1, 2\] in this structure, and \[0, 1\] there",
    ),
    "turned": (
        lambda: net([[0, 1], [1, 2], [3, 1]]),
        r"links\[2\] is \[3, 1\] in this structure, and \[1, 3\]",
    ),
    "fewer": (
        lambda: net([[0, 1], [1, 3]], held=(0, 2, 3)),
        "has 2 elements in this structure, and 3 there",
    ),
    "kind": (lambda: net(kind=jc.Bars), "is made of Bars in this structure, and of Cables there"),
    "chains": (
        lambda: net([[0, 1, 2], [1, 2, 2], [1, 3, 3]], jc.SlidingCables),
        "is made of SlidingCables in this structure",
    ),
    "tree": (lambda: net(wrap=lambda g: g), r"element groups: one without .* and \['net'\] there"),
    "name": (
        lambda: net(wrap=lambda g: {"guys": g}),
        r"groups: \['guys'\] in this structure, and \['net'\]",
    ),
    "nodes": (
        lambda: net(nodes=np.vstack([NODES, [[0.0, 0.0, 9.0]]]), held=(0, 2, 3, 4)),
        "belongs to a structure of 4 nodes; this structure has 5",
    ),
    "supports": (
        lambda: net(held=(0, 1, 2, 3)),
        "supports: this structure holds node 1 otherwise.*into a phase",
    ),
    "memory": (
        lambda: net(axial_stiffness=None, area=1e-4, law=jc.materials.strand()),
        "its law has other history variables than there",
    ),
}


@pytest.mark.slow_cases("renumbered")
@pytest.mark.parametrize("name", REFUSED)
def test_another_topology_is_refused_by_name(first, name):
    make, text = REFUSED[name]
    other = make()
    for start in (first, first.last):
        with pytest.raises(ValueError, match=f"start: .*{text}"):
            jc.solve(other, jc.Phase(), start=start)
    with pytest.raises(ValueError, match=f"state: .*{text}"):
        jc.stiffness.tangent_stiffness(other, first)


@pytest.mark.slow
def test_other_numbers_are_not(first):
    """Stiffness, places and weights may change; equilibrium is that of the new numbers."""
    moved = NODES + np.array([[0.0], [1.0], [0.0], [0.0]]) * 1e-3
    structure = net(nodes=moved, axial_stiffness=1.1e5, weight=3.0)
    again = traced(lambda start: jc.solve(structure, jc.Phase(loads=jc.SelfWeight()), start=start))
    solution = converged(again(first))
    pulls = pulls_on_nodes(structure, solution.positions, solution.tension)
    # of some 1000 N at that node Newton's method leaves 1e-10
    np.testing.assert_allclose((pulls + np.asarray(solution.load))[1], 0.0, atol=2e-7)
    weight = 0.5 * 3.0 * np.asarray(solution.rest_length["net"]).sum()
    np.testing.assert_allclose(solution.load[1], [0.0, 0.0, -600.0 - weight], rtol=1e-9)
    assert weight > 20.0
