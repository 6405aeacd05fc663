"""Scene files with mistakes: the reader names the line or the field; the schema refuses them."""

import json
import sys

import numpy as np
import pytest
from file_cases import CHECK, GONE, MAST, changed, read_scene, stages

import jaxcable as jc
from jaxcable.files import FileError

GROUPS = ("structure", "elements")
GUYS, BEAM, NODES = (*GROUPS, "guys"), (*GROUPS, "mast"), ("structure", "nodes")
STIFF, SUPPORTS = (*GUYS, "axial_stiffness"), ("structure", "supports")
FIRST, SECOND = ("phases", 0), ("phases", 1)
LOAD = (*SECOND, "loads", 0)
ALIKE = "'guys', 'mast'; did you mean "
NO_TYPE = '"type"'
MOVED = {"type": "SupportMovement", "nodes": [1], "displacements": [1, 0, 0]}
SINGLE = {"type": "float32"}
DETACHED = {"type": "LineLoads", "forces": [1, 0, 0], "on": "Mast"}
WRONG = {  # of the mast: what is put where, and what the reader says
    "field": (
        (*GUYS, "axial_stifness"),
        1,
        r"elements\['guys'\]: Cables has no key .* did you mean",
    ),
    "field of a phase": ((*FIRST, "pretention"), 1, r"phases\[0\]: .*'pretension'"),
    "field of the file": (("scene",), 1, "unknown field 'scene'"),
    "field of a structure": (("structure", "suports"), {}, "'suports'; did you mean 'supports'"),
    "not positive": (STIFF, -1.5, r"\['guys'\]: axial_stiffness\[0\] = -1.5: must be positive"),
    "text": (STIFF, "__import__", r"elements\['guys'\]: axial_stiffness: expected numbers"),
    "text in a node": ((*NODES, 2, 1), "0", r'nodes\[2\]\[1\]: expected a number, got "0"'),
    "class of the whole": (
        ("structure",),
        {"type": "Elastic", "E": 1},
        "structure: expected a Str",
    ),
    "groups in a list": (
        GROUPS,
        [MAST["structure"]["elements"]["guys"]],
        "has a list of 1, got gr",
    ),
    "counts of fibres": ((*BEAM, "section", "counts"), [2], "counts"),
    "short node": ((*NODES, 2), [4, 0], r"nodes\[2\]: .* got 2 where others have 3"),
    "false in a node": ((*NODES, 2, 1), False, "nodes: expected numbers, got true or false"),
    "ragged": ((*GUYS, "links", 2), [1], r"links\[2\]: .* lists of equal lengths, .* 1 .* 2"),
    "true in a link": ((*GUYS, "links", 2, 1), True, "links: expected numbers, got true or false"),
    "unknown node": ((*GUYS, "links", 2), [1, 5], r"links\[2\] = \[1, 5\]: .* nodes 0 to 4"),
    "below zero": ((*GUYS, "links", 0, 0), -1, "node numbers start at 0"),
    "half a node": ((*SUPPORTS, "nodes", 0), 0.5, "structure.supports: .*integers"),
    "number for true": ((*SUPPORTS, "mask"), [[1] * 6] * 5, "expected booleans"),
    "class": ((*GUYS, "type"), "os.system", r"elements\['guys'\]: unknown type 'os.system'"),
    "class of a load": ((*GUYS, "type"), "NodalLoads", "NodalLoads has no key"),
    "class of a support": ((*SUPPORTS, "type"), "Phase", "supports: expected a Supports"),
    "two stiffnesses": ((*GUYS, "area"), 1.0, "axial_stiffness"),
    "single": (STIFF, {**SINGLE, "values": 1e300}, "too large for float32"),
    "single alone": (STIFF, SINGLE, '"values" is missing; {"type": "float32"} needs'),
    "points": ((*BEAM, "points"), 10**9, "points = 1000000000: .* integer from 3 to 1000"),
    "float of points": ((*BEAM, "points"), 1e9, "points = 1000000000.0: expected an integer from"),
    "true for points": ((*BEAM, "points"), True, "points = True: expected an integer from 3"),
    "group without type": (
        GUYS,
        {"links": [[1, 2]]},
        f"{NO_TYPE} is missing; .* {NO_TYPE}: .Cables",
    ),
    "law without type": (
        (*BEAM, "section", "laws"),
        [{"E": 1.0}],
        f"{NO_TYPE} is missing; .* of a law, ",
    ),
    "held alone": (SUPPORTS, {"nodes": [0], "held": [[True] * 6]}, "supports chosen: missing"),
    "chosen alone": (SUPPORTS, {"chosen": [0]}, "supports held: missing"),
    "nothing held": (SUPPORTS, {}, "nothing is held; give nodes or clamps"),
    "increments": (
        (*SECOND, "increments"),
        9999999999,
        r"phases\[1\].increments = 9999999999: at most",
    ),
    "text of increments": ((*SECOND, "increments"), "x", r"phases\[1\]: increments = 'x'"),
    "enum": ((*SECOND, "placed"), "pulled", "placed = 'pulled'"),
    "true for a number": ((*FIRST, "pretension"), True, "expected numbers, got bool"),
    "negative": ((*FIRST, "pretension", "guys"), -2, r"phases\[0\].pretension.* = -2"),
    "text of a group": ((*FIRST, "pretension", "guys"), "1", "expected numbers, got t"),
    "group": (
        (*FIRST, "pretension"),
        {"guy": 1.0},
        rf"pretension: no group 'guy' .* {ALIKE}'guys'",
    ),
    "groups within": (
        (*FIRST, "pretension"),
        {"guys": {"a": 1.0}},
        r"pretension\['guys'\]: expected one number, or numbers \[n_elem\]",
    ),
    "added group": (
        (*SECOND, "adds"),
        {"mats": True},
        rf"adds: no group 'mats' .* {ALIKE}'mast'\?",
    ),
    "added key": ((*SECOND, "adds"), "mats", rf"adds = 'mats': no such key .* {ALIKE}'mast'\?"),
    "cold group": (
        (*FIRST, "temperature"),
        {"guys": -30},
        r"temperature\['guys'\]: the group has no coefficient of expansion",
    ),
    "load node": ((*LOAD, "nodes"), [88], r"phases\[1\].loads\[0\]: load nodes\[0\] = 88"),
    "true among nodes": ((*LOAD, "nodes"), [2, True], "nodes: expected numbers, got true or false"),
    "true for nodes": ((*LOAD, "nodes"), True, "load nodes: expected integers, got bool"),
    "group of a load": (LOAD, DETACHED, rf"loads\[0\]: on = 'Mast': .* {ALIKE}'mast'"),
    "load without type": (
        LOAD,
        {"nodes": [1]},
        rf"loads\[0\]: {NO_TYPE} is missing; .* a load, such",
    ),
    "one load": ((*SECOND, "loads"), {"nodes": [1]}, rf"phases\[1\].loads: {NO_TYPE} is missing"),
    "moved free node": (LOAD, MOVED, r"loads\[0\]: displacements\[0\]: node 1 is free along x"),
    "phase list": (FIRST, {"type": "list", "items": []}, r"phases\[0\]: expected a Ph"),
    "phase float": (FIRST, {**SINGLE, "values": [1]}, r"phases\[0\]: expected a Ph"),
    "phases as object": (("phases",), {}, "phases: expected a list"),
    "schema": (("$schema",), 5, r"\$schema: expected a text"),
    "version": (("version",), 7, "version: 7 is newer than 1"),
    "format": (("format",), "other", 'format: expected "jaxcable scene"'),
    "no format": (("format",), GONE, "format: missing; expected"),
    "no version": (("version",), GONE, "version: missing; expected a whole number such as 1"),
    "no phases": (("phases",), GONE, r"phases: missing; expected a list such as \["),
    "no nodes": (NODES, GONE, "nodes: missing"),
    "no supports": (SUPPORTS, GONE, "supports: missing"),
    "no links": ((*GUYS, "links"), GONE, r"elements\['guys'\]: links: missing"),
    "no stiffness": (STIFF, GONE, "axial_stiffness: missing"),
    "no forces": ((*LOAD, "forces"), GONE, "forces: missing"),
}
BEYOND = {"unknown node", "load node", "moved free node", "single", "negative", "cold group"}
BEYOND |= {"group", "groups within", "added group", "added key", "group of a load"}
BEYOND |= {"groups in a list", "counts of fibres"}
"""Of `WRONG`: what a schema cannot say, such as numbers of nodes and names of groups."""
SPEAKS = ("prefix", "pytree", "None", "<U", "dict", "ndarray is")


@pytest.mark.filterwarnings("ignore::jaxcable.InputWarning")  # suspicious beside what is wrong
@pytest.mark.parametrize("name", WRONG)
def test_mistakes_are_named_and_refused_by_the_schema(name, tmp_path):
    path, value, message = WRONG[name]
    data = changed(MAST, (path, value))
    assert CHECK.is_valid(data) == (name in BEYOND)
    with pytest.raises(FileError, match=message) as caught:
        read_scene(data, tmp_path)
    text = str(caught.value)
    assert text.startswith(str(tmp_path / "scene.json")) and "\n" not in text
    assert not any(word in text for word in SPEAKS)


def test_without_mistakes_it_is_read(tmp_path):
    CHECK.validate(MAST)
    structure, phases = read_scene(MAST, tmp_path)
    assert structure.nodes.dtype == np.float64 and list(structure.elements) == ["guys", "mast"]
    assert phases[0].pretension == {"guys": 10e3}
    assert "numbers of nodes or elements" in CHECK.schema["description"]  # what it cannot say


HEAD = '{"format": "jaxcable scene", "a": '
TEXT = json.dumps(MAST, indent=0)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (TEXT.replace("1000000.0", "1e999"), r"\['guys'\].axial_stiffness: .*too large"),
        (TEXT.replace("1000000.0", "NaN"), r"NaN is not allowed"),
        (TEXT.replace("1000000.0", "9" * 5000), r"a whole number of 5000 digits"),
        (TEXT.replace('"phases"', '"structure"'), r"the field 'structure' occurs twice"),
        (
            TEXT.replace('"version": 1,', '"version": 1'),
            r"line 3: not valid JSON: a comma is missing at the end",
        ),
        (
            TEXT.replace('"version": 1,', '"version": 1,,'),
            r"line 3, column 14: not .* expected the na",
        ),
        (
            TEXT.replace('"version": 1,', '"version" 1,'),
            r"line 3, column 11: not .* a colon is missing",
        ),
        (TEXT[:-1], "not valid JSON: the file ends before all brackets are closed"),
        (TEXT + "}", "not valid JSON: there is text after the end of the object"),
        (TEXT[:-1].rstrip() + ",}", "not valid JSON: remove the comma before }"),
        (TEXT.replace('"version"', '"version'), "line 3, .*: not valid JSON"),
        (
            HEAD + "[1 2]}",
            "line 1, column 38: not valid JSON: a comma is missing before this place",
        ),
        ("", "not a JSON object"),
        ("[1, 2]", "not a JSON object"),
        (HEAD + "[" * 100_000, "nested too deeply"),
        (HEAD + '{"b": ' * 100_000 + "1" + "}" * 100_001, "nested too deeply"),
        (  # Python 3.13 reads this depth, and what is wrong then is that the version is missing
            HEAD + '{"b": ' * 5000 + "1" + "}" * 5001,
            "nested too deeply"
            if sys.version_info < (3, 13)
            else "version: missing; expected a whole",
        ),
        ("\0\1\2", "a binary file"),
        ('{\n"a": "\udcff"}', "line 2: not UTF-8"),
    ],
)
def test_nonsense_fails_fast(content, message, tmp_path):
    path = tmp_path / "bad.json"
    path.write_bytes(content.encode(errors="surrogateescape"))
    with pytest.raises(FileError, match=message) as caught:
        jc.load_scene(path)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def test_errors_of_the_schema_point_inside_of_an_element():
    """At what is wrong, not at `structure.elements`."""
    for path, value in (
        (STIFF, "1e6"),
        ((*GUYS, "area"), 1.0),
        ((*GUYS, "type"), "Cable"),
        ((*GUYS, "links", 0, 1), 1.5),
        ((*BEAM, "section", "laws", 0, "E"), -1),
        ((*BEAM, "section", "y"), "0"),
    ):
        errors = list(CHECK.iter_errors(changed(MAST, (path, value))))
        assert errors and all(list(e.absolute_path) == list(path) for e in errors)
        assert len(errors[0].message) < 120
    (error,) = CHECK.iter_errors(changed(MAST, (STIFF, GONE)))
    assert error.message.startswith("'axial_stiffness, or area and law, or section'")
    assert list(error.absolute_path) == list(GUYS)


def test_files_beyond_the_limit_are_not_read(tmp_path):
    path = tmp_path / "good.json"
    path.write_text(TEXT)
    with pytest.raises(FileError, match=r"larger than the limit of 0\.0.+ MB"):
        jc.load_scene(path, largest=len(TEXT) - 1)
    assert jc.load_scene(path, largest=len(TEXT)).structure.n_node == 5
    with pytest.raises(FileError, match="larger than the limit of 1 MB"):  # a device has no end
        jc.load_scene("/dev/zero", largest=1e6)
    with pytest.raises(OSError):
        jc.load_scene(tmp_path / "nothing.json")


@pytest.mark.filterwarnings("ignore::jaxcable.InputWarning")  # suspicious beside what is wrong
def test_mutated_scenes_are_refused_or_read(tmp_path):
    """Random bytes of a valid file changed: a scene, or a FileError, and nothing else."""
    jc.save_scene(tmp_path / "good.json", stages())
    text = (tmp_path / "good.json").read_text()
    random = np.random.default_rng(1)
    alphabet = list('0123456789.-eE"[]{},:abtfn ')
    refused = loaded = 0
    for _ in range(200):
        mutated = list(text)
        for _ in range(random.integers(1, 4)):
            mutated[random.integers(len(mutated))] = alphabet[random.integers(len(alphabet))]
        try:
            read_scene("".join(mutated), tmp_path)
            loaded += 1
        except FileError:
            refused += 1
    assert refused > 60 and loaded > 5
