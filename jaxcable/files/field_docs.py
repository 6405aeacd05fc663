"""What docstrings say about classes and fields of scene files: descriptions and units.

The docstring of a class is the one source for its fields, also for classes of users. A
description such as "weight per length, scalar or [n_elem], N/m; it acts ..." says that numbers are
in N/m: the unit follows a comma and ends its clause. Numbers that have none say "without unit".
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Iterator, Mapping

from ..common.units import is_unit

OF_PHASE_INPUT = "of the phase input"
"""What stands in place of the unit of numbers that a phase states of elements."""

_OTHER_SECTIONS = ("Options:", "Returns:", "Raises:", "Source:", "Example:")
_SAME = ("as of `", "as for `")
_LIKE = "Arguments and errors are those of `"
_WORDS = {"None": "null", "True": "true", "False": "false"}
_WORD = re.compile(r"\b(None|True|False)\b")  # JSON has other words for them
_TUPLE = re.compile(r"(`*)\((-?\w+(?:, -?\w+){2})\)\1")  # JSON has lists only


def class_summary(cls: type) -> str:
    """Return the first paragraph of the docstring of a class, on one line."""
    return " ".join((inspect.getdoc(cls) or cls.__name__).split("\n\n")[0].split())


def field_descriptions(cls: type, classes: Mapping[str, type]) -> dict[str, str]:
    """Return the description of each field in the docstring of a class, one line by field.

    Fields are entries of "Args" or "Attributes", or items of a list with their name in front. An
    entry like "as of `Bars`" is replaced by the description in the docstring of that class.

    Args:
        cls: the class.
        classes: other classes, by the names under which docstrings refer to them.
    """
    text = inspect.getdoc(cls) or ""
    like = " ".join(text.split()).partition(_LIKE)[2].partition("`")[0]
    found = field_descriptions(classes[like], classes) if like in classes else {}
    for names, words in _described_fields(text):
        for name in names:
            told = _resolve_reference(name, words, classes)
            told = _TUPLE.sub(r"[\2]", _WORD.sub(lambda word: _WORDS[word[0]], told))
            found[name] = told.replace("``", "`")
    return found


def _described_fields(text: str) -> Iterator[tuple[list[str], str]]:
    """Yield (names, text) for each entry of a docstring that describes fields.

    `names` are the fields of the entry, a list, and the text is its description on one line.
    """
    names: list[str] = []
    words: list[str] = []
    deeper = ""
    for line in [*text.split("\n"), _OTHER_SECTIONS[0]]:
        begin = next((one for one in ("    ", "- ") if line.startswith(one)), None)
        head, colon, rest = line[len(begin or "") :].partition(":")
        if names and line.startswith(deeper):
            words += line.split()
            continue
        if names:
            yield names, " ".join(words)
        if line.startswith(_OTHER_SECTIONS):
            return
        fields = head.split(", ")
        names = fields if begin and colon and all(map(str.isidentifier, fields)) else []
        words, deeper = rest.split(), "  " if begin == "- " else " " * 5


def _resolve_reference(name: str, words: str, classes: Mapping[str, type]) -> str:
    """Return the description of a field, with "as of `Bars`" replaced by what that class says.

    `words` is the description in the docstring, and `classes` has classes by name.
    """
    other, _, own = words.partition("`")[2].partition("`")
    if not words.startswith(_SAME) or other not in classes:
        return words
    own = own[own[:1] in (";", ".") :].removeprefix(" ")
    own = own if name in own.lower() else ""  # what is added there may concern another one
    return " ".join((field_descriptions(classes[other], classes).get(name, ""), own)).strip()


def unit_in_description(text: str) -> str | None:
    """Return the unit that the description of a field states; None if it states none.

    "-" is that of numbers without unit, and `OF_PHASE_INPUT` that of what a phase states.
    """
    for clause in text.split(", "):
        head = clause.partition(" (")[0]
        for end in ".,;:)":
            head = head.partition(end)[0]
        if head[:1].isalnum() and is_unit(head):
            return head
        if "without unit" in clause:
            return "-"
        if "in the unit of what is stated" in clause:
            return OF_PHASE_INPUT
    return None


def field_units(cls: type, classes: Mapping[str, type]) -> dict[str, str]:
    """Return the unit of each field of a class whose docstring states one, a dict by field.

    Args:
        cls: the class.
        classes: other classes, by the names under which docstrings refer to them.
    """
    return _cached_field_units(cls, tuple(classes.items()))


@functools.lru_cache(256)
def _cached_field_units(cls, classes):
    """Return units by field as `field_units`, cached; `classes` are pairs (name, class)."""
    described: dict[str, str] = {}
    for base in reversed(cls.__mro__[:-1]):  # inherited fields are described there
        described |= field_descriptions(base, dict(classes))
    own = field_descriptions(cls, dict(classes))
    if getattr(cls, "face", None) is not None and "weight" not in own:
        described.pop("weight", None)  # of faces it is per area, of their bases per length
    units = {name: unit_in_description(text) for name, text in described.items()}
    return {name: unit for name, unit in units.items() if unit is not None}


def may_have_unit(cls: type, name: str, annotation: str) -> bool:
    """Return whether a field may hold numbers that have a unit, judged by its annotation.

    Indices, flags and texts have none. Without an annotation that says so (in a user's class) any
    field that is not one of indices may.
    """
    # without postponed annotations the text is that of a class
    annotation = annotation.removeprefix("<class '").removesuffix("'>")
    if "Float" in annotation or annotation in ("float", "float | None"):
        return True
    plain = annotation in ("object", "Any", "typing.Any", "ArrayLike", "ArrayLike | None")
    return plain and name not in getattr(cls, "_index_fields", ())
