"""The JSON Schema of scene files, made from the classes whose objects files can hold.

Names and kinds of fields are those of the classes, what is said of them is in their docstrings;
only what neither of them tells stands here. `scene.schema.json` beside this module is the schema as
text: ``python -m jaxcable schema --save jaxcable/files/scene.schema.json`` writes it.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from ..analysis.phases import PLACES, Phase
from ..elements.element import Element
from ..loads import along, areas, pressure
from ..loads.load import Load
from ..materials.law import Law
from . import examples, texts
from .codec import COMMENT, IMPLIED, TYPES, stated
from .explained import explained, summary
from .kinds import Schema, closed, if_named, if_type, ref, tagged, tags, value
from .scene import FORMAT, MOST_INCREMENTS, VERSION
from .together import together

_DIALECT = "https://json-schema.org/draft/2020-12/schema"

_ENUMS: dict[tuple[str, str], tuple[str, ...]] = {
    ("Phase", "placed"): PLACES,
    ("LineLoads", "per"): along.PER,
    ("LineLoads", "geometry"): along.GEOMETRIES,
    ("AreaLoads", "per"): areas.PER,
    ("AreaLoads", "geometry"): along.GEOMETRIES,
    ("CablePressure", "per"): pressure.PER,
    ("Polygonal", "unloading"): ("reversible", "elastic"),
}

_TAKEN = {  # what constructors take, where the annotation has what they make of it
    ("Beams", "up"): "Float[ArrayLike, '... 3'] | None",
    ("Beams", "hinges"): "Bool[ArrayLike, 'n_elem 2'] | Bool[ArrayLike, 'n_elem 2 3'] | None",
    ("Beams", "springs"): "Float[ArrayLike, ''] | Float[ArrayLike, '2 3'] | "
    "Float[ArrayLike, 'n_elem 2 3'] | None",
    ("SlidingCables", "links"): "Int[ArrayLike, 'n_elem 2+']",
    ("Catenaries", "axial_stiffness"): "Float[ArrayLike, ' n_elem']",
    **{("Catenaries", name): "None" for name in ("area", "law", "section")},
    ("Supports", "mask"): "Bool[ArrayLike, 'n_node 3'] | Bool[ArrayLike, 'n_node 6'] | None",
    ("Only", "values"): "Float[ArrayLike, ''] | Float[ArrayLike, ' n']",
    ("Polygonal", "strain"): "Float[ArrayLike, '2+']",
    ("Polygonal", "stress"): "Float[ArrayLike, '2+']",
    ("Structure", "supports"): "Supports",
    ("Beams", "section"): "Section",
    ("Beams", "points"): "int | None",
    ("Section", "counts"): "tuple[int, ...] | None",
}
_NEEDED = {("Structure", "supports"), ("Beams", "section"), ("Catenaries", "axial_stiffness")}
"""Fields that have a default and are needed all the same."""

_RARE = {  # what programs write, and no person needs
    *((name, "count") for name in ("Only", "Selection")),
    *(("Section", name) for name in ("points", "cells", "placed")),
    *(("Catenaries", name) for name in ("area", "law", "section")),
    ("Polygonal", "endless"),
}

_ABOVE: Schema = {"exclusiveMinimum": 0}
_BOUNDS: dict[str | tuple[str, str], Schema] = {
    **{name: _ABOVE for name in ("axial_stiffness", "torsional_stiffness", "area", "E")},
    **{name: _ABOVE for name in ("rest_length", "strength")},
    **{name: {"minimum": 0} for name in ("weight", "compliance", "springs")},
    ("Beams", "points"): {"minimum": 3, "maximum": 1000},
    ("Phase", "increments"): {"minimum": 1, "maximum": MOST_INCREMENTS},
    ("Phase", "rest_length"): {},
}
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
        "examples": [examples.SCENE],
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
                    "items": {"defaultSnippets": examples.of_classes(["Phase"]), **ref("Phase")},
                    "minItems": 1,
                },
            },
            ["format", "version", "structure", "phases"],
        ),
        "$defs": {**objects, **_values(), **dict(sorted(defs.items()))},
    }


def _object(cls, defs):
    """The schema of the objects of a class; what the class is stands at its `type`."""
    name, told = cls.__name__, explained(cls, TYPES)
    needs = [field.name for field in stated(cls) if _needed(cls, field)]
    named = cls not in (*IMPLIED.values(), Phase)
    kind: Schema = {"const": name, "description": f"{name}: {_summary(cls)}"}
    shown = list(examples.CLASSES.get(name, {}).values())
    return {
        **closed(
            {
                "type": kind if named else {**kind, "doNotSuggest": True},
                COMMENT: _COMMENT,
                **{field.name: _field(cls, field, told, defs) for field in stated(cls)},
            },
            (["type"] if named else []) + needs,
        ),
        **together(cls),
        **({"examples": shown} if shown else {}),
    }


def _summary(cls):
    """What a class is, in a line."""
    return texts.CLASSES.get(cls.__name__) or summary(cls)


def _needed(cls, field):
    """Whether a field must be there."""
    nothing = dataclasses.MISSING
    bare = field.default is nothing and field.default_factory is nothing
    return bare or (cls.__name__, field.name) in _NEEDED


def _field(cls, field, told, defs):
    """The schema of a field of a class, with its description."""
    key = cls.__name__, field.name
    about: Schema = {
        "description": texts.FIELDS.get(key) or told.get(field.name) or f"of the {cls.__name__}"
    }
    if isinstance(field.default, bool | int | str):
        about["default"] = field.default
    if key in examples.FIELDS:
        about["examples"] = examples.FIELDS[key]
    if key in _RARE:
        about["doNotSuggest"] = True
    if key in _ENUMS:
        return {**about, "enum": list(_ENUMS[key])}
    annotation = _TAKEN.get(key, field.type)
    if not isinstance(annotation, str):  # of a class without postponed annotations
        annotation = getattr(annotation, "__name__", "")
    for words, names in _offered():
        if annotation.startswith(words):
            about["defaultSnippets"] = examples.of_classes(names)
    bound = _BOUNDS.get(key, _BOUNDS.get(field.name))
    return {**about, **value(annotation, TYPES, defs, bound, issubclass(cls, Element))}


def _offered():
    """Pairs: how an annotation begins, and the classes whose examples editors offer there."""
    return [
        ("PyTree[Element]", _names(Element)),
        ("Load |", _names(Load)),
        *((words, _names(Law)) for words in ("Law", "Sequence[Law]")),
        *((name, [name]) for name in ("Section", "Supports", "Selection")),
    ]


def _names(base):
    """Names of the classes that derive from one, a list."""
    return [name for name, cls in TYPES.items() if issubclass(cls, base)]


def _values():
    """Definitions of values that are not objects of one class."""
    of_load, of_law = tags(ref("load")), tags(ref("law"))
    flag, number = {"type": "boolean"}, {"type": "number"}
    numbers = {"type": ["number", "array"], "items": number, "minItems": 1}
    single = tagged("float32", "values", numbers)
    marked = if_named(["float32"], tags(ref("statement")), single)
    many = {"type": "array", "contains": {"type": "object"}}
    keys = {"if": {"contains": {"type": "string"}}, "then": {"items": {"type": "string"}}}
    return {
        "group": _any_of(Element),
        "load": _any_of(Load),
        "law": _any_of(Law),
        "laws": {
            "type": ["array", "object"],
            "items": ref("law"),
            **if_type("object", if_named(_TAGS, ref("law"), of_law)),
        },
        "loads": {
            "type": ["array", "object"],
            "items": ref("load"),
            **if_type("object", if_named(_TAGS, ref("load"), of_load)),
        },
        "counts": {
            "type": ["array", "object"],
            "items": {"type": "integer"},
            "minItems": 1,
            **if_type("object", tags({"type": "integer"})),
        },
        "elements": {
            "type": ["object", "array"],
            "errorMessage": "Expected a group of elements, or an object or a list of groups.",
            "items": ref("part"),
            "if": {"type": "array", "minItems": 1},
            "then": {"contains": {"type": "object"}},
            "allOf": [if_type("object", _by_group(_names(Element), "part", tags(ref("part"))))],
        },
        "part": {
            "if": {"not": {"type": "null"}},
            "then": ref("elements"),
            "defaultSnippets": examples.of_classes(_names(Element)),
        },
        "statement": {
            "type": ["object", "number", "array", "null"],
            "errorMessage": "Expected a number, a list of numbers, or these by group.",
            "if": many,
            "then": {"items": ref("statement")},
            "else": {"items": number},
            "allOf": [if_type("object", _by_group(["Only"], "statement", marked, ["float32"]))],
        },
        "choice": {
            "type": ["object", "boolean", "array", "null"],
            "errorMessage": "Expected Selection, true or false, or a list of true and false.",
            "if": many,
            "then": {"items": ref("choice")},
            "else": {"items": flag},
            "allOf": [if_type("object", _by_group(["Selection"], "choice", tags(ref("choice"))))],
        },
        "change": {
            "type": ["string", "array", "object", "boolean", "null"],
            "errorMessage": "Expected the key of a group, a list of keys, or choices by group.",
            "if": many,
            "then": {"items": ref("choice")},
            "else": {**keys, "else": {"items": flag}},
            "allOf": [if_type("object", _by_group(["Selection"], "choice", tags(ref("choice"))))],
        },
    }


_TAGS = ["list", "tuple"]


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
                "enumDescriptions": [_summary(TYPES[name]) for name in names],
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
        "defaultSnippets": examples.of_classes(names),
    }


def _by_group(names, each, others, more=()):
    """The schema of an object with a text under "type", or of an object with the keys of groups.

    The first is of one of the classes `names`, or if it is marked as a list, a tuple or one of
    `more`, of `others`.
    """
    text = {"type": "string", "description": "the class of this object", "examples": names}
    return if_named(
        [*_TAGS, *more],
        {
            "if": {"required": ["type"], "properties": {"type": text}},
            "then": ref(names[0] if len(names) == 1 else "group"),
            "else": {"additionalProperties": ref(each)},
        },
        others,
    )
