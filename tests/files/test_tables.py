"""Lines of modelling programs (OBJ) and tables of spreadsheets (CSV) become nets, or are refused.

What a reader leaves out it tells in one warning; a `FileError` is one line with the place.
"""

import csv
import io
import itertools

import numpy as np
import pytest
from banks.shapes import pieces
from file_cases import outcome

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.files import FileError, Net, read_csv, read_obj
from jaxcable.files.results import format_csv

# --- OBJ

LINES = """# lines of a modelling program, millimetres
o net
v 0 0 0
v 1000 0 0
v 1000 0 0.0001
v 2000 0 0
v 1000 1000 500
v 9 9 9
g edge
l 1 2
l 3 4
g field
l -2 -4
l 2 1
f 1 2 5
vt 0 0
"""


def test_lines_become_a_net(tmp_path):
    path = tmp_path / "net.obj"
    path.write_text(LINES)
    net, told = outcome(read_obj, path, scale=1e-3)
    assert told == ["line that occurs again (1)", "point that no line touches (1)"]
    assert [row.where for row in net.omissions] == ["line 14", "point 6"]
    # points nearer than 1e-6 m are one; the point that no line touches is none; links occur once
    assert net.nodes.tolist() == [[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0.5]]
    assert net.links.tolist() == [[0, 1], [1, 2], [3, 1], [3, 0]]
    assert net.groups == ("edge", "edge", "field", "field")
    assert net.names == ("1", "2", "4", "5") and not net.fixed.any()
    assert len(outcome(read_obj, path, scale=1.0, tolerance=1e-5)[0].nodes) == 5
    structure, _ = net.scene([0, 2, 3], axial_stiffness=1e5, pretension=100.0)
    assert list(structure.elements) == ["edge", "field"]


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
UNREAD = [f"statement {word!r} (1)" for word in ("cstype", "curv", "deg", "end", "p", "parm")]
UNREAD = ["point that no line touches (1)", *UNREAD, "weight of a point (1)"]
FACES = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nvt 0 0\ns off\nf 1/1/1 2//1 3\nf 1 3 4\n"
SIDES = [[0, 1], [1, 2], [2, 0], [2, 3], [3, 0]]


@pytest.mark.parametrize(
    ("text", "links", "rows"),
    [
        (FREE, [[0, 1], [1, 2]], UNREAD),
        (FACES, SIDES, []),
        ("\ufeff" + FACES.replace("\n", "\r\n"), SIDES, []),
        (FACES + "l 4 1\n", SIDES, ["line that occurs again (1)"]),
    ],
    ids=["free-form curves", "faces", "mark and lines of Windows", "a line twice"],
)
def test_lines_of_modelling_programs(text, links, rows, tmp_path):
    (tmp_path / "net.obj").write_bytes(text.encode())
    net, told = outcome(read_obj, tmp_path / "net.obj")
    assert net.links.tolist() == links and told == rows


TWO = "v 0 0 0\nv 1 0 0\n"
CROWD = "".join(f"v {k}e-9 0 0\n" for k in range(900))


@pytest.mark.slow_cases("14")
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TWO + "l 1 3\n", "line 3: point 3 is not among the 2"),
        (TWO + "l 1 0\n", "line 3: point 0"),
        (TWO + "l 1 -3\n", "line 3: point -3"),
        (FACES[:-3] + " 9\n", "line 9: point 9 is not among the 4"),
        ("v 0 0 0\nv 1 0\n", "line 2: a point has three finite"),
        ("v 0 0 inf\n", "line 1: a point has three finite"),
        ("v 0 0 x\n", "line 1: 'x' is not a number"),
        ("v 0 0 1_0\n", "line 1: '1_0' is not a number"),  # Python reads these as 10, 1 and 2
        ("v 0 0 \u0661\n", "line 1: '\u0661' is not a number"),
        (TWO + "l 1 0_2\n", "line 3: '0_2' is not the number of a point"),
        ("v 0 0 0\nv 0 0 0\nl 1 2\n", "line 3: the line has no length"),
        ("v 0 0 0\nl 1\n", "line 2: a line has at least two points"),
        ("v 0 0 0\nv 1e200 0 0\nl 1 2\n", "coordinates beyond"),
        (CROWD + "l 1 2\n", "too many points closer than"),
        ("v 0 0 0\n" * 100_000 + "l 1 2\n", "the line has no length"),
        ("hello\n", "has 0 points (v) and 0 lines"),
    ],
    ids=itertools.count(),
)
def test_bad_lines_are_named(text, message, tmp_path):
    (tmp_path / "net.obj").write_text(text)
    net, told = outcome(read_obj, tmp_path / "net.obj")
    assert net is None and message in told


# --- CSV


def pair(folder, nodes, links):
    """The paths of a table of nodes and one of links, with the lines of `nodes` and `links`."""
    for name, text in (("n.csv", nodes), ("l.csv", links)):
        (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return folder / "n.csv", folder / "l.csv"


BRIDGE = """# a hanging bridge
node;x;y;z;support;fz
A;0;0;0;1;
B;1;0;-0.1;;-50
C;2;0;0;xz;
D;2;1;0;1;
"""
MEMBERS = """first,last,kind,group,axial_stiffness,pretension
A,B,cable,main,1e5,200
B,C,cable,main,1e5,
C,D,bar,strut,2e6,
"""


def test_a_pair_of_tables_becomes_a_net(tmp_path):
    net, told = outcome(read_csv, *pair(tmp_path, BRIDGE, MEMBERS))
    assert told == []
    assert net.links.tolist() == [[0, 1], [1, 2], [2, 3]] and net.names == tuple("ABCD")
    assert net.fixed.tolist() == [[True] * 3, [False] * 3, [True, False, True], [True] * 3]
    assert net.loads[:, 2].tolist() == [0, -50, 0, 0]
    structure, (prestress, loading) = net.scene(pretension=100.0)
    assert type(structure.elements["strut"]) is jc.Bars
    assert prestress.pretension["main"].tolist() == [200.0, 100.0]  # given where the file has none
    assert loading.loads.nodes.array.tolist() == [1]
    assert structure.supports.fixed(4)[2].tolist() == [True, False, True, False, False, False]
    bare = Net(net.nodes, net.links, np.zeros((4, 3), bool))
    ends = bare.scene("ends", axial_stiffness=1.0).structure
    assert ends.supports.nodes.array.tolist() == [0, 3]
    for of, arguments, options, message in (
        (net, (), {}, "pretension: link 1 has none; give pretension="),
        (net, (), {"stiffness": 1.0}, "stiffness: not a property"),
        (bare, ("ends",), {}, "axial_stiffness: the file has none"),
        (bare, (), {"axial_stiffness": 1.0}, "anchors: the file names no supports"),
        (bare, ("all",), {"axial_stiffness": 1.0}, "anchors = 'all'"),
    ):
        with pytest.raises(ValueError, match=message):
            of.scene(*arguments, **options)


GERMAN = "Knoten;X-Koord.;Y-Koord.;Höhe;Lager;Bemerkung\nA;0;0;0,5;1;am Haus\nB;1,5;0;0;0;\n"
GERMAN += "C;3;0;0,5;1;Mast\n"
NAMES = {"node": "Knoten", "x": "x-koord.", "y": "Y-Koord.", "z": "Höhe", "support": "Lager"}
PLAIN = "node,x,y,z,support\nA,0,0,0.5,1\nB,1.5,0,0,0\nC,3,0,0.5,1\n"
LINKS = "first,last,axial_stiffness\nA,B,1e5\nB,C,1e5\n"
QUOTED = '"Node","X","Y","Z","Support"\n"A","0","0","0.5","true"\n' + PLAIN[31:]


@pytest.mark.parametrize(
    ("text", "columns", "rows"),
    [
        (PLAIN, None, []),
        ("\ufeff" + GERMAN.replace("\n", "\r\n"), NAMES, ["column 'bemerkung' (1)"]),
        (PLAIN.replace(",", "\t"), None, []),
        ("node,x,y,z,libre\nA,0,0,0.5,0\nB,1.5,0,0,1\nC,3,0,0.5,no\n", {"free": "Libre"}, []),
        (QUOTED, None, []),
        ("sep=|\n" + PLAIN.replace(",", "|").replace(".", ","), None, []),
    ],
    ids=["plain", "German", "tabs", "flags of what is free", "quotes", "decimal commas"],
)
def test_tables(text, columns, rows, tmp_path):
    net, told = outcome(read_csv, *pair(tmp_path, text, LINKS), columns=columns)
    assert told == rows
    assert net.nodes.tolist() == [[0, 0, 0.5], [1.5, 0, 0], [3, 0, 0.5]]
    assert net.fixed.tolist() == [[True] * 3, [False] * 3, [True] * 3]


@pytest.mark.parametrize(
    ("mark", "stated"),
    [
        *itertools.product(";\t", ["", "sep={}"]),
        *itertools.product(",", ["", '"sep={}"', "SEP={}", "sep={0}{0}{0}"]),
        ("|", "sep={}"),
    ],
)
def test_rows_that_spreadsheets_add(tmp_path, mark, stated):
    """Empty rows of several kinds, and a row that names the separator."""
    rows = ["x;y;z;support", "0.5;0;0;1", "1;2;0;1"]
    rows = [";;;", rows[0], ";;;", rows[1], ";;;;;", '"";"";"";""', rows[2], " ; ; ; ", ";"]
    links = ["first;last;axial_stiffness", "0;1;1e5", ";;", ";"]
    head = [stated.format(mark)] if stated else []
    texts = ["\r\n".join([*head, *(row.replace(";", mark) for row in t)]) for t in (rows, links)]
    net, told = outcome(read_csv, *pair(tmp_path, *(text + "\r\n" for text in texts)))
    assert net.nodes.tolist() == [[0.5, 0, 0], [1, 2, 0]] and net.links.tolist() == [[0, 1]]
    assert net.fixed.all() and net.values["axial_stiffness"].tolist() == [1e5] and told == []


@pytest.mark.parametrize(
    ("nodes", "columns", "message"),
    [
        ("", None, "n.csv: is empty"),
        (";;;\n;;;\n", None, "n.csv: is empty"),
        ("sep=;\n", None, "n.csv: is empty"),
        ("sep=;\nx;y;z\n;;\n", None, "n.csv: has no rows"),
        ("sep=;\nx;y;z\n\n;;\n1;2\n", None, "n.csv: line 5: 2 fields, the header has 3"),
        ("sep=a\nx,y,z\n", None, "unknown column 'sep=a'"),
        (GERMAN.replace("1,5", "1.5"), NAMES, "line 2: z: '0,5' is not a number"),
        (GERMAN, None, "line 1: unknown column 'knoten'"),
        (GERMAN.encode("utf-16"), NAMES, "a binary file"),
        (GERMAN.encode("cp1252"), NAMES, "not UTF-8"),
        (PLAIN, {"support": "Fixed"}, "support: there is no column 'fixed'"),
        (PLAIN.replace("z,", "x,"), None, "line 1: column 'x' occurs twice"),
        (PLAIN.replace("z,", "fx,"), None, "line 1: column 'z' is missing"),
        ("node,x,y,z,support,free\nA,0,0,0.5,1,0\n", None, "has both support and free"),
        (
            "node,x,y,z,free\nA,0,0,0.5,\n",
            None,
            "line 2: free: is empty; expected 0, 1 or some of xyz",
        ),
        (PLAIN.replace("0.5,1", "0.5,all", 1), None, "line 2: support: 'all'"),
        (PLAIN.replace("\nC", "\nB"), None, "line 4: node 'B' occurs twice"),
        (PLAIN.replace("1.5", "nan"), None, "line 3: x: 'nan' is not finite"),
        (PLAIN.replace("1.5", "zero"), None, "line 3: x: 'zero' is not a number"),
        (PLAIN.replace("1.5", "1_0"), None, "line 3: x: '1_0' is not a number"),
        (PLAIN.replace("1.5", ""), None, "line 3: x: '' is not a number"),
        (PLAIN[:-4], None, "line 4: 4 fields, the header has 5"),
    ],
    ids=itertools.count(),
)
def test_a_bad_table_names_line_and_column(nodes, columns, message, tmp_path):
    net, told = outcome(read_csv, *pair(tmp_path, nodes, LINKS), columns=columns)
    assert net is None and message in told


@pytest.mark.parametrize(
    ("links", "message"),
    [
        (MEMBERS.replace("A,B", "A,Z"), "l.csv: line 2: last: no node 'Z'"),
        (MEMBERS.replace("bar,", "rope,"), "l.csv: line 4: kind: 'rope'"),
        (MEMBERS.replace("1e5,200", '1e5,"200'), "l.csv: "),
        ("first,last\n", "l.csv: has no rows"),
    ],
    ids=itertools.count(),
)
def test_bad_links_are_named(links, message, tmp_path):
    net, told = outcome(read_csv, *pair(tmp_path, BRIDGE, links))
    assert net is None and message in told


# --- on the command line


def test_convert_names_columns_and_refuses_what_would_do_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pair(tmp_path, GERMAN, LINKS)
    words = ["convert", "n.csv", "l.csv", "--save", "net.json", "--columns"]
    assert main([*words, *(f"{name}={own}" for name, own in NAMES.items())]) == 0
    out, err = capsys.readouterr()
    assert out == "wrote net.json: 3 nodes, 2 links\n"
    assert err.splitlines()[1].startswith("  column 'bemerkung' (1), n.csv: line 1: ")
    assert np.asarray(jc.load_scene("net.json").structure.nodes)[0].tolist() == [0, 0, 0.5]
    scene = ["convert", "net.json", "--save", "net.dxf"]
    for line, message in (
        ([*words[:5], "--scale", "0.001"], "--scale: is for files .obj, .dxf only"),
        ([*words[:5], "--supports", "A"], "--supports: is for files .dxf only"),
        ([*words, "x"], "--columns: expected column=name in the file: x"),
        ([*words, "hight=x"], "--columns: no column 'hight'; known are node"),
        ([*scene, "--weight", "3"], "--weight: is for nets, not for scenes"),
    ):
        assert main(line) == 2
        assert message in capsys.readouterr().err
    assert main(scene) == 0
    assert "; a drawing has no stiffnesses, prestress or loads" in capsys.readouterr().out


def test_decimal_marks_of_two_files_agree(tmp_path):
    """1,200 beside 2.5: a decimal comma in one file would be a mark of thousands in the other."""
    commas, points = "node;x;y;z\nA;0;0;0\nB;1,200;0;0\n", "first;last;rest_length\nA;B;2.5\n"
    words = "{}.csv has decimal commas, and .*{}.csv decimal points"
    with pytest.raises(FileError, match=words.format("n", "l")):
        read_csv(*pair(tmp_path, commas, points))
    with pytest.raises(FileError, match=words.format("l", "n")):
        read_csv(*pair(tmp_path, commas.replace(",", "."), points.replace(".", ",")))
    net = read_csv(*pair(tmp_path, commas, points.replace(".", ",")))
    assert net.nodes[1, 0] == 1.2 and net.values["rest_length"][0] == 2.5


def test_texts_of_csv_files_are_no_formulas():
    """Spreadsheets run a cell that begins with = + - @; numbers, also as texts, stay numbers."""
    rows = [["=1+1", "+x", "-x", "@a", "\t=1"], [-1.5, "-1.5", "+2e3", "-", "a=b"]]
    first, second = csv.reader(io.StringIO(format_csv(rows)))
    assert first == ["'=1+1", "'+x", "'-x", "'@a", "'\t=1"]
    assert second == ["-1.5", "-1.5", "+2e3", "-", "a=b"]


def test_names_of_groups_are_texts_in_results_and_reports(tmp_path):
    nodes, links = pieces(2, 2.0)
    structure = jc.Structure(
        nodes, {"=cmd": jc.Cables(links, 1e5, strength=1e4)}, jc.pinned([0, 2])
    )
    solution = jc.solve(structure, jc.Phase(pretension=100.0))
    written = jc.files.save_result(tmp_path / "r.csv", structure, solution)
    written += jc.report(structure, solution).save(tmp_path / "t.csv")
    named = [path for path in written if "=cmd" in path.read_text()]
    assert len(named) >= 3
    for path in named:
        cells = itertools.chain(*csv.reader(io.StringIO(path.read_text())))
        assert not any(cell.startswith(("=", "@")) for cell in cells)
