"""Drawn nets: gaps, crossings and T-joints without nodes, arcs, properties by layer."""

import itertools
import math
import re
import warnings

import ezdxf
import numpy as np
import pytest
import scenes

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.files import Net, read_dxf
from jaxcable.files.net_doubts import describe_likely_mistakes

N = 5  # cables in each direction
SIDE = 12.0  # m


def height(x, y):
    """A hyperbolic paraboloid, whose lines along x and y are straight."""
    return 4.0 * x * y / SIDE**2


def write(path, chains, points=(), unit=6):
    """A drawing of lines in layers: chains are (layer, points), points are (layer, place)."""
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = unit
    space = document.modelspace()
    for layer, places in chains:
        for first, last in itertools.pairwise(places):
            space.add_line(first, last, dxfattribs={"layer": layer})
    for layer, place in points:
        space.add_point(place, dxfattribs={"layer": layer})
    document.saveas(path)
    return path


def roof(through, lift=0.0):
    """Chains of a net with edge cables: drawn through, or segment by segment; `lift` of one way."""
    s = [SIDE * k / (N + 1) for k in range(N + 2)]
    ways = [[(x, y) for y in s] for x in s[1:-1]], [[(x, y) for x in s] for y in s[1:-1]]
    chains = []
    for number, lines in enumerate(ways):
        for line in lines:
            rise = lift * (number if through else 0.5)
            inner = [(x, y, height(x, y) + rise) for x, y in line]
            if through:
                inner = [inner[0], inner[-1]]
            else:  # ends lie on the edge
                inner[0], inner[-1] = ((*line[end], height(*line[end])) for end in (0, -1))
            chains.append(("NET", inner))
    corners = np.array([(0, 0), (SIDE, 0), (SIDE, SIDE), (0, SIDE), (0, 0)])
    for first, last in itertools.pairwise(corners):
        places = [first + (last - first) * t for t in np.linspace(0, 1, 2 if through else N + 2)]
        chains.append(("EDGE", [(*map(float, p), height(*p)) for p in places]))
    return chains


def same_places(first, second):
    """Number in `second` of every node of `first`: within 1e-9 m, the rounding of the heights."""
    distance = np.linalg.norm(first[:, None] - second[None], axis=2)
    assert distance.min(axis=1).max() < 1e-9 and len(first) == len(second)
    return distance.argmin(axis=1)


def linked(net, number):
    """Links with their groups, by the numbers of another net, a set."""
    pairs = np.sort(number[net.links], axis=1).tolist()
    return {(*pair, group) for pair, group in zip(pairs, net.groups, strict=True)}


def test_a_net_drawn_through_is_the_segmented_one(tmp_path):
    """The same nodes, links and groups, and the same form with the corners held."""
    through = read_dxf(write(tmp_path / "through.dxf", roof(True)))
    pieces = read_dxf(write(tmp_path / "pieces.dxf", roof(False)))
    assert len(through.links) == 2 * N + 4 and len(pieces.links) == 2 * N * (N + 1) + 4 * (N + 1)
    split = through.split()
    number = same_places(split.nodes, pieces.nodes)
    assert linked(split, number) == linked(pieces, np.arange(len(pieces.nodes)))
    assert len(split.links) == len(pieces.links)
    np.testing.assert_array_equal(split.nodes[: len(through.nodes)], through.nodes)
    forms = []
    for net in (split, pieces):
        place = net.nodes[:, :2]
        held = np.flatnonzero(np.isin(place, (0.0, SIDE)).all(axis=1))
        assert len(held) == 4
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            structure, _ = net.scene(held, axial_stiffness=1e6)
        forms.append(np.asarray(jc.force_density(structure, {"NET": 1e3, "EDGE": 1e4})))
    # one linear system in two orders: rounding times its condition
    np.testing.assert_allclose(forms[0], forms[1][number], atol=1e-9)
    again = split.split()
    assert again.links.tolist() == split.links.tolist()
    assert len(again.nodes) == len(split.nodes)


def test_heights_at_crossings_are_means(tmp_path):
    """One way is 0.4 m higher: nodes are half of that above, and ends come down to the edge."""
    net = read_dxf(write(tmp_path / "through.dxf", roof(True, lift=0.4)))
    split = net.split()
    new = split.nodes[len(net.nodes) :]
    assert len(new) == N**2
    np.testing.assert_allclose(new[:, 2], height(new[:, 0], new[:, 1]) + 0.2, atol=1e-12)
    with pytest.warns(jc.InputWarning, match=r"split: 3\d places .* differ by more than 0.01 of"):
        left = net.split(gap=0.01)  # 0.12 m of cables of 12 m
    assert len(left.nodes) == len(net.nodes)
    assert left.groups.count("EDGE") == 4 + 2 * N  # the ends of the other way lie on the edges


def free(nodes, links, **more):
    """A `Net` without supports."""
    return Net(np.array(nodes, float), np.array(links), np.zeros((len(nodes), 3), bool), **more)


def test_three_cables_through_a_point_have_one_node():
    """Heights 0, 0.3 and 0.6 m where they cross; in another place two more, below those."""
    turn = np.array([0.1, 1.2, 2.3])
    out = 3.0 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    lift = np.array([[0.0, 0, 0], [0, 0, 0.3], [0, 0, 0.6]])
    nodes = np.concatenate([lift - out, lift + out]) + np.array([7.0, 5.0, 0.0])
    links = np.array([[0, 3], [1, 4], [2, 5]])
    net = free(nodes, links).split(tolerance=1e-9)
    assert len(net.nodes) == 7 and len(net.links) == 6
    np.testing.assert_allclose(net.nodes[6], [7.0, 5.0, 0.3], atol=1e-12)
    both = free([*nodes, *(nodes - [0.0, 0, 50.0])], [*links, *(links + 6)])
    with pytest.warns(jc.InputWarning, match="split: 6 places"):  # not those below each other
        both = both.split(tolerance=1e-9)
    assert sorted(np.round(both.nodes[12:, 2], 9).tolist()) == [-49.7, 0.3]


def test_pieces_keep_what_their_link_had():
    net = Net(
        np.array([[0.0, 0, 0], [4, 0, 0], [1, -1, 0], [1, 1, 0], [4, 3, 0]]),
        np.array([[0, 1], [2, 3], [1, 4]]),
        np.array([[True] * 3] + [[False] * 3] * 4),
        loads=np.ones((5, 3)),
        values={
            "rest_length": np.array([3.9, 1.9, np.nan]),
            "force_density": np.array([10.0, 20.0, 5.0]),
            "pretension": np.array([40.0, 40.0, 15.0]),
        },
        **{"kinds": ("cable", "bar", "cable"), "groups": tuple("abc"), "names": tuple("ABCDE")},
    )
    found = net.split()
    assert found.links.tolist() == [[0, 5], [5, 1], [2, 5], [5, 3], [1, 4]]
    assert repr(found).startswith("Net\n  nodes [6, 3] ") and repr(found).count("\n") < 5
    assert found.groups == tuple("aabbc")
    assert found.kinds == ("cable", "cable", "bar", "bar", "cable")
    assert found.names == (*"ABCDE", "") and found.loads[5].tolist() == [0.0] * 3
    assert found.fixed.any(axis=1).tolist() == [True] + [False] * 5
    np.testing.assert_allclose(found.values["rest_length"][:4], [0.975, 2.925, 0.95, 0.95])
    length = np.linalg.norm(np.diff(found.nodes[found.links], axis=1)[:, 0], axis=1)
    # forces: 10 N/m over 4 m, 20 N/m over 2 m, and as before
    np.testing.assert_allclose(found.values["force_density"] * length, [40, 40, 40, 40, 15])
    assert found.values["pretension"].tolist() == [40, 40, 40, 40, 15]
    assert net.split(["a", "c"]).links.tolist() == net.links.tolist()
    # an end above a link comes down to it, unless a link that takes no part holds it, too
    nodes = [[0.0, 0, 0], [4, 0, 0], [2, 0, 0.1], [2, 3, 0], [2, 0, 3]]
    above = free(nodes, [[0, 1], [2, 3], [2, 4]], groups=("a", "a", "c"))
    with pytest.warns(jc.InputWarning, match="split: 1 places"):
        assert len(above.split(["a"]).links) == 3
    assert free(nodes[:4], [[0, 1], [2, 3]]).split().links.tolist() == [[0, 2], [2, 1], [2, 3]]
    with pytest.raises(ValueError, match="groups: no group 'd'; there are a, b, c"):
        net.split(["d"])
    with pytest.raises(ValueError, match=r"tolerance = -1.0, gap = 0.25: expected positive"):
        net.split(tolerance=-1.0)


def test_joints_on_inclined_upright_and_doubled_links():
    """A guy at a vertical mast, at half its height; a link that lies on a part of another one."""
    guy = free([[0.0, 0, 0], [0, 0, 6], [4, 0, 0], [0, 0, 3]], [[0, 1], [2, 3]]).split()
    assert guy.links.tolist() == [[0, 3], [3, 1], [2, 3]]
    line = free([[0.0, 0, 0], [6, 0, 3], [2, 0, 1], [4, 0, 2]], [[0, 1], [2, 3]]).split()
    assert line.links.tolist() == [[0, 2], [2, 3], [3, 1]]


@pytest.mark.parametrize("name", ["geiger_dome", "cable_truss", "guyed_mast", "simplex"])
def test_structures_in_space_are_not_doubtful(name):
    """Their cables lie above each other in plan, and are not meant to be joined."""
    structure, _ = scenes.EVERY[name]()
    links = np.concatenate([g.links.array[:, :2] for g in structure.groups])
    held = np.asarray(structure.supports.fixed(structure.n_node)).any(axis=1)
    assert describe_likely_mistakes(np.asarray(structure.nodes, float), links, held) == []


MAST = [("MAST", [(0, 0, 0), (0, 0, 8)]), ("TIE", [(0, 0, 8), (-5, 0, 0)])]


def test_a_loose_end_beside_a_mast_head_is_no_anchor(tmp_path):
    """0.5 mm off, in a drawing in metres."""
    path = write(tmp_path / "gap.dxf", [*MAST, ("TIE", [(3e-4, 4e-4, 8), (5, 0, 0)])])
    net = read_dxf(path)
    told = r"node 3 at \(0.0003, 0.0004, 8\) m is 0.5 mm from node 1; .*--tol.*--split"
    with pytest.raises(ValueError, match=f"anchors: 1 of the ends touch.*{told}"):
        net.scene("ends", axial_stiffness=1e6)
    words = "2 nodes, with node 3 .* are not connected to a support: 1 pair of"
    with pytest.raises(ValueError, match=words):
        net.scene([0, 2], axial_stiffness=1e6)
    words = r"1 pair of nodes closer than 1% .* nodes 1 and 3 at \(0, 0, 8\) m, 0.5 mm .*; .*--tol"
    with pytest.warns(jc.InputWarning, match=words):  # named by its number: as asked for
        structure, _ = net.scene(["ends", 3], axial_stiffness=1e6)
    assert structure.supports.nodes.array.tolist() == [0, 2, 3, 4]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        structure, _ = read_dxf(path, tolerance=1e-3).scene("ends", axial_stiffness=1e6)
    assert structure.supports.nodes.array.tolist() == [0, 2, 3]


@pytest.mark.parametrize(("off", "doubtful"), [(0.049, True), (0.051, False)])
def test_one_per_cent_of_the_shortest_link(off, doubtful):
    """The links there are 5 m and 8 m; a link of 1 mm elsewhere hides nothing."""
    nodes = np.array([[0.0, 0, 8], [0, 0, 0], [off, 0, 8], [5 + off, 0, 8], [5 + off, 0.001, 8]])
    told = describe_likely_mistakes(nodes, np.array([[0, 1], [2, 3], [3, 4]]), np.zeros(5, bool))
    assert any("pair" in text for text in told) == doubtful


def test_an_end_just_short_of_an_edge_cable(tmp_path):
    """It is 0.4 mm off: no anchor, told, and joined by a split with a larger tolerance."""
    chains = [("EDGE", [(0, 0, 0), (10, 0, 1)]), ("NET", [(5, 4e-4, 0.5), (5, 6, 0)])]
    net = read_dxf(write(tmp_path / "short.dxf", chains))
    with pytest.raises(ValueError, match=r"node 2 at .* 0.4 mm from the link from node 0 to 1"):
        net.scene("ends", axial_stiffness=1e6)
    held = np.array([True, True, False, True])
    (text,) = describe_likely_mistakes(net.nodes, net.links, held)
    assert "1 end closer to a link than 1% of its length: node 2" in text
    assert net.split(tolerance=1e-3).links.tolist() == [[0, 2], [2, 1], [2, 3]]


@pytest.mark.parametrize(("degrees", "clockwise"), [(30.0, False), (180.0, True), (300.0, False)])
def test_arcs_are_chords(degrees, clockwise, tmp_path):
    """All kinds of arcs: points on the circle, middles of chords within the sagitta of it."""
    radius, sagitta = 5.0, 0.02
    sign = -1.0 if clockwise else 1.0
    bulge = sign * math.tan(math.radians(degrees) / 4)
    first, last = 0.3, 0.3 + sign * math.radians(degrees)
    ends = [(radius * math.cos(a), radius * math.sin(a)) for a in (first, last)]
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 5  # centimetres
    space = document.modelspace()
    points = [(100 * x, 100 * y, b) for (x, y), b in zip(ends, (bulge, 0.0), strict=True)]
    space.add_lwpolyline(points, format="xyb", dxfattribs={"layer": "a", "elevation": 200})
    space.add_polyline2d(points, format="xyb", dxfattribs={"layer": "b"})
    turn = sorted([math.degrees(first), math.degrees(last)])
    space.add_arc((0, 0, 700), 100 * radius, *turn, dxfattribs={"layer": "c"})
    document.saveas(tmp_path / "arcs.dxf")
    with pytest.raises(
        jc.files.FileError,
        match=r"ARC \(1\), layer 'c': to replace arcs by chords, give sagitta.*; LWPOLY",
    ):
        read_dxf(tmp_path / "arcs.dxf")
    net = read_dxf(tmp_path / "arcs.dxf", sagitta=sagitta)
    # rounding of the bulge and of the tangent of the quarter angle
    np.testing.assert_allclose(np.linalg.norm(net.nodes[:, :2], axis=1), radius, rtol=1e-9)
    middles = net.nodes[net.links].mean(axis=1)
    depth = radius - np.linalg.norm(middles[:, :2], axis=1)
    assert 0.25 * sagitta < depth.min() and depth.max() <= sagitta * (1 + 1e-9)
    least = math.ceil(math.radians(degrees) / (2 * math.acos(1 - sagitta / radius)))
    for layer, z in (("a", 2.0), ("b", 0.0), ("c", 7.0)):
        part = net.links[np.array(net.groups) == layer]
        assert len(part) == least and set(net.nodes[part][..., 2].ravel().tolist()) == {z}
        length = np.linalg.norm(np.diff(net.nodes[part], axis=1)[:, 0], axis=1).sum()
        # chords are shorter than the arc by the square of their angle over 24
        arc = radius * math.radians(degrees)
        assert length < arc and length == pytest.approx(arc, rel=(sagitta / radius))
    middle = 0.3 + sign * math.radians(degrees) / 2  # the arc lies on the right side of its chord
    on = net.nodes[:, :2] @ [math.cos(middle), math.sin(middle)]
    assert on.max() > radius - sagitta
    with pytest.raises(ValueError, match=r"sagitta = 0: expected a positive number"):
        read_dxf(tmp_path / "arcs.dxf", sagitta=0)


def test_cables_that_end_on_an_arc_are_joined_to_it(tmp_path, capsys):
    """Their ends are on the arc, up to the sagitta off its chords, which then go through them."""
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 6
    space = document.modelspace()
    space.add_lwpolyline([(5, 0, 1), (-5, 0, 0)], format="xyb", dxfattribs={"layer": "EDGE"})
    for turn in (0.3, 1.1, 2.0):
        end = (5 * math.cos(turn), 5 * math.sin(turn))
        space.add_line((0, -1), end, dxfattribs={"layer": "NET"})
    document.saveas(tmp_path / "arc.dxf")
    net = read_dxf(tmp_path / "arc.dxf", sagitta=0.02)
    chords = net.groups.count("EDGE")
    assert net.split(tolerance=0.02).groups.count("EDGE") == chords + 3
    words = ["info", str(tmp_path / "arc.dxf"), "--sagitta", "0.02"]
    assert main(words) == 0
    assert "doubtful: 3 crossings of links in plan without a node" in capsys.readouterr().out
    assert main([*words, "--split"]) == 0
    out = capsys.readouterr().out
    assert f"split: 0 nodes added, {chords + 6} links instead of {chords + 3}" in out
    assert "end nodes: 2\n" in out and "doubtful" not in out


def test_properties_by_layer(tmp_path):
    net = read_dxf(write(tmp_path / "mast.dxf", MAST, [("FOOT", (0, 0, 0)), ("DIM", (-5, 0, 0))]))
    assert {layer: nodes.tolist() for layer, nodes in net.marks.items()} == {
        "FOOT": [0],
        "DIM": [2],
    }
    stiff = {"MAST": 2e9, "TIE": 1e7}
    more = {"strength": {"TIE": 3e5}, "pretension": {"TIE": 1e4}}
    structure, phases = net.scene([0, 2], bars=["MAST"], axial_stiffness=stiff, **more)
    mast, tie = structure.elements["MAST"], structure.elements["TIE"]
    assert type(mast) is jc.Bars and type(tie) is jc.Cables
    assert mast.axial_stiffness.tolist() == [2e9] and tie.axial_stiffness.tolist() == [1e7]
    assert mast.strength is None and tie.strength.tolist() == [3e5]
    assert phases[0].pretension["TIE"].tolist() == [1e4] and phases[0].pretension["MAST"] is None
    for options, message in (
        ({"axial_stiffness": {"MAST": 1e9}}, "axial_stiffness: group 'TIE' has none"),
        ({"axial_stiffness": {"POST": 1e9}}, "axial_stiffness: no group 'POST'; there are MAST, T"),
        ({"bars": ["POST"]}, "bars: no group 'POST'"),
        ({"anchors": ["end"]}, "anchors = 'end': expected node numbers or"),
        ({"anchors": [0, 9]}, "9"),
    ):
        with pytest.raises(ValueError, match=re.escape(message)):
            net.scene(**{"anchors": [0, 2], "axial_stiffness": 1e9, **options})


def test_the_command_line_splits_and_takes_layers(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    feet = [("SUPPORT", (x, y, height(x, y))) for x in (0, SIDE) for y in (0, SIDE)]
    write("roof.dxf", roof(True), feet)
    assert main(["info", "roof.dxf"]) == 0
    out = capsys.readouterr().out
    assert "groups: NET 10, EDGE 4" in out and "nodes with points, by layer: SUPPORT 4" in out
    assert "end nodes: 20\n  node 0 at (2, 0, 0) m" in out and "  and 8 more" in out
    assert "corners of groups in plan: 4\n" in out and "at (12, 12, 4) m" in out
    assert "doubtful: 25 crossings of links in plan without a node, and 20 nodes on a link" in out
    stiff = ["--axial-stiffness", "NET=2e7", "EDGE=1e8", "--strength", "NET=2e5"]
    words = ["convert", "roof.dxf", "--supports", "SUPPORT", *stiff, "--save", "roof.json"]
    for more, message in (
        ([], "are not connected to a support: 25 crossings of links"),
        (["--split", "STAY"], "--split: groups: no group 'STAY'; there are NET, EDGE"),
        (["--split", "--anchors", "5-x", "ends"], "'5-x' is no node number or range such as 5-8"),
    ):
        assert main([*words, *more]) == 2
        assert message in capsys.readouterr().err
    assert main([*words, "--split"]) == 0
    assert "split: 25 nodes added, 84 links instead of 14" in capsys.readouterr().out
    structure, _ = jc.load_scene("roof.json")
    assert structure.elements["EDGE"].axial_stiffness.tolist() == [1e8] * 24
    assert structure.elements["EDGE"].strength is None
    assert len(structure.supports.nodes.array) == 4
    write("mast.dxf", MAST)
    words = ["convert", "mast.dxf", "--anchors", "ends", "1", "--bars", "MAST"]
    assert main([*words, "--axial-stiffness", "1e8", "--save", "mast.json"]) == 0
    structure, _ = jc.load_scene("mast.json")
    assert type(structure.elements["MAST"]) is jc.Bars
    assert structure.supports.nodes.array.tolist() == [0, 1, 2]
