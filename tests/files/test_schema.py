"""The JSON Schema of scene files: it says what `load_scene` takes, and refuses nothing of that."""

from __future__ import annotations

import collections
import copy
import json
import re
import warnings
from typing import Literal

import jsonschema
import numpy as np
import pytest
from file_cases import CHECK, GONE, MAST, SCHEMA, at, changed, read_scene, scene_of

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.common.rules import not_negative, positive
from jaxcable.common.tree import pytree
from jaxcable.common.types import ArrayLike, Float
from jaxcable.common.units import as_units
from jaxcable.elements.element import Element
from jaxcable.files import FileError, codec
from jaxcable.files.examples import load_schema_examples
from jaxcable.files.json_format import format_json
from jaxcable.files.scene import FORMAT, MOST_INCREMENTS, VERSION
from jaxcable.loads.load import Load
from jaxcable.materials.law import Law

OWN = {k: v for k, v in codec.TYPES.items() if v.__module__.startswith("jaxcable")}
"""Without what other tests have registered."""


def test_the_file_is_what_the_classes_say(tmp_path, capsys, monkeypatch):
    """``python -m jaxcable schema --save jaxcable/files/scene.schema.json`` writes it."""
    monkeypatch.setattr("jaxcable.files.schema.TYPES", OWN)
    assert SCHEMA.read_text() == format_json(jc.files.scene_schema()) + "\n"
    assert main(["schema"]) == 0
    assert capsys.readouterr().out == SCHEMA.read_text()
    path = tmp_path / "scene.schema.json"
    assert main(["schema", "--save", str(path)]) == 0
    assert '"$schema": "scene.schema.json"' in capsys.readouterr().out
    assert path.read_text() == SCHEMA.read_text()


@pytest.mark.slow
def test_it_is_a_schema_that_explains_every_field():
    schema = json.loads(SCHEMA.read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    classes = {k: v for k, v in schema["$defs"].items() if "additionalProperties" in v}
    assert set(classes) == set(OWN)
    for name, own in classes.items():
        assert own["additionalProperties"] is False
        assert own["properties"]["type"]["description"].startswith(f"{name}: ")
        for field, about in own["properties"].items():
            assert len(about["description"]) > len(field), f"{name}.{field}"
    links = classes["SlidingCables"]["properties"]["rest_length"]["description"]
    assert links.endswith("`rest_length` is that of the whole cable.")  # beside that of `Bars`
    used = set(json.dumps(schema).split('"#/$defs/')[1:])
    assert {word.split('"')[0] for word in used} <= set(schema["$defs"])


# Measured once with the language service of VS Code (vscode-json-languageservice 5.7.2): at 35 of
# 35 places completions were what fits there and nothing else, 126 of 126 fields showed their own
# description, and 13 of 13 mistakes were named. The tests that follow hold what that rests on.


def schemas(part):
    """All schemas, and what looks like one, in a part of a schema."""
    if isinstance(part, dict):
        yield part
        for key, inner in part.items():
            if key not in ("examples", "defaultSnippets", "enum", "const"):
                yield from schemas(inner)
    elif isinstance(part, list):
        for inner in part:
            yield from schemas(inner)


def test_types_list_all_classes():
    defs = CHECK.schema["$defs"]
    for name, base in (("group", Element), ("load", Load), ("law", Law)):
        known = defs[name]["properties"]["type"]
        assert known["enum"] == [k for k, cls in OWN.items() if issubclass(cls, base)]
        assert len(known["enum"]) == len(known["enumDescriptions"]) > 2
    # `schema_parts.json` states again what the reader demands
    assert CHECK.schema["properties"]["format"]["const"] == FORMAT
    assert CHECK.schema["properties"]["version"]["enum"] == [*range(1, VERSION + 1)]
    increments = defs["Phase"]["properties"]["increments"]
    assert increments["maximum"] == MOST_INCREMENTS
    text = defs["elements"]["allOf"][0]["then"]["then"]["if"]["properties"]["type"]
    assert text["examples"] == defs["group"]["properties"]["type"]["enum"]


def test_no_definition_hides_what_a_field_says():
    """Editors put what is in a definition in the place of what stands beside its $ref."""
    for one in schemas(CHECK.schema):
        target = CHECK.schema["$defs"].get(str(one.get("$ref")).removeprefix("#/$defs/"), {})
        shared = target.keys() & one.keys()
        assert shared <= {"defaultSnippets"} and not target.keys() & {"title", "description"}


PYTHON = re.compile(
    r"\b(None|True|False|dict|tuple|pytree|constructors?)\b|\w\((?!z\))[^)]*\)\w?|"
    r"`(only|pinned|clamped|restrained|net_faces|tension_only|extrapolated|in_series_with_spring|centred|shifted)`"
)


def test_descriptions_speak_json():
    for one in schemas(CHECK.schema):
        for text in (one.get("description"), *one.get("enumDescriptions", [])):
            if isinstance(text, str) and text != CHECK.schema["description"]:
                assert not PYTHON.search(text), text


def fits(example, kind, field=None):
    """A scene in which an example of a class, or of one of its fields, makes sense."""
    data = changed(MAST, (("structure", "nodes", 2, 2), 0.5))
    structure, phase = data["structure"], {}
    guys, mast = structure["elements"].values()
    guys |= {"links": [[1, 2], [1, 3]], "expansion": 1e-5, "weight": 5.0}
    mast |= {"up": [1, 0, 0]}
    if field in ("sag", "built_sag", "horizontal_tension"):
        guys |= {"type": "Catenaries"}
        mast |= {"hinges": [[False, True]]}
    if field == "clamped":
        guys |= {"type": "FrictionCables", "links": [[1, 2, 3, 4]]}
    if kind == "Action":
        own = {"name": "cold", "kind": "wind", "temperature": {"guys": -1.0}, field: example}
        data = {**data, "actions": [own if field else example]}
    elif kind == "SteelSection":
        section = {"type": "MemberSection", "profile": example, "yield_strength": 355e6}
        data = {**data, "checks": [section]}
    elif issubclass(OWN[kind], jc.design.Check):
        guys |= {"strength": 2e5}
        data = {**data, "checks": [example]}
    elif kind == "Phase":
        phase = {field: example} if field else example
    elif kind in ("Elastic", "Polygonal"):
        guys |= {"area": 1e-4, "law": example}
        del guys["axial_stiffness"]
    elif kind in ("Only", "Selection"):
        phase = {"pretension": {"guys": example}} if kind == "Only" else {"adds": {"guys": example}}
    elif kind in ("Section", "LinearSection"):
        mast["section"] = example
    elif kind == "Supports":
        structure["supports"] = {"clamps": [3], **example, "mask": [[True] * 6] * 5}
        if "axes" in example:  # along other directions nothing else may be held in part
            structure["supports"]["mask"] = [[k != 2] * 6 for k in range(5)]
    elif issubclass(OWN[kind], Element):
        count = np.max(example["links"]) + 1
        width = 6 if kind == "Beams" else 3
        held = {"mask": [[True] * width] * count}
        structure |= {"nodes": structure["nodes"][:count], "elements": example, "supports": held}
    elif kind in ("EurocodeWind", "WindPowerLaw", "WindTable"):
        load = {"type": "WindLoads", "direction": [1, 0, 0], "drag": 1.2, "diameter": 0.1}
        phase = {"loads": {**load, "profile": example}}
    else:
        phase = {"loads": example}
    return {**data, "phases": [phase]}


SCENE, CLASSES, FIELDS = load_schema_examples().values()
EXAMPLES = [
    *((kind, None, one) for kind, all_of in CLASSES.items() for one in all_of.values()),
    *(
        (k, field, one)
        for k, of in FIELDS.items()
        for field, values in of.items()
        for one in values
    ),
]


@pytest.mark.slow_cases("Section-None-example13")
@pytest.mark.parametrize(("kind", "field", "example"), EXAMPLES)
def test_examples_are_valid_and_read(kind, field, example, tmp_path):
    data = fits(copy.deepcopy(example), kind, field)
    CHECK.validate(data)
    assert read_scene(data, tmp_path).structure.n_node > 0


@pytest.mark.slow
def test_the_example_of_a_scene_is_analysed(tmp_path):
    """Two cables in a 3-4-5 triangle carry 500 N each under 600 N."""
    CHECK.validate(SCENE)
    solution = jc.solve(*read_scene(SCENE, tmp_path))
    assert solution.status == 0
    np.testing.assert_allclose(solution.tension["guys"], 500.0, rtol=1e-9)  # it begins there


def test_every_example_is_in_the_schema():
    """What the tests above read is all that editors offer."""
    known = [json.dumps(one) for _, _, one in EXAMPLES] + [json.dumps(SCENE)]
    found, units = 0, CHECK.schema["properties"]["units"]["examples"]
    known += [json.dumps(one) for one in units if as_units(one)]
    for one in schemas(CHECK.schema):
        for example in one.get("examples", []):
            found += 1
            assert json.dumps(example) in known or example in OWN
        for snippet in one.get("defaultSnippets", []):
            assert json.dumps(snippet["body"]) in known and len(snippet["label"]) < 60
    assert found > len(EXAMPLES)


def test_classes_of_users_are_described_by_what_they_say(monkeypatch):
    """A law with rules, with a text that is one of two, and with a field for programs."""

    @pytree(static=("kind", "count"))
    class Foam(jc.Elastic):
        """A law for this test.

        Args:
            E: modulus, Pa.
            porosity: share of holes.
            kind: which foam.
            count: number of cells; set by nobody.
        """

        porosity: Float[ArrayLike, ""] = 0.0
        kind: Literal["open", "closed"] = "open"
        count: int = None

        def rules(self):
            return [*super().rules(), not_negative("porosity", self.porosity)]

    monkeypatch.setattr("jaxcable.files.schema.TYPES", {**OWN, "Foam": Foam})
    about = jc.files.scene_schema()["$defs"]["Foam"]
    assert about["required"] == ["type", "E"]
    fields = about["properties"]
    above = {"$ref": "#/$defs/number_one_above_0"}
    assert fields["E"] == {"description": "modulus, Pa.", **above}
    assert fields["porosity"]["$ref"] == "#/$defs/number_one_from_0"
    assert fields["kind"]["enum"] == ["open", "closed"] and fields["kind"]["default"] == "open"
    assert fields["count"]["type"] == ["integer", "null"] and fields["count"]["doNotSuggest"]

    monkeypatch.setattr(Foam, "rules", lambda self: [positive("E", 2 * self.E)])  # needs a number
    about = jc.files.scene_schema()["$defs"]["Foam"]
    assert about["properties"]["E"]["$ref"] == "#/$defs/number_one"


# --- the schema refuses nothing that the reader takes

JUNK = [None, True, "x", -1, 0, 1, 2.5, [], {}, [[]], [1.0], [0, 1], ["a"], [True], {"type": "x"}]
JUNK += [{"type": "float32", "values": 0.5}, [[0, 1]], [0.0, 0.0, 1.0], {"a": 1.0}, [{}]]
JUNK += [{"type": "Elastic", "E": 1e9}, {"type": "Selection", "elements": [0]}, [None]]
JUNK += [{"type": "Only", "elements": [0], "values": 1.0}, {"type": "SelfWeight"}, {"nodes": [0]}]
JUNK += [{"type": "tuple", "items": [1.0]}, {"chosen": [0]}, [{"type": "SelfWeight"}]]


def places(data, path=()):
    """Paths of all values in the data of a file; of lists of numbers only the first item."""
    yield path
    if isinstance(data, dict):
        for key, value in data.items():
            yield from places(value, (*path, key))
    elif isinstance(data, list):
        objects = [k for k, item in enumerate(data) if isinstance(item, dict)]
        for k in objects or range(min(1, len(data))):
            yield from places(data[k], (*path, k))


def changes_of(data):
    """Changes (path, value) of one value each: another one, none, or a field more."""
    for path in list(places(data))[1:]:
        yield from ((path, value) for value in [*JUNK, GONE])
        if isinstance(at(data, path), dict):
            yield (*path, "another"), 1.0


def odd(path, value, data):
    """Whether a change is one that the schema leaves out, though it is read.

    Lists of numbers in the forms that no field needs, lists that are empty inside, and what a tree
    of groups does not see because it has no numbers.
    """
    kind = value.get("type") if isinstance(value, dict) else None
    unseen = kind == "Selection" and path[:2] == ("structure", "elements")
    return kind in ("tuple", "list", "float32") or unseen or "[[]]" in json.dumps(data)


@pytest.mark.parametrize("name", ["mast", "everything", "stages"])
def test_the_schema_refuses_nothing_that_is_read(name, tmp_path):
    """Files with one change each, drawn from some thousand; it refuses most of what is not read."""
    if name == "mast":
        data = MAST
    else:
        jc.save_scene(tmp_path / "scene.json", scene_of(name))
        data = json.loads((tmp_path / "scene.json").read_text())
    every, counts, wrong = list(changes_of(data)), collections.Counter(), []
    for k in np.random.default_rng(0).permutation(len(every))[:100]:
        other = changed(data, every[k])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", jc.InputWarning)
            try:
                read_scene(other, tmp_path)
                read = True
            except FileError:
                read = False
        if not read and counts[False, False] >= 30:
            continue  # validation costs four times as much as reading
        valid = CHECK.is_valid(other)
        counts[read, valid] += 1
        if read and not valid and not odd(*every[k], other):
            wrong.append(every[k])
    assert not wrong, wrong
    assert counts[False, False] > 4 * counts[False, True], counts
    assert counts[True, True] > 3, counts  # what is given may often be left out
