"""Scenes and results in files: exact round trips, and files that are not what they should be."""

import io
import json
import os
import stat
import sys
import zipfile

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.common.writing import written
from jaxcable.files import FileError
from jaxcable.files.results import flat

SMALL = {  # sizes of scenes that are quick to solve
    "saddle": {"n_x": 3, "n_y": 3},
    "saddle_net": {"increments": (1, 1), "shape": (3, 3)},
    "hypar_net": {"increments": (1, 1)},
    "guyed_mast": {"levels": 1, "per_level": 2, "increments": (1, 1)},
    "strung_arch": {"n": 4, "increments": (1, 1)},
    "toggle_frame": {"n": 2},
    "lee_frame": {"n": 2},
}
SCENES = [name for name in jc.scenes.__all__ if name != "Scene"]
QUICK = ("flat_net", "von_mises_truss")


def scene_of(name):
    return jc.scenes.Scene(*getattr(jc.scenes, name)(**SMALL.get(name, {})))


def require_same(one, other):
    """Equal trees with equal leaves, bit by bit and in dtype."""
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        a, b = np.asarray(a), np.asarray(b)
        assert a.dtype == b.dtype and a.shape == b.shape
        assert a.tobytes() == b.tobytes()


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_comes_back_exactly(name, tmp_path):
    """The numbers that an analysis is a pure function of are the same, bit by bit."""
    scene = scene_of(name)
    jc.save_scene(tmp_path / "scene.json", scene)
    require_same(jc.load_scene(tmp_path / "scene.json"), scene)


@pytest.mark.parametrize(
    "name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in SCENES]
)
def test_every_scene_solves_to_the_identical_result(name, tmp_path):
    scene = scene_of(name)
    jc.save_scene(tmp_path / "scene.json", scene)
    one, other = jc.solve(*scene), jc.solve(*jc.load_scene(tmp_path / "scene.json"))
    assert int(one.status) == int(other.status)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()


def everything():
    """A scene with what the ready ones lack, in float32 too."""
    nodes = np.array([[0, 0, 0], [1, 0, 0.1], [2, 0, 0], [1, 1, 0]], np.float32)
    nodes = nodes + np.float32(1 / 3)
    steel = jc.Polygonal([-0.02, 0.0, 0.002, 0.02], [-5e8, 0.0, 4e8, 5e8], unloading="reversible")
    section = jc.Section.composite(
        [
            jc.Section.disc(0.02, steel, (3, 2)),
            jc.Section.ring(0.03, 0.004, jc.Elastic(1e9), (1, 4)),
        ]
    )
    elements = {
        "a": [
            jc.Cables([[0, 1]], area=1e-4, law=steel, strength=[1e5 * np.pi]),
            jc.Bars([[1, 2], [0, 2]], section=section, expansion=1.2e-5, weight=[1.0, 2.0]),
        ],
        "list": (jc.SlidingCables([[0, 3, 2], [1, 3]], axial_stiffness=[1e5, 2e5]),),
    }
    mask = np.zeros((4, 3), bool)
    mask[[0, 2]] = True
    mask[3, 1] = True
    structure = jc.Structure(nodes, elements, jc.Supports(mask))
    faces = [[0, 1, 3, 3], [1, 2, 3, 3]]
    phases = [
        jc.Phase(
            pretension={"a": [100.0, jc.only([1], 50.0)], "list": None},
            loads=[
                jc.SelfWeight(),
                jc.LineLoads((0, 0, -1.0), on="list", per="projected"),
                jc.AreaLoads(faces, (0, 0, -10.0)),
                jc.FacePressure(faces, [1.0, 2.0]),
            ],
        ),
        jc.Phase(
            supports=jc.pinned([0, 2]),
            loads=[],
            temperature={"a": [None, 20.0], "list": None},
            increments=3,
        ),
        jc.Phase(loads=jc.SupportMovement([2], (0.01, 0.0, 0.0))),
    ]
    return jc.scenes.Scene(structure, phases)


def test_laws_sections_groups_and_float32_come_back(tmp_path):
    scene = everything()
    jc.save_scene(tmp_path / "scene.json", scene)
    again = jc.load_scene(tmp_path / "scene.json")
    require_same(again, scene)
    assert again.structure.nodes.dtype == np.float32
    # what was read and written once more is the same text
    jc.save_scene(tmp_path / "again.json", again)
    assert (tmp_path / "again.json").read_text() == (tmp_path / "scene.json").read_text()


def test_sections_know_their_second_moments_and_axis_again(tmp_path):
    """And a file of before, without either, is read as points of area about a stated axis."""
    corners = [[0, 0], [0.1, 0], [0.1, 0.01], [0.01, 0.01], [0.01, 0.1], [0, 0.1]]
    section = jc.Section.polygon(corners, None, jc.Elastic(210e9), 0.05)
    bars = jc.Bars([[0, 1]], section=section)
    structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], bars, jc.pinned([0]))
    path = tmp_path / "scene.json"
    jc.save_scene(path, jc.scenes.Scene(structure, [jc.Phase()]))
    again = jc.load_scene(path).structure.elements.section
    assert again.placed is False and again.own.tobytes() == np.asarray(section.own).tobytes()
    old = json.loads(path.read_text())
    del old["structure"]["elements"]["section"]["own"]
    del old["structure"]["elements"]["section"]["placed"]
    path.write_text(json.dumps(old))
    again = jc.load_scene(path).structure.elements.section
    assert again.placed is True and again.own is None
    # rounding of a sum over a few fibres
    assert float(again.inertia()[0]) == pytest.approx(again.area @ again.z**2, rel=1e-14)


def test_a_frame_with_hinges_and_moments_comes_back(tmp_path):
    structure, phases = jc.scenes.lee_frame(n=2)
    hinges = np.zeros((len(structure.elements.links), 2), bool)
    hinges[0, 1] = True
    structure = jc.replace(structure, elements=jc.replace(structure.elements, hinges=hinges))
    moment = jc.NodalLoads([2], (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    scene = jc.scenes.Scene(structure, [*phases, jc.Phase(loads=moment)])
    jc.save_scene(tmp_path / "scene.json", scene)
    require_same(jc.load_scene(tmp_path / "scene.json"), scene)


def test_what_a_file_cannot_hold_is_refused(tmp_path):
    path = tmp_path / "scene.json"
    structure, phases = jc.scenes.flat_net()
    nodes = structure.nodes.copy()
    nodes[3, 1] = np.nan
    with pytest.raises(ValueError, match=r"structure.nodes\[3, 1\]: not finite"):
        jc.save_scene(path, (jc.replace(structure, nodes=nodes), phases))
    keyed = jc.replace(structure, elements={1: structure.elements})
    with pytest.raises(ValueError, match=r"structure.elements: the key 1 is no text"):
        jc.save_scene(path, (keyed, phases))
    with pytest.raises(ValueError, match="expected a Scene"):
        jc.save_scene(path, structure)
    with pytest.raises(ValueError, match=r"phases\[0\]: expected a Phase"):
        jc.save_scene(path, (structure, [None]))

    def traced(load):
        loads = jc.NodalLoads([3], load * jnp.ones(3))
        jc.save_scene(path, (structure, [jc.Phase(loads=loads)]))

    with pytest.raises(ValueError, match=r"phases\[0\].loads.forces: is being traced"):
        jax.jit(traced)(1.0)
    assert list(tmp_path.iterdir()) == []  # nothing is left of files that were not finished


def text_of(scene, tmp_path):
    jc.save_scene(tmp_path / "good.json", scene)
    return (tmp_path / "good.json").read_text()


BAD = {  # from a part of the good file to another, and what the message names
    "misspelt": ("axial_stiffness", "axial_stifness", r"structure.elements: .*did you mean"),
    "value": ("97970.0", "-97970.0", r"structure.elements: axial_stiffness\[0\] = -97970.0: must"),
    "text": ("97970.0", '"__import__"', r"structure.elements: axial_stiffness: expected numbers"),
    "type": ('"Cables"', '"os.system"', r"structure.elements: unknown type 'os.system'"),
    "node": ("[8, 11]", "[8, 12]", r"links\[11\] = \[8, 12\]: the structure has nodes 0 to 11"),
    "ragged": ("[8, 11]", "[8]", r"elements.links\[11\]: .* lists of equal lengths, .* 1 .* 2"),
    "increments": ('"increments": 10', '"increments": 9999999999', r"phases\[1\].increments: more"),
    "no number": ('"increments": 10', '"increments": "x"', r"phases\[1\]: increments = 'x'"),
    "load": ("[3, 4, 7, 8]", "[3, 4, 7, 88]", r": phases\[1\].loads\[0\]: load nodes\[3\] = 88"),
    "supports": ('"supports"', '"suports"', r"structure: .*'suports'; did you mean 'supports'"),
    "nodes": ('"nodes": [0, 1, 2, 5', '"nodes": [0.5, 1, 2, 5', r"structure.supports: .*integers"),
    "infinite": ("97970.0", "1e999", r"structure.elements.axial_stiffness: .*too large"),
    "nan": ("97970.0", "NaN", r"NaN is no number"),
    "digits": ("97970.0", "9" * 5000, r"a whole number of 5000 digits"),
    "twice": ('"phases"', '"structure"', r"the field 'structure' occurs twice"),
    "missing": ('"phases"', '"comment"', r"phases: expected a list, got nothing"),
    "unknown": ('"phases"', '"scene": 1, "phases"', r"unknown field 'scene'"),
    "format": ('"jaxcable scene"', '"other"', r'format: expected "jaxcable scene"'),
    "version": ('"version": 1', '"version": 7', r"version: 7 is newer than 1"),
    "no version": ('"version": 1,', "", r"version: expected a whole number, got nothing"),
    "comma": ('"version": 1,', '"version": 1', r"line 4, column 2: no JSON"),
    "phase": ('"pretension": 200.0', '"pretention": 200.0', r"phases\[0\]: .*'pretension'"),
    "negative": (
        '"pretension": 200.0',
        '"pretension": -200.0',
        r": phases\[0\].pretension\[0\] = -200",
    ),
    "kind": ('"supports": {', '"supports": {"type": "Phase", ', r"supports: expected a Supports"),
    "phase list": (
        '"pretension": 200.0',
        '"type": "list", "items": []',
        r"phases\[0\]: expected a Ph",
    ),
    "phase float": (
        '"phases": [',
        '"phases": [{"type": "float32", "values": [1]},',
        r"phases\[0\]: exp",
    ),
    "single": ("97970.0", '{"type": "float32", "values": 1e300}', r"too large for float32"),
    "single fields": ("97970.0", '{"type": "float32"}', r'float32 has the fields "type" and "val'),
    "no links": ('"links"', '"area": 1.0, "law"', r"structure.elements: links: missing"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_names_the_line_or_the_field(name, tmp_path):
    old, new, message = BAD[name]
    text = text_of(jc.scenes.flat_net(load=15.0), tmp_path)
    assert text.count(old) >= 1
    (tmp_path / "bad.json").write_text(text.replace(old, new, 1))
    with pytest.raises(FileError, match=message) as caught:
        jc.load_scene(tmp_path / "bad.json")
    assert str(caught.value).startswith(str(tmp_path / "bad.json"))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "no JSON object"),
        (b"[1, 2]", "no JSON object"),
        (b'{"format": "jaxcable scene", "a": ' + b"[" * 100_000, "nested too deeply"),
        (
            b'{"format": "jaxcable scene", "a": ' + b'{"b": ' * 100_000 + b"1" + b"}" * 100_001,
            "nested too deeply",
        ),
        (  # Python 3.13 reads this depth, and what is wrong then is that the version is missing
            b'{"format": "jaxcable scene", "a": ' + b'{"b": ' * 5000 + b"1" + b"}" * 5001,
            "nested too deeply" if sys.version_info < (3, 13) else "version: expected a whole",
        ),
        (b"\x00\x01\x02", "binary data"),
        (b'{\n"a": "\xff"}', "line 2: no UTF-8"),
    ],
)
def test_nonsense_fails_fast(content, message, tmp_path):
    (tmp_path / "bad.json").write_bytes(content)
    with pytest.raises(FileError, match=message):
        jc.load_scene(tmp_path / "bad.json")


def test_files_beyond_the_limit_are_not_read(tmp_path):
    text = text_of(jc.scenes.flat_net(), tmp_path)
    with pytest.raises(FileError, match="larger than 0 MB"):
        jc.load_scene(tmp_path / "good.json", largest=len(text) - 1)
    assert jc.load_scene(tmp_path / "good.json", largest=len(text)).structure.n_node == 12
    with pytest.raises(FileError, match="larger than 1 MB"):  # a device has no end
        jc.load_scene("/dev/zero", largest=1e6)
    with pytest.raises(OSError):
        jc.load_scene(tmp_path / "nothing.json")


def test_a_file_is_there_as_a_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), written(path) as stream:
        stream.write("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old" and len(list(tmp_path.iterdir())) == 1
    with written(path) as stream:
        stream.write("new")
    assert path.read_text() == "new"
    umask = os.umask(0)
    os.umask(umask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~umask


def test_files_written_by_hand_may_be_short(tmp_path):
    """Whole numbers for floats, one load without a list, a comment, groups by name."""
    text = """{"format": "jaxcable scene", "version": 1, "comment": "by hand",
        "structure": {
            "nodes": [[0, 0, 0], [1, 0, 0], [2, 0, 0]],
            "elements": {"net": {"type": "Cables", "links": [[0, 1], [1, 2]],
                         "axial_stiffness": 100000}},
            "supports": {"nodes": [0, 2]}},
        "phases": [{"pretension": 200}, {"loads": {"type": "NodalLoads", "nodes": [1],
            "forces": [0, 0, -10]}}, {"loads": []}]}"""
    (tmp_path / "hand.json").write_text(text)
    structure, phases = jc.load_scene(tmp_path / "hand.json")
    assert structure.nodes.dtype == np.float64 and list(structure.elements) == ["net"]
    assert phases[0].pretension == 200 and phases[2].loads == []


BEAM = """{"format": "jaxcable scene", "version": 1, "structure": {
    "nodes": [[0, 0, 0], [1, 0, 0], [2, 0, 0]],
    "elements": {"type": "Beams", "links": [[0, 1], [1, 2]], "points": 3, "torsional_stiffness": 1,
        "section": {"y": [0, 1], "z": [0, 1], "area": [1, 1],
            "laws": [{"type": "Elastic", "E": 1}]}},
    "supports": {"clamps": [0]}}, "phases": [{"loads": {"type": "NodalLoads", "nodes": [2, 1],
    "forces": [0, 0, -1]}}]}"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"points": 3', '"points": 1000000000', "points = 1000000000: .* integer from 3 to 1000"),
        ('"points": 3', '"points": 1e9', "points = 1000000000.0: expected an integer from 3"),
        ('"points": 3', '"points": true', "points = True: expected an integer from 3"),
        ('"nodes": [2, 1]', '"nodes": [2, true]', "nodes: expected numbers, got true or false"),
        ('"nodes": [2, 1]', '"nodes": true', "load nodes: expected integers, got bool"),
        ("[[0, 1], [1, 2]]", "[[0, 1], [true, 2]]", "links: expected numbers, got true or false"),
        ("[[0, 0, 0], ", "[[0, false, 0], ", "nodes: expected numbers, got true or false"),
    ],
)
@pytest.mark.filterwarnings("ignore::jaxcable.InputWarning")
def test_what_python_would_take_for_a_number_is_refused(old, new, message, tmp_path):
    (tmp_path / "good.json").write_text(BEAM)
    assert jc.load_scene(tmp_path / "good.json").structure.n_node == 3
    assert old in BEAM
    (tmp_path / "bad.json").write_text(BEAM.replace(old, new, 1))
    with pytest.raises(FileError, match=message) as caught:
        jc.load_scene(tmp_path / "bad.json")
    assert len(str(caught.value).splitlines()) == 1


# --- results


@pytest.fixture(scope="module")
def solved():
    structure, phases = jc.scenes.flat_net(load=15.0)
    structure = jc.replace(structure, elements={"net": structure.elements})
    solution = jc.solve(structure, phases)
    assert int(solution.status) == 0
    return structure, phases, solution


@pytest.mark.parametrize("suffix", [".npz", ".json"])
def test_results_come_back_exactly(suffix, solved, tmp_path):
    structure, phases, solution = solved
    failed = jc.solve(structure, phases, jc.Newton(max_steps=1))
    assert int(failed.status) == 1
    for result in (solution, failed):
        (path,) = jc.files.save_result(tmp_path / f"r{suffix}", structure, result)
        read, meant = jc.files.load_result(path), flat(structure, result)
        assert read.keys() == meant.keys()
        for name, value in meant.items():
            assert read[name].shape == value.shape
            assert np.issubdtype(read[name].dtype, np.integer) == np.issubdtype(
                value.dtype, np.integer
            )
            np.testing.assert_array_equal(read[name], value)
    assert np.isnan(read["tension.net"]).all() and np.isfinite(read["last.tension.net"]).all()


def test_arrays_of_objects_are_never_unpickled(tmp_path):
    path = tmp_path / "evil.npz"
    np.savez(path, tension=np.array([{"a": 1}], dtype=object))
    with pytest.raises(FileError, match="no result in NPZ"):
        jc.files.load_result(path)
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(FileError, match="no result in NPZ"):
        jc.files.load_result(tmp_path / "text.npz")
    np.savez_compressed(path, tension=np.zeros(100_000))
    with pytest.raises(FileError, match="unpacks to 1 MB"):
        jc.files.load_result(path, largest=500_000)
    (tmp_path / "r.json").write_text('{"format": "jaxcable result", "tension": ["x"]}')
    with pytest.raises(FileError, match="could not convert"):
        jc.files.load_result(tmp_path / "r.json")
    (tmp_path / "r.json").write_text('{"format": "jaxcable result", "phase": 1, "lastx": 2.5}')
    assert jc.files.load_result(tmp_path / "r.json")["lastx"] == 2.5
    (tmp_path / "r.json").write_text('{"format": "jaxcable scene"}')
    with pytest.raises(FileError, match="format: expected"):
        jc.files.load_result(tmp_path / "r.json")


def test_tables_have_units_and_all_digits(solved, tmp_path):
    structure, _, solution = solved
    paths = jc.files.save_result(tmp_path / "net.csv", structure, solution)
    assert [p.name for p in paths] == ["net-nodes.csv", "net-elements.csv", "net-increments.csv"]
    nodes, elements, increments = ([r.split(",") for r in p.read_text().split("\n")] for p in paths)
    assert nodes[0][:3] == ["node", "support", "x (m)"] and "reaction z (N)" in nodes[0]
    assert [row[1] for row in nodes[1:5]] == ["xyz", "xyz", "xyz", ""]
    assert float(nodes[4][7]) == float(solution.displacement[3, 2])
    assert elements[0][4:] == ["tension (N)", "unstressed length (m)", "peak tension (N)"]
    assert [float(row[4]) for row in elements[1:-1]] == solution.tension["net"].tolist()
    assert len(increments) == 13 and increments[1][:3] == ["1", "1", "1.0"]
    with pytest.raises(ValueError, match=r"ends with .npz, .json or .csv"):
        jc.files.save_result(tmp_path / "net.xls", structure, solution)
    batch = jax.tree.map(lambda x: np.stack([x, x]), solution)
    with pytest.raises(ValueError, match="is a batch"):
        jc.files.save_result(tmp_path / "net.csv", structure, batch)
    (path,) = jc.files.save_result(tmp_path / "batch.npz", structure, batch)
    assert jc.files.load_result(path)["tension.net"].shape == (2, 12)


def test_mutated_archives_are_refused_or_read(solved, tmp_path):
    """A byte changed anywhere: an array that is read, or a FileError, and nothing else."""
    structure, _, solution = solved
    (path,) = jc.files.save_result(tmp_path / "r.npz", structure, solution)
    content, random = path.read_bytes(), np.random.default_rng(0)
    refused = 0
    for _ in range(300):
        mutated = bytearray(content)
        mutated[random.integers(len(mutated))] = random.integers(256)
        path.write_bytes(mutated)
        try:
            jc.files.load_result(path)
        except FileError:
            refused += 1
    assert refused > 100
    with zipfile.ZipFile(path, "w") as archive:
        head = io.BytesIO()
        np.lib.format.write_array_header_1_0(
            head, {"descr": "<f8", "fortran_order": False, "shape": (10**11,)}
        )
        archive.writestr("tension.npy", head.getvalue())
    with pytest.raises(FileError, match="unpacks to 800000 MB"):
        jc.files.load_result(path)


def test_mutated_scenes_are_refused_or_read(tmp_path):
    """Random bytes of a valid file changed: a scene, or a FileError, and nothing else."""
    text = text_of(jc.scenes.tent_edge(n=4), tmp_path)
    random = np.random.default_rng(1)
    alphabet = list('0123456789.-eE"[]{},:abtfn ')
    refused = loaded = 0
    for _ in range(300):
        mutated = list(text)
        for _ in range(random.integers(1, 4)):
            mutated[random.integers(len(mutated))] = alphabet[random.integers(len(alphabet))]
        (tmp_path / "bad.json").write_text("".join(mutated))
        try:
            jc.load_scene(tmp_path / "bad.json")
            loaded += 1
        except FileError:
            refused += 1
    assert refused > 100 and loaded > 5


def test_written_files_respect_links_and_kinds(tmp_path):
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to(tmp_path / "real.txt")
    with written(tmp_path / "link.txt") as stream:
        stream.write("new")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "real.txt").read_text() == "new"
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="Is not a regular file"), written(tmp_path / "pipe"):
        pass


def test_groups_that_would_be_called_alike_are_refused(tmp_path):
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]
    one, other = (jc.Cables([pair], 1e5) for pair in ((0, 1), (1, 2)))
    structure = jc.Structure(nodes, {"a": [one], "a.0": other}, jc.pinned([0, 2]))
    solution = jc.solve(structure, jc.Phase(pretension=10.0))
    assert int(solution.status) == 0
    with pytest.raises(ValueError, match="two groups would be called alike"):
        jc.files.save_result(tmp_path / "r.npz", structure, solution)


def test_a_group_may_have_any_name(tmp_path):
    structure, phases = jc.scenes.flat_net()
    named = jc.replace(structure, elements={"float32": structure.elements})
    scene = jc.scenes.Scene(named, [jc.Phase(pretension={"float32": 100.0}), phases[1]])
    jc.save_scene(tmp_path / "scene.json", scene)
    require_same(jc.load_scene(tmp_path / "scene.json"), scene)


def test_json_of_a_result_is_standard(solved, tmp_path):
    structure, phases, _ = solved
    failed = jc.solve(structure, phases, jc.Newton(max_steps=1))
    jc.files.save_result(tmp_path / "r.json", structure, failed)
    data = json.loads((tmp_path / "r.json").read_text(), parse_constant=pytest.fail)
    assert data["tension.net"] == [None] * 12 and data["status"] == 1
    assert data["description"] == jc.describe(1)
