"""Units of the fields of scene files, as their docstrings state them.

A description such as "weight per length, scalar or [n_elem], N/m; it acts ..." says that numbers
are in N/m: the unit follows a comma and ends its clause. Numbers that have none say "without unit".
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping

from ..common.units import UNIT_PATTERN
from .field_docs import field_descriptions

OF_STATEMENT = "of the statement"
"""What stands in place of the unit of numbers that a phase states of elements."""

_UNIT = re.compile(rf"(?:^|, )({UNIT_PATTERN})(?=$|[.,;:)]| \()")
_NONE = re.compile(r"\bwithout unit\b")
_STATED = re.compile(r"\bin the unit of what is stated\b")


def unit_in_description(text: str) -> str | None:
    """Return the unit that the description of a field states; None if it states none.

    "-" is that of numbers without unit, and `OF_STATEMENT` that of what a phase states.
    """
    found = [
        (match.start(), unit)
        for pattern, unit in ((_UNIT, None), (_NONE, "-"), (_STATED, OF_STATEMENT))
        if (match := pattern.search(text)) is not None
        for unit in (unit or match[1],)
    ]
    return min(found)[1] if found else None


def field_units(cls: type, classes: Mapping[str, type]) -> dict[str, str]:
    """Return the unit of each field of a class whose docstring states one, a dict by field.

    Args:
        cls: the class.
        classes: other classes, by the names under which docstrings refer to them.
    """
    return _field_units(cls, tuple(classes.items()))


@functools.lru_cache(256)
def _field_units(cls, classes):
    """Return what `field_units` does; the classes are pairs, so that they can be hashed."""
    described: dict[str, str] = {}
    for base in reversed(cls.__mro__):  # fields that a class has of another one are described there
        if base is not object:
            described |= field_descriptions(base, dict(classes))
    if getattr(cls, "face", None) is not None and "weight" not in field_descriptions(
        cls, dict(classes)
    ):
        described.pop(
            "weight", None
        )  # of faces it is per area, of what they derive from per length
    units = {name: unit_in_description(text) for name, text in described.items()}
    return {name: unit for name, unit in units.items() if unit is not None}


def holds_numbers(cls: type, name: str, annotation: str) -> bool:
    """Return whether a field holds numbers that have a unit, by its annotation.

    Numbers of nodes and elements, flags and texts have none. A class of a user may have no
    annotations that say so: whatever is no index may be a number then.
    """
    # without postponed annotations the text is that of a class
    annotation = annotation.removeprefix("<class '").removesuffix("'>")
    if "Float" in annotation or annotation in ("float", "float | None"):
        return True
    plain = annotation in ("object", "Any", "typing.Any", "ArrayLike", "ArrayLike | None")
    return plain and name not in getattr(cls, "_index_fields", ())
