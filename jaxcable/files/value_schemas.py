"""JSON Schemas of the values of a field, from its annotation: shapes of arrays, texts, objects.

An annotation such as ``Float[ArrayLike, "n 3"] | None`` says which axes an array has. A number is
an axis of this length, ``2+`` one of at least this length, ``3or4`` one of either; ``...`` and
``*shape`` are axes that may be missing; other names are axes of any length, not zero if they begin
with ``n_``.

What a value may be is told by its JSON type first, and then by the depth and the width of lists:
``if`` and ``then``, not ``anyOf``, whose errors name no place inside of the value. Definitions that
several fields share have no description: editors would show it instead of the field's own. Texts
that a field can have are those of ``Literal["initial", "projected"]``.
"""

from __future__ import annotations

import ast
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
    "bool": {"type": "boolean"},
    "int": {"type": "integer", "minimum": 0},
    "float": {"type": "number"},
    "str": {"type": "string"},
    "Key": {"type": ["string", "integer", "null"]},
    "Profile": {"type": "string"},
    "Sequence[str]": {"type": ["string", "array"], "items": {"type": "string"}},
}
_NAMED: dict[str, tuple[list[str], str]] = {  # types and name of what has a definition of its own
    "Law": (["object"], "law"),
    "Load": (["object"], "load"),
    "WindProfile": (["object"], "wind_profile"),
    "Sequence[Law]": (["array", "object"], "laws"),
    "Sequence[Load]": (["array", "object"], "loads"),
    "tuple[int, ...]": (["array", "object"], "counts"),
    "PyTree[Element]": (["object", "array"], "elements"),
    "AnySection": (["object"], "section"),
}
_MIXED = {  # alternatives that have one definition together
    "Load | Sequence[Load]": "Sequence[Load]",
    "str | Sequence[str] | PyTree[Bool": "PyTree[Bool",
    " | Solution | State | None": " | None",  # no file holds results
    "Solution | State | None": "None",
    "Section | LinearSection": "AnySection",
}


def reference(name: str) -> Schema:
    """Return the schema {"$ref": ...} that refers to the shared definition of this name."""
    return {"$ref": f"#/$defs/{name}"}


def value_schema(
    annotation: str,
    classes: Collection[str],
    defs: dict[str, Schema],
    bound: Schema | None = None,
    each: bool = False,
) -> Schema:
    """Return the schema of the values that a field with this annotation can have.

    Args:
        annotation: annotation of the field, as text; an unknown one allows anything.
        classes: names of classes whose objects have a definition of their own.
        defs: definitions of the whole schema, to which those of arrays are added.
        bound: bound of the numbers, as ``{"minimum": 0}``; None for none.
        each: whether one value can stand for the values of all elements.
    """
    for several, one in _MIXED.items():
        annotation = annotation.replace(several, one)
    words = _union_members(ast.parse(annotation, mode="eval").body)
    null = ["null"] if "None" in words else []
    arrays: dict[str, list[tuple[str, ...]]] = {}
    ways: list[Schema] = []
    for word in words:
        if (array := _ARRAY.match(word)) is not None:
            arrays.setdefault(array[1], []).extend(_array_shapes(array[1], array[3], each))
        elif word != "None":
            ways.append(_plain_schema(word, classes, bound, null))
    if {} in ways:  # an unknown annotation
        return {}
    several_kinds = [
        _define_array_schema(kind, shapes, bound, defs, null if len(arrays) == 1 else ())
        for kind, shapes in arrays.items()
    ]
    if several_kinds:
        ways.insert(0, several_kinds[0] if len(arrays) == 1 else {"anyOf": several_kinds})
    if not ways:
        return {"type": "null"}
    return ways[0] if len(ways) == 1 else {"anyOf": ways}


def _plain_schema(word, classes, bound, null):
    """Return the schema of one alternative of an annotation that is no array; {} if it is unknown.

    Args:
        word: the alternative as text, such as "bool" or "Law".
        classes: names of classes whose objects have a definition of their own.
        bound: bound of integers, as ``{"minimum": 0}``, or None.
        null: ["null"] if null is allowed, too, else [].
    """
    if word in _PLAIN:
        plain = {**_PLAIN[word], **((bound if word == "int" else None) or {})}
        types = plain["type"]
        return {**plain, "type": [types, *null]} if null and isinstance(types, str) else plain
    if word.startswith("Literal["):
        return {
            "enum": [*ast.literal_eval(word.removeprefix("Literal")), *([None] if null else [])]
        }
    if word in _NAMED or word in classes:
        types, name = _NAMED.get(word, (["object"], word))
        return {"type": [*types, *null], "if": {"type": types}, "then": reference(name)}
    if word.startswith("Mapping[str, PyTree[Float"):
        return {"type": ["object", *null], "additionalProperties": reference("input")}
    trees = {"PyTree[Float": "input", "PyTree[Bool": "change"}
    return next((reference(name) for begin, name in trees.items() if word.startswith(begin)), {})


def _union_members(annotation):
    """Return the alternatives of an annotation (a syntax tree), which ``|`` joins, as texts."""
    if isinstance(annotation, ast.BinOp):
        return [*_union_members(annotation.left), *_union_members(annotation.right)]
    return [ast.unparse(annotation)]


def _array_shapes(kind, axes, each):
    """Return the shapes that an array can have, a list of tuples of axes such as ("n_elem", "3").

    `kind` is "Float", "Int" or "Bool", and `axes` are those of the annotation, "n_elem 3". `each`
    says whether one value can stand for the values of all elements.
    """
    shapes = [()]
    for axis in axes.split():
        ways = {"...": ((), ("n",)), "3or4": (("3",), ("4",)), "*shape": ((), ("n",))}
        shapes = [(*shape, *way) for shape in shapes for way in ways.get(axis, ((axis,),))]
    alone = len(shapes) == 1 and len(shapes[0]) == 1
    if alone and ((each and shapes[0] == ("n_elem",)) or (kind == "Int" and shapes[0] == ("n",))):
        shapes.insert(0, ())  # one number for all elements, or one node
    return shapes


def _define_array_schema(kind, shapes, bound, defs, null):
    """Add the schema of arrays of some shapes to the definitions `defs`; return a reference to it.

    `kind` is "Float", "Int" or "Bool", and `shapes` are tuples of axes, () for a single number.
    Null is allowed if `null` is ["null"].
    """
    word, item = _ITEMS[kind]
    item = {**item, **(bound or {})}
    lengths = [tuple(map(_axis_length, shape)) for shape in dict.fromkeys(shapes)]
    limits = [{"exclusiveMinimum": "above", "minimum": "from"}[key] for key in bound or {}]
    limits += [str(limit) for limit in (bound or {}).values()]
    shown = ["_".join(shape) or "one" for shape in lengths]
    name = "_".join((word, "_or_".join(shown), *limits, *null)).replace("+", "up")
    if name not in defs:
        types = [item["type"]] if () in lengths else []
        lists = [shape for shape in lengths if shape]
        types += ["array"] if lists else []
        plain = {
            **(item if () in lengths else {}),
            **(_nested_list_schema(lists, item) if lists else {}),
        }
        if kind == "Float":  # in single precision numbers are marked
            tag = {"const": "float32", "doNotSuggest": True}
            single = {"type": tag, "values": {**plain, "type": types}}
            marked = {"if": {"type": "object"}, "then": closed_object(single, ["type", "values"])}
            defs[name] = {"allOf": [marked], **plain, "type": [*types, "object", *null]}
        else:
            defs[name] = {**plain, "type": [*types, *null]}
        wanted = " or ".join(_describe_shape(word, shape) for shape in lengths)
        defs[name]["errorMessage"] = f"Expected {wanted}{', or null' if null else ''}."
    return reference(name)


def _describe_shape(word, lengths):
    """Return a shape in words, such as "a list [n, 3] of numbers", for messages of editors.

    `word` says what the items are, and `lengths` has the lengths of axes, as of `_axis_length`.
    """
    if not lengths:
        return {"number": "a number", "whole": "a whole number"}.get(word, "true or false")
    of = {"number": "numbers", "whole": "whole numbers"}.get(word, "true or false")
    axes = [axis.replace("n1", "n").replace("2+", "2 or more") for axis in lengths]
    return f"a list [{', '.join(axes)}] of {of}"


def _axis_length(axis):
    """Return the length of an axis as text: "3" or "2+", "n1" for any but zero, or "n" for any."""
    return axis if axis[0].isdigit() else "n1" if axis[:2] == "n_" else "n"


def _nested_list_schema(shapes, item):
    """Return the schema of nested lists that have one of the shapes; other values pass.

    Shapes are told apart by the depth of the lists, and those of one depth by their width.

    Args:
        shapes: tuples of lengths of axes: "3", "2+", "n1" (at least one) or "n" (any).
        item: schema of the numbers.
    """
    first = max(shapes, key=lambda shape: (len(shape), [-int(n) for n in shape if n.isdigit()]))
    nested = item
    for axis in reversed(first):
        nested = {"type": "array", "items": nested, **_list_length_limits(axis)}
    del nested["type"]
    others = [shape for shape in shapes if shape != first]
    if not others:
        return nested
    depth = len(first)
    deeper = all(len(shape) < depth for shape in others)
    test: Schema = {"type": "array"} if deeper else {"maxItems": int(first[-1])}
    for _ in range(depth - 1):
        test = {"items": test}
    return {"if": test, "then": nested, "else": _nested_list_schema(others, item)}


def _list_length_limits(axis):
    """Return ``minItems`` and ``maxItems`` of a list of length `axis`: "3", "2+", "n1" or "n"."""
    if axis == "n":
        return {}
    if axis == "n1":
        return {"minItems": 1}
    least = int(axis.rstrip("+"))
    return {"minItems": least} if axis.endswith("+") else {"minItems": least, "maxItems": least}


def closed_object(properties: Mapping[str, Schema], required: list[str]) -> Schema:
    """Return the schema of an object with these fields and no other, of which some are required."""
    return {
        "type": "object",
        "properties": dict(properties),
        "required": required,
        "additionalProperties": False,
    }
