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
}
_NAMED: dict[str, tuple[list[str], str]] = {  # types and name of what has a definition of its own
    "Law": (["object"], "law"),
    "Load": (["object"], "load"),
    "Sequence[Law]": (["array", "object"], "laws"),
    "Sequence[Load]": (["array", "object"], "loads"),
    "tuple[int, ...]": (["array", "object"], "counts"),
    "PyTree[Element]": (["object", "array"], "elements"),
}
_MIXED = {  # alternatives that have one definition together
    "Load | Sequence[Load]": "Sequence[Load]",
    "str | Sequence[str] | PyTree[Bool": "PyTree[Bool",
}
TAGS = ["list", "tuple"]
"""Names under "type" that belong to containers, not to classes."""


def ref(name: str) -> Schema:
    """The schema that is defined under a name."""
    return {"$ref": f"#/$defs/{name}"}


def if_type(kind: str, then: Schema) -> Schema:
    """`then`, for values of a JSON type."""
    return {"if": {"type": kind}, "then": then}


def if_named(names: Collection[str], then: Schema, otherwise: Schema) -> Schema:
    """`otherwise` for objects with one of some texts under "type", else `then`.

    The condition is negative: an editor asks for what fits while the text is not there yet.
    """
    other = {"type": {"not": {"enum": list(names)}, "doNotSuggest": True}}
    return {"if": {"properties": other}, "then": then, "else": otherwise}


def value(
    annotation: str,
    classes: Collection[str],
    defs: dict[str, Schema],
    bound: Schema | None = None,
    each: bool = False,
) -> Schema:
    """The schema of the values that a field with an annotation can have.

    Args:
        annotation: of the field; what it does not tell may be anything.
        classes: names of classes whose objects have a definition of their own.
        defs: definitions, to which those of arrays are added.
        bound: of the numbers, as ``{"minimum": 0}``.
        each: whether one value can stand for that of every element.
    """
    for several, one in _MIXED.items():
        annotation = annotation.replace(several, one)
    words = _alternatives(ast.parse(annotation, mode="eval").body)
    null, nothing = (["null"], [None]) if "None" in words else ([], [])
    arrays: dict[str, list[tuple[str, ...]]] = {}
    for word in words:
        if (array := _ARRAY.match(word)) is not None:
            arrays.setdefault(array[1], []).extend(_shapes(array[1], array[3], each))
    ways: list[Schema] = []
    if len(arrays) == 1:
        ((kind, shapes),) = arrays.items()
        ways = [_numbers(kind, shapes, bound, defs, null)]
    elif arrays:
        ways = [{"anyOf": [_numbers(kind, shapes, bound, defs) for kind, shapes in arrays.items()]}]
    for word in words:
        if word in _PLAIN:
            plain = {**_PLAIN[word], **((bound if word == "int" else None) or {})}
            if null and isinstance(plain["type"], str):
                plain["type"] = [plain["type"], *null]
            ways.append(plain)
        elif word.startswith("Literal["):
            ways.append({"enum": [*ast.literal_eval(word.removeprefix("Literal")), *nothing]})
        elif word in _NAMED or word in classes:
            types, name = _NAMED.get(word, (["object"], word))
            ways.append({"type": [*types, *null], "if": {"type": types}, "then": ref(name)})
        elif word.startswith("Mapping[str, PyTree[Float"):
            ways.append({"type": ["object", *null], "additionalProperties": ref("statement")})
        elif word.startswith(("PyTree[Float", "PyTree[Bool")):
            ways.append(ref("statement" if word.startswith("PyTree[Float") else "change"))
        elif word != "None" and _ARRAY.match(word) is None:
            return {}
    if not ways:
        return {"type": "null"}
    return ways[0] if len(ways) == 1 else {"anyOf": ways}


def _alternatives(annotation):
    """The parts of a parsed annotation that ``|`` joins, as texts."""
    if isinstance(annotation, ast.BinOp):
        return [*_alternatives(annotation.left), *_alternatives(annotation.right)]
    return [ast.unparse(annotation)]


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


def _numbers(kind, shapes, bound, defs, null=()):
    """A reference to the schema of numbers of some shapes, which is added to the definitions."""
    word, item = _ITEMS[kind]
    item = {**item, **(bound or {})}
    lengths = [tuple(map(_length, shape)) for shape in dict.fromkeys(shapes)]
    limits = [{"exclusiveMinimum": "above", "minimum": "from"}[key] for key in bound or {}]
    limits += [str(limit) for limit in (bound or {}).values()]
    shown = ["_".join(shape) or "one" for shape in lengths]
    name = "_".join((word, "_or_".join(shown), *limits, *null)).replace("+", "up")
    if name not in defs:
        types = [item["type"]] if () in lengths else []
        lists = [shape for shape in lengths if shape]
        types += ["array"] if lists else []
        plain = {**(item if () in lengths else {}), **(_lists(lists, item) if lists else {})}
        if kind == "Float":  # in single precision numbers are marked
            single = tagged("float32", "values", {**plain, "type": types})
            marked = [*types, "object", *null]
            defs[name] = {"allOf": [if_type("object", single)], **plain, "type": marked}
        else:
            defs[name] = {**plain, "type": [*types, *null]}
        wanted = " or ".join(_shown(word, shape) for shape in lengths)
        defs[name]["errorMessage"] = f"Expected {wanted}{', or null' if null else ''}."
    return ref(name)


def _shown(word, lengths):
    """A shape in words, for messages of editors."""
    if not lengths:
        return {"number": "a number", "whole": "a whole number"}.get(word, "true or false")
    of = {"number": "numbers", "whole": "whole numbers"}.get(word, "true or false")
    axes = [axis.replace("n1", "n").replace("2+", "2 or more") for axis in lengths]
    return f"a list [{', '.join(axes)}] of {of}"


def _length(axis):
    """The length of an axis: a number, "n1" for any but zero, or "n"."""
    return axis if axis[0].isdigit() else "n1" if axis[:2] == "n_" else "n"


def _lists(shapes, item):
    """What lists of some shapes keep: the deepest are told by their depth, others by their width.

    It holds for lists only; other values pass.
    """
    first = max(shapes, key=lambda shape: (len(shape), [-int(n) for n in shape if n.isdigit()]))
    nested = item
    for axis in reversed(first):
        nested = {"type": "array", "items": nested, **_limits(axis)}
    del nested["type"]
    others = [shape for shape in shapes if shape != first]
    if not others:
        return nested
    depth = len(first)
    deeper = all(len(shape) < depth for shape in others)
    test: Schema = {"type": "array"} if deeper else {"maxItems": int(first[-1])}
    for _ in range(depth - 1):
        test = {"items": test}
    return {"if": test, "then": nested, "else": _lists(others, item)}


def _limits(axis):
    """Limits of the length of a list."""
    if axis == "n":
        return {}
    if axis == "n1":
        return {"minItems": 1}
    least = int(axis.rstrip("+"))
    return {"minItems": least} if axis.endswith("+") else {"minItems": least, "maxItems": least}


def tagged(name: str, field: str, content: Schema) -> Schema:
    """The schema of an object with its name under "type", and one field."""
    return closed({"type": {"const": name, "doNotSuggest": True}, field: content}, ["type", field])


def tags(content: Schema) -> Schema:
    """The schema of the marked lists and tuples with some content."""
    kinds: Schema = {"type": {"enum": TAGS, "doNotSuggest": True}}
    return closed({**kinds, "items": {"type": "array", "items": content}}, ["type", "items"])


def closed(properties: Mapping[str, Schema], required: list[str]) -> Schema:
    """The schema of an object with these fields and no other."""
    return {
        "type": "object",
        "properties": dict(properties),
        "required": required,
        "additionalProperties": False,
    }
