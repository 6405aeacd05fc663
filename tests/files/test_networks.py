"""Networks and meshes of compas and jax_fdm: read as these programs write them, and written.

A reader reads a file whole, or names each thing that it leaves out in one warning and in
``omissions``, or raises a `FileError` of one line that names the file.
"""

import itertools
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from file_cases import EDGE, NODE, changed, network, outcome
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.files import read_network, save_network


def mesh():
    """A square of two triangles as jax_fdm writes it, with default attributes of compas_fofin."""
    corners = {"0": (0, 0), "1": (2, 0), "2": (2, 2), "3": (0, 2)}
    zero = {"px": 0.0, "py": 0.0, "pz": 0.0}
    return {
        "dtype": "jax_fdm.datastructures/FDMesh",
        "data": {
            "attributes": {"density": 1},
            "default_vertex_attributes": {"is_support": False, "constraint": None, **zero},
            "default_edge_attributes": {"q": 1.0, **zero},
            "default_face_attributes": zero,
            "vertex": {name: {"x": x, "y": y, "z": 0} for name, (x, y) in corners.items()},
            "face": {"0": [0, 1, 2], "1": [0, 2, 3]},
            "facedata": {"0": {}, "1": {}},
            "edgedata": {"(0, 1)": {"q": 3.0}},
            "max_vertex": 3,
            "max_face": 1,
        },
    }


def session(*items):
    """A session as compas_session dumps it: objects beside the tree of what is shown."""
    root = {"name": "ROOT", "children": [{"item": "9434", "settings": {"show": True}}]}
    scene = {"name": "Scene", "root": root, "items": [*items]}
    return {
        "data": {},
        "scene": {"dtype": "compas.scene/Scene", "data": scene, "guid": "26fb"},
        "settings": {"solver": {"kmax": 100}},
    }


def cable_mesh():
    """The mesh with the constraint of a vertex, as compas_fofin 0.15 writes it."""
    line = {"geometry": {"start": [0.0, 0, 0], "end": [1.0, 0, 0]}}
    constraint = {"dtype": "compas_fd.constraints/LineConstraint", "data": line, "guid": "14b3"}
    return changed(
        mesh(),
        (("dtype",), "compas_fofin.datastructures/CableMesh"),
        (("data", "constraints"), {"14b3": constraint}),
        (("data", "vertex", "3", "constraint"), "14b3"),
        (("data", "vertex", "0", "is_support"), True),
        (("data", "default_vertex_attributes", "thickness"), 0.02),
    )


def of_net(*changes):
    return changed(network(), *changes)


def of_mesh(*changes):
    return changed(mesh(), *changes)


def read(data, folder):
    """What `outcome` says of data in a file."""
    (folder / "net.json").write_text(json.dumps(data))
    return outcome(read_network, folder / "net.json")


DATA = network()["data"]
OLD = {"compas": "1.17.5", "datatype": "compas.datastructures/Network", "data": DATA}
LINE = {"dtype": "compas.geometry/Line", "data": {"start": [0]}}
BACK, PAIRS, FACES = (*EDGE, "1", "0"), ("data", "edgedata"), ("data", "facedata")
X = (*NODE, "1", "x")
READ = {  # data, and what is left out
    "support is 1": (of_net(((*NODE, "0", "is_support"), 1)), ""),
    "compas 1": (OLD, ""),
    "a version of compas 1 that wraps twice": ({"dtype": "x", "value": {"data": DATA}}, ""),
    "result attributes": (network(force=1.0, length=1.0, _f=3.0, color=[1, 0, 0]), ""),
    "a prescribed force": (network(force=7.0), "attribute 'force' of an edge (1)"),
    "stiffness": (network(E=200.0), "attribute 'E' of an edge (1)"),
    "own data": (of_net(((*NODE, "1", "mass"), 3.5)), "attribute 'mass' of a node (1)"),
    "of the whole": (
        of_net((("data", "attributes"), {"case": "snow"})),
        "attribute 'case' of the whole (1)",
    ),
    "another field": (of_net((("data", "cells"), {"0": [1]})), "field 'cells' (1)"),
    "both directions": (of_net((BACK, {"q": 1.0})), ""),
    "differ by direction": (of_net((BACK, {"q": 2.0})), "edge that occurs again (1)"),
    "a side that no face has": (
        of_mesh(((*PAIRS, "1-3"), {"q": 2.0})),
        "edge that is no side of a face (1)",
    ),
    "data of a missing face": (
        of_mesh(((*FACES, "7"), {"pz": 2.0})),
        "attributes of a face that is not there (1)",
    ),
    "a session": (
        session(cable_mesh()),
        "attribute 'constraint' of a vertex (1), attribute 'thickness' of a vertex (4), "
        "field 'constraints' (1)",
    ),
    "a session with more": (
        session(LINE, mesh(), network()),
        "net (1), object 'compas.geometry/Line' beside the net (1)",
    ),
    "a foreign type": ({**network(), "dtype": "other.program/A"}, "type other.program/A (1)"),
    "a foreign schema": ({**network(), "$schema": "https://a.org/b"}, "field beside the net (1)"),
    **{f"the type {k}": ({**network(), "dtype": k}, "") for k in ("compas_fd.x/Y", "x", 3, None)},
}
FINITE = "node['1'].x: expected a finite number"
BARE = (("data", "default_node_attributes"), {"pz": 0})
POLYLINE = {"dtype": "compas.geometry/Polyline", "data": {"points": [[0, 0, 0]]}}
REFUSED = [  # data, and the message
    (of_net((X, "1.0")), f"{FINITE}, got '1.0'"),
    (of_net((X, None)), f"{FINITE}, got null"),
    (of_net((X, 1e308)), FINITE),
    (of_net((X, float("nan"))), "NaN is not allowed"),
    (of_net(((*NODE, "0", "is_support"), "yes")), "is_support: expected true or false, got 'yes'"),
    (network(f="much"), "edge 0-1.f: expected a finite number"),
    (network(f=True), "edge 0-1.f: expected a finite number"),
    (of_net(((*NODE, "1"), {}), BARE), "node['1']: has no coordinates x, y, z"),
    (of_net(((*EDGE, "0", "8"), {})), "edge['0']['8']: there is no node '8'"),
    (of_net(((*EDGE, "0", "0"), {})), "edge['0']['0']: an edge from a node to itself"),
    (of_net(((*EDGE, "0"), [1])), "edge['0']: expected an object"),
    (of_net((EDGE, {})), "edge: the network has no edges"),
    (of_net((NODE, {})), "node: missing"),
    (of_net((NODE, [1])), "node: expected an object"),
    (of_mesh(((*PAIRS, "(0, 1)"), [3.0])), "edgedata['(0, 1)']: expected an object of attributes"),
    (session(of_mesh((("data", "face"), {}))), "scene.data.items[0].data.face: the mesh has no fa"),
    (POLYLINE, "has no network or mesh of compas, but an object 'compas.geometry/Polyline'"),
    ({"type": "A", "features": []}, "has no network or mesh of compas, but the fields type, feat"),
]


@pytest.mark.parametrize("name", READ)
def test_what_is_left_out_is_told(name, tmp_path):
    data, expected = READ[name]
    net, told = read(data, tmp_path)
    assert ", ".join(told) == expected
    if "vertex" in json.dumps(data):
        assert sorted(map(sorted, net.links.tolist())) == [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]
        assert sorted(net.values["force_density"].tolist()) == [1.0, 1.0, 1.0, 1.0, 3.0]
    else:
        assert net.links.tolist() == [[0, 1], [1, 2]]
        assert net.values["force_density"].tolist() == [1.0, 1.0]
        assert net.fixed.all(axis=1).tolist() == [True, False, True]
        assert net.loads.tolist() == [[0, 0, 0], [0, 0, -1], [0, 0, 0]]


@pytest.mark.parametrize(("data", "message"), REFUSED, ids=itertools.count())
def test_what_is_no_net_is_refused(data, message, tmp_path):
    net, told = read(data, tmp_path)
    assert net is None and message in told


@pytest.mark.parametrize("cut", [0.2, 0.99])
def test_a_network_cut_off(cut, tmp_path):
    text = json.dumps(session(mesh()))
    (tmp_path / "net.json").write_text(text[: int(cut * len(text))])
    net, told = outcome(read_network, tmp_path / "net.json")
    assert net is None and "line 1, column" in told


def test_sessions_of_compas_fofin_by_their_own_suffix(tmp_path, monkeypatch, capsys):
    """That of today; and as its command FOFIN_save wrote: settings beside the data of a net."""
    monkeypatch.chdir(tmp_path)
    old = {"settings": {"file.name": "tent.fofin", "layer": "net"}, "cablenet": mesh()["data"]}
    old["cablenet"]["vertex"]["0"]["is_anchor"] = True
    for data in (session(cable_mesh()), old):
        (tmp_path / "tent.fofin").write_text(json.dumps(data))
        words = ["convert", "tent.fofin", "--axial-stiffness", "1e5", "--save", "tent.json"]
        assert main(words) == 0, capsys.readouterr().err
        structure = jc.load_scene("tent.json").structure
        assert structure.n_node == 4
        assert sum(len(group.links) for group in structure.groups) == 5


@pytest.mark.slow
def test_a_network_becomes_a_scene(tmp_path):
    """q1 (x - 0) + q2 (x - 2) = 0, (q1 + q2) z = -1."""
    net, _ = read(network({"q": 2.0}, {"q": 4.0}), tmp_path)
    structure, phases = net.scene(axial_stiffness=1e5)
    places = jc.force_density(structure, phases[0].force_density, phases[1].loads)
    np.testing.assert_allclose(places[1], [8 / 6, 0.0, -1 / 6], atol=1e-14)  # a few roundings


def test_loads_of_edges_act_at_their_ends(tmp_path):
    data = network(*[{"q": 1.0, "pz": -1.0}] * 2)
    net, told = read(data, tmp_path)
    assert told == [] and net.loads[:, 2].tolist() == [-0.5, -2.0, -0.5]  # edges of 1 m
    # twice as long: twice the load of the edges, and once that of the node
    data = changed(data, (X, 2), ((*NODE, "2", "x"), 4))
    assert read(data, tmp_path)[0].loads[:, 2].tolist() == [-1.0, -3.0, -1.0]


def test_loads_of_faces_act_at_their_corners(tmp_path):
    """On a triangle a third at each corner; on a kite by hand, with the mean of its corners."""
    net, told = read(of_mesh(((*FACES, "0"), {"px": 3.0, "pz": -6.0})), tmp_path)
    share = np.array([3.0, 0.0, -6.0]) * 2.0 / 3.0  # of an area of 2 m2
    assert told == []
    np.testing.assert_allclose(net.loads, [share, share, share, np.zeros(3)], rtol=1e-15)
    # a square with one corner drawn out: areas 1.5, 1.5, 2.5, 2.5 m2 of its sides up to (1.5, 1.5)
    kite = of_mesh(
        (("data", "face"), {"0": [0, 1, 2, 3]}),
        (("data", "vertex", "2"), {"x": 4, "y": 4, "z": 0}),
        (("data", "default_face_attributes"), {"pz": 1.0}),
    )
    net, _ = read(kite, tmp_path)
    np.testing.assert_allclose(net.loads[:, 2], [1.5, 2.0, 2.5, 2.0], rtol=1e-14)


def test_loads_in_a_result_count_once(tmp_path):
    """jax_fdm writes results with the loads of edges in those of nodes, and at the edges, too."""
    node = {"x": 1, "z": -1.0, "pz": -2.0, "rz": 0.0}  # 1 N/m twice, 1 m down: 2 N
    data = changed(network(*[{"q": 1.0, "pz": -1.0}] * 2), ((*NODE, "1"), node))
    net, told = read(data, tmp_path)
    assert net.loads[:, 2].tolist() == [0.0, -2.0, 0.0]
    assert told == ["load of an edge (2)"]
    net, told = read(changed(data, ((*NODE, "1", "pz"), -1.9)), tmp_path)  # control: no balance
    assert told == [] and net.loads[1, 2] == pytest.approx(-1.9 - np.sqrt(2.0), rel=1e-15)


def test_edges_of_a_mesh_by_either_direction(tmp_path):
    net, told = read(of_mesh(((*PAIRS, "2-0"), {"q": 5.0})), tmp_path)
    densities = dict(zip(map(tuple, net.links.tolist()), net.values["force_density"], strict=True))
    assert densities == {(0, 1): 3.0, (1, 2): 1.0, (2, 0): 5.0, (2, 3): 1.0, (3, 0): 1.0}
    net, more = read(of_mesh(((*PAIRS, "0-2"), {"_is_edge": False})), tmp_path)
    assert told == more == [] and len(net.links) == 4
    assert [0, 2] not in np.sort(net.links, axis=1).tolist()


def test_groups_and_unstressed_lengths(tmp_path):
    data = of_net(
        ((*EDGE, "0", "1"), {"l0": 0.9, "group": "left"}),
        ((*EDGE, "1", "2"), {"l0": 0.8, "group": "right"}),
    )
    net, told = read(data, tmp_path)
    assert told == [] and net.values["rest_length"].tolist() == [0.9, 0.8]
    structure, _ = net.scene(axial_stiffness=1e5)
    assert list(structure.elements) == ["left", "right"]
    net, told = read(changed(data, ((*EDGE, "0", "1", "q"), -1.0)), tmp_path)
    assert net.kinds == ("bar", "cable") and told == ["attribute 'l0' of an edge (1)"]


LONG = (X, 2), ((*NODE, "2"), {"x": 2, "y": 3, "is_support": True})
CABLES = ("cable", "cable")


@pytest.mark.parametrize(
    ("first", "second", "expected", "kinds"),
    [
        ({"f": 6.0}, {"f": 3.0}, [3.0, 1.0], CABLES),
        ({"force": 6.0}, {"f": -3.0}, [3.0, -1.0], ("cable", "bar")),
        ({"q": 0.0, "f": 4.0}, {"q": None, "f": 6.0}, [2.0, 2.0], CABLES),
        ({"q": 5.0, "f": 10.0}, {"q": 1.0, "f": 3.0, "l": 3.0}, [5.0, 1.0], CABLES),
        ({"f": 6.0}, {}, [3.0, np.nan], CABLES),
    ],
)
def test_forces_without_force_densities(first, second, expected, kinds, tmp_path):
    """Lengths of 2 and 3 m, from the coordinates; a strut is a bar."""
    net, told = read(changed(network(first, second), *LONG), tmp_path)
    np.testing.assert_array_equal(net.values["force_density"], expected)
    assert net.kinds == kinds and told == []


def test_forces_that_contradict_force_densities_are_told(tmp_path):
    second = {"f": 3.0, "force": 4.0, "l": 7.0}
    net, _ = read(changed(network({"q": 5.0, "f": 11.0}, second), *LONG), tmp_path)
    assert net.values["force_density"].tolist() == [5.0, 1.0]
    assert [(row.what, row.count, row.where) for row in net.omissions] == [
        ("attribute 'f' of an edge", 1, "edge 0-1"),
        ("attribute 'force' of an edge", 1, "edge 1-2"),
        ("attribute 'l' of an edge", 1, "edge 1-2"),
    ]


# --- written


@pytest.fixture(scope="module")
def solved():
    structure, phases = jc.scenes.flat_net(load=15.0)
    return structure, converged(jc.solve(structure, phases))


def quilt():
    """Two triangles, whose sides are cables; their solution, and the faces."""
    nodes = [[0.0, 0, 0], [1, 0, 0], [1, 1, 1 / 7], [0, 1, 0]]
    links = [[0, 1], [1, 2], [2, 0], [2, 3], [3, 0]]
    structure = jc.Structure(nodes, jc.Cables(links, axial_stiffness=1e5), jc.pinned([0, 1, 3]))
    solution = converged(jc.solve(structure, jc.Phase(pretension=100.0)))
    return structure, solution, [[0, 1, 2], [0, 2, 3]]


@pytest.mark.slow
def test_a_result_comes_back_exactly(solved, tmp_path):
    structure, solution = solved
    (path,) = save_network(tmp_path / "net.json", structure, solution)
    net, told = outcome(read_network, path)
    np.testing.assert_array_equal(net.nodes, solution.positions)
    links = structure.elements.links.array.tolist()
    assert told == [] and sorted(net.links.tolist()) == sorted(links)  # sorted by first nodes
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
    assert np.abs(balance[~held.all(axis=1)]).max() < 1e-8  # N, of 300: the analysis' residual


def test_a_structure_alone_and_a_rope(tmp_path):
    nodes = [[0.0, 0, 0], [1, 0, -1], [2, 0, 0], [1, 0, 1 / 3]]
    rope, tie = jc.SlidingCables([[0, 1, 2]], 1e5), jc.Bars([[1, 3]], 1e5)
    structure = jc.Structure(nodes, {"rope": rope, "tie": tie}, jc.pinned([0, 2, 3]))
    (path,) = save_network(tmp_path / "net.json", structure)
    net = read_network(path)
    assert net.nodes.tolist() == nodes and net.links.tolist() == [[0, 1], [1, 2], [1, 3]]
    assert "force_density" not in net.values and net.loads is None
    assert json.loads(path.read_text())["data"]["edge"]["1"]["3"]["group"] == "tie"
    twice = {"rope": rope, "more": jc.Cables([[1, 0]], axial_stiffness=1.0)}
    with pytest.raises(ValueError, match="two join nodes 0 and 1"):
        save_network(path, jc.Structure(nodes[:3], twice, jc.pinned([0, 2])))
    with pytest.raises(ValueError, match=r"ends with \.json"):
        save_network(tmp_path / "net.obj", structure)
    held = jc.replace(structure, supports=jc.pinned([0, 2]) + jc.restrained([3], "y"))
    words = r"support in some directions \(1\), node 3: in compas"
    with pytest.warns(jc.InputWarning, match=words):
        save_network(path, held)
    assert read_network(path).fixed[:, 0].tolist() == [True, False, True, False]


@pytest.mark.filterwarnings("ignore:.*is a free corner")  # of a mesh
def test_a_mesh_comes_back(tmp_path):
    structure, solution, faces = quilt()
    (path,) = save_network(tmp_path / "net.json", structure, solution, faces=faces)
    net = read_network(path)
    np.testing.assert_array_equal(net.nodes, solution.positions)
    where = {frozenset(pair): k for k, pair in enumerate(structure.elements.links.array.tolist())}
    order = [where[frozenset(pair)] for pair in net.links.tolist()]
    assert sorted(order) == list(range(5))
    about = json.loads(path.read_text())["data"]["edgedata"]
    assert about["(0, 2)"]["f"] == solution.tension[2]
    known = np.nan_to_num(net.values["force_density"])
    lengths = np.linalg.norm(net.nodes[net.links[:, 1]] - net.nodes[net.links[:, 0]], axis=1)
    np.testing.assert_allclose(known, solution.tension[np.array(order)] / lengths, rtol=1e-15)
    for bad, message in (
        ([[0, 1, 2]], r"the link \[0, 3\] is no side of a face"),
        ([[0, 1, 2], [1, 2, 3], [0, 2, 3]], r"the link \[1, 3\] is the side of a face, but no el"),
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


@pytest.mark.parametrize("kind", ["Graph", "Mesh"])
def test_compas_opens_it(kind, solved, tmp_path):
    """Where a Python has compas: ``COMPAS_PYTHON``, or this one."""
    python = os.environ.get("COMPAS_PYTHON", sys.executable)
    if subprocess.run([python, "-c", "import compas"], capture_output=True, check=False).returncode:
        pytest.skip("compas is not installed; set COMPAS_PYTHON to a Python that has it")
    structure, solution, faces = quilt() if kind == "Mesh" else (*solved, None)
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


def test_foreign_schemas_of_scenes_are_told(tmp_path, capsys):
    path = tmp_path / "a.json"
    jc.save_scene(path, jc.scenes.flat_net(increments=(1, 1)))
    data = json.loads(path.read_text())
    for schema, is_told in (
        ("../schemas/any.json", False),
        ("urn:jaxcable:scene:1", False),
        ("https://example.org/scene.schema.json", False),
        ("https://json-schema.org/draft/2020-12/schema", True),
        ("https://geojson.org/schema/FeatureCollection.json", True),
    ):
        path.write_text(json.dumps({"$schema": schema, **data}))
        assert main(["info", str(path)]) == 0
        told = capsys.readouterr().err
        words = f"left out:\n  schema {schema} (1), $schema: is not the schema of scene files"
        assert (words in told) is bool(told) is is_told
