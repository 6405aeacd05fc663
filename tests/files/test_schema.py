"""The JSON Schema of scene files: it says what `load_scene` takes, and refuses nothing of that."""

import copy
import json
import re
import warnings
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from test_files import BAD, BEAM, SCENES, everything, scene_of, text_of

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.elements.element import Element
from jaxcable.files import FileError, codec, examples
from jaxcable.files.layout import laid_out
from jaxcable.loads.load import Load
from jaxcable.materials.law import Law

SHIPPED = Path(jc.__file__).parent / "files" / "scene.schema.json"
CHECK = jsonschema.Draft202012Validator(json.loads(SHIPPED.read_text()))


OWN = {k: v for k, v in codec.TYPES.items() if v.__module__.startswith("jaxcable")}
"""Without what other tests have registered."""


def test_the_file_is_what_the_classes_say(tmp_path, capsys, monkeypatch):
    """``python -m jaxcable schema --save jaxcable/files/scene.schema.json`` writes it."""
    monkeypatch.setattr("jaxcable.files.schema.TYPES", OWN)
    assert SHIPPED.read_text() == laid_out(jc.files.scene_schema()) + "\n"
    assert main(["schema"]) == 0
    assert capsys.readouterr().out == SHIPPED.read_text()
    path = tmp_path / "scene.schema.json"
    assert main(["schema", "--save", str(path)]) == 0
    assert '"$schema": "scene.schema.json"' in capsys.readouterr().out
    assert path.read_text() == SHIPPED.read_text()


def test_it_is_a_schema_that_explains_every_field():
    schema = json.loads(SHIPPED.read_text())
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


# What the language service of VS Code (vscode-json-languageservice 5.7.2) did with the schema
# before and after it was written for it, measured once with a script: at 25 and 35 of 35 places
# completions were what fits there and nothing else (classes, fields of a class, known texts);
# 4 and 8 of 8 fields were inserted with no other value than the default; 0 and 11 of 11 values had
# an example to insert; 97 and 126 of 126 fields showed their own description; 7 and 13 of 13
# mistakes were named. The tests that follow hold what that rests on.


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
    r"`(only|pinned|clamped|restrained|net_faces|tension_only|extended|softened|centred|shifted)`"
)


def test_descriptions_speak_json():
    for one in schemas(CHECK.schema):
        for text in (one.get("description"), *one.get("enumDescriptions", [])):
            if isinstance(text, str) and text != CHECK.schema["description"]:
                assert not PYTHON.search(text), text


def fits(example, kind, field=None):
    """A scene in which an example of a class, or of one of its fields, makes sense."""
    tube = examples.CLASSES["Section"]["one fibre: E, A, Iy, Iz, J"]
    mast = {"type": "Beams", "links": [[0, 1]], "section": tube, "up": [1, 0, 0]}
    guys = {"type": "Cables", "links": [[1, 2], [1, 3]], "axial_stiffness": 1e6}
    guys |= {"expansion": 1e-5, "weight": 5.0}
    held = {"clamps": [0], "nodes": [2, 3]}
    nodes = [[0, 0, 0], [0, 0, 3], [4, 0, 0.5], [0, 4, 0]]
    structure = {"nodes": nodes, "elements": {"guys": guys, "mast": mast}, "supports": held}
    phase = {}
    if field == "sag":
        guys |= {"type": "Catenaries"}
        mast |= {"hinges": [[False, True]]}
    if kind == "Phase":
        phase = {field: example} if field else example
    elif kind in ("Elastic", "Polygonal"):
        guys |= {"area": 1e-4, "law": example}
        del guys["axial_stiffness"]
    elif kind in ("Only", "Selection"):
        phase = {"pretension": {"guys": example}} if kind == "Only" else {"adds": {"guys": example}}
    elif kind == "Section":
        mast["section"] = example
    elif kind == "Supports":
        structure["supports"] = {"clamps": [3], **example, "mask": [[True] * 6] * 4}
        if "axes" in example:  # along other directions nothing else may be held in part
            structure["supports"]["mask"][2] = [False] * 6
    elif issubclass(OWN[kind], Element):
        count = np.max(example["links"]) + 1
        width = 6 if kind == "Beams" else 3
        held = {"mask": [[True] * width] * count}
        structure = {"nodes": nodes[:count], "elements": example, "supports": held}
    else:
        phase = {"loads": example}
    head = {"format": "jaxcable scene", "version": 1}
    return {**head, "structure": structure, "phases": [phase]}


EXAMPLES = [
    *((kind, None, one) for kind, all_of in examples.CLASSES.items() for one in all_of.values()),
    *((kind, field, one) for (kind, field), values in examples.FIELDS.items() for one in values),
]


@pytest.mark.parametrize(("kind", "field", "example"), EXAMPLES)
def test_examples_are_valid_and_read(kind, field, example, tmp_path):
    data = fits(copy.deepcopy(example), kind, field)
    CHECK.validate(data)
    (tmp_path / "example.json").write_text(json.dumps(data))
    jc.load_scene(tmp_path / "example.json")


def test_the_example_of_a_scene_is_analysed(tmp_path):
    """Two cables in a 3-4-5 triangle carry 500 N each under 600 N."""
    CHECK.validate(examples.SCENE)
    (tmp_path / "example.json").write_text(json.dumps(examples.SCENE))
    solution = jc.solve(*jc.load_scene(tmp_path / "example.json"))
    assert solution.status == 0
    np.testing.assert_allclose(solution.tension["guys"], 500.0, rtol=1e-9)  # it begins there


def test_every_example_is_in_the_schema():
    """What the tests above read is all that editors offer."""
    known = [json.dumps(one) for _, _, one in EXAMPLES] + [json.dumps(examples.SCENE)]
    found = 0
    for one in schemas(CHECK.schema):
        for example in one.get("examples", []):
            found += 1
            assert json.dumps(example) in known or example in OWN
        for snippet in one.get("defaultSnippets", []):
            assert json.dumps(snippet["body"]) in known and len(snippet["label"]) < 60
    assert found > len(EXAMPLES)


def test_errors_point_inside_of_an_element(tmp_path):
    """At what is wrong, not at `structure.elements`."""
    data = plain(stages(), tmp_path)
    for path, value in (
        (("elements", "stay", "axial_stiffness"), "1e6"),
        (("elements", "stay", "area"), 1.0),
        (("elements", "stay", "type"), "Cable"),
        (("elements", "stay", "links", 0, 1), 1.5),
        (("elements", "deck", "section", "laws", 0, "E"), -1),
        (("elements", "deck", "section", "y"), "0"),
    ):
        other = copy.deepcopy(data)
        at(other["structure"], path[:-1])[path[-1]] = value
        errors = list(CHECK.iter_errors(other))
        assert errors and all(list(e.absolute_path) == ["structure", *path] for e in errors)
        assert len(errors[0].message) < 120
    other = copy.deepcopy(data)
    del other["structure"]["elements"]["stay"]["axial_stiffness"]
    (error,) = CHECK.iter_errors(other)
    assert error.message.startswith("'axial_stiffness, or area and law, or section'")
    assert list(error.absolute_path) == ["structure", "elements", "stay"]


def stages():
    """A scene with what comes and goes, and what the other ones of these tests lack."""
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, -1], [1, 1, 0]]
    section = jc.Section.rectangle(0.1, 0.1, jc.Elastic(1e9))
    elements = {
        "deck": jc.Beams(
            [[0, 1], [1, 2]], section, up=(0, 0, 1.0), hinges=[[0, 0], [0, 1]] == np.ones((2, 2))
        ),
        "stay": jc.Cables([[1, 4]], axial_stiffness=1e6, expansion=1e-5, weight=1.0),
        "rope": jc.Catenaries([[0, 4], [2, 4]], axial_stiffness=1e6, weight=5.0),
    }
    held = jc.clamped([0, 2]) + jc.pinned([4])
    structure = jc.Structure(nodes, elements, held, rigid=[[1, 3]])
    phases = [
        jc.Phase(sag={"deck": None, "stay": None, "rope": 0.1}, loads=jc.SelfWeight(on="stay")),
        jc.Phase(removes="stay", loads=jc.NodalLoads([3], (0, 0, -1.0), (0, 1.0, 0))),
        jc.Phase(
            adds={"deck": None, "stay": jc.only([0]), "rope": None},
            removes={"deck": None, "stay": None, "rope": [True, False]},
            placed="attached",
            shortening={"deck": None, "stay": 0.01, "rope": None},
            loads=[
                jc.LineLoads((0, 0, -1.0), on="deck", elements=jc.only([1]), per="initial"),
                jc.LineLoads((0, 0, -1.0), on="deck", per="initial", geometry="begun"),
                jc.CablePressure(1.0, (0, 1.0, 0), on="deck", per="unstressed"),
            ],
        ),
        jc.Phase(
            supports=held + jc.restrained([1], "y"),
            temperature={"deck": None, "stay": 5.0, "rope": None},
            loads=jc.SupportMovement([0], None, (0.0, 0.001, 0.0)),
        ),
    ]
    return structure, phases


def plain(scene, tmp_path):
    """The data of a scene's file."""
    return json.loads(text_of(scene, tmp_path))


@pytest.mark.parametrize("name", [*SCENES, "everything", "stages"])
def test_saved_scenes_are_valid(name, tmp_path):
    scene = {"everything": everything, "stages": stages}.get(name, lambda: scene_of(name))()
    data = plain(scene, tmp_path)
    CHECK.validate(data)
    data["$schema"] = "scene.schema.json"  # what an editor puts there is not read
    CHECK.validate(data)
    (tmp_path / "named.json").write_text(json.dumps(data))
    jc.load_scene(tmp_path / "named.json")


MISTAKES = {  # of the file of `flat_net`: what is put where, and what the reader says
    "unknown field": (("structure", "elements", "colour"), "red", "a Cables has no field 'colour'"),
    "unknown field of a phase": (("phases", 0, "load"), [], "a Phase has no field 'load'"),
    "unknown field of the file": (("nodes",), [], "unknown field 'nodes'"),
    "wrong type": (("structure", "elements", "axial_stiffness"), "1e5", "expected numbers"),
    "wrong shape": (("structure", "nodes", 0), [0, 0], "lists of equal lengths"),
    "text for a number": (("phases", 1, "increments"), "10", "increments = '10'"),
    "true for a number": (("phases", 0, "pretension"), True, "expected numbers, got bool"),
    "number for true": (("structure", "supports", "mask"), [[1, 1, 1]] * 12, "expected booleans"),
    "half a node": (("structure", "supports", "nodes", 0), 0.5, "expected integers"),
    "below zero": (("structure", "elements", "links", 0, 0), -1, "node numbers start at 0"),
    "not positive": (("structure", "elements", "axial_stiffness"), 0, "must be positive"),
    "wrong enum": (("phases", 1, "placed"), "pulled", "placed = 'pulled'"),
    "wrong class": (("structure", "elements", "type"), "Ropes", "unknown type 'Ropes'"),
    "load for a group": (("structure", "elements", "type"), "NodalLoads", "a NodalLoads has no"),
    "two stiffnesses": (("structure", "elements", "area"), 1.0, "axial_stiffness"),
    "number as schema": (("$schema",), 5, r"\$schema: expected a text"),
    "newer version": (("version",), 2, "version: 2 is newer"),
    "phases as object": (("phases",), {}, "phases: expected a list"),
}
MISSING = {
    "links": (("structure", "elements"), "links: missing"),
    "supports": (("structure",), "supports: missing"),
    "nodes": (("structure",), "nodes: missing"),
    "phases": ((), "phases: expected a list, got nothing"),
    "format": ((), "format: expected"),
    "axial_stiffness": (("structure", "elements"), "axial_stiffness: missing"),
    "forces": (("phases", 1, "loads"), "forces: missing"),
}


def at(data, path):
    for key in path:
        data = data[key]
    return data


def both_refuse(data, message, tmp_path):
    """The schema and the reader, which names the place."""
    assert not CHECK.is_valid(data)
    (tmp_path / "bad.json").write_text(json.dumps(data))
    with pytest.raises(FileError, match=message):
        jc.load_scene(tmp_path / "bad.json")


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_refused_by_both(name, tmp_path):
    path, value, message = MISTAKES[name]
    data = plain(jc.scenes.flat_net(load=15.0), tmp_path)
    CHECK.validate(data)
    at(data, path[:-1])[path[-1]] = value
    both_refuse(data, message, tmp_path)


@pytest.mark.parametrize("name", MISSING)
def test_what_is_missing_is_missed_by_both(name, tmp_path):
    path, message = MISSING[name]
    data = plain(jc.scenes.flat_net(load=15.0), tmp_path)
    del at(data, path)[name]
    both_refuse(data, message, tmp_path)


BEYOND = ("node", "load", "negative", "infinite", "nan", "digits", "single")
"""Of `BAD`: what a schema cannot say, or what is no JSON; its description tells these."""


@pytest.mark.parametrize("name", BAD)
def test_the_bad_files_of_the_reader(name, tmp_path):
    old, new, _ = BAD[name]
    text = text_of(jc.scenes.flat_net(load=15.0), tmp_path).replace(old, new, 1)
    try:
        data = json.loads(text)
    except ValueError:
        return  # no JSON: editors say so by themselves
    assert CHECK.is_valid(data) == (name in BEYOND)
    assert "numbers of nodes or elements" in CHECK.schema["description"]


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


def changed(data):
    """Files with one change each: pairs of what was done, and the data."""
    for path in list(places(data))[1:]:
        last = path[-1]
        for value in JUNK:
            other = copy.deepcopy(data)
            at(other, path[:-1])[last] = value
            yield (*path, value), other
        other = copy.deepcopy(data)
        del at(other, path[:-1])[last]
        yield (*path, "deleted"), other
        if isinstance(at(data, path), dict):
            other = copy.deepcopy(data)
            at(other, path)["another"] = 1.0
            yield (*path, "added"), other


def odd(change, data):
    """Whether a change is one that the schema leaves out, though it is read.

    Lists of numbers in the forms that no field needs, lists that are empty inside, and what a tree
    of groups does not see because it has no numbers.
    """
    value = change[-1]
    kind = value.get("type") if isinstance(value, dict) else None
    unseen = kind == "Selection" and change[:2] == ("structure", "elements")
    return kind in ("tuple", "list", "float32") or unseen or "[[]]" in json.dumps(data)


def sample(changes, most=400):
    """Some of the changes: all of them take minutes."""
    every = list(changes)
    chosen = np.random.default_rng(0).permutation(len(every))[:most]
    return [every[k] for k in chosen]


@pytest.mark.parametrize("name", ["flat_net", "everything", "stages", "beam"])
def test_the_schema_refuses_nothing_that_is_read(name, tmp_path):
    """Hundreds of files with one change each; and most of what is not read it refuses as well."""
    if name == "beam":
        data = json.loads(BEAM)
    else:
        scene = {"everything": everything, "stages": stages}.get(name, lambda: scene_of(name))()
        data = plain(scene, tmp_path)
    if name == "flat_net":
        data["structure"]["elements"] = {"a": data["structure"]["elements"]}
    path, counts, wrong = tmp_path / "changed.json", {}, []
    for change, other in sample(changed(data)):
        path.write_text(json.dumps(other))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", jc.InputWarning)
            try:
                jc.load_scene(path)
                read = True
            except FileError:
                read = False
        valid = CHECK.is_valid(other)
        counts[read, valid] = counts.get((read, valid), 0) + 1
        if read and not valid and not odd(change, other):
            wrong.append(change)
    assert not wrong, wrong
    assert counts[False, False] > 4 * counts.get((False, True), 0), counts
    assert counts[True, True] > 3, counts  # what is given may often be left out
