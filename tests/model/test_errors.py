"""Bad input gets a ValueError that names the argument, the index and the rule."""

import jax
import numpy as np
import pytest

import jaxcable as jc

NODES = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
CABLES = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e3)
STRUCTURE = jc.Structure(NODES, CABLES, jc.pinned([0, 2]))


def analyse(**phase):
    return jc.solve(STRUCTURE, [jc.Phase(**phase)])


def cables(links=((0, 1), (1, 2)), **options):
    return jc.Cables(links, **{"axial_stiffness": 1e3, **options})


CASES = {
    # elements
    "links shape": (lambda: cables([[0, 1, 2]]), r"links: expected shape \[n, 2\]"),
    "links kind": (lambda: cables([[0.0, 1.0]]), "links: expected integers"),
    "no links": (lambda: cables(np.zeros((0, 2), int)), "links: a group needs at least one"),
    "negative node": (lambda: cables([[0, 1], [-1, 2]]), r"links\[1\]"),
    "equal ends": (lambda: cables([[0, 1], [2, 2]]), r"links\[1\] = \[2, 2\]: the two ends"),
    "repeated link": (lambda: cables([[0, 1], [1, 2], [1, 0]]), r"links\[2\].*repeats links\[0\]"),
    "stiffness sign": (
        lambda: cables(axial_stiffness=[1.0, -1.0]),
        r"axial_stiffness\[1\] = -1.0: must be positive",
    ),
    "stiffness shape": (
        lambda: cables(axial_stiffness=[1.0, 1.0, 1.0]),
        r"axial_stiffness: expected a scalar or shape \(2,\)",
    ),
    "area and stiffness": (lambda: cables(area=1.0), "axial_stiffness, area: give either"),
    "no section": (lambda: jc.Cables([[0, 1]]), "axial_stiffness: missing"),
    "area without law": (lambda: jc.Cables([[0, 1]], area=1.0), "axial_stiffness: missing"),
    "rest length": (lambda: cables(rest_length=[0.0, 1.0]), r"rest_length\[0\] = 0.0"),
    "weight": (lambda: cables(weight=-1.0), r"weight\[0\] = -1.0: must not be negative"),
    "text": (lambda: cables(axial_stiffness="stiff"), "axial_stiffness: expected numbers"),
    "modulus": (lambda: jc.Elastic(-1.0), "E = -1.0: Young's modulus must be positive"),
    "modulus shape": (lambda: jc.Elastic([1.0, 2.0]), "E: expected a scalar"),
    # structure
    "nodes shape": (
        lambda: jc.Structure(NODES[:, :2], CABLES, jc.pinned([0])),
        r"nodes: expected shape \[n_node, 3\]",
    ),
    "unknown node": (
        lambda: jc.Structure(NODES[:2], CABLES, jc.pinned([0])),
        r"links\[1\] = \[1, 2\]: the structure has nodes 0 to 1",
    ),
    "zero length": (
        lambda: jc.Structure(NODES * [[0], [0], [1]], CABLES, jc.pinned([0])),
        r"links\[0\] = \[0, 1\]: zero length",
    ),
    "no supports": (lambda: jc.Structure(NODES, CABLES), "supports: missing"),
    "supports free": (
        lambda: jc.Structure(NODES, CABLES, jc.Supports(np.zeros((3, 3), bool))),
        "supports: no freedom is fixed",
    ),
    "supports mask": (
        lambda: jc.Supports(np.zeros((3, 2), bool)),
        r"supports mask: expected booleans \[n_node, 3\]",
    ),
    "supports rows": (
        lambda: jc.Structure(NODES, CABLES, jc.Supports(np.ones((2, 3), bool))),
        "supports mask: has 2 rows",
    ),
    "supports unknown": (
        lambda: jc.Structure(NODES, CABLES, jc.pinned([0, 7])),
        r"pinned nodes\[1\] = 7: the structure has nodes 0 to 2",
    ),
    "idle node": (
        lambda: jc.Structure(np.r_[NODES, [[5.0, 5, 5]]], CABLES, jc.pinned([0, 2])),
        r"nodes\[3\]: no element touches this node",
    ),
    "not a group": (
        lambda: jc.Structure(NODES, {"net": [1.0]}, jc.pinned([0])),
        r"elements\['net'\]\[0\]: float is not an element group",
    ),
    # loads
    "load node": (
        lambda: analyse(loads=jc.NodalLoads([1, 9], (0, 0, 1.0))),
        r"load nodes\[1\] = 9: the structure has nodes 0 to 2",
    ),
    "load shape": (
        lambda: jc.NodalLoads([1, 2], np.zeros((3, 3))),
        r"forces: expected shape \(3,\) or \(2, 3\)",
    ),
    "not a load": (lambda: jc.Phase(loads=[3.0]), r"loads\[0\]: float is not a load"),
    "no weight": (lambda: analyse(loads=jc.SelfWeight()), "SelfWeight: no element group has"),
    "direction": (lambda: jc.SelfWeight((0, -1)), r"direction: expected shape \(3,\)"),
    # phases
    "increments": (lambda: jc.Phase(increments=0), "increments = 0: a phase has at least 1"),
    "increments kind": (lambda: jc.Phase(increments=1.5), "increments = 1.5: expected an integer"),
    "phase supports": (lambda: jc.Phase(supports=[0]), "supports: expected pinned"),
    "two statements": (
        lambda: analyse(pretension=1.0, rest_length=1.0),
        "pretension, rest_length: both state the prestress of elements;",
    ),
    "jacking and shortening": (
        lambda: analyse(jacking=1.0, shortening=0.1),
        "jacking: elements has",
    ),
    "negative pretension": (
        lambda: analyse(pretension=[1.0, -2.0]),
        r"pretension\[1\] = -2.0: a cable carries tension only",
    ),
    "pretension shape": (
        lambda: analyse(pretension=[1.0, 2.0, 3.0]),
        r"pretension: expected a scalar or shape \(2,\)",
    ),
    "pretension tree": (
        lambda: analyse(pretension={"net": 1.0}),
        "pretension: expected one number",
    ),
    "rest length sign": (lambda: analyse(rest_length=-1.0), "rest_length.*must be positive"),
    "prestrain": (lambda: analyse(prestrain=-1.5), "prestrain.*must be above -1"),
    "moments": (
        lambda: jc.solve(
            STRUCTURE, [jc.Phase(loads=jc.NodalLoads([1], (0, 0, 1.0), moments=(0, 0, 1.0)))]
        ),
        "moments: node 1 has no rotation",
    ),
    "compliance": (lambda: cables(compliance=-1e-3), r"compliance\[0\] = -0.001: must not"),
    "temperature": (lambda: analyse(temperature=10.0), "temperature: the group has no expansion"),
    # solve
    "structure": (lambda: jc.solve(NODES, []), "structure: expected a Structure, got ndarray"),
    "no phases": (lambda: jc.solve(STRUCTURE, []), "phases: an analysis needs at least one"),
    "phase": (lambda: jc.solve(STRUCTURE, [1]), r"phases\[0\]: expected a Phase, got int"),
    "method": (lambda: jc.solve(STRUCTURE, [jc.Phase()], "newton"), "method: expected Newton"),
    "start": (lambda: jc.solve(STRUCTURE, [jc.Phase()], start=1), "start: expected a Solution"),
    "tolerance": (lambda: jc.Newton(tol=-1.0), "tol = -1.0: must be positive"),
    "corrections": (lambda: jc.Incremental(-1), "corrections = -1: expected an integer >= 0"),
    "stiffness": (lambda: jc.Incremental(stiffness="x"), "stiffness = 'x': expected"),
    "replace": (lambda: jc.replace(STRUCTURE, node=1), "replace: Structure has no field 'node'"),
    "accuracy elements": (lambda: jc.scenes.accuracy_cable(7), "n_elements = 7"),
    "saddle": (lambda: jc.scenes.saddle(0, 3), "n_x, n_y = 0, 3"),
}


@pytest.mark.parametrize("name", CASES)
def test_wrong_argument(name):
    make, text = CASES[name]
    with pytest.raises(ValueError, match=text):
        make()


def test_start_of_another_structure():
    other = jc.solve(*jc.scenes.flat_net(load=15.0))
    with pytest.raises(ValueError, match="start: belongs to a structure of 12 nodes"):
        jc.solve(STRUCTURE, [jc.Phase()], start=other)


def test_constructors_work_on_tracers():
    """Shapes are checked always, values only when they are there."""

    def total(nodes, stiffness):
        group = jc.Cables([[0, 1], [1, 2]], axial_stiffness=stiffness)
        structure = jc.Structure(nodes, group, jc.pinned([0, 2]))
        return jc.solve(structure, [jc.Phase(pretension=stiffness)]).tension.sum()

    assert np.isfinite(jax.jit(total)(NODES, 10.0))
    with pytest.raises(ValueError, match="nodes: expected shape"):
        jax.jit(total)(NODES[:, :2], 10.0)
    with pytest.raises(ValueError, match="indices are topology"):
        jax.jit(lambda links: jc.Cables(links, axial_stiffness=1.0).axial_stiffness)(
            np.array([[0, 1]])
        )


def test_raise_if_failed_cannot_be_traced():
    def traced(t):
        jc.raise_if_failed(jc.solve(STRUCTURE, [jc.Phase(pretension=t)]))

    with pytest.raises(ValueError, match="the solution is being traced"):
        jax.jit(traced)(1.0)
