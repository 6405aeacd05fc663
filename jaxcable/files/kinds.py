"""JSON Schemas of the values of a field, from its annotation: shapes of arrays, texts, objects.

An annotation such as ``Float[ArrayLike, "n 3"] | None`` says which axes an array has. A number is
an axis of this length, ``2+`` one of at least this length, ``3or4`` one of either; ``...`` and
``*shape`` are axes that may be missing; other names are axes of any length, not zero if they begin
with ``n_``.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

Schema = dict[str, Any]
"""A JSON Schema, or a part of one."""

_ARRAY = re.compile(r"^(Float|Int|Bool)\[\w+, (['\"])(.*?)\2\]$")
_ITEMS: dict[str, tuple[str, Schema]] = {
    "Float": ("number", {"type": "number"}),
    "Int": ("whole", {"type": "integer", "minimum": 0}),
    "Bool": ("boolean", {"type": "boolean"}),
}
_PLAIN: dict[str, Schema] = {
    "None": {"type": "null"},
    "bool": {"type": "boolean"},
    "int": {"type": "integer", "minimum": 0},
    "float": {"type": "number"},
    "str": {"type": "string"},
    "Key": {"type": ["string", "integer", "null"]},
    "Sequence[str]": {"type": "array", "items": {"type": "string"}, "minItems": 1},
}
_NAMED = {  # annotations of values that have a definition of their own
    "Law": "law",
    "Load": "load",
    "Sequence[Law]": "laws",
    "Sequence[Load]": "listOfLoads",
    "tuple[int, ...]": "counts",
    "PyTree[Element]": "elements",
}
_WHOLE = "The reader takes whole numbers without a decimal point only."


def ref(name: str) -> Schema:
    """The schema that is defined under a name."""
    return {"$ref": f"#/$defs/{name}"}


def united(options: list[Schema]) -> Schema:
    """The schema of values that any of several schemas takes."""
    return options[0] if len(options) == 1 else {"anyOf": options}


def options(
    annotation: str,
    classes: Collection[str],
    defs: dict[str, Schema],
    bound: Schema | None = None,
    each: bool = False,
) -> list[Schema]:
    """Schemas of the values that a field with an annotation can have, a list.

    Args:
        annotation: of the field; what it does not tell may be anything.
        classes: names of classes whose objects have a definition of their own.
        defs: definitions, to which those of arrays are added.
        bound: of the numbers, as ``{"minimum": 0}``.
        each: whether one value can stand for that of every element.
    """
    found: list[Schema] = []
    for word in _alternatives(annotation):
        array = _ARRAY.match(word)
        if array is not None:
            for axes in _shapes(array[1], array[3], each):
                found.append(_array(array[1], axes, bound, defs))
        elif word in _PLAIN:
            found.append({**_PLAIN[word], **((bound if word == "int" else None) or {})})
        elif word in classes:
            found.append(ref(word))
        elif word in _NAMED:
            found.append(ref(_NAMED[word]))
        elif word.startswith("PyTree[Float"):
            found.append(ref("statement"))
        elif word.startswith("PyTree[Bool"):
            found.append(ref("choice"))
        else:
            return [{}]
    return found


def _alternatives(annotation):
    """The parts of an annotation that ``|`` joins, outside of brackets."""
    parts, depth = [""], 0
    for character in annotation:
        depth += {"[": 1, "]": -1}.get(character, 0)
        if character == "|" and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts]


def _shapes(kind, axes, each):
    """The shapes that an array can have, a list of tuples of axes."""
    shapes = [()]
    for axis in axes.split():
        ways = {"...": ((), ("n",)), "3or4": (("3",), ("4",)), "*shape": ((), ("n",))}
        shapes = [(*shape, *way) for shape in shapes for way in ways.get(axis, ((axis,),))]
    alone = len(shapes) == 1 and len(shapes[0]) == 1
    if alone and ((each and shapes[0] == ("n_elem",)) or (kind == "Int" and shapes[0] == ("n",))):
        shapes.insert(0, ())  # one number for all elements, or one node
    return shapes


def _array(kind, axes, bound, defs):
    """A reference to the schema of an array, which is added to the definitions."""
    word, item = _ITEMS[kind]
    item = {**item, **(bound or {})}
    lengths = [axis if axis[0].isdigit() else "n1" if axis[:2] == "n_" else "n" for axis in axes]
    limits = [{"exclusiveMinimum": "above", "minimum": "from"}[key] for key in bound or {}]
    limits += [str(value) for value in (bound or {}).values()]
    name = "_".join((word, *lengths, *limits)).replace("+", "up")
    if name not in defs:
        nested = item
        for axis in reversed(lengths):
            nested = {"type": "array", "items": nested, **_limits(axis)}
        shown = ", ".join(axis if axis.isdigit() else "n" for axis in lengths)
        title = f"array [{shown}]" if axes else word
        told: Schema = {"description": _WHOLE} if kind == "Int" else {}
        defs[name] = {"title": title, **told, **(_either(nested) if kind == "Float" else nested)}
    return ref(name)


def _limits(axis):
    """Limits of the length of a list."""
    if axis == "n":
        return {}
    if axis == "n1":
        return {"minItems": 1}
    least = int(axis.rstrip("+"))
    return {"minItems": least} if axis.endswith("+") else {"minItems": least, "maxItems": least}


def _either(numbers):
    """Numbers in double precision, or in single precision, which are marked."""
    return {"anyOf": [numbers, tagged("float32", "values", numbers)]}


def tagged(name: str, field: str, content: Schema) -> Schema:
    """The schema of an object with its name under "type", and one field."""
    return closed({"type": {"const": name}, field: content}, ["type", field])


def closed(properties: Mapping[str, Schema], required: list[str]) -> Schema:
    """The schema of an object with these fields and no other."""
    return {
        "type": "object",
        "properties": dict(properties),
        "required": required,
        "additionalProperties": False,
    }
