"""Graphs and meshes of compas, written: read back exactly, and opened by compas itself."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

import jaxcable as jc
from jaxcable.files import read_network, save_network


@pytest.fixture(scope="module")
def solved():
    structure, phases = jc.scenes.flat_net(load=15.0)
    solution = jc.solve(structure, phases)
    assert int(solution.status) == 0
    return structure, phases, solution


def test_a_result_comes_back_exactly(solved, tmp_path):
    structure, _, solution = solved
    (path,) = save_network(tmp_path / "net.json", structure, solution)
    net = read_network(path)
    np.testing.assert_array_equal(net.nodes, solution.positions)
    links = structure.elements.links.array.tolist()
    assert sorted(net.links.tolist()) == sorted(links)  # they are sorted by their first nodes
    order = [net.links.tolist().index(pair) for pair in links]
    held = structure.supports.fixed(structure.n_node)[:, :3]
    np.testing.assert_array_equal(net.fixed, held)
    np.testing.assert_array_equal(net.loads, solution.load)
    data = json.loads(path.read_text())["data"]
    for k, (i, j) in enumerate(links):
        about = data["edge"][str(i)][str(j)]
        assert about["f"] == solution.tension[k] and about["l0"] == solution.rest_length[k]
        length = float(np.linalg.norm(solution.positions[i] - solution.positions[j]))
        assert about["l"] == pytest.approx(length, rel=1e-15)  # the same sum
        assert net.values["force_density"][order[k]] == about["q"] == about["f"] / about["l"]
    # force densities are in balance with the loads: q (x_i - x_j) summed, at every free node
    balance = np.array(net.loads)
    for (i, j), q in zip(net.links, net.values["force_density"], strict=True):
        balance[i] += q * (net.nodes[j] - net.nodes[i])
        balance[j] += q * (net.nodes[i] - net.nodes[j])
    free = ~held.all(axis=1)
    assert np.abs(balance[free]).max() < 1e-8  # N, of 300: the residual of the analysis


def test_a_structure_alone_and_a_rope(tmp_path):
    nodes = [[0.0, 0, 0], [1, 0, -1], [2, 0, 0], [1, 0, 1 / 3]]
    elements = {
        "rope": jc.SlidingCables([[0, 1, 2]], axial_stiffness=1e5),
        "tie": jc.Bars([[1, 3]], axial_stiffness=1e5),
    }
    structure = jc.Structure(nodes, elements, jc.pinned([0, 2, 3]))
    (path,) = save_network(tmp_path / "net.json", structure)
    net = read_network(path)
    assert net.nodes.tolist() == nodes and net.links.tolist() == [[0, 1], [1, 2], [1, 3]]
    assert "force_density" not in net.values and net.loads is None
    assert json.loads(path.read_text())["data"]["edge"]["1"]["3"]["group"] == "tie"
    twice = {**elements, "more": jc.Cables([[1, 0]], axial_stiffness=1.0)}
    with pytest.raises(ValueError, match="two between the nodes 0 and 1"):
        save_network(path, jc.replace(structure, elements=twice))
    with pytest.raises(ValueError, match=r"ends with \.json"):
        save_network(tmp_path / "net.obj", structure)


def quilt():
    """Two triangles, whose sides are cables."""
    nodes = [[0.0, 0, 0], [1, 0, 0], [1, 1, 1 / 7], [0, 1, 0]]
    links = [[0, 1], [1, 2], [2, 0], [2, 3], [3, 0]]
    structure = jc.Structure(nodes, jc.Cables(links, axial_stiffness=1e5), jc.pinned([0, 1, 3]))
    return structure, [[0, 1, 2], [0, 2, 3]]


def test_a_mesh_comes_back(tmp_path):
    structure, faces = quilt()
    solution = jc.solve(structure, jc.Phase(pretension=100.0))
    (path,) = save_network(tmp_path / "net.json", structure, solution, faces=faces)
    net = read_network(path)
    np.testing.assert_array_equal(net.nodes, solution.positions)
    where = {frozenset(pair): k for k, pair in enumerate(structure.elements.links.array.tolist())}
    order = [where[frozenset(pair)] for pair in net.links.tolist()]
    assert sorted(order) == list(range(5))
    about = json.loads(path.read_text())["data"]["edgedata"]
    assert about["(0, 2)"]["f"] == solution.tension[2]
    known = [0.0 if np.isnan(q) else q for q in net.values["force_density"]]
    lengths = np.linalg.norm(net.nodes[net.links[:, 1]] - net.nodes[net.links[:, 0]], axis=1)
    np.testing.assert_allclose(known, solution.tension[np.array(order)] / lengths, rtol=1e-15)
    for bad, message in (
        ([[0, 1, 2]], r"the link \[0, 3\] is no side of a face"),
        ([[0, 1, 2], [1, 2, 3], [0, 2, 3]], r"the link \[1, 3\] of a face has no element"),
        ([[0, 1, 9], [0, 2, 3]], r"faces\[0\] = \[0, 1, 9\]: the structure has nodes 0 to 3"),
    ):
        with pytest.raises(ValueError, match=message):
            save_network(path, structure, solution, faces=bad)


OPEN = """
import json, sys, compas
found = compas.json_load(sys.argv[1])
graph = type(found).__name__ == "Graph"
of = found.node_attributes if graph else found.vertex_attributes
nodes = list(found.nodes() if graph else found.vertices())
edges = {str(sorted(e)): found.edge_attributes(e, ["q", "f", "l", "l0"]) for e in found.edges()}
places = [of(k, ["x", "y", "z", "is_support"]) for k in nodes]
print(json.dumps([type(found).__name__, places, edges]))
"""


def compas():
    """Python with compas, or None: ``COMPAS_PYTHON``, or this one if it has it."""
    python = os.environ.get("COMPAS_PYTHON", sys.executable)
    found = subprocess.run([python, "-c", "import compas"], capture_output=True, check=False)
    return python if found.returncode == 0 else None


@pytest.mark.parametrize("kind", ["Graph", "Mesh"])
def test_compas_opens_it(kind, solved, tmp_path):
    python = compas()
    if python is None:
        pytest.skip("compas is not installed; set COMPAS_PYTHON to a Python that has it")
    structure, _, solution = solved
    faces = None
    if kind == "Mesh":
        structure, faces = quilt()
        solution = jc.solve(structure, jc.Phase(pretension=100.0))
    (path,) = save_network(tmp_path / "net.json", structure, solution, faces=faces)
    done = subprocess.run(
        [python, "-c", OPEN, str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    name, nodes, edges = json.loads(done.stdout)
    assert name == kind
    np.testing.assert_array_equal([node[:3] for node in nodes], solution.positions)
    held = structure.supports.fixed(structure.n_node)[:, :3].all(axis=1)
    assert [node[3] for node in nodes] == held.tolist()
    for k, pair in enumerate(structure.elements.links.array.tolist()):
        q, f, length, rest = edges[str(sorted(pair))]
        assert (f, rest) == (solution.tension[k], solution.rest_length[k]) and q == f / length
