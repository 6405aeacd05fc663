"""Actions in scene files: what is written is read back, in any units, and what cannot act is
refused."""

import json

import jax
import numpy as np
import pytest

import jaxcable as jc
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
