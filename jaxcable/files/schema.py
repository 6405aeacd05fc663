"""The JSON Schema of scene files, made from the classes whose objects files can hold.

Names and kinds of fields are those of the classes: their annotations say which values they take
(`kinds`), their docstrings what they are (`explained`), the rules of their numbers where these end,
and a field "set by" something is not offered to persons. What holds for every field of a kind, and
how containers are written, stands here. `scene.schema.json` beside this module is the schema as
text: ``python -m jaxcable schema --save jaxcable/files/scene.schema.json`` writes it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from ..analysis.phases import Phase
from ..common.selection import Selection
from ..elements.element import Element
from ..loads.load import Load
from ..materials.law import Law
from ..model.supports import Supports
from ..sections import Section
from .codec import COMMENT, IMPLIED, TYPED, TYPES, has_no_default, stated
from .examples import examples, snippets
from .explained import explained, summary
from .kinds import TAGS, Schema, closed, if_named, if_type, ref, tagged, tags, value
from .scene import FORMAT, MOST_INCREMENTS, VERSION
from .together import together

_DIALECT = "https://json-schema.org/draft/2020-12/schema"

_NEEDED = {
    *(("Structure", "supports"), ("Beams", "section"), ("Catenaries", "axial_stiffness")),
    *(("AreaLoads", "forces"), ("FacePressure", "pressure")),
}
"""Fields that have a default and are needed all the same."""

_COUNTS: dict[tuple[str, str], Schema] = {
    ("Beams", "points"): {"minimum": 3, "maximum": 1000},
    ("Phase", "increments"): {"minimum": 1, "maximum": MOST_INCREMENTS},
}
"""Bounds of whole numbers, which no rule states."""

_BY_GROUP = {
    "PyTree[Float": (
        ' One number for all groups that can take it, or by group, {"guys": 1.0}, or for some '
        'elements of a group, {"guys": {"type": "Only", "elements": [0], "values": 1.0}}; groups '
        "that are left out have none. One number for all passes by beams where there are cables or "
        "bars (if it is a temperature, by groups without `expansion`); name the group to state it "
        "of beams."
    ),
    "PyTree[Bool": (
        ' Keys of groups are a text or a list of texts, elements of groups {"deck": {"type": '
        '"Selection", "elements": [0, 1]}}.'
    ),
}
"""How fields are written that state something by group, by how their annotations begin."""

_COMMENT: Schema = {"description": "anything, such as a text or a list of lines; it is not read"}
_BEYOND = (
    "Reading also refuses what a schema cannot say: numbers of nodes or elements, and keys of "
    "groups, that the structure does not have; arrays that shall have one length and do not; "
    "links without length, equal or repeated; parts without supports; loads and prestress that "
    "elements cannot take; laws whose points are no curve; whole numbers with a decimal point, "
    "numbers of more than 64 bits, the same field twice in one object. Of a list of numbers it "
    'also takes the form {"type": "list", "items": [...]}, and single numbers in it as '
    '{"type": "float32", ...}, which no field needs.'
)


_OFFERED: dict[tuple[str, ...], type] = {
    **{words: base for base, (words, _) in TYPED.items()},
    **{(cls.__name__,): cls for cls in (Section, Supports, Selection)},
}
"""What editors offer examples of, by how annotations begin."""


def scene_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of scene files, which `load_scene` reads.

    Editors that know it explain, complete and check what is typed: names and units of all fields,
    what is needed, which texts are known. It refuses nothing that `load_scene` takes; `load_scene`
    refuses more, such as numbers of nodes that the structure does not have, and the description
    says what. Classes that `register` has added are in it. ``jaxcable schema`` prints it.

    Returns:
        The schema as plain data, a dict.

    Example:
        >>> schema = jc.files.scene_schema()
        >>> links = schema["$defs"]["Cables"]["properties"]["links"]
        >>> print(links["description"])
        node numbers, [n_elem, 2].
    """
    defs: dict[str, Schema] = {}
    objects = {name: _object(cls, defs) for name, cls in TYPES.items()}
    return {
        "$schema": _DIALECT,
        "$id": f"urn:jaxcable:scene:{VERSION}",
        "title": "jaxcable scene",
        "description": "A structure of cables, bars and beams, and the phases in which it is "
        f"prestressed and loaded; SI units; nodes and elements are numbered from 0. {_BEYOND}",
        "examples": [examples()["scene"]],
        **closed(
            {
                "$schema": {"type": "string", "description": "place of this schema, for editors"},
                "format": {"const": FORMAT, "description": "says what the file is"},
                "version": {
                    "enum": list(range(1, VERSION + 1)),
                    "description": "of the format; a whole number",
                },
                COMMENT: _COMMENT,
                "structure": {
                    "description": "nodes, elements and supports",
                    **value("Structure", TYPES, defs),
                },
                "phases": {
                    "description": "stages of the analysis, one after the other",
                    "type": "array",
                    "items": {"defaultSnippets": snippets(["Phase"]), **ref("Phase")},
                    "minItems": 1,
                },
            },
            ["format", "version", "structure", "phases"],
        ),
        "$defs": {**objects, **_values(), **dict(sorted(defs.items()))},
    }


def _object(cls, defs):
    """The schema of the objects of a class; what the class is stands at its `type`."""
    name, told, bounds = cls.__name__, explained(cls, TYPES), _bounds(cls)
    fields = {field.name: _field(cls, field, told, bounds, defs) for field in stated(cls)}
    needs = [f.name for f in stated(cls) if has_no_default(f) or (name, f.name) in _NEEDED]
    named = cls not in (*IMPLIED.values(), Phase)
    kind: Schema = {"const": name, "description": f"{name}: {summary(cls)}"}
    shown = list(examples()["classes"].get(name, {}).values())
    return {
        **closed(
            {
                "type": kind if named else {**kind, "doNotSuggest": True},
                COMMENT: _COMMENT,
                **fields,
            },
            (["type"] if named else []) + needs,
        ),
        **together(cls),
        **({"examples": shown} if shown else {}),
    }


def _annotation(cls, field):
    """The annotation of a field as text; metadata without a value are set by the constructor."""
    kind = field.type  # text, but for a class without postponed annotations
    text = kind if isinstance(kind, str) else getattr(kind, "__name__", "Any")
    absent = field.default is None and field.name in getattr(cls, "_static_fields", ())
    return f"{text} | None" if absent and "None" not in text else text


def _bounds(cls):
    """Bounds of numbers by field, from the rules of a class: above zero, or not below it."""
    limits = {(True, True): {"exclusiveMinimum": 0}, (True, False): {"minimum": 0}}
    found: dict[str, Schema] = {}
    # rules of a user's class may need its numbers
    with contextlib.suppress(AttributeError, IndexError, TypeError, ValueError):
        bare = object.__new__(cls)
        vars(bare).update(dict.fromkeys(cls.__dataclass_fields__))
        for rule in bare.rules() if hasattr(cls, "rules") else ():
            if rule.values is None:
                broken = tuple(np.ravel(rule.broken(np.array([-1.0, 0.0]))))
                found |= {rule.name: limits[broken]} if broken in limits else {}
    return found


def _field(cls, field, told, bounds, defs):
    """The schema of a field of a class, with its description."""
    annotation = _annotation(cls, field)
    text = told.get(field.name) or f"of the {cls.__name__}"
    text += "".join(more for words, more in _BY_GROUP.items() if words in annotation)
    about: Schema = {"description": text}
    if isinstance(field.default, bool | int | str):
        about["default"] = field.default
    if shown := examples()["fields"].get(cls.__name__, {}).get(field.name):
        about["examples"] = shown
    if annotation == "None" or "set by " in text:
        about["doNotSuggest"] = True
    for words, base in _OFFERED.items():
        if annotation.startswith(words):
            about["defaultSnippets"] = snippets(_names(base))
    bound = _COUNTS.get((cls.__name__, field.name), bounds.get(field.name))
    return {**about, **value(annotation, TYPES, defs, bound, issubclass(cls, Element))}


def _names(base):
    """Names of the classes that derive from one, a list."""
    return [name for name, cls in TYPES.items() if issubclass(cls, base)]


def _values():
    """Definitions of values that are not objects of one class."""
    flag, number, text = ({"type": kind} for kind in ("boolean", "number", "string"))
    numbers = {"type": ["number", "array"], "items": number, "minItems": 1}
    single = tagged("float32", "values", numbers)
    choices = ["object", "boolean", "array", "null"]
    return {
        "group": _any_of(Element),
        "load": _any_of(Load),
        "law": _any_of(Law),
        "laws": _listed(ref("law")),
        "loads": _listed(ref("load")),
        "counts": {**_listed({"type": "integer"}), "minItems": 1},
        "elements": _by_group(
            ["object", "array"],
            "a group of elements, or an object or a list of groups",
            _names(Element),
            "part",
            {"items": {"type": "object"}},
        ),
        "part": {
            "if": {"not": {"type": "null"}},
            "then": ref("elements"),
            "defaultSnippets": snippets(_names(Element)),
        },
        "statement": _by_group(
            ["object", "number", "array", "null"],
            "a number, a list of numbers, or these by group",
            ["Only"],
            "statement",
            {"items": {"type": ["number", "array"], "items": number}},  # components, in rows
            {"float32": single},
        ),
        "choice": _by_group(
            choices,
            "Selection, true or false, or a list of true and false",
            ["Selection"],
            "choice",
            {"items": flag},
        ),
        "change": _by_group(
            ["string", *choices],
            "the key of a group, a list of keys, or choices by group",
            ["Selection"],
            "choice",
            {"if": {"contains": text}, "then": {"items": text}, "else": {"items": flag}},
        ),
    }


def _any_of(base):
    """The schema of objects of all classes that derive from a class, told by their `type`."""
    names = _names(base)
    return {
        "type": "object",
        "required": ["type"],
        "properties": {
            "type": {
                "description": "which kind it is",
                "enum": names,
                "enumDescriptions": [summary(TYPES[name]) for name in names],
            }
        },
        "allOf": [
            {
                "if": {
                    "required": ["type"],
                    "properties": {"type": {"const": name, "doNotSuggest": True}},
                },
                "then": ref(name),
            }
            for name in names
        ],
        "defaultSnippets": snippets(names),
    }


def _listed(item):
    """The schema of one item or a list of them."""
    marked = if_type("object", if_named(TAGS, item, tags(item)))
    return {"type": ["array", "object"], "items": item, **marked}


def _by_group(
    types: Sequence[str],
    expected: str,
    names: Sequence[str],
    each: str,
    values: Schema,
    marked: Mapping[str, Schema] = MappingProxyType({}),
) -> Schema:
    """The schema of values for a structure: plain ones, objects of some classes, or by group.

    Args:
        types: JSON types that it can have.
        expected: what it can be, in words for an error.
        names: classes whose objects it can be.
        each: the definition of its parts: values under the keys of groups, or items of a list.
        values: the schema of lists that have no objects in them.
        marked: schemas of objects with another text under "type".
    """
    text = {"type": "string", "description": "the class of this object", "examples": names}
    content = {
        "if": {"required": ["type"], "properties": {"type": text}},
        "then": ref(names[0] if len(names) == 1 else "group"),
        "else": {"additionalProperties": ref(each)},
    }
    for tag, schema in marked.items():
        content = if_named([tag], content, schema)
    content = if_named(TAGS, content, tags(ref(each)))
    return {
        "type": list(types),
        "errorMessage": f"Expected {expected}.",
        "if": {"type": "array", "contains": {"type": "object"}},
        "then": {"items": ref(each)},
        "else": values,
        "allOf": [if_type("object", content)],
    }
