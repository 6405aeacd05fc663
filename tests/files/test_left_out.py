"""Files as programs and mail really deliver them: read whole, refused with the place, or told.

Every file here is a small one of a real format (compas 1 and 2, jax_fdm and compas_fofin as these
programs write them; DXF by ezdxf; CSV as spreadsheets save it), changed in one way. A reader reads
it whole, or names each thing that it leaves out in one warning and in ``omissions``, or raises a
`FileError` of one line that names the file.
"""

import copy
import json
import warnings

import ezdxf
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.files import FileError, read_csv, read_dxf, read_network, read_obj


def outcome(read, *paths, **options):
    """What a reader makes of files: (net, rows as "what (count)"), or (None, the FileError)."""
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            net = read(*paths, **options)
        except FileError as error:
            text = str(error)
            assert any(text.startswith(str(path)) for path in paths) and "\n" not in text
            return None, text
    rows = [f"{row.what} ({row.count})" for row in net.omissions]
    texts = [str(w.message) for w in seen]
    assert len(texts) == bool(rows) and all(w.category is jc.InputWarning for w in seen)
    for row in net.omissions:
        assert f"\n  {row}" in texts[0]
    return net, rows


# --- JSON of compas and jax_fdm


def network():
    """A network of two cables as jax_fdm 0.14 on compas 2.15 writes it."""
    zero = dict.fromkeys(("px", "py", "pz"), 0.0)
    return {
        "dtype": "jax_fdm.datastructures/FDNetwork",
        "data": {
            "attributes": {"name": "FDNetwork"},
            "default_node_attributes": {
                **dict.fromkeys("xyz", 0.0),
                **zero,
                **dict.fromkeys(("rx", "ry", "rz"), 0.0),
                "is_support": False,
            },
            "default_edge_attributes": {"q": 0.0, "length": 0.0, "force": 0.0, **zero},
            "node": {
                "0": {"x": 0, "is_support": True},
                "1": {"x": 1, "pz": -1.0},
                "2": {"x": 2, "is_support": True},
            },
            "edge": {"0": {"1": {"q": 1.0}}, "1": {"2": {"q": 1.0}}, "2": {}},
            "max_node": 2,
        },
        "inheritance": ["compas.datastructures/Graph"],
        "guid": "17bcc62f-c06e-4212-be07-742509e72830",
    }


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


def session(items):
    """A session as compas_session dumps it: objects beside the tree of what is shown."""
    root = {"name": "ROOT", "children": [{"item": "9434", "settings": {"show": True}}]}
    scene = {"name": "Scene", "root": root, "items": items}
    return {
        "data": {},
        "scene": {"dtype": "compas.scene/Scene", "data": scene, "guid": "26fb"},
        "settings": {"solver": {"kmax": 100}},
    }


def cable_mesh():
    """The mesh with the constraint of a vertex, as compas_fofin 0.15 writes it."""
    found = mesh()
    line = {"geometry": {"start": [0.0, 0, 0], "end": [1.0, 0, 0]}}
    constraint = {"dtype": "compas_fd.constraints/LineConstraint", "data": line, "guid": "14b3"}
    found["dtype"] = "compas_fofin.datastructures/CableMesh"
    found["data"]["constraints"] = {"14b3": constraint}
    found["data"]["vertex"]["3"]["constraint"] = "14b3"
    found["data"]["vertex"]["0"]["is_support"] = True
    found["data"]["default_vertex_attributes"]["thickness"] = 0.02
    return found


def changed(data, path, value):
    """Data with another value at a path of keys."""
    data = copy.deepcopy(data)
    *way, last = path
    place = data
    for key in way:
        place = place[key]
    place[last] = value
    return data


def edges(**attributes):
    """The network with more attributes on its first edge."""
    return changed(network(), ("data", "edge", "0", "1"), {"q": 1.0, **attributes})


NODE, EDGE = ("data", "node"), ("data", "edge")
OLD = {"compas": "1.17.5", "datatype": "compas.datastructures/Network", "data": network()["data"]}
JSON = {
    "support is 1": (changed(network(), (*NODE, "0", "is_support"), 1), []),
    "compas 1": (OLD, []),
    "a version of compas 1 that wraps twice": ({"dtype": "x", "value": {"data": OLD["data"]}}, []),
    "result attributes": (edges(force=1.0, length=1.0, _f=3.0, color=[1, 0, 0]), []),
    "a prescribed force": (edges(force=7.0), ["attribute 'force' of an edge (1)"]),
    "stiffness": (
        edges(E=200.0, radius=0.01),
        ["attribute 'E' of an edge (1)", "attribute 'radius' of an edge (1)"],
    ),
    "own data": (changed(network(), (*NODE, "1", "mass"), 3.5), ["attribute 'mass' of a node (1)"]),
    "own data of the whole": (
        changed(network(), ("data", "attributes"), {"case": "snow"}),
        ["attribute 'case' of the whole (1)"],
    ),
    "another field": (changed(network(), ("data", "cells"), {"0": [1]}), ["field 'cells' (1)"]),
    "edges in both directions": (changed(network(), (*EDGE, "1", "0"), {"q": 1.0}), []),
    "edges that differ by direction": (
        changed(network(), (*EDGE, "1", "0"), {"q": 2.0}),
        ["edge that occurs again (1)"],
    ),
    "a side that no face has": (
        changed(mesh(), ("data", "edgedata", "1-3"), {"q": 2.0}),
        ["edge that is no side of a face (1)"],
    ),
    "data of a missing face": (
        changed(mesh(), ("data", "facedata", "7"), {"pz": 2.0}),
        ["attributes of a face that is not there (1)"],
    ),
    "a session": (
        session([cable_mesh()]),
        [
            "attribute 'constraint' of a vertex (1)",
            "attribute 'thickness' of a vertex (4)",
            "field 'constraints' (1)",
        ],
    ),
    "a session with more": (
        session([{"dtype": "compas.geometry/Line", "data": {"start": [0]}}, mesh(), network()]),
        ["net (1)", "object 'compas.geometry/Line' beside the net (1)"],
    ),
    "numbers as texts": (
        changed(network(), (*NODE, "1", "x"), "1.0"),
        r"node['1'].x: expected a finite number, got '1.0'",
    ),
    "a support in words": (
        changed(network(), (*NODE, "0", "is_support"), "yes"),
        "node['0'].is_support: expected true or false, got 'yes'",
    ),
    "a missing node": (changed(network(), (*EDGE, "0", "8"), {}), "there is no node '8'"),
    "no coordinates": (
        changed(
            changed(network(), (*NODE, "1"), {}), ("data", "default_node_attributes"), {"pz": 0}
        ),
        "node['1']: has no coordinates x, y, z",
    ),
    "a coordinate that is null": (
        changed(network(), (*NODE, "1", "x"), None),
        "node['1'].x: expected a finite number, got null",
    ),
    "a loop": (changed(network(), (*EDGE, "0", "0"), {}), "an edge from a node to itself"),
    "not finite": (changed(network(), (*NODE, "1", "x"), float("nan")), "NaN is no number"),
    "attributes in a list": (
        changed(mesh(), ("data", "edgedata", "(0, 1)"), [3.0]),
        "edgedata['(0, 1)']: expected an object of attributes",
    ),
    "a session without faces": (
        session([changed(mesh(), ("data", "face"), {})]),
        "scene.data.items[0].data.face: the mesh has no faces",
    ),
    "another object": (
        {"dtype": "compas.geometry/Polyline", "data": {"points": [[0, 0, 0]]}},
        "no network or mesh of compas in it, but an object 'compas.geometry/Polyline'",
    ),
    "another program": (
        {"type": "FeatureCollection", "features": []},
        "no network or mesh of compas in it, but the fields type, features",
    ),
}


@pytest.mark.parametrize("name", JSON)
def test_networks(name, tmp_path):
    data, expected = JSON[name]
    (tmp_path / "net.json").write_text(json.dumps(data))
    net, told = outcome(read_network, tmp_path / "net.json")
    if isinstance(expected, str):
        assert net is None and expected in told
        return
    assert told == expected
    if "vertex" in json.dumps(data):
        assert sorted(map(sorted, net.links.tolist())) == [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]
        assert sorted(net.values["force_density"].tolist()) == [1.0, 1.0, 1.0, 1.0, 3.0]
    else:
        assert net.links.tolist() == [[0, 1], [1, 2]]
        assert net.values["force_density"].tolist() == [1.0, 1.0]
        assert net.fixed.all(axis=1).tolist() == [True, False, True]
        assert net.loads.tolist() == [[0, 0, 0], [0, 0, -1], [0, 0, 0]]


@pytest.mark.parametrize("cut", [0.2, 0.6, 0.99])
def test_a_network_cut_off(cut, tmp_path):
    text = json.dumps(session([mesh()]))
    (tmp_path / "net.json").write_text(text[: int(cut * len(text))])
    net, told = outcome(read_network, tmp_path / "net.json")
    assert net is None and "line 1, column" in told


def read(data, tmp_path):
    (tmp_path / "net.json").write_text(json.dumps(data))
    return outcome(read_network, tmp_path / "net.json")


def test_loads_of_edges_act_at_their_ends(tmp_path):
    data = network()
    for ends in (("0", "1"), ("1", "2")):
        data = changed(data, (*EDGE, *ends), {"q": 1.0, "pz": -1.0})
    net, told = read(data, tmp_path)
    assert told == [] and net.loads[:, 2].tolist() == [-0.5, -2.0, -0.5]  # edges of 1 m
    # twice as long: twice the load of the edges, and once that of the node
    for node, x in (("1", 2), ("2", 4)):
        data = changed(data, (*NODE, node, "x"), x)
    assert read(data, tmp_path)[0].loads[:, 2].tolist() == [-1.0, -3.0, -1.0]


def test_loads_of_faces_act_at_their_corners(tmp_path):
    """On a triangle a third at each corner; on a kite by hand, with the mean of its corners."""
    data = changed(mesh(), ("data", "facedata", "0"), {"px": 3.0, "pz": -6.0})
    net, told = read(data, tmp_path)
    share = np.array([3.0, 0.0, -6.0]) * 2.0 / 3.0  # of an area of 2 m2
    assert told == []
    np.testing.assert_allclose(net.loads, [share, share, share, np.zeros(3)], rtol=1e-15)
    # a square with one corner drawn out: areas 1.5, 1.5, 2.5, 2.5 m2 of its sides up to (1.5, 1.5)
    kite = changed(mesh(), ("data", "face"), {"0": [0, 1, 2, 3]})
    kite = changed(kite, ("data", "vertex", "2"), {"x": 4, "y": 4, "z": 0})
    kite = changed(kite, ("data", "default_face_attributes"), {"pz": 1.0})
    net, _ = read(kite, tmp_path)
    np.testing.assert_allclose(net.loads[:, 2], [1.5, 2.0, 2.5, 2.0], rtol=1e-14)


def test_loads_in_a_result_count_once(tmp_path):
    """jax_fdm writes results with the loads of edges in those of nodes, and at the edges, too."""
    data = network()
    node = {"x": 1, "z": -1.0, "pz": -2.0, "rz": 0.0}  # 1 N/m twice, 1 m down: 2 N
    data = changed(data, (*NODE, "1"), node)
    for ends in (("0", "1"), ("1", "2")):
        data = changed(data, (*EDGE, *ends), {"q": 1.0, "pz": -1.0})
    net, told = read(data, tmp_path)
    assert net.loads[:, 2].tolist() == [0.0, -2.0, 0.0]
    assert told == ["load of an edge (2)"]
    net, told = read(changed(data, (*NODE, "1", "pz"), -1.9), tmp_path)  # control: no balance
    assert told == [] and net.loads[1, 2] == pytest.approx(-1.9 - np.sqrt(2.0), rel=1e-15)


def test_edges_that_a_mesh_does_not_have(tmp_path):
    data = changed(mesh(), ("data", "edgedata", "0-2"), {"_is_edge": False})
    net, told = read(data, tmp_path)
    assert told == [] and len(net.links) == 4 and [0, 2] not in net.links.tolist()


def test_groups_and_unstressed_lengths(tmp_path):
    data = changed(network(), (*EDGE, "0", "1"), {"l0": 0.9, "group": "left"})
    data = changed(data, (*EDGE, "1", "2"), {"l0": 0.8, "group": "right"})
    net, told = read(data, tmp_path)
    assert told == [] and net.values["rest_length"].tolist() == [0.9, 0.8]
    structure, _ = net.scene(axial_stiffness=1e5)
    assert list(structure.elements) == ["left", "right"]
    data = changed(data, (*EDGE, "0", "1", "q"), -1.0)
    net, told = read(data, tmp_path)
    assert net.kinds == ("bar", "cable") and told == ["attribute 'l0' of an edge (1)"]


def test_supports_in_some_directions_are_not_written(tmp_path):
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
    held = jc.pinned([0, 2]) + jc.restrained([1], "y")
    structure = jc.Structure([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], cables, held)
    with pytest.warns(
        jc.InputWarning, match=r"support in some directions \(1\), node 1: nodes are"
    ):
        (path,) = jc.files.save_network(tmp_path / "net.json", structure)
    assert outcome(read_network, path)[0].fixed[:, 0].tolist() == [True, False, True]


# --- DXF


def drawing(path, change, unit=6):
    """A drawing of a line of 1 m on the layer NET, changed."""
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = unit
    document.layers.add("NET")
    document.modelspace().add_line((0, 0), (1, 0), dxfattribs={"layer": "NET"})
    change(document, document.modelspace())
    document.saveas(path)
    return path


def unseen(document, space):
    for k, name in enumerate(("alt", "Entwürfe", "gesperrt")):
        document.layers.add(name)
        space.add_line((1, k), (2, k + 1), dxfattribs={"layer": name})
    document.layers.get("alt").off()
    document.layers.get("Entwürfe").freeze()
    document.layers.get("gesperrt").lock()  # is seen
    space.add_line((0, 0), (0, 1), dxfattribs={"layer": "NET", "invisible": 1})


def references(document, space):
    document.blocks.new("part").add_line((0, 0), (9, 9))
    space.add_blockref("part", (0, 0))
    document.add_xref_def("steel.dwg", "steel")
    space.add_blockref("steel", (0, 0))
    document.layout("Layout1").add_line((0, 0), (1, 1))


CURVED = "3DFACE", "ELLIPSE", "LWPOLYLINE with arcs", "POLYLINE fitted by a spline", "SOLID"
CURVED += "SPLINE", "TEXT"


def curves(document, space):
    space.add_spline([(0, 0), (1, 1), (2, 0)])
    space.add_ellipse((0, 0), (2, 0), 0.5)
    space.add_lwpolyline([(0, 0, 1), (5, 0, 0)], format="xyb")
    fitted = space.add_polyline2d([(0, 0), (1, 1), (2, 0)])
    fitted.dxf.flags |= 4
    space.add_3dface([(0, 0), (1, 0), (1, 1)])
    space.add_text("roof")
    space.add_solid([(0, 0), (1, 0), (1, 1)])


DXF = {
    "layers that are not seen": (unseen, 2, ["LINE (1)"] * 3),
    "blocks, references, paper": (
        references,
        1,
        ["INSERT (1)", "entity in paper space (1)", "external reference (1)"],
    ),
    "curves, faces, texts": (
        curves,
        1,
        [f"{word} (1)" for word in CURVED],
    ),
    "a line drawn twice": (
        lambda d, s: s.add_line((1, 0), (0, 0), dxfattribs={"layer": "Größe ∅"}),
        1,
        ["link that occurs again (1)"],
    ),
    "only what is not seen": (
        lambda d, s: d.layers.get("NET").off(),
        "has no lines or polylines in model space: 0 POINT; LINE (1), layer 'NET': off in the",
        None,
    ),
}


@pytest.mark.parametrize("name", DXF)
def test_drawings(name, tmp_path):
    change, expected, rows = DXF[name]
    net, told = outcome(read_dxf, drawing(tmp_path / "net.dxf", change))
    if rows is None:
        assert net is None and expected in told
    else:
        assert len(net.links) == expected and sorted(told) == sorted(rows)


def test_hidden_lines_are_read_if_asked_for(tmp_path, capsys):
    path = drawing(tmp_path / "net.dxf", unseen)
    net, _ = outcome(read_dxf, path)
    reasons = {row.why.split(" in ")[0]: row.where for row in net.omissions}
    places = {"off": "layer 'alt'", "frozen": "layer 'Entwürfe'", "invisible": "layer 'NET'"}
    assert reasons == places
    net, told = outcome(read_dxf, path, hidden=True)
    assert told == [] and len(net.links) == 5
    assert main(["info", str(path)]) == 0
    out, err = capsys.readouterr()
    assert "net of 4 nodes, 2 links" in out
    assert err.startswith(f"jaxcable: warning: {path}: left out:\n  LINE (1), layer 'Entwürfe': fr")
    assert main(["info", str(path), "--hidden"]) == 0
    out, err = capsys.readouterr()
    assert "5 links" in out and err == ""


@pytest.mark.parametrize("cut", [0.3, 0.97])
def test_a_drawing_cut_off(cut, tmp_path):
    path = drawing(tmp_path / "net.dxf", curves)
    text = path.read_text()
    path.write_text(text[: int(cut * len(text))])
    net, told = outcome(read_dxf, path)
    assert net is None and "no DXF drawing, or a damaged one" in told


# --- OBJ

FREE = """# rational curve of a modelling program
mtllib a.mtl
v 0 0 0
v 1 0 0 0.7071
v 2 0 0 1.0
v 3 0 0 0.5 0.5 0.5
g cables
usemtl steel
l -4 -3 \\
  -2
p 1 2
cstype rat bspline
deg 2
curv 0 1 1 2 3
parm u 0 1
end
"""
FACES = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nvt 0 0\ns off\nf 1/1/1 2//1 3\nf 1 3 4\n"
OBJ = {
    "free-form curves": (
        FREE,
        [[0, 1], [1, 2]],
        ["point that no line touches (1)"]
        + [f"statement {word!r} (1)" for word in ("cstype", "curv", "deg", "end", "p", "parm")]
        + ["weight of a point (1)"],
    ),
    "faces with normals": (FACES, [[0, 1], [1, 2], [2, 0], [2, 3], [3, 0]], []),
    "a mark, and lines as Windows ends them": (
        "\ufeff" + FACES.replace("\n", "\r\n"),
        [[0, 1], [1, 2], [2, 0], [2, 3], [3, 0]],
        [],
    ),
    "a line twice": (FACES + "l 4 1\n", [[0, 1], [1, 2], [2, 0], [2, 3], [3, 0]], ["line that"]),
    "cut off": (FACES[:-3] + " 9\n", "line 9: point 9 is not among the 4", None),
    "no coordinates": (FACES.replace("1 1 0", "1 nan 0"), "three finite coordinates", None),
}


@pytest.mark.parametrize("name", OBJ)
def test_lines_of_modelling_programs(name, tmp_path):
    text, expected, rows = OBJ[name]
    (tmp_path / "net.obj").write_bytes(text.encode())
    net, told = outcome(read_obj, tmp_path / "net.obj")
    if rows is None:
        assert net is None and expected in told
        return
    assert net.links.tolist() == expected
    assert len(told) == len(rows) and all(map(str.startswith, told, rows))


# --- CSV

NODES = "node,x,y,z,support\nA,0,0,0.5,1\nB,1.5,0,0,0\nC,3,0,0.5,1\n"
LINKS = "first,last,axial_stiffness\nA,B,1e5\nB,C,1e5\n"
GERMAN = "Knoten;X-Koord.;Y-Koord.;Höhe;Lager;Bemerkung\nA;0;0;0,5;1;am Haus\nB;1,5;0;0;0;\n"
GERMAN += "C;3;0;0,5;1;Mast\n"
NAMES = {"node": "Knoten", "x": "x-koord.", "y": "Y-Koord.", "z": "Höhe", "support": "Lager"}
CSV = {
    "plain": (NODES, {}, []),
    "a spreadsheet in German": (
        "\ufeff" + GERMAN.replace("\n", "\r\n"),
        {"columns": NAMES},
        ["column 'bemerkung' (1)"],
    ),
    "tabs": (NODES.replace(",", "\t"), {}, []),
    "flags of what is free": (
        "node,x,y,z,libre\nA,0,0,0.5,0\nB,1.5,0,0,1\nC,3,0,0.5,no\n",
        {"columns": {"free": "Libre"}},
        [],
    ),
    "quotes": ('"Node","X","Y","Z","Support"\n"A","0","0","0.5","true"\n' + NODES[31:], {}, []),
    "decimal points beside commas": (
        GERMAN.replace("1,5", "1.5"),
        {"columns": NAMES},
        "line 2: z: '0,5' is no number",
    ),
    "columns of another program": (GERMAN, {}, "unknown column 'knoten'"),
    "a column that is not there": (
        NODES,
        {"columns": {"support": "Fixed"}},
        "support: there is no column 'fixed'",
    ),
    "two flags": (
        "node,x,y,z,support,free\nA,0,0,0.5,1,0\n",
        {},
        "has both support and free",
    ),
    "an empty flag of what is free": (
        "node,x,y,z,free\nA,0,0,0.5,\n",
        {},
        "line 2: free: expected 0, 1 or some of xyz, got nothing",
    ),
    "a node twice": (NODES.replace("\nC", "\nB"), {}, "line 4: node 'B' occurs twice"),
    "not finite": (NODES.replace("1.5", "nan"), {}, "line 3: x: 'nan' is not finite"),
    "cut off": (NODES[:-4], {}, "line 4: 4 fields, the header has 5"),
}


@pytest.mark.parametrize("name", CSV)
def test_tables(name, tmp_path):
    text, options, expected = CSV[name]
    (tmp_path / "n.csv").write_bytes(text.encode())
    (tmp_path / "l.csv").write_text(LINKS)
    net, told = outcome(read_csv, tmp_path / "n.csv", tmp_path / "l.csv", **options)
    if isinstance(expected, str):
        assert net is None and expected in told
        return
    assert told == expected
    assert net.nodes.tolist() == [[0, 0, 0.5], [1.5, 0, 0], [3, 0, 0.5]]
    assert net.fixed.tolist() == [[True] * 3, [False] * 3, [True] * 3]


def test_other_encodings_and_names(tmp_path):
    (tmp_path / "l.csv").write_text(LINKS)
    for code in ("utf-16", "cp1252"):
        (tmp_path / "n.csv").write_bytes(GERMAN.encode(code))
        net, told = outcome(read_csv, tmp_path / "n.csv", tmp_path / "l.csv", columns=NAMES)
        assert net is None and ("binary data" in told or "no UTF-8 text" in told)
    with pytest.raises(ValueError, match="columns: no column 'hight'; known are node, x"):
        read_csv(tmp_path / "n.csv", tmp_path / "l.csv", columns={"hight": "Höhe"})


# --- on the command line


def test_convert_names_columns_and_refuses_what_would_do_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "n.csv").write_text(GERMAN)
    (tmp_path / "l.csv").write_text(LINKS)
    words = ["convert", "n.csv", "l.csv", "--save", "net.json", "--columns"]
    words += [f"{name}={own}" for name, own in NAMES.items()]
    assert main(words) == 0
    out, err = capsys.readouterr()
    assert out == "wrote net.json: 3 nodes, 2 links\n"
    assert err.splitlines()[1].startswith("  column 'bemerkung' (1), n.csv: line 1: ")
    assert np.asarray(jc.load_scene("net.json").structure.nodes)[0].tolist() == [0, 0, 0.5]
    for more, message in (
        (["--scale", "0.001"], "--scale: is for files .obj, .dxf only"),
        (["--supports", "A"], "--supports: is for files .dxf only"),
        (["--columns", "x"], "--columns: expected column=name in the file: x"),
        (["--columns", "hight=x"], "--columns: no column 'hight'; known are node"),
    ):
        assert main([*words[:5], *more]) == 2
        assert message in capsys.readouterr().err
    assert main(["convert", "net.json", "--save", "net.dxf", "--weight", "3"]) == 2
    assert "--weight: is for nets, not for scenes" in capsys.readouterr().err
    assert main(["convert", "net.json", "--save", "net.dxf"]) == 0
    assert "; a drawing has no stiffnesses, prestress or loads" in capsys.readouterr().out


# --- the form of a scene


def dome():
    """A grid of bars over 8 m, and its heights by NumPy: force densities -2 kN/m, 1 kN a node."""
    n = 5
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(-4, 4, n), np.linspace(-4, 4, n)))
    number = np.arange(n * n).reshape(n, n)
    ends = [number[:, :-1], number[:, 1:]], [number[:-1], number[1:]]
    links = np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in ends])
    held = np.maximum(abs(x), abs(y)) == 4
    nodes = np.stack([x, y, 0.0 * x], axis=1)
    bars = jc.Bars(links, axial_stiffness=1e7)
    structure = jc.Structure(nodes, bars, jc.pinned(np.flatnonzero(held)))
    loads = jc.NodalLoads(np.flatnonzero(~held), (0.0, 0.0, -1e3))

    def heights(q):
        matrix = np.zeros((n * n, n * n))
        for i, j in links:
            matrix[[i, j], [i, j]] += q
            matrix[[i, j], [j, i]] -= q
        z = np.zeros(n * n)
        z[~held] = np.linalg.solve(matrix[~held][:, ~held], np.full((~held).sum(), -1e3))
        return z

    return structure, loads, heights


def test_form_takes_loads_and_force_densities_of_the_scene(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    structure, loads, heights = dome()
    assert heights(-2e3).max() > 0.5  # m: it is no flat grid
    snow = jc.Phase(loads=jc.NodalLoads([12], (0.0, 0.0, -50.0)))
    for phases in (
        [jc.Phase(force_density=-2e3), jc.Phase(loads=loads), snow],
        [jc.Phase(force_density=-2e3, loads=loads), snow],
    ):
        jc.save_scene("dome.json", (structure, phases))
        assert main(["form", "dome.json", "--save", "form.json"]) == 0
        out, err = capsys.readouterr()
        assert "force densities: those of phase 1\n" in out and "left out" not in err
        number = len(phases) - 1
        assert f"loads in the form: those of the first phase that has any, phase {number} (" in out
        found, (first, second) = jc.load_scene("form.json")
        # solved by another program in double precision
        np.testing.assert_allclose(found.nodes[:, 2], heights(-2e3), atol=1e-12)
        np.testing.assert_allclose(found.nodes[:, :2], structure.nodes[:, :2], atol=1e-12)
        assert len(first.loads) == 1 and second.loads[0].nodes.array.tolist() == [12]
    assert main(["form", "dome.json", "--force-density", "-4e3", "--save", "form.json"]) == 0
    assert (
        "force_density (1), phase 1: the prestress of the form replaces" in capsys.readouterr().err
    )
    np.testing.assert_allclose(jc.load_scene("form.json")[0].nodes[:, 2], heights(-4e3), atol=1e-12)
    assert main(["form", "dome.json", "--loads", "none"]) == 0
    out, _ = capsys.readouterr()
    assert "loads in the form: none\n" in out and "it lies in a plane, without loads" in out
    assert main(["form", "dome.json", "--loads", "9"]) == 2
    assert "--loads: expected numbers of phases, 1 to 2, or none" in capsys.readouterr().err


def test_form_tells_what_it_does_not_take(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0]]
    cables = {"a": jc.Cables([[0, 1], [1, 2]], 1e5), "b": jc.Cables([[1, 3]], 1e5)}
    structure = jc.Structure(nodes, cables, jc.pinned([0, 2, 3]))
    settled = jc.SupportMovement([0], (0.0, 0.0, -0.01))
    phases = [
        jc.Phase(force_density={"a": 100.0}, pretension={"b": 70.0}),
        jc.Phase(loads=[jc.NodalLoads([1], (0.0, 0.0, -60.0)), settled]),
        jc.Phase(removes="b"),
        jc.Phase(pretension={"a": 30.0}),
    ]
    jc.save_scene("net.json", (structure, phases))
    assert main(["form", "net.json"]) == 2
    assert "element 0 of elements['b'] has no force density" in capsys.readouterr().err
    words = ["form", "net.json", "--force-density", "b=100", "--save", "form.json"]
    assert main(words) == 0
    out, err = capsys.readouterr()
    assert "force densities: those of phase 1, a\n" in out
    rows = err.split("left out:\n")[1].splitlines()
    assert [row.split(":")[0] for row in rows] == [
        "  SupportMovement (1), phase 2",
        "  pretension (2), phase 1, phase 4",
    ]
    found, later = jc.load_scene("form.json")
    np.testing.assert_allclose(found.nodes[1], [1, 1 / 3, -0.2], atol=1e-14)  # 60 / (3 100)
    assert later[0].force_density == {"a": 100.0, "b": 100.0} and len(later[0].loads) == 1
    assert type(later[1].loads[0]) is jc.SupportMovement and later[2].removes is not None
    assert len(later) == 3
