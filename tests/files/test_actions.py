"""Actions in scene files: what is written is read back, in any units, and what cannot act is
refused."""

import json

import jax
import numpy as np
import pytest
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.common.tree import Indices
from jaxcable.files import FileError

Action = jc.design.Action
NODES = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [6.0, 0.0, 0.0]]
CABLES = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e6, weight=10.0, expansion=1e-5)
STRUCTURE = jc.Structure(NODES, {"main": CABLES}, supports=jc.pinned([0, 2]))
PHASES = [jc.Phase(pretension=5e3, loads=jc.SelfWeight())]
ACTIONS = [
    Action("self-weight", "permanent", jc.SelfWeight(), in_phases=True, source="own"),
    Action("prestress", "prestress", in_phases=True),
    Action("ice", "snow", jc.LineLoads((0.0, 0.0, -7.3)), exclusive="cold"),
    Action(
        *("wind", "wind", [jc.NodalLoads([1], (0.1, 700.0 / 3.0, 0.0)), jc.LineLoads((1.0, 0, 0))]),
        **{"needs": ("ice",), "excludes": ("cold",)},
    ),
    Action("cold", "temperature", temperature={"main": np.array([-30.0, -20.1])}),
    Action("slip", "accidental", shortening=-0.0123),
    Action("loss", "accidental", removes={"main": np.array([True, False])}),
]


def same(one, other, tolerance=0.0):
    for a, b in zip(one, other, strict=True):
        # names, kinds and what goes together are static parts of the structure
        assert jax.tree.structure(a) == jax.tree.structure(b)
        for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
            np.testing.assert_allclose(x, y, rtol=tolerance, atol=0.0)


@pytest.mark.parametrize("units", [None, "kN, mm", "kip, ft, F"])
def test_actions_are_read_back(units, tmp_path):
    path = tmp_path / "scene.json"
    jc.save_scene(path, (STRUCTURE, PHASES), units=units, actions=ACTIONS)
    scene = jc.load_scene(path)
    assert len(scene) == 2 and scene._fields == ("structure", "phases")
    same(scene.actions, ACTIONS, 0.0 if units is None else 4e-16)
    assert str(scene.units) == {None: "None", "kN, mm": "kN, mm, K"}.get(units, units)
    jc.save_scene(path, scene)  # with its own units and actions
    again = jc.load_scene(path)
    same(again.actions, scene.actions, 4e-16)
    assert again.units == scene.units
    stated = json.loads(path.read_text())["actions"][4]["temperature"]["main"]
    factor = 1.8 if units == "kip, ft, F" else 1.0
    np.testing.assert_allclose(stated, factor * np.array([-30.0, -20.1]), rtol=1e-15)


def test_a_scene_keeps_its_actions_and_units(tmp_path):
    scene = jc.scenes.Scene(STRUCTURE, PHASES)
    assert scene.actions == [] and scene.units is None
    full = scene.with_actions(ACTIONS).with_units("kN, m")
    other = full._replace(phases=[])
    assert other.phases == [] and other.actions == ACTIONS and str(other.units) == "kN, m"
    assert full.with_units(None).actions == ACTIONS
    assert str(full.with_actions([]).units) == "kN, m" and full == scene
    jc.save_scene(tmp_path / "a.json", scene)
    assert "actions" not in json.loads((tmp_path / "a.json").read_text())
    jc.save_scene(tmp_path / "a.json", full, actions=[])
    assert jc.load_scene(tmp_path / "a.json").actions == []


PUSH = {"type": "NodalLoads", "nodes": [1], "forces": [0, 0, -1]}
SNOW = {"name": "snow", "kind": "snow", "loads": PUSH}
BAD = {
    "actions: expected a list": {"snow": SNOW},
    r"actions\[0\]: expected an object": ["snow"],
    r"actions\[0\]: Action has no key 'knid'": [{**SNOW, "knid": "snow"}],
    r"actions\[0\]: kind: missing": [{"name": "snow"}],
    r"actions\[0\]: 'snow' has no loads and no changes": [{"name": "snow", "kind": "snow"}],
    r"actions\[1\]: 'snow' is the name of actions\[0\], too": [SNOW, SNOW],
    r"actions\[0\]: needs = 'ice': is no other action": [{**SNOW, "needs": ["ice"]}],
    r"actions\[0\]: .*node": [{**SNOW, "loads": {**PUSH, "nodes": [7]}}],
    r"actions\[0\]: .*mian": [{"name": "cold", "kind": "wind", "temperature": {"mian": 3.0}}],
    r"actions\[0\].*removes": [{"name": "loss", "kind": "accidental", "removes": "main"}],
}


@pytest.mark.parametrize("message", BAD)
def test_what_cannot_act_is_refused(message, tmp_path):
    path = tmp_path / "scene.json"
    jc.save_scene(path, (STRUCTURE, PHASES))
    data = json.loads(path.read_text())
    path.write_text(json.dumps({**data, "actions": [SNOW]}))
    assert jc.load_scene(path).actions[0].name == "snow"  # the control
    path.write_text(json.dumps({**data, "actions": BAD[message]}))
    with pytest.raises(FileError, match=message):
        jc.load_scene(path)


# --- standards of combinations, and checks

SNOW_ACTION = Action("snow", "snow", jc.NodalLoads([1], (0.0, 0.0, -1e3)))
ROPES = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e6, weight=10.0, strength=4e4)
STEEL = jc.Bars([[0, 2]], axial_stiffness=1e7)
TIED = jc.Structure(NODES, {"ropes": ROPES, "strut": STEEL}, jc.pinned([0, 2]))
TUBE = jc.catalogue.profile_data("CHS 168.3x8")
WELDED = jc.standards.SteelSection(4e-3, 1e-5, 2e-5, 1e-4, 2e-4, circular=True, label="welded")
CHECKS = [
    "EN 1993-1-11",
    jc.design.CableSafety(factor=2.5, elements={"ropes": jc.only([1])}),
    jc.design.CableFatigue(category=110e6, of="SLS frequent", area=2e-4),
    jc.design.MemberSection(profile=TUBE, yield_strength=355e6, elements="strut", section_class=1),
    jc.design.MemberBuckling(
        **{"profile": WELDED, "yield_strength": 235e6, "lengths": (4.0, 6.0), "curves": "b"}
    ),
    jc.design.MemberBuckling(
        **{"profile": WELDED, "yield_strength": 235e6, "factors": 3.0},
        **{"name": "by factor", "reference": "last phase"},
    ),
    jc.design.DisplacementLimit(0.05, [1], (0.0, 0.0, 1.0), since="last phase"),
    jc.design.TensionLimit(lower=300.0, name="taut", of=()),
    jc.design.ReactionLimit([0, 2], lower=-5e3, upper=9e3),
]


def content_of(one):
    """A check, or a value in it, as plain data."""
    if isinstance(one, str):
        return one
    if isinstance(one, dict):
        return {key: content_of(value) for key, value in one.items()}
    if hasattr(one, "__dataclass_fields__"):
        fields = {name: getattr(one, name) for name in one.__dataclass_fields__}
        return type(one), content_of(fields)
    return one.array.tolist() if isinstance(one, Indices) else np.asarray(one).tolist()


@pytest.mark.parametrize("units", [None, "kN, mm"])
def test_checks_and_their_standard_are_read_back(units, tmp_path):
    path, more = tmp_path / "scene.json", {"combinations": "EN 1990", "checks": CHECKS}
    jc.save_scene(path, (TIED, PHASES), units=units, actions=[SNOW_ACTION], **more)
    scene = jc.load_scene(path)
    assert scene.combination_rules == "EN 1990" and len(scene.checks) == len(CHECKS)
    jc.save_scene(path, scene._replace(phases=PHASES))  # with all that it has
    again = jc.load_scene(path)
    assert [content_of(one) for one in again.checks] == [content_of(one) for one in scene.checks]
    if units is None:  # to the last digit; others to the rounding of their units
        assert list(map(content_of, again.checks)) == list(map(content_of, CHECKS))
    data = json.loads(path.read_text())
    assert data["checks"][3]["profile"] == "CHS 168.3x8"
    force, length = (1.0, 1.0) if units is None else (1e-3, 1e3)
    stated = data["checks"][4]
    assert stated["profile"]["Wy"] == pytest.approx(1e-4 * length**3, rel=1e-15)
    assert stated["yield_strength"] == pytest.approx(235e6 * force / length**2, rel=1e-15)
    assert data["checks"][8]["lower"] == pytest.approx(-5e3 * force, rel=1e-15)


def test_rules_of_an_annex_are_read_back(tmp_path):
    """Other factors than those of the standard, which combine the actions of the file."""
    path = tmp_path / "scene.json"
    annex = jc.design.combination_rules("EN 1990") | {"gamma": 1.6, "source": "an annex"}
    scene = (TIED, PHASES)
    jc.save_scene(path, scene, units="kN, mm", actions=[SNOW_ACTION], combinations=annex)
    read = jc.load_scene(path)
    assert read.combination_rules == annex
    jc.save_scene(path, read)
    assert json.loads(path.read_text())["combinations"]["gamma"] == 1.6
    found = jc.design.combinations(read.actions, read.combination_rules, which=["ULS 6.10"])
    assert found.formula(1) == "1.6 snow"
    data = json.loads(path.read_text())
    data["combinations"]["kinds"]["snow"]["psi"] = [0.5]
    path.write_text(json.dumps(data))
    with pytest.raises(FileError, match=r"combinations: rules: kinds\['snow'\]\['psi'\]: expected"):
        jc.load_scene(path)


SERVICE = {"type": "CableService"}
BAD_CHECKS = {
    r"checks\[0\]: expected EN 1993-1-11 or ASCE 19 .*MemberSection.*'EN 1993'$": "EN 1993",
    r"checks\[0\]: expected EN 1993-1-11 .*, got int": [5],
    r"checks\[1\]: .*is the name of checks\[0\]": [SERVICE, SERVICE],
    r"checks\[0\]: CableService has no key 'fractoin'": [{**SERVICE, "fractoin": 0.4}],
    "checks: cable service stress: elements = 'nett'": [{**SERVICE, "elements": "nett"}],
    r"checks\[0\].*profile: .*CHS": [
        {"type": "MemberSection", "yield_strength": 355e6, "profile": "CHS 168"}
    ],
    r'checks\[0\].profile: "type" is missing': [
        {"type": "MemberSection", "yield_strength": 355e6, "profile": {"A": 1.0}}
    ],
    "reaction: nodes": [{"type": "ReactionLimit", "nodes": [99], "lower": 0.0}],
}


@pytest.mark.parametrize("message", BAD_CHECKS)
def test_what_cannot_be_checked_is_refused(message, tmp_path):
    path = tmp_path / "scene.json"
    jc.save_scene(path, (TIED, PHASES), checks=["ASCE 19"])
    data = json.loads(path.read_text())
    assert jc.load_scene(path).checks == ["ASCE 19"]  # the control
    path.write_text(json.dumps({**data, "checks": BAD_CHECKS[message]}))
    with pytest.raises(FileError, match=message):
        jc.load_scene(path)


def test_files_hold_no_results_and_no_standard_without_actions(tmp_path):
    path = tmp_path / "scene.json"
    calm = converged(jc.solve(TIED, PHASES))
    since = jc.design.DisplacementLimit(0.1, since=calm)
    own = jc.design.OwnCheck("own", lambda structure, solution: solution.reactions[0, 0])
    other = jc.catalogue.profile_data("SHS 100x5", manufacture="cold-formed")
    cold = jc.design.MemberSection(profile=other, yield_strength=355e6)
    for check, message in ((since, "Solution"), (own, "OwnCheck"), (cold, "not as in the catalog")):
        with pytest.raises(ValueError, match=rf"checks\[0\].*{message}"):
            jc.save_scene(path, (TIED, PHASES), checks=[check])
    for standard, message in (("EN 1990", "no actions"), ("EN", "expected one of EN 1990")):
        with pytest.raises(ValueError, match=f"combinations = '{standard}': .*{message}"):
            jc.save_scene(path, (TIED, PHASES), combinations=standard)
    assert not path.exists()
