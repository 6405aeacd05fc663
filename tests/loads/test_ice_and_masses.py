"""Weight of ice and of masses at nodes, and wind among phases, groups and files.

Weights are computed here by hand, wind by the closed form of members across it.
"""

import json
import re

import jax
import jsonschema
import numpy as np
import pytest
from banks.shapes import SPOKES, SQUARE, hub
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.cli import parser

CHORD = SQUARE[SPOKES[:, 1]] - SQUARE[SPOKES[:, 0]]
LENGTH = np.linalg.norm(CHORD, axis=1)
REST = LENGTH / 1.02
TAUT = jc.Phase(prestrain=0.02)
TABLE = jc.WindTable([0.0, 3.0], pressures=[300.0, 600.0])


def by_hand(amounts):
    """Force of a wind downwards, of `TABLE`, on each cable; amounts are drag times width, m."""
    wind = np.array([0.0, 0.0, -1.0])
    along = CHORD / LENGTH[:, None]
    normal = wind - (along @ wind)[:, None] * along
    mean = 300.0 + 100.0 * (SQUARE[SPOKES[:, 0], 2] + SQUARE[SPOKES[:, 1], 2]) / 2
    return (mean * LENGTH * amounts * np.linalg.norm(normal, axis=1))[:, None] * normal


def test_iced_weight_by_hand():
    """9.80665 m/s2 times 900 kg/m3 on (40^2 - 20^2) pi / 4 mm2 = 942.478 mm2: 8.318295 N/m."""
    ice = jc.IceLoads(0.01, [0.02, 0.04], on="back", elements=jc.only([0]))
    solution = converged(jc.solve(hub(), [TAUT, jc.Phase(loads=ice)]))
    load = np.asarray(solution.load)
    half = 0.5 * 8.318295 * REST[2]
    np.testing.assert_allclose(load[[2, 4], 2], -half, rtol=1e-7)  # of the digits above
    assert (load[[0, 1, 3]] == 0).all() and (load[:, :2] == 0).all()


def test_wind_in_the_geometry_where_its_phase_begins():
    nodes = [[0.0, 0, 0], [0.0, 0, 4.0]]
    structure = jc.Structure(nodes, jc.Cables([[0, 1]], 1e3), jc.pinned([0, 1]))
    moved = jc.Phase(loads=jc.SupportMovement([1], (3.0, 0.0, 0.0)))
    wind = jc.WindLoads((1.0, 0, 0), jc.WindTable(pressures=100.0), 1.0, 0.1, geometry="begun")
    solution = converged(jc.solve(structure, [moved, jc.Phase(loads=wind)]))
    # 5 m at an angle of sine 4/5, normal (4, 0, -3) / 5
    half = 0.5 * 10.0 * 5.0 * 0.64 * np.array([0.8, 0.0, -0.6])
    np.testing.assert_allclose(solution.load, [half, half], rtol=1e-12)


def test_a_batch_of_patches_is_one_program():
    patches = np.array([[1.0, 1.0], [0.0, 1.5], [1.5, 0.0]])

    def analyse(factor):
        wind = jc.WindLoads((0, 0, -1.0), TABLE, 1.0, 0.1, on="back", factor=factor)
        return jc.solve(hub(), [TAUT, jc.Phase(loads=wind)])

    batch = jax.vmap(analyse)(patches)
    assert (np.asarray(batch.status) == 0).all()
    for load, patch in zip(batch.load, patches, strict=True):
        expected = by_hand(0.1 * np.concatenate([[0, 0], patch]))
        np.testing.assert_allclose(load.sum(axis=0), expected.sum(axis=0), rtol=1e-12, atol=1e-12)
    # single factors are scaled by combinations, those of elements as well
    loads = jc.combine([jc.WindLoads((1.0, 0, 0), TABLE, 1.0, 0.1, "back", factor=[1.0, 3.0])], [2])
    assert loads[0].factor.tolist() == [2.0, 6.0]
    assert jc.combine([jc.IceLoads(0.01, 0.02)], [3.0])[0].direction.tolist() == [0, 0, -3.0]


# --- masses


def test_weights_and_accelerations_of_masses():
    masses = jc.PointMasses([4, 4], [100.0, 50.0])
    quake = jc.PointMasses([4], 150.0, direction=(0.2, 0.0, -0.1))
    solution = converged(jc.solve(hub(), [TAUT, jc.Phase(loads=masses), jc.Phase(loads=quake)]))
    np.testing.assert_allclose(solution.phases[1].load[4], [0, 0, -1470.9975], rtol=1e-14)
    np.testing.assert_allclose(solution.load[4], [294.1995, 0, -1618.09725], rtol=1e-14)
    assert (np.asarray(solution.load[:4]) == 0).all()


def test_frequencies_take_the_same_object():
    heavy = hub(weight=20.0)
    solution = jc.solve(heavy, TAUT)
    added = jc.PointMasses([4, 4], [100.0, 50.0])
    found = jc.dynamics.modes(heavy, solution, n=3, masses=added)
    by_array = np.array([0, 0, 0, 0, 150.0])
    known = jc.dynamics.modes(heavy, solution, n=3, masses=by_array)
    assert (found.squared == known.squared).all()
    # the tangent stiffness of four taut cables over the mass, with a share of theirs
    way = CHORD / LENGTH[:, None]
    force = 0.02 * 1e5
    stiffness = sum(
        1e5 / r * np.outer(e, e) + force / s * (np.eye(3) - np.outer(e, e))
        for e, r, s in zip(way, REST, LENGTH, strict=True)
    )
    own = 20.0 * REST.sum() / 9.80665 * (1 / 2 + 1 / 3) / 2  # mean of lumped and consistent
    squared = np.linalg.eigvalsh(stiffness) / (150.0 + own)
    np.testing.assert_allclose(np.sort(found.squared), squared, rtol=1e-9)
    with pytest.raises(ValueError, match=r"load nodes\[0\] = 9: the structure has nodes 0 to 4"):
        jc.dynamics.modes(heavy, solution, masses=jc.PointMasses([9], 1.0))


def test_form_finding_takes_masses():
    weights = jc.NodalLoads([4], (0.0, 0.0, -100.0 * 9.80665))
    one, other = (
        jc.force_density(hub(), 300.0, loads) for loads in (weights, jc.PointMasses([4], 100.0))
    )
    np.testing.assert_allclose(one, other, rtol=1e-14)


def test_wrong_profiles_in_files_are_refused_and_all_are_described(tmp_path, capsys):
    """That files hold them is in `tests/files`."""
    wind = jc.WindLoads((1.0, 0, 0), jc.EurocodeWind(25.0, "II"), 1.2, 0.1, on="front")
    ice = jc.IceLoads(0.02, [0.02, 0.03], on="back")
    path = tmp_path / "scene.json"
    law = jc.WindPowerLaw(20.0, 0.16)
    gust = jc.WindLoads((0, 1.0, 0), law, 1.2, 0.1, elements=jc.only([1]), on="back")
    loads = [wind, ice, jc.PointMasses([4], [120.0]), gust]
    jc.save_scene(path, (hub(), [TAUT, jc.Phase(loads=loads)]))
    data = json.loads(path.read_text())
    schema = jsonschema.Draft202012Validator(jc.files.scene_schema())
    schema.validate(data)
    parser.main(["info", str(path)])
    told = capsys.readouterr().out
    assert "WindLoads on front towards (1, 0, 0): EN 1991-1-4 of 25 m/s, terrain II, peak" in told
    assert "IceLoads on back; thickness 0.02 m, diameter 0.02 to 0.03 m, density 900 kg/m3" in told
    assert "PointMasses on 1 node, sum 120 kg" in told
    assert "power law of 20 m/s" in told and "(element 1)" in told
    profile = data["phases"][1]["loads"][0]["profile"]
    for key, value, message in (
        ("terrain", "V", "terrain = 'V': expected one of 0, I, II, III, IV"),
        ("velocity", -1.0, "velocity = -1.0: must not be negative"),
        ("type", None, '"type" is missing; it names the class of a wind profile'),
    ):
        before = profile.pop(key)
        profile |= {} if value is None else {key: value}
        path.write_text(json.dumps(data))
        with pytest.raises(jc.files.FileError, match=re.escape(message)):
            jc.load_scene(path)
        with pytest.raises(jsonschema.ValidationError):
            schema.validate(data)
        profile[key] = before
