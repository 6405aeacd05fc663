"""Scene files with mistakes: the reader names the line or the field; the schema refuses them."""

import json
import sys
import tempfile
import warnings
from pathlib import Path

import jax
import numpy as np
import pytest
from file_cases import CHECK, GONE, MAST, changed, read_scene, stages

import jaxcable as jc
from jaxcable.files import FileError

GROUPS = ("structure", "elements")
GUYS, BEAM = (*GROUPS, "guys"), (*GROUPS, "mast")
STIFF = (*GUYS, "axial_stiffness")
WRONG = Path(__file__).with_name("wrong_scenes.json")
"""Mistakes in the file of a mast: what is put where, what the schema does, what the reader says.

Without a value the field is left out, and a text that ends with "..." is the beginning of one.
``python tests/files/test_bad_scenes.py`` writes what the schema does and the reader says now.
"""
MISTAKES = json.loads(WRONG.read_text("utf-8"))
SPEAKS = ("prefix", "pytree", "None", "<U", "dict", "ndarray is")


def answer(mistake, folder):
    """Return whether the schema refuses a mistake, and what the reader says of it."""
    data = changed(MAST, (mistake["at"], mistake.get("value", GONE)))
    with pytest.raises(FileError) as caught:
        read_scene(data, folder)
    return not CHECK.is_valid(data), str(caught.value)


@pytest.mark.filterwarnings("ignore::jaxcable.InputWarning")  # suspicious beside what is wrong
@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_named_and_refused_by_the_schema(name, tmp_path):
    refuses, text = answer(MISTAKES[name], tmp_path)
    assert refuses == MISTAKES[name]["schema refuses"]
    place, expected = f"{tmp_path / 'scene.json'}: ", MISTAKES[name]["says"]
    found = text[: len(place) + len(expected) - 3] + "..." if expected.endswith("...") else text
    assert found == place + expected and "\n" not in text
    assert not any(word in text for word in SPEAKS)


def rewrite(folder):
    """Write the answers to all mistakes as they are now."""
    rows = []
    for name, mistake in MISTAKES.items():
        mistake["schema refuses"], text = answer(mistake, folder)
        if not mistake["says"].endswith("..."):
            mistake["says"] = text.removeprefix(f"{folder / 'scene.json'}: ")
        stated = json.dumps({key: mistake[key] for key in mistake if key != "says"})[:-1]
        rows.append(f' "{name}": {stated},\n  "says": {json.dumps(mistake["says"])}}}')
    WRONG.write_text("{\n" + ",\n".join(rows) + "\n}\n", "utf-8")


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
        (TEXT[:-1].rstrip() + ",}", "not valid JSON: (remove the comma before }|Illegal trailing)"),
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
        assert len(errors[0].message) < 170  # which lists all kinds of elements
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


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    warnings.simplefilter("ignore", jc.InputWarning)
    with tempfile.TemporaryDirectory() as place:
        rewrite(Path(place))
