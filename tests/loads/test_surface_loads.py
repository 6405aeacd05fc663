"""Loads on the faces of groups: a membrane written outside of the package, against closed forms."""

import json

import jsonschema
import numpy as np
import pytest
from extensions.own_membrane import Membranes, sheet
from numpy.testing import assert_allclose
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.common import checks

ET, NU = 1e4, 0.3
NODES, TRIANGLES = sheet(4, warp=0.06)
RIM = np.flatnonzero(((NODES[:, :2] == 0.0) | (NODES[:, :2] == 1.0)).any(axis=1))
HALF = len(TRIANGLES) // 2
FIRST, SECOND = TRIANGLES[:HALF], TRIANGLES[HALF:]


def areas(triangles, nodes=NODES):
    """Areas of triangles in the plane x, y."""
    a, b = (nodes[triangles[:, k], :2] - nodes[triangles[:, 0], :2] for k in (1, 2))
    return 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def square():
    """Two groups that are one bundle, between a rim that is held."""
    elements = {"one": Membranes(FIRST, ET, NU), "two": Membranes(SECOND, ET, NU)}
    return jc.Structure(NODES, elements, jc.pinned(RIM))


def loaded(*loads, phases=()):
    """The solution of the stretched square under loads."""
    given = [jc.Phase(prestrain=0.01), jc.Phase(loads=loads), *phases]
    return converged(jc.solve(square(), given))


PRESSURES = np.random.default_rng(1).uniform(40.0, 90.0, HALF)
FORCES = np.random.default_rng(2).uniform(-9.0, 9.0, (HALF, 3))


@pytest.mark.parametrize(
    "by_group, by_faces",
    [
        (
            [
                jc.FacePressure(pressure=PRESSURES, on="one"),
                jc.AreaLoads(forces=FORCES, on="two", geometry="begun"),
            ],
            [jc.FacePressure(FIRST, PRESSURES), jc.AreaLoads(SECOND, FORCES, geometry="begun")],
        ),
        (
            [
                jc.FacePressure(pressure=60.0),
                jc.AreaLoads(
                    forces=FORCES, per="initial", on="one", elements=jc.only([2, 7]), factor=3.0
                ),
            ],
            [
                jc.FacePressure(TRIANGLES, 60.0),
                jc.AreaLoads(FIRST[[2, 7]], 3.0 * FORCES[[2, 7]], per="initial"),
            ],
        ),
    ],
)
def test_a_load_on_a_group_is_that_on_its_faces(by_group, by_faces):
    """One value, or one for each element; all elements or some; of one group or of all."""
    found, expected = loaded(*by_group), loaded(*by_faces)
    assert np.abs(expected.displacement).max() > 1e-3
    # the order of sums differs, and the iteration ends at 1e-10 of the forces
    assert_allclose(found.load, expected.load, atol=1e-11)
    assert_allclose(found.displacement, expected.displacement, atol=1e-12)


def test_resultants_are_area_times_load():
    """Pressure on any surface over the flat rim is that on the rim's area, 1 m2, along z."""
    solution = loaded(jc.FacePressure(pressure=80.0))
    assert solution.displacement[:, 2].max() > 0.01
    assert_allclose(solution.load.sum(axis=0), [0.0, 0.0, 80.0], atol=1e-12 * 80)
    solution = loaded(jc.AreaLoads(forces=(0.0, 3.0, -7.0), on="two", per="initial"))
    assert_allclose(
        solution.load.sum(axis=0), areas(SECOND).sum() * np.array([0, 3, -7]), atol=1e-13
    )


def test_weight_of_some_elements():
    structure = jc.Structure(NODES, Membranes(TRIANGLES, ET, NU, weight=20.0), jc.pinned(RIM))
    phases = [jc.Phase(prestrain=0.01), jc.Phase(loads=jc.SelfWeight(elements=jc.only([0, 9])))]
    solution = converged(jc.solve(structure, phases))
    weight = 20.0 * areas(TRIANGLES[[0, 9]]).sum()
    assert_allclose(solution.load[:, 2].sum(), -weight, rtol=1e-13)


def test_a_load_acts_where_its_elements_are():
    """Removed elements are not loaded, and loaded again when they are back, as with line loads."""
    gone = [3, 4, 11]
    loads = [
        jc.AreaLoads(forces=np.tile([0.0, 0.0, -50.0], (HALF, 1)), on="one"),
        jc.FacePressure(pressure=30.0, on="two"),
        jc.AreaLoads(FIRST[gone], (0.0, 0.0, -1.0)),  # stated faces are always loaded
    ]
    chosen = {"one": jc.only(gone), "two": None}
    solution = loaded(*loads, phases=[jc.Phase(removes=chosen), jc.Phase(adds=chosen)])
    full = -50.0 * areas(FIRST).sum() + 30.0 * areas(SECOND).sum() - areas(FIRST[gone]).sum()
    there = solution.phases[2].present
    assert int((there["one"] == 0).sum()) == 3
    lost = 50.0 * areas(FIRST[gone]).sum()
    # pressure on half of the square has no flat rim: its resultant along z is that of the plan
    for number, more in ((1, 0.0), (2, lost), (3, 0.0)):
        places = np.asarray(solution.phases[number].positions)
        moved = 30.0 * (areas(SECOND, places).sum() - areas(SECOND).sum())
        total = float(solution.phases[number].load[:, 2].sum())
        assert total == pytest.approx(full + moved + more, abs=1e-10)


def test_loads_on_elements_that_never_come_are_told():
    structure = square()
    phases = [
        jc.Phase(prestrain=0.01, removes="one"),
        jc.Phase(loads=jc.FacePressure(pressure=PRESSURES, on="one")),
    ]
    with pytest.warns(checks.InputWarning, match=r"phases\[1\].loads: FacePressure acts on"):
        jc.solve(structure, phases)


def test_scene_files_and_their_schema_know_groups(tmp_path):
    path = tmp_path / "scene.json"
    loads = [
        jc.FacePressure(pressure=PRESSURES, on="one"),
        jc.AreaLoads(forces=(0.0, 0.0, -5.0), on="two", elements=jc.only([3])),
    ]
    jc.save_scene(path, (square(), [jc.Phase(prestrain=0.01), jc.Phase(loads=loads)]))
    scene = jc.load_scene(path)
    pressed, covered = scene.phases[1].loads
    assert (pressed.pressure == PRESSURES).all() and (pressed.on, covered.on) == ("one", "two")
    assert covered.elements.elements.array.tolist() == [3] and covered.forces[2] == -5.0
    data = json.loads(path.read_text())
    schema = jsonschema.Draft202012Validator(jc.files.scene_schema())
    schema.validate(data)
    data["phases"][1]["loads"][0]["faces"] = [[0, 1, 2]]
    with pytest.raises(jsonschema.ValidationError, match="is not of type 'null'"):
        schema.validate(data)


def eighth(n):
    """An eighth of a sphere of radius 1 in n^2 triangles; nodes on its edges stay in its planes."""
    grid = [(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]
    number = {key: k for k, key in enumerate(grid)}
    nodes = np.array(grid, float)
    nodes /= np.linalg.norm(nodes, axis=1, keepdims=True)
    faces = [
        [number[key] for key in ((i, j, k), (i, j + 1, k - 1), (i + 1, j, k - 1))]
        for i, j, k in grid
        if k > 0
    ]
    faces += [
        [number[key] for key in ((i, j, k), (i - 1, j, k + 1), (i, j - 1, k + 1))]
        for i, j, k in grid
        if i > 0 and j > 0
    ]
    faces = np.array(faces)
    a, b, c = (nodes[faces[:, m]] for m in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) < 0
    faces[inward] = faces[inward][:, ::-1]
    return nodes, faces, jc.Supports(np.array(grid) == 0)


@pytest.mark.slow
def test_a_sphere_under_pressure():
    """N = p r / 2, with E t / (1 - nu) (s^2 - 1) / 2 = p s R / 2 for the stretch s = r / R.

    The second Piola-Kirchhoff force of an equal stretch in both directions is that per present
    width. Flat triangles approach both at second order.
    """
    pressure = 3000.0
    ratio = pressure * (1 - NU) / ET
    stretch = 0.5 * (ratio + np.sqrt(ratio**2 + 4))
    errors = []
    for n in (4, 8):
        nodes, faces, supports = eighth(n)
        structure = jc.Structure(nodes, {"shell": Membranes(faces, ET, NU)}, supports)
        inflated = jc.Phase(loads=jc.FacePressure(pressure=pressure, on="shell"))
        solution = converged(jc.solve(structure, inflated))
        a, b, c = (np.asarray(solution.positions)[faces[:, k]] for k in range(3))
        volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
        force = np.asarray(solution.results["membrane_forces"]["shell"])[:, :2].mean(axis=1)
        size = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        force = np.average(force, weights=size) / (0.5 * pressure * stretch)
        errors.append([1 - volume / (np.pi / 6 * stretch**3), 1 - force])
    assert (np.array(errors[1]) < 0.03).all()
    assert_allclose(np.log2(np.divide(*errors)), 2.0, atol=0.15)


def test_what_is_no_face_is_refused(monkeypatch):
    for load, words in (
        (jc.FacePressure(pressure=np.ones(3), on="one"), r"elements\['one'\] has 16 elements"),
        (jc.AreaLoads(forces=np.ones((3, 3)), on="one"), r"forces: expected shape \(3,\) or"),
        (
            jc.AreaLoads(forces=np.ones(3), on="one", elements=jc.only([16])),
            r"elements of elements\['one'\]: elements\[0\] = 16",
        ),
    ):
        with pytest.raises(ValueError, match=words):
            load.check(square())
            load.with_group_indices(square())
    for face in ((0, 1, 3), (0, 1, 1), (0, 1), [0, 1, 2]):
        monkeypatch.setattr(Membranes, "face", face)
        with pytest.raises(ValueError, match="face: expected a tuple of 3 or 4 ends of 0 to 2"):
            square()
