"""Names that the command line makes of another name: nobody's file is replaced, none twice."""

from pathlib import Path

import pytest
import scenes
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.cli import file_names, main
from jaxcable.files.results import result_tables


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a scene, in which commands run; an analysis would raise."""
    monkeypatch.chdir(tmp_path)
    jc.save_scene("net.json", jc.scenes.flat_net(increments=(1, 1)))

    def analysed(*_, **__):
        raise AssertionError("was computed")

    monkeypatch.setattr("jaxcable.analysis.solver.solve", analysed)
    return tmp_path


def refused(words, capsys):
    """The line of a command that refuses its words."""
    assert main(words) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line


@pytest.mark.parametrize(
    ("option", "name", "content"),
    [
        ("--save", "net-nodes.csv", "x,y,z\n0,0,0\n"),
        ("--save", "net-nodes.csv", "node,support,x,y,z\n0,xyz,0,0,0\n"),  # columns of read_csv
        ("--save", "net-elements.csv", "group,element,first,last,axial_stiffness\nnet,0,0,1,1e5\n"),
        ("--save", "net-increments.csv", ""),
        ("--report", "net-summary.csv", "of,notes\nme,my thoughts\n"),
        ("--report", "net-reactions.csv", "node,Rx,Ry\n0,1,2\n"),
        ("--report", "net-slack.csv", "group,element,in,why\n"),
        ("--report", "net-energy.csv", b"\xff\xfe\x00"),
    ],
)
def test_tables_replace_no_file_that_others_have_written(folder, capsys, option, name, content):
    data = content if isinstance(content, bytes) else content.encode()
    (folder / name).write_bytes(data)
    line = refused(["solve", "net.json", option, "net.csv"], capsys)
    assert line == (
        f"jaxcable: {name}: exists and was not written by jaxcable; net.csv would replace it: give "
        "another name"
    )
    assert (folder / name).read_bytes() == data
    assert sorted(path.name for path in folder.iterdir()) == [name, "net.json"]


def test_tables_do_not_replace_the_scene(folder, capsys):
    before = Path("net.json").read_bytes()
    Path("a-nodes.csv").symlink_to("net.json")
    Path("b-slack.csv").hardlink_to("net.json")
    for option, name in (("--save", "a.csv"), ("--report", "b.csv")):
        refused(["solve", "net.json", option, name], capsys)
    Path("c-nodes.csv").write_bytes(before)  # a scene under the name of a table
    line = refused(["solve", "c-nodes.csv", "--save", "c.csv"], capsys)
    assert line.startswith("jaxcable: c-nodes.csv: ")
    assert Path("net.json").read_bytes() == before == Path("c-nodes.csv").read_bytes()


def test_two_files_of_a_call_have_two_names(folder, capsys):
    for words, name in (
        (["--save", "a.csv", "--save", "./a.csv"], "a-nodes.csv"),
        (["--save", "a.csv", "--save", "a.CSV"], "a-nodes.csv"),
        (["--save", "a.json", "--report", "a.json"], "a.json"),
    ):
        line = refused(["solve", "net.json", *words], capsys)
        assert line == f"jaxcable: {name}: two outputs of this command have this name"
    Path("a.vtk").write_text("old", encoding="utf-8")
    Path("b.vtk").hardlink_to("a.vtk")
    line = refused(["solve", "net.json", "--save", "a.vtk", "--save", "b.vtk"], capsys)
    assert line == "jaxcable: b.vtk: two outputs of this command have this name"


def test_a_path_without_a_name_has_no_picture_beside_it(folder, capsys):
    for command in ("plot", "view"):
        for path, named in ((".", "."), ("", "scene"), ("/", "/")):
            line = refused([command, path], capsys)
            assert line == f"jaxcable: {named}: is not the name of a file"


def test_pictures_pages_and_schemas_that_nobody_has_named_are_known_by_their_marks(folder, capsys):
    """Files of others may well speak of this program."""
    notes = b"\x89PNG made of a result of jaxcable, <html><h1>What I know of jaxcable</h1>"
    for words, name, option in (
        (["view", "net.json"], "net.html", "--save"),
        (["plot", "net.json"], "net.png", "--save"),
        (["demo"], "hypar_net.png", "--plot"),
    ):
        Path(name).write_bytes(notes)
        line = refused(words, capsys)
        assert line == (
            f"jaxcable: {name}: exists and was not written by jaxcable; {option} names another file"
        )
        assert Path(name).read_bytes() == notes
    scene = Path("net.json").read_bytes()
    Path("scene.schema.json").write_bytes(scene)  # no schema, whatever it is called
    assert main(["new", "mast", "--force"]) == 0
    assert Path("scene.schema.json").read_bytes() == scene


@pytest.mark.slow
def test_tables_of_this_program_are_known_and_replaced(tmp_path, monkeypatch, capsys):
    """As they are written, for cables and for beams; the same command may run again."""
    monkeypatch.chdir(tmp_path)
    scene = scenes.strung_arch()
    assert {type(group) for group in scene.structure.groups} == {jc.Beams, jc.Cables}
    jc.save_scene("arch.json", scene)
    words = ["solve", "arch.json", "--report", "arch.csv", "--save", "arch.CSV", "--quiet"]

    def written():
        assert main(words) == 0
        return {path: path.read_bytes() for path in Path().glob("arch-*.csv")}

    first = written()
    assert {Path(f"arch-{name}.csv") for name in ("nodes", "members", "summary")} <= first.keys()
    kinds = file_names.REPORT, file_names.RESULT
    looked_for = [name for kind in kinds for name in file_names.files_to_write("arch.csv", kind)]
    assert first.keys() <= set(map(Path, looked_for))
    for path in first:  # what a user may have left of it
        path.write_text(path.read_text().splitlines()[0] + "\n")
    assert written() == first
    tables = result_tables(scene.structure, converged(jc.solve(*scene)))
    assert set(file_names.RESULT) == set(tables) and capsys.readouterr().err == ""


def test_suffixes_may_be_in_capitals(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    jc.save_scene("net.json", jc.scenes.flat_net(increments=(1, 1)))
    names = ["R.JSON", "R.NPZ", "R.VTK", "R.PY", "R.DXF"]
    saves = [word for name in names for word in ("--save", name)]
    words = ["solve", "net.json", *saves, "--report", "R.TXT", "--plot", "R.PNG", "--quiet"]
    assert main(words) == 0
    found = {path.name for path in tmp_path.iterdir()}
    assert found == {*names, "R.TXT", "R.PNG", "net.json"}
    for name in ("R.JSON", "R.NPZ"):
        assert "tension" in jc.files.load_result(name)
