"""What spreadsheets and other programs put into files: read right, or named."""

import json
import warnings

import numpy as np
import pytest

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.files import FileError, read_csv, read_network

LINKS = "first;last;axial_stiffness\n0;1;1e5\n"


def outcome(read, *paths):
    """What a reader returns, and the rows of the table of what it leaves out."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        read = read(*paths)
    return read, [row for warning in found for row in str(warning.message).splitlines()[1:]]


@pytest.mark.parametrize("mark", [";", ",", "\t", "|"])
@pytest.mark.parametrize("empty", [False, True], ids=["", "empty"])
@pytest.mark.parametrize("stated", ["", "sep={}", '"sep={}"', "SEP={}", "sep={0}{0}{0}"])
def test_tables_of_spreadsheets(tmp_path, mark, empty, stated):
    if mark == "|" and not stated:
        pytest.skip("is no separator unless it is stated")
    if mark == "|" and stated.count("{") > 1:
        pytest.skip("nobody writes that")
    rows = ["x;y;z;support", "0.5;0;0;1", "1;2;0;1"]
    links = ["first;last;axial_stiffness", "0;1;1e5"]
    if empty:
        rows = [";;;", rows[0], ";;;", rows[1], ";;;;;", '"";"";"";""', rows[2], " ; ; ; ", ";"]
        links = [*links, ";;", ";"]
    head = [stated.format(mark)] if stated else []
    for name, table in (("n.csv", rows), ("l.csv", links)):
        lines = [*head, *(row.replace(";", mark) for row in table)]
        (tmp_path / name).write_text("\r\n".join(lines) + "\r\n", newline="")
    net, told = outcome(read_csv, tmp_path / "n.csv", tmp_path / "l.csv")
    assert net.nodes.tolist() == [[0.5, 0, 0], [1, 2, 0]] and net.links.tolist() == [[0, 1]]
    assert net.fixed.all() and net.values["axial_stiffness"].tolist() == [1e5] and told == []


def test_decimal_commas_with_a_stated_separator(tmp_path):
    (tmp_path / "n.csv").write_text("sep=|\nx|y|z|support\n0,5|0|0|1\n1,25|0|0|1\n")
    (tmp_path / "l.csv").write_text(LINKS)
    net, _ = outcome(read_csv, tmp_path / "n.csv", tmp_path / "l.csv")
    assert net.nodes[:, 0].tolist() == [0.5, 1.25]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (";;;\n;;;\n", "n.csv: is empty"),
        ("sep=;\n", "n.csv: is empty"),
        ("sep=;\nx;y;z\n;;\n", "n.csv: has no rows"),
        ("sep=;\nx;y;z\n\n;;\n1;2\n", "n.csv: line 5: 2 fields, the header has 3"),
        ("sep=a\nx,y,z\n", "unknown column 'sep=a'"),
    ],
)
def test_lines_keep_their_numbers_and_nothing_is_named(tmp_path, text, said):
    (tmp_path / "n.csv").write_text(text)
    (tmp_path / "l.csv").write_text(LINKS)
    with pytest.raises(FileError, match=said):
        read_csv(tmp_path / "n.csv", tmp_path / "l.csv")


NODES = {
    "0": {"x": 0, "y": 0, "z": 0, "is_support": True},
    "1": {"x": 2, "y": 0, "z": 0},
    "2": {"x": 2, "y": 3, "z": 0, "is_support": True},
}


def network(tmp_path, first, second, **beside):
    edges = {"0": {"1": first}, "1": {"2": second}}
    data = {"data": {"node": NODES, "edge": edges}, **beside}
    (tmp_path / "net.json").write_text(json.dumps(data))
    return outcome(read_network, tmp_path / "net.json")


def test_forces_without_force_densities(tmp_path):
    """Lengths of 2 and 3 m, from the coordinates; a strut is a bar."""
    for first, second, expected, kinds in (
        ({"f": 6.0}, {"f": 3.0}, [3.0, 1.0], ("cable", "cable")),
        ({"force": 6.0}, {"f": -3.0}, [3.0, -1.0], ("cable", "bar")),
        ({"q": 5.0}, {"f": 3.0}, [5.0, 1.0], ("cable", "cable")),
        ({"q": 0.0, "f": 4.0}, {"q": None, "f": 6.0}, [2.0, 2.0], ("cable", "cable")),
        ({"q": 5.0, "f": 10.0}, {"q": 1.0, "f": 3.0, "l": 3.0}, [5.0, 1.0], ("cable", "cable")),
    ):
        net, told = network(tmp_path, first, second)
        assert net.values["force_density"].tolist() == expected
        assert net.kinds == kinds and told == []
    net, told = network(tmp_path, {"f": 6.0}, {})
    assert net.values["force_density"][0] == 3.0 and np.isnan(net.values["force_density"][1])
    net, told = network(tmp_path, {"q": 5.0, "f": 11.0}, {"f": 3.0, "force": 4.0, "l": 7.0})
    assert net.values["force_density"].tolist() == [5.0, 1.0]
    assert [row.split(":")[0].strip() for row in told] == [
        "attribute 'f' of an edge (1), edge 0-1",
        "attribute 'force' of an edge (1), edge 1-2",
        "attribute 'l' of an edge (1), edge 1-2",
    ]
    for wrong in ("much", True, [3.0]):
        with pytest.raises(FileError, match=r"edge 0-1\.f: expected a finite number"):
            network(tmp_path, {"f": wrong}, {})


def test_the_forces_of_a_file_are_those_of_the_form(tmp_path):
    """A form that is in balance, written with forces alone: the same prestress is read."""
    nodes = [[-1.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0.2, 0.1, 0]]
    links = [[0, 4], [1, 4], [2, 4], [3, 4]]
    structure = jc.Structure(nodes, jc.Cables(links, 1e5), jc.pinned([0, 1, 2, 3]))
    places = np.asarray(jc.force_density(structure, np.array([3.0, 5.0, 2.0, 4.0])))
    lengths = np.linalg.norm(places[[0, 1, 2, 3]] - places[4], axis=1)
    node = {
        str(k): dict(zip("xyz", place.tolist(), strict=True)) | {"is_support": k < 4}
        for k, place in enumerate(places)
    }
    forces = np.array([3.0, 5.0, 2.0, 4.0]) * lengths
    edge = {str(k): {"4": {"f": float(force)}} for k, force in enumerate(forces)}
    (tmp_path / "net.json").write_text(json.dumps({"data": {"node": node, "edge": edge}}))
    net, told = outcome(read_network, tmp_path / "net.json")
    solution = jc.solve(*net.scene(axial_stiffness=1e5))
    assert told == [] and float(np.abs(solution.displacement).max()) < 1e-9
    np.testing.assert_allclose(solution.tension, forces, rtol=1e-9)


def test_types_of_other_programs_are_named(tmp_path):
    ours = ("compas.datastructures/Graph", "compas_fd.x/Y", "jax_fdm.datastructures/FDNetwork", "x")
    for kind in ours:
        assert network(tmp_path, {"q": 1.0}, {"q": 1.0}, dtype=kind)[1] == []
    net, told = network(tmp_path, {"q": 1.0}, {"q": 2.0}, dtype="other.program/Thing")
    assert net.values["force_density"].tolist() == [1.0, 2.0]
    assert [row.strip() for row in told] == [
        "type other.program/Thing (1), dtype: is of another program; what has the names of compas "
        "is read as it is there"
    ]
    _, told = network(tmp_path, {"q": 1.0}, {}, **{"$schema": "https://other.org/net.json"})
    assert [row.strip() for row in told] == ["field beside the net (1), $schema"]
    for kind in ([1], {"a": 1}, 3, None):
        assert network(tmp_path, {"q": 1.0}, {"q": 1.0}, dtype=kind)[1] == []


def test_foreign_schemas_of_scenes_are_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    jc.save_scene("net.json", jc.scenes.flat_net(increments=(1, 1)))
    data = json.loads((tmp_path / "net.json").read_text())
    for schema, is_told in (
        ("scene.schema.json", False),
        ("../schemas/any.json", False),
        ("urn:jaxcable:scene:1", False),
        ("https://example.org/scene.schema.json", False),
        ("https://geojson.org/schema/FeatureCollection.json", True),
        ("https://json-schema.org/draft/2020-12/schema", True),
    ):
        (tmp_path / "a.json").write_text(json.dumps({"$schema": schema, **data}))
        scene, told = outcome(jc.load_scene, tmp_path / "a.json")
        assert scene.structure.n_node == 12 and bool(told) is is_told
        assert not told or told[0].strip().startswith(f"schema {schema} (1), $schema: is not that")
    assert main(["info", "a.json"]) == 0
    assert "left out" in capsys.readouterr().err
