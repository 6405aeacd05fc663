"""What docstrings say of the fields of a class, for the schema of scene files."""

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


def summary(cls: type) -> str:
    """The first paragraph of the docstring of a class, on one line."""
    return " ".join((inspect.getdoc(cls) or cls.__name__).split("\n\n")[0].split())


def explained(cls: type, classes: Mapping[str, type]) -> dict[str, str]:
    """What the docstring of a class says of its fields: dict from name to text, on one line.

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
        found |= explained(classes[like[1]], classes)
    for in_section, its_words, in_list, words in _ENTRY.findall(text):
        told = " ".join((its_words or words).split())
        for name in (in_section or in_list).split(", "):
            found[name] = _in_json(_resolved(name, told, classes))
    return found


def _in_json(words):
    """Words of a docstring with the constants and the lists of JSON."""
    words = _WORD.sub(lambda found: _WORDS[found[0]], words)
    return _TUPLE.sub(r"[\2]", words).replace("``", "`")


def _resolved(name, words, classes):
    """What is said of a field; with what another class says of it, if it is the same there."""
    same = _SAME.match(words)
    if same is None or same[1] not in classes:
        return words
    own = same[2] if name in same[2].lower() else ""  # what is added there may concern another one
    return " ".join((explained(classes[same[1]], classes).get(name, ""), own)).strip()
