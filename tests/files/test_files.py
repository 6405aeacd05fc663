"""Scenes and results in files: exact round trips, and archives that are not what they should be."""

import io
import json
import os
import stat
import zipfile

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import pieces
from extensions.own_elements import GroundSprings
from file_cases import CHECK, MAST, SCENES, changed, read_scene, require_same, scene_of
from oracles.convergence import converged
from oracles.traced import traced

import jaxcable as jc
from jaxcable.common.tree import pytree
from jaxcable.common.writing import atomic_write
from jaxcable.files import FileError, codec
from jaxcable.files.results import flatten_result


@pytest.mark.slow_cases("everything")
@pytest.mark.parametrize("name", SCENES)
def test_every_scene_comes_back_exactly(name, tmp_path):
    """The numbers that an analysis is a pure function of are the same, bit by bit.

    The schema takes the file, and what was read and written once more is the same text.
    """
    scene = scene_of(name)
    paths = [tmp_path / "scene.json", tmp_path / "again.json"]
    jc.save_scene(paths[0], scene)
    CHECK.validate(json.loads(paths[0].read_text()))
    again = jc.load_scene(paths[0])
    require_same(again, scene)
    single = name == "everything"
    assert again.structure.nodes.dtype == (np.float32 if single else np.float64)
    jc.save_scene(paths[1], again)
    assert paths[0].read_text() == paths[1].read_text()


def test_every_scene_solves_to_the_identical_result(solved, tmp_path):
    """One of them: of the others the test before shows that the same goes into the analysis."""
    structure, phases, solution = solved
    jc.save_scene(tmp_path / "scene.json", (structure, phases))
    again = jc.solve(*jc.load_scene(tmp_path / "scene.json"))
    assert int(solution.status) == int(again.status) == 0
    for a, b in zip(jax.tree.leaves(solution), jax.tree.leaves(again), strict=True):
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()


@pytest.mark.slow
def test_arrays_of_own_elements_come_back_with_all_rows(tmp_path):
    """Two springs alike: their constructor takes [n_elem, 3] only."""
    springs = GroundSprings([[1], [2]], [[3.0, 2.0, 5.0]] * 2)
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e3)
    structure = jc.Structure(np.eye(3), {"net": cables, "ground": springs}, jc.pinned([0]))
    path = tmp_path / "own.json"
    jc.save_scene(path, (structure, [jc.Phase(pretension={"net": 10.0})]))
    read, phases = jc.load_scene(path)
    np.testing.assert_array_equal(read.elements["ground"].stiffness, springs.stiffness)
    assert jc.solve(read, phases).status == jc.status.OK


def test_what_is_registered():
    """A class that is defined again, as by a cell of a notebook; no dataclass, no second class."""

    def defined():
        @pytree
        class Own:
            number: object

        return Own

    first, again = jc.files.register(defined()), jc.files.register(defined())
    assert first is not again and codec.TYPES["Own"] is again
    with pytest.raises(ValueError, match="Plain: is not a dataclass"):
        jc.files.register(type("Plain", (), {}))
    with pytest.raises(ValueError, match="Cables: another class has this name in files"):
        jc.files.register(pytree(type("Cables", (), {})))
    del codec.TYPES["Own"]


def test_an_editor_may_name_its_schema(tmp_path):
    """Which is not read."""
    data = {**MAST, "$schema": "scene.schema.json"}
    CHECK.validate(data)
    require_same(read_scene(data, tmp_path), read_scene(MAST, tmp_path))


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
    for name in ("own", "placed"):
        del old["structure"]["elements"]["section"][name]
    again = read_scene(old, tmp_path).structure.elements.section
    assert again.placed is True and again.own is None
    # rounding of a sum over a few fibres
    assert float(again.inertia()[0]) == pytest.approx(again.area @ again.z**2, rel=1e-14)


def test_sections_by_numbers_and_shear_stiffnesses_come_back(tmp_path):
    by_numbers = jc.Section.linear(1e8, 2e5, 1e5, 1e4, GAz=3e7, EIyz=1e4).shifted(z=0.1)
    fibres = jc.Section.rectangle(0.1, 0.2, jc.Elastic(1e9), (2, 2)).with_shear(GAy=1e6)
    nodes, links = pieces(2, 2.0)
    elements = [jc.Beams(links[k : k + 1], s) for k, s in enumerate((by_numbers, fibres))]
    path = tmp_path / "scene.json"
    structure = jc.Structure(nodes, elements, jc.clamped([0]))
    jc.save_scene(path, jc.scenes.Scene(structure, [jc.Phase()]))
    CHECK.validate(json.loads(path.read_text()))
    again = [group.section for group in jc.load_scene(path).structure.elements]
    require_same(again, [by_numbers, fibres])
    assert [type(section).__name__ for section in again] == ["LinearSection", "Section"]


def test_files_written_by_hand_may_be_short(tmp_path):
    """Whole numbers for floats, a group and a load without a list, a comment."""
    guys = MAST["structure"]["elements"]["guys"]
    load = {"type": "NodalLoads", "nodes": [1], "forces": [0, 0, -10]}
    structure, phases = read_scene(
        changed(
            {**MAST, "comment": "by hand"},
            (("structure", "elements"), {**guys, "axial_stiffness": 100000}),
            (("structure", "supports"), {"nodes": [0, 2, 3, 4]}),
            (("phases",), [{"pretension": 200}, {"loads": load}, {"loads": []}]),
        ),
        tmp_path,
    )
    assert structure.nodes.dtype == np.float64 and phases[0].pretension == 200
    assert structure.elements.axial_stiffness.dtype == np.float64
    assert phases[1].loads.nodes.array.tolist() == [1] and phases[2].loads == []


def test_what_a_file_cannot_hold_is_refused(tmp_path):
    path = tmp_path / "scene.json"
    structure, phases = jc.scenes.flat_net()
    nodes = structure.nodes.copy()
    nodes[3, 1] = np.nan
    keyed = jc.replace(structure, elements={1: structure.elements})
    for scene, message in (
        ((jc.replace(structure, nodes=nodes), phases), r"structure.nodes\[3, 1\]: is not finite"),
        ((keyed, phases), r"structure.elements: the key 1 is not a text"),
        (structure, "expected a Scene"),
        ((structure, [None]), r"phases\[0\]: expected a Phase"),
    ):
        with pytest.raises(ValueError, match=message):
            jc.save_scene(path, scene)

    def inside(load):
        loads = jc.NodalLoads([3], load * jnp.ones(3))
        jc.save_scene(path, (structure, [jc.Phase(loads=loads)]))

    with pytest.raises(ValueError, match=r"phases\[0\].loads.forces: is being traced"):
        traced(inside)(1.0)
    assert list(tmp_path.iterdir()) == []  # nothing is left of files that were not finished


def test_a_file_is_there_as_a_whole_or_not_at_all(tmp_path):
    path, link = tmp_path / "a.txt", tmp_path / "link.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), atomic_write(path) as stream:
        stream.write("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old" and len(list(tmp_path.iterdir())) == 1
    link.symlink_to(path)
    with atomic_write(link) as stream:
        stream.write("new")
    assert path.read_text() == "new" and link.is_symlink()
    umask = os.umask(0)
    os.umask(umask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~umask
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="Is not a regular file"), atomic_write(tmp_path / "pipe"):
        pass


# --- results


@pytest.fixture(scope="module")
def solved():
    structure, phases = jc.scenes.flat_net(load=15.0)
    structure = jc.replace(structure, elements={"net": structure.elements})
    return structure, phases, converged(jc.solve(structure, phases))


@pytest.fixture(scope="module")
def failed(solved):
    structure, phases, _ = solved
    solution = jc.solve(structure, phases, jc.Newton(max_steps=1))
    assert int(solution.status) == 1
    return solution


@pytest.mark.parametrize("suffix", [".npz", ".json"])
def test_results_come_back_exactly(suffix, solved, failed, tmp_path):
    structure, _, solution = solved
    for result in (solution, failed):
        (path,) = jc.files.save_result(tmp_path / f"r{suffix}", structure, result)
        read, meant = jc.files.load_result(path), flatten_result(structure, result)
        assert read.keys() == meant.keys()
        for name, value in meant.items():
            assert read[name].shape == value.shape
            whole = [np.issubdtype(of.dtype, np.integer) for of in (read[name], value)]
            assert whole[0] == whole[1]
            np.testing.assert_array_equal(read[name], value)
    assert np.isnan(read["tension.net"]).all() and np.isfinite(read["last.tension.net"]).all()
    if suffix == ".json":  # standard JSON, without NaN
        data = json.loads(path.read_text(), parse_constant=pytest.fail)
        assert data["tension.net"] == [None] * 12 and data["status"] == 1
        assert data["description"] == jc.describe(1)


def test_arrays_of_objects_are_never_unpickled(tmp_path):
    path, data = tmp_path / "evil.npz", tmp_path / "r.json"
    np.savez(path, tension=np.array([{"a": 1}], dtype=object))
    with pytest.raises(FileError, match="not an NPZ file of a result"):
        jc.files.load_result(path)
    path.write_text("no archive")
    with pytest.raises(FileError, match="not an NPZ file of a result"):
        jc.files.load_result(path)
    np.savez_compressed(path, tension=np.zeros(100_000))
    with pytest.raises(FileError, match=r"unpacks to 0\.8 MB, and the limit is 0\.5"):
        jc.files.load_result(path, largest=500_000)
    with zipfile.ZipFile(path, "w") as archive:
        head = io.BytesIO()
        shape = {"descr": "<f8", "fortran_order": False, "shape": (10**11,)}
        np.lib.format.write_array_header_1_0(head, shape)
        archive.writestr("tension.npy", head.getvalue())
    with pytest.raises(FileError, match=r"unpacks to 8e\+05 MB"):
        jc.files.load_result(path)
    data.write_text('{"format": "jaxcable result", "tension": ["x"]}')
    with pytest.raises(FileError, match="could not convert"):
        jc.files.load_result(data)
    data.write_text('{"format": "jaxcable result", "phase": 1, "lastx": 2.5}')
    assert jc.files.load_result(data)["lastx"] == 2.5
    data.write_text('{"format": "jaxcable scene"}')
    with pytest.raises(FileError, match="format: expected"):
        jc.files.load_result(data)


@pytest.mark.slow
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


def test_tables_have_units_and_all_digits(solved, tmp_path):
    structure, _, solution = solved
    paths = jc.files.save_result(tmp_path / "net.csv", structure, solution)
    assert [p.name for p in paths] == ["net-nodes.csv", "net-elements.csv", "net-increments.csv"]
    nodes, elements, increments = ([r.split(",") for r in p.read_text().split("\n")] for p in paths)
    names = [f"{word} {axis}" for word in ("displacement", "load", "reaction") for axis in "xyz"]
    assert nodes[0][:5] == ["node", "support", "x (m)", "y (m)", "z (m)"]
    assert [name.split(" (")[0] for name in nodes[0][5:]] == names
    assert [name.split(" (")[1] for name in nodes[0][5:]] == ["m)"] * 3 + ["N)"] * 6
    assert [row[1] for row in nodes[1:5]] == ["xyz", "xyz", "xyz", ""]
    arrays = solution.positions, solution.displacement, solution.load, solution.reactions
    found = np.array([row[2:] for row in nodes[1:-1]], float)
    np.testing.assert_array_equal(found, np.hstack(arrays))
    assert elements[0][4:] == [
        "tension (N)",
        "unstressed length at present temperature (m)",
        "peak tension (N)",
    ]
    assert [float(row[4]) for row in elements[1:-1]] == solution.tension["net"].tolist()
    assert len(increments) == 13 and increments[1][:3] == ["1", "1", "1.0"]


@pytest.mark.slow
def test_batches_other_suffixes_and_names_alike(solved, tmp_path):
    structure, _, solution = solved
    with pytest.raises(ValueError, match=r"ends with .npz, .json or .csv"):
        jc.files.save_result(tmp_path / "net.xls", structure, solution)
    batch = jax.tree.map(lambda x: np.stack([x, x]), solution)
    with pytest.raises(ValueError, match="is a batch"):
        jc.files.save_result(tmp_path / "net.csv", structure, batch)
    (path,) = jc.files.save_result(tmp_path / "batch.npz", structure, batch)
    assert jc.files.load_result(path)["tension.net"].shape == (2, 12)
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]
    one, other = (jc.Cables([pair], 1e5) for pair in ((0, 1), (1, 2)))
    alike = jc.Structure(nodes, {"a": [one], "a.0": other}, jc.pinned([0, 2]))
    solution = converged(jc.solve(alike, jc.Phase(pretension=10.0)))
    with pytest.raises(ValueError, match="two groups would have the same name"):
        jc.files.save_result(tmp_path / "r.npz", alike, solution)


def test_what_is_written_can_be_read(tmp_path):
    """Phases and actions that no analysis takes are refused when they are written, with the place.

    Moments on a beam with a hinge about one axis only: a file with them could not be loaded.
    """
    section = jc.Section.linear(EA=1e9, EIy=1e6, EIz=1e6, GJ=1e6)
    nodes, ends = [[0, 0, 0], [4.0, 0, 0]], jc.clamped([0, 1])
    beams = jc.Beams([[0, 1]], section=section, hinges=[[False, True]], springs=1e6)
    scene = jc.Structure(nodes, beams, ends), [jc.Phase()]
    load = jc.PointLoads([0], 0.5, (0.0, 0, -1e3), (0.0, 1e3, 0))
    path = tmp_path / "beam.json"
    with pytest.raises(ValueError, match=r"phases\[0\].*moments"):
        jc.save_scene(path, (scene[0], [jc.Phase(loads=load)]))
    with pytest.raises(ValueError, match=r"actions\[0\].*moments"):
        jc.save_scene(path, scene, actions=[jc.design.Action("a", "permanent", load)])
    assert not path.exists()


def test_names_of_phases_come_back(tmp_path):
    """From a dict, in other units, in a changed scene; wrong ones are refused."""
    structure, phases = jc.scenes.flat_net(load=15.0)
    path = tmp_path / "net.json"
    named = dict(zip(("prestress", "=snow"), phases, strict=True))
    for units in (None, "kN, m"):
        jc.save_scene(path, (structure, named), units=units)
        scene = jc.load_scene(path)
        assert scene.phase_names == ("prestress", "=snow") and len(scene.phases) == 2
        jc.save_scene(path, scene._replace(phases=scene.phases))
        assert jc.load_scene(path).phase_names == ("prestress", "=snow")
    assert scene.with_actions([]).with_units(None).phase_names == ("prestress", "=snow")
    with pytest.raises(ValueError, match="phase_names: 1 names for 2 phases"):
        jc.save_scene(path, scene.with_phase_names(["a"]))
    text = path.read_text()
    for wrong in ('"name": "prestress"', '"name": 3', '"name": ""'):
        path.write_text(text.replace('"name": "=snow"', wrong))
        with pytest.raises(ValueError, match=r"phases\[1\]: name = .*: expected a text"):
            jc.load_scene(path)
    path.write_text(text.replace('"name": "=snow",', ""))
    assert jc.load_scene(path).phase_names == ("prestress", "phase 2")
    jc.save_scene(path, (structure, phases))
    assert jc.load_scene(path).phase_names is None and "name" not in path.read_text()
