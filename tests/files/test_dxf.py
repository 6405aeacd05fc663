"""Drawings in DXF: read, written, read by others; and files that are not what they should be."""

import re

import dxfgrabber
import ezdxf
import numpy as np
import pytest
import scenes
from file_cases import outcome
from oracles.convergence import converged
from scipy import constants

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.files import FileError, read_dxf, save_dxf
from jaxcable.files.dxf import METRES_PER_UNIT


def drawing(path, unit=6, change=None):
    """A drawing of two layers: a line, a closed and a 3D polyline, points; and what is no line."""
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = unit
    space = document.modelspace()
    space.add_line((0, 0, 0), (1, 0, 1 / 3), dxfattribs={"layer": "edge"})
    square = [(1, 0), (2, 0), (2, 1)]
    space.add_lwpolyline(square, close=True, dxfattribs={"layer": "field", "elevation": 1 / 3})
    space.add_polyline3d([(2, 1, 1 / 3 + 1e-8), (3, 1, 0), (4, 1, 5)], dxfattribs={"layer": "edge"})
    space.add_point((0, 0, 0), dxfattribs={"layer": "held"})
    space.add_point((4, 1, 5), dxfattribs={"layer": "held"})
    if change is not None:
        change(document, space)
    document.saveas(path)
    return path


def tags(path):
    """Pairs (code, text) of the file: two lines each. This is the whole format."""
    lines = path.read_text().splitlines()
    return [(int(code), word.strip()) for code, word in zip(lines[::2], lines[1::2], strict=True)]


def entities(path):
    """Entities of the file, by a reader of its own: lists of pairs, the kind first."""
    found, inside = [], False
    for code, word in tags(path):
        if (code, word) == (2, "ENTITIES"):
            inside = True
        elif (code, word) == (0, "ENDSEC"):
            inside = False
        elif inside and code == 0:
            found.append([(code, word)])
        elif inside and found:
            found[-1].append((code, word))
    return found


# --- read


def test_lines_and_polylines_become_groups_by_layer(tmp_path):
    """Also where lines end as Windows ends them."""
    path = drawing(tmp_path / "net.dxf")
    for end in (b"\n", b"\r\n"):
        path.write_bytes(path.read_bytes().replace(b"\r\n", b"\n").replace(b"\n", end))
        net, told = outcome(read_dxf, path, supports="held")
        assert told == [] and net.nodes.tolist()[:3] == [[0, 0, 0], [1, 0, 1 / 3], [2, 0, 1 / 3]]
        assert net.links.tolist() == [[0, 1], [1, 2], [2, 3], [3, 1], [3, 4], [4, 5]]
        assert net.groups == ("edge", *["field"] * 3, *["edge"] * 2)
        assert np.flatnonzero(net.fixed.all(axis=1)).tolist() == [0, 5]
    structure, _ = net.scene([4], axial_stiffness=1e5)
    assert list(structure.elements) == ["edge", "field"]
    assert len(read_dxf(path, tolerance=1e-9).nodes) == 7  # ends that are not merged


def test_units_of_the_header(tmp_path):
    """All codes are in `test_units_of_all_codes`; `scale` is instead of what the header says."""
    path = drawing(tmp_path / "net.dxf", 4)
    assert read_dxf(path).nodes[5].tolist() == [4e-3, 1e-3, 5e-3]
    assert read_dxf(path, 2.0).nodes[5].tolist() == [8, 2, 10]
    text = r"net.dxf: .* unit \(\$INSUNITS = 0\); give .* scale=0.001 for mm"
    with pytest.raises(FileError, match=text):
        read_dxf(drawing(path, 0))


def unseen(document, space):
    for k, name in enumerate(("alt", "Entwürfe", "gesperrt")):
        document.layers.add(name)
        space.add_line((1, k), (2, k + 1), dxfattribs={"layer": name})
    document.layers.get("alt").off()
    document.layers.get("Entwürfe").freeze()
    document.layers.get("gesperrt").lock()  # is seen
    space.add_line((0, 0), (0, 1), dxfattribs={"layer": "edge", "invisible": 1})


def references(document, space):
    document.blocks.new("part").add_line((0, 0), (9, 9))
    space.add_blockref("part", (0, 0))
    document.add_xref_def("steel.dwg", "steel")
    space.add_blockref("steel", (0, 0))
    document.layout("Layout1").add_line((0, 0), (1, 1))


def curves(document, space):
    space.add_spline([(0, 0), (1, 1), (2, 0)])
    space.add_ellipse((0, 0), (2, 0), 0.5)
    space.add_lwpolyline([(0, 0, 1), (5, 0, 0)], format="xyb")
    fitted = space.add_polyline2d([(0, 0), (1, 1), (2, 0)])
    fitted.dxf.flags |= 4
    space.add_circle((0, 0), 1)
    space.add_circle((0, 0), 2)
    for add in (space.add_3dface, space.add_solid):
        add([(0, 0), (1, 0), (1, 1)])
    space.add_polyface()
    space.add_text("roof")
    space.add_point((7, 7, 7))


def again(document, space):
    space.add_line((1, 0, 1 / 3), (0, 0, 0), dxfattribs={"layer": "Größe ∅"})


CURVED = "3DFACE (1), CIRCLE (2), ELLIPSE (1), LWPOLYLINE with arcs (1), POINT (1), "
CURVED += "POLYLINE fitted by a spline (1), POLYLINE mesh (1), SOLID (1), SPLINE (1), TEXT (1)"


@pytest.mark.slow_cases(
    "references-INSERT (1), entity in paper space (1), external reference (1)-6"
)
@pytest.mark.parametrize(
    ("change", "rows", "links"),
    [
        (unseen, "LINE (1), LINE (1), LINE (1)", 7),
        (references, "INSERT (1), entity in paper space (1), external reference (1)", 6),
        (curves, CURVED, 6),
        (again, "link that occurs again (1)", 6),
    ],
)
def test_what_is_left_out_is_counted(change, rows, links, tmp_path):
    net, told = outcome(read_dxf, drawing(tmp_path / "net.dxf", change=change))
    assert len(net.links) == links and sorted(told) == rows.split(", ")
    about = {row.what: row for row in net.omissions}
    if change is references:
        assert "explode blocks first" in about["INSERT"].why
    if change is again:
        assert "'Größe ∅'" in about["link that occurs again"].where


def test_hidden_lines_are_read_if_asked_for(tmp_path, capsys):
    path = drawing(tmp_path / "net.dxf", change=unseen)
    net, _ = outcome(read_dxf, path)
    reasons = {row.why.split(" in ")[0]: row.where for row in net.omissions}
    places = {"off": "layer 'alt'", "frozen": "layer 'Entwürfe'", "invisible": "layer 'edge'"}
    assert reasons == places
    net, told = outcome(read_dxf, path, hidden=True)
    assert told == [] and len(net.links) == 10
    assert main(["info", str(path)]) == 0
    out, err = capsys.readouterr()
    assert "7 links" in out
    assert err.startswith(f"jaxcable: warning: {path}: left out:\n  LINE (1), layer 'Entwürfe': fr")
    assert main(["info", str(path), "--hidden"]) == 0
    out, err = capsys.readouterr()
    assert "10 links" in out and err == ""


# --- written


@pytest.mark.parametrize("name", ["hypar_net", "geiger_dome"])
def test_structures_come_back(name, tmp_path):
    """Every digit of the positions, links, groups and supports; with nothing left out."""
    structure, _ = scenes.EVERY[name]()
    save_dxf(tmp_path / "net.dxf", structure)
    net, told = outcome(read_dxf, tmp_path / "net.dxf", tolerance=0.0, supports="supports")
    places = np.asarray(structure.nodes, float)
    same = [places.tolist().index(node) for node in net.nodes.tolist()]  # exact
    links = np.concatenate([group.links.array for group in structure.groups])
    assert told == [] and np.array(same)[net.links].tolist() == links.tolist()
    held = structure.supports.fixed(structure.n_node).any(axis=1)
    assert net.fixed.all(axis=1).tolist() == held[same].tolist()
    counts = [len(group.links) for group in structure.groups]
    assert [net.groups.count(g) for g in dict.fromkeys(net.groups)] == counts
    kinds = [type(group) is jc.Bars for group in structure.groups for _ in group.links.array]
    assert [kind == "bar" for kind in net.kinds] == kinds
    own = read_dxf(tmp_path / "net.dxf", tolerance=0.0)  # it is its own drawing
    np.testing.assert_array_equal(own.fixed, net.fixed)


def test_drawings_in_other_units(tmp_path):
    structure, _ = scenes.geiger_dome()
    links = np.concatenate([group.links.array for group in structure.groups])
    for scale, unit in ((1e-3, 4), (0.3048, 2)):
        (path,) = save_dxf(tmp_path / "net.dxf", structure, scale=scale)
        document = ezdxf.readfile(path)
        assert document.header["$INSUNITS"] == unit
        lines = [e for e in document.modelspace() if e.dxftype() == "LINE"]
        ends = scale * np.array([[e.dxf.start, e.dxf.end] for e in lines])
        # a quotient and a product, each rounded
        places = np.asarray(structure.nodes)[links]
        np.testing.assert_allclose(ends, places, rtol=1e-15, atol=1e-15)
        assert len(read_dxf(path).links) == len(links)
    with pytest.raises(
        ValueError, match=r"scale = 0.5: expected metres per drawing unit of DXF, such"
    ):
        save_dxf(path, structure, scale=0.5)


def test_supports_in_some_directions_are_not_taken_for_pins(tmp_path):
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
    held = np.array([[1, 1, 1], [0, 1, 0], [1, 1, 1]], bool)
    structure = jc.Structure([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], cables, jc.Supports(mask=held))
    save_dxf(tmp_path / "net.dxf", structure)
    net = read_dxf(tmp_path / "net.dxf")
    assert not net.fixed.any() and net.marks["supports"].tolist() == [0, 1, 2]


@pytest.mark.slow
def test_others_read_what_is_written(tmp_path):
    """A reader of pairs of lines, written here; and dxfgrabber."""
    structure, phases = jc.scenes.flat_net(load=15.0)
    solution = converged(jc.solve(structure, phases))
    (path,) = save_dxf(tmp_path / "net.dxf", structure, solution)
    pairs = tags(path)
    assert pairs[pairs.index((9, "$INSUNITS")) + 1] == (70, "6")
    lines = [dict(e) for e in entities(path) if e[0] == (0, "LINE")]
    ends = np.array([[[float(e[c + k]) for c in (10, 20, 30)] for k in (0, 1)] for e in lines])
    links = structure.elements.links.array
    np.testing.assert_array_equal(ends, np.asarray(solution.positions)[links])
    assert {e[8] for e in lines} == {"Cables"}
    other = dxfgrabber.readfile(str(path))
    assert other.header["$INSUNITS"] == 6
    colours = {layer.name: layer.color for layer in other.layers}
    assert colours["Cables"] == 5 and {"supports", "nodes"} <= set(colours)
    seen = [e for e in other.entities if e.dxftype == "LINE"]
    np.testing.assert_array_equal([[e.start, e.end] for e in seen], ends)
    assert sum(e.dxftype == "POINT" for e in other.entities) == structure.n_node


def test_ropes_are_polylines(tmp_path):
    nodes = [[0.0, 0, 0], [1, 0, -1], [2, 0, 0], [1, 0, 1]]
    ropes = jc.SlidingCables([[0, 1, 2], [0, 3]], axial_stiffness=1e5)
    structure = jc.Structure(nodes, ropes, jc.pinned([0, 2, 3]))
    (path,) = save_dxf(tmp_path / "rope.dxf", structure)
    assert [e[0][1] for e in entities(path)][:5] == ["POLYLINE", *["VERTEX"] * 3, "SEQEND"]
    assert read_dxf(path).links.tolist() == [[0, 1], [1, 2], [0, 3]]
    save_dxf(path, jc.replace(structure, elements={"net/1": ropes}))
    assert set(read_dxf(path).groups) == {"net_1"}  # what a layer may be called
    both = {"a": ropes, "A": jc.Cables([[1, 3]], axial_stiffness=1.0)}
    with pytest.raises(ValueError, match=r"the layer of group 'a', 'a', is used"):
        save_dxf(path, jc.replace(structure, elements=both))
    with pytest.raises(ValueError, match=r"ends with \.dxf"):
        save_dxf(tmp_path / "rope.dwg", structure)


# --- files that are not what they should be


def hostile(text):
    """Damaged files, from the text of a good one: bytes, and what the message says."""
    third = str(1 / 3)
    return {
        "empty": (b"", "not a DXF drawing"),
        "words": (b"hello\nworld\n", "not a DXF drawing"),
        "binary": (b"AutoCAD Binary DXF\r\n\x1a\0" + bytes(range(256)), "a binary file"),
        "garbage": (np.random.default_rng(0).bytes(100_000), "a binary file|not a DXF"),
        "high bytes": (b"\xff\xfe" * 50_000, "not a DXF drawing"),
        "cut": (text[: len(text) // 2].encode(), "not a DXF drawing"),
        "cut late": (text[: text.rfind(third)].encode(), "not a DXF drawing"),
        "nan": (text.replace(third, "nan").encode(), "LINE .* a coordinate is not finite"),
        "infinite": (text.replace(third, "1e999").encode(), "not finite"),
        "far": (text.replace(third, "1e200").encode(), "coordinates beyond"),
        "word": (text.replace(third, "far").encode(), "not a DXF drawing"),
        "code": (text.replace("AcDbLine\n 10\n", "AcDbLine\nten\n").encode(), "not a DXF drawing"),
        "deep": (b"  0\nSECTION\n" * 100_000, "not a DXF drawing"),
    }


@pytest.mark.parametrize("name", hostile(""))
def test_hostile_files_end_in_one_line(name, tmp_path):
    text = drawing(tmp_path / "good.dxf").read_text()
    data, message = hostile(text)[name]
    path = tmp_path / "bad.dxf"
    path.write_bytes(data)
    net, told = outcome(read_dxf, path)
    assert net is None and re.search(message, told)


def only_a_circle(document, space):
    for entity in list(space):
        space.delete_entity(entity)
    space.add_circle((0, 0), 1)


def only_unseen(document, space):
    document.layers.add("edge").off()
    document.layers.add("field").off()


def held_aside(document, space):
    space.add_point((9, 9, 9), dxfattribs={"layer": "held"})


def a_point(document, space):
    space.add_line((5, 5, 5), (5, 5, 5))


NO_LINES = "has no lines or polylines in model space: "


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        (only_a_circle, {}, rf"{NO_LINES}0 POINT; CIRCLE \(1\), layer '0'"),
        (only_unseen, {}, rf"{NO_LINES}2 POINT; LINE \(1\), layer 'edge': off in the"),
        (a_point, {}, r"net.dxf: LINE \w+ on layer '0': the line has no length"),
        (
            held_aside,
            {"supports": "held"},
            r"POINT \w+ on layer 'held': a support, but .* m from the nearest",
        ),
        (None, {"supports": "feet"}, r"supports = 'feet': there is no POINT on this layer"),
        (None, {"largest": 1000}, "larger than the limit of 0.001 MB"),
        (None, {"scale": -1.0}, r"scale = -1\.0"),
    ],
)
def test_drawings_that_are_no_nets(change, options, message, tmp_path):
    path = drawing(tmp_path / "net.dxf", change=change)
    with pytest.raises(ValueError if "scale" in options else FileError, match=message):
        read_dxf(path, **options)


def test_the_command_line_converts(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    drawing(tmp_path / "net.dxf", 4)
    words = ["--supports", "held", "--anchors", "4", "--axial-stiffness", "1e5"]
    assert main(["convert", "net.dxf", *words, "--save", "net.json"]) == 0
    assert jc.load_scene("net.json").structure.nodes[1, 0] == 1e-3
    assert main(["convert", "net.json", "--scale", "0.001", "--save", "mm.dxf"]) == 0
    assert ezdxf.readfile("mm.dxf").header["$INSUNITS"] == 4
    found, once = (sorted(read_dxf(name).nodes.tolist()) for name in ("mm.dxf", "net.dxf"))
    assert found == once
    assert main(["convert", "net.json", "--save", "net.compas.json"]) == 0
    assert main(["info", "net.compas.json"]) == 0
    assert "net of 6 nodes, 6 links" in capsys.readouterr().out


# $INSUNITS by the DXF reference, with the names of scipy.constants
UNIT_CODES = {
    **{1: "inch", 2: "foot", 3: "mile", 4: "milli", 5: "centi", 7: "kilo", 9: "mil", 10: "yard"},
    **{11: "angstrom", 12: "nano", 13: "micro", 14: "deci", 15: "deka", 16: "hecto", 17: "giga"},
    **{18: "au", 19: "light_year", 20: "parsec", 21: "survey_foot", 24: "survey_mile"},
}


def test_units_of_all_codes(tmp_path):
    """Lengths by scipy.constants, and the multiples of inch, yard and foot that it lacks."""
    exact = {code: getattr(constants, name) for code, name in UNIT_CODES.items()}
    foot = constants.survey_foot
    exact |= {6: 1.0, 8: 1e-6 * constants.inch, 22: foot / 12, 23: 3 * foot}
    assert sorted(exact) == list(range(1, 25))
    structure = jc.Structure([[0, 0, 0], [3.0, 0, 4.0]], jc.Cables([[0, 1]], 1e3), jc.pinned([0]))
    for code, metres in exact.items():
        assert METRES_PER_UNIT[code] == pytest.approx(metres, rel=1e-12)
    for code in (3, 10, 21):  # and a drawing there and back
        (path,) = save_dxf(tmp_path / f"{code}.dxf", structure, scale=METRES_PER_UNIT[code])
        header = ezdxf.readfile(path).header
        assert header["$INSUNITS"] == code and header["$MEASUREMENT"] == 0
        net = read_dxf(path)
        length = np.linalg.norm(net.nodes[net.links[0, 1]] - net.nodes[net.links[0, 0]])
        assert length == pytest.approx(5.0, rel=1e-12)


def test_points_of_nodes_may_be_left_out(tmp_path):
    structure, _ = scenes.geiger_dome()
    kinds = []
    for node_points in (True, False):
        save_dxf(tmp_path / "net.dxf", structure, node_points=node_points)
        kinds.append({one.dxftype() for one in ezdxf.readfile(tmp_path / "net.dxf").modelspace()})
    assert kinds[0] - kinds[1] == {"POINT"} and "LINE" in kinds[1]
