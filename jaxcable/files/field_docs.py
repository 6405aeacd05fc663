"""Descriptions of classes and fields for the schema of scene files, taken from docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping

_NAMES = r"(\w+(?:, \w+)*): ?"
_ENTRY = re.compile(
    rf"^(?:    {_NAMES}(.*(?:\n {{5,}}.*)*)|- {_NAMES}(.*(?:\n  .*)*))", re.MULTILINE
)
"""Names of fields and what is said of them: in a section, or in an item of a list."""
_OTHERS = re.compile(r"^(?:Options|Returns|Raises|Source|Example):", re.MULTILINE)
_SAME = re.compile(r"^as (?:of|for) `(\w+)`[;.]? ?(.*)$")
_WORDS = {"None": "null", "True": "true", "False": "false"}
_WORD = re.compile(r"\b(None|True|False)\b")  # JSON has other words for them
_TUPLE = re.compile(r"(`*)\((-?\w+(?:, -?\w+){2})\)\1")  # JSON has lists only
_LIKE = re.compile(r"Arguments and errors are those of\s+`(\w+)`")


def class_summary(cls: type) -> str:
    """Return the first paragraph of the docstring of a class, on one line."""
    return " ".join((inspect.getdoc(cls) or cls.__name__).split("\n\n")[0].split())


def field_descriptions(cls: type, classes: Mapping[str, type]) -> dict[str, str]:
    """Return what the docstring of a class says about each field: a dict from field to one line.

    Fields are entries of "Args" or "Attributes", or items of a list with their name in front. An
    entry like "as of `Bars`" is replaced by what the docstring of that class says.

    Args:
        cls: the class.
        classes: other classes, by the names under which docstrings refer to them.
    """
    text = _OTHERS.split(inspect.getdoc(cls) or "")[0]
    found: dict[str, str] = {}
    like = _LIKE.search(text)
    if like is not None and like[1] in classes:
        found |= field_descriptions(classes[like[1]], classes)
    for in_section, its_words, in_list, words in _ENTRY.findall(text):
        told = " ".join((its_words or words).split())
        for name in (in_section or in_list).split(", "):
            found[name] = _python_to_json_words(_resolve_reference(name, told, classes))
    return found


def _python_to_json_words(words):
    """Return a description with None, True, False and tuples of Python written as in JSON."""
    words = _WORD.sub(lambda found: _WORDS[found[0]], words)
    return _TUPLE.sub(r"[\2]", words).replace("``", "`")


def _resolve_reference(name, words, classes):
    """Return the description of a field; for "as of `Bars`" that of the field in this class."""
    same = _SAME.match(words)
    if same is None or same[1] not in classes:
        return words
    own = same[2] if name in same[2].lower() else ""  # what is added there may concern another one
    return " ".join((field_descriptions(classes[same[1]], classes).get(name, ""), own)).strip()
