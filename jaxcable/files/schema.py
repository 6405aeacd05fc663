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
from ..elements.straight import Straight
from ..loads import along, areas, pressure
from ..loads.load import Load
from ..materials.law import Law
from .codec import COMMENT, IMPLIED, TYPES, stated
from .explained import explained, summary
from .kinds import Schema, closed, options, ref, tagged, united
from .scene import FORMAT, MOST_INCREMENTS, VERSION

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

_ABOVE: Schema = {"exclusiveMinimum": 0}
_BOUNDS: dict[str | tuple[str, str], Schema] = {
    **{name: _ABOVE for name in ("axial_stiffness", "torsional_stiffness", "area", "E")},
    **{name: _ABOVE for name in ("rest_length", "strength")},
    **{name: {"minimum": 0} for name in ("weight", "compliance", "springs")},
    ("Beams", "points"): {"minimum": 3, "maximum": 1000},
    ("Phase", "increments"): {"minimum": 1, "maximum": MOST_INCREMENTS},
    ("Phase", "rest_length"): {},
}
_LOADED = 'the elements of that group: {"type": "Selection", "elements": [4, 5]}; null means all'
_NOT_HERE = "a catenary is elastic: left out, or null"
_MORE = {  # what docstrings tell in prose, of two fields at once, or in the words of Python
    ("Structure", "elements"): (
        "one group of elements (Cables, Bars, ...), or several: an object whose "
        "keys are names of groups, or a list; at any depth"
    ),
    ("Structure", "supports"): "which nodes are held, and how",
    ("Supports", "chosen"): "nodes that are held in part or in other directions, [n]",
    ("Supports", "held"): (
        "of the chosen nodes: which of three displacements and three rotations are held, [n, 6]"
    ),
    ("Supports", "axes"): (
        "of the chosen nodes: the directions of what is held, [n, 3, 3], one in each "
        "row of a matrix"
    ),
    ("Phase", "shortening"): "by how much a turnbuckle shortens the unstressed length, m",
    ("Phase", "temperature"): "change of the temperature, K; the group needs `expansion`",
    ("Phase", "adds"): (
        "elements that are there from this phase on, and not before: the key of a group, "
        "a list of keys, or Selection or booleans [n_elem] in the forms of a statement"
    ),
    ("Phase", "removes"): "elements that go, in the same forms; their end forces are ramped out",
    ("Bars", "area"): "cross-section, scalar or [n_elem], m2; beside a law",
    ("Bars", "law"): "uniaxial law of all elements of the group; beside an area",
    ("Catenaries", "area"): _NOT_HERE,
    ("Catenaries", "law"): _NOT_HERE,
    ("Catenaries", "section"): _NOT_HERE,
    ("AreaLoads", "factor"): "factor of the forces, without unit",
    ("LineLoads", "factor"): "factor of the forces, without unit",
    ("LineLoads", "elements"): _LOADED,
    ("SelfWeight", "elements"): _LOADED,
    ("SupportMovement", "displacements"): (
        "[3] or [n, 3], m, along freedoms held in the phase; null if nodes only turn"
    ),
    ("Parallel", "laws"): "the laws, a list",
    ("Polygonal", "strain"): "strains of the points, [n], n >= 2, increasing, without unit",
    ("Polygonal", "stress"): "stresses of the points, [n], Pa",
    ("Section", "laws"): "uniaxial laws, a list; fibres of one law follow each other",
    ("Section", "points"): "points of a mesh for pictures, [n_point, 2], m",
    ("Section", "cells"): "the four points of each fibre in a mesh for pictures, [n_fibre, 4]",
}
for _key in ("area", "law"):
    _MORE |= {(_name, _key): _MORE["Bars", _key] for _name in ("Cables", "SlidingCables")}
_COMMENT: Schema = {
    "title": COMMENT,
    "description": "anything, such as a text or a list of lines; it is not read",
}
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
        >>> print(links["title"] + ":", links["description"])
        links: node numbers, [n_elem, 2].
    """
    defs: dict[str, Schema] = {}
    objects = {name: _object(cls, defs) for name, cls in TYPES.items()}
    return {
        "$schema": _DIALECT,
        "$id": f"urn:jaxcable:scene:{VERSION}",
        "title": "jaxcable scene",
        "description": "A structure of cables, bars and beams, and the phases in which it is "
        f"prestressed and loaded; SI units; nodes and elements are numbered from 0. {_BEYOND}",
        **closed(
            {
                "$schema": {"type": "string", "description": "place of this schema, for editors"},
                "format": {"const": FORMAT, "description": "says what the file is"},
                "version": {
                    "type": "integer",
                    "minimum": 1,
                    "maximum": VERSION,
                    "description": "of the format",
                },
                COMMENT: _COMMENT,
                "structure": ref("Structure"),
                "phases": {
                    "type": "array",
                    "items": ref("Phase"),
                    "minItems": 1,
                    "description": "stages of the analysis, one after the other",
                },
            },
            ["format", "version", "structure", "phases"],
        ),
        "$defs": {**objects, **_values(defs), **dict(sorted(defs.items()))},
    }


def _object(cls, defs):
    """The schema of the objects of a class."""
    name, texts = cls.__name__, explained(cls, TYPES)
    needs = [field.name for field in stated(cls) if _needed(cls, field)]
    named = cls not in (*IMPLIED.values(), Phase)
    return {
        "title": name,
        "description": summary(cls),
        **closed(
            {
                "type": {"const": name, "description": "the class of this object"},
                COMMENT: _COMMENT,
                **{field.name: _field(cls, field, texts, defs) for field in stated(cls)},
            },
            (["type"] if named else []) + needs,
        ),
        **_together(cls),
    }


def _needed(cls, field):
    """Whether a field must be there."""
    nothing = dataclasses.MISSING
    bare = field.default is nothing and field.default_factory is nothing
    return bare or (cls.__name__, field.name) in _NEEDED


def _field(cls, field, texts, defs):
    """The schema of a field of a class, with its title and description."""
    key = cls.__name__, field.name
    text = _MORE.get(key) or texts.get(field.name) or field.name
    about: Schema = {"title": field.name, "description": text}
    if isinstance(field.default, bool | int | str):
        about["default"] = field.default
    if key in _ENUMS:
        return {**about, "enum": list(_ENUMS[key])}
    annotation = _TAKEN.get(key, field.type)
    if not isinstance(annotation, str):  # of a class without postponed annotations
        annotation = getattr(annotation, "__name__", "")
    bound = _BOUNDS.get(key, _BOUNDS.get(field.name))
    each = issubclass(cls, Element)
    return {**about, **united(options(annotation, TYPES, defs, bound, each))}


def _given(name):
    """The schema of objects that have a field, and not null in it."""
    return {"required": [name], "properties": {name: {"not": {"type": "null"}}}}


def _these(*names, others=()):
    """The schema of objects that have some fields, and none of `others`."""
    return {"allOf": [*map(_given, names), *({"not": _given(name)} for name in others)]}


def _together(cls):
    """What must, or must not, be given together in the objects of a class."""
    if cls.__name__ == "Supports":
        directed = "chosen", "held", "axes"
        return {
            "anyOf": [_given(name) for name in ("mask", "nodes", "clamps", "chosen")],
            "oneOf": [_these(*directed), _these(others=directed)],
        }
    if cls.__name__ == "LineLoads":
        begun = {"properties": {"geometry": {"const": "begun"}}, "required": ["geometry"]}
        per = {"properties": {"per": {"enum": ["initial", "projected"]}}, "required": ["per"]}
        return {"if": begun, "then": per}
    if issubclass(cls, Straight) and cls.__name__ != "Catenaries":
        return {
            "oneOf": [
                _these("axial_stiffness", others=("area", "law", "section")),
                _these("area", "law", others=("axial_stiffness", "section")),
                _these("section", others=("axial_stiffness", "area", "law")),
            ]
        }
    return {}


def _values(defs):
    """Definitions of values that are not objects of one class."""
    number, numbers = options("Float[ArrayLike, ''] | Float[ArrayLike, ' n_elem']", TYPES, defs)
    flag = {"type": "boolean"}
    flags = {"type": "array", "items": flag, "minItems": 1}
    return {
        "group": _any_of(Element, "A group of elements of one kind."),
        "load": _any_of(Load, "Something that acts on the structure."),
        "law": _any_of(Law, "A uniaxial law: stress from strain."),
        "laws": {"anyOf": [*_lists(ref("law")), ref("law")]},
        "listOfLoads": {"anyOf": _lists(ref("load"))},
        "counts": {
            "anyOf": [
                {"type": "array", "items": {"type": "integer"}, "minItems": 1},
                *(tagged(name, "items", _LIST_OF_WHOLE) for name in ("tuple", "list")),
            ]
        },
        "elements": {
            "description": "One group, or several: an object whose keys are names, or a list.",
            **_tree("group", "elements"),
        },
        "statement": {
            "description": "One number for all elements, a list of one for each element of the "
            "only group, Only for some elements, or an object or a list with one of these for "
            "each group.",
            **_tree("marked", "statement", [number, numbers]),
        },
        "marked": {
            "description": "Numbers for some elements, or in single precision.",
            "anyOf": [ref("Only"), number, numbers],
        },
        "choice": {
            "description": "Some elements: Selection, true or false for each element of the only "
            "group or for all, or an object or a list with one of these for each group.",
            **_tree("Selection", "choice", [flag, flags]),
        },
    }


_LIST_OF_WHOLE: Schema = {"type": "array", "items": {"type": "integer"}}


def _any_of(base, text):
    """The schema of objects of all classes that derive from a class."""
    names = [name for name, cls in TYPES.items() if issubclass(cls, base)]
    return {"description": text, "anyOf": [ref(name) for name in names]}


def _lists(item):
    """Schemas of lists that hold objects, which may be empty, and of marked lists and tuples."""
    items: Schema = {"type": "array", "items": item}
    plain: Schema = {**items, "anyOf": [{"maxItems": 0}, {"contains": {"type": "object"}}]}
    return [plain, *(tagged(name, "items", items) for name in ("list", "tuple"))]


def _tree(leaf, name, more=()):
    """The schema of an object of a class, of `more`, or of objects and lists of these.

    What names its class is compared with that class alone: to try the others, too, would take
    seconds for a file with an error, and would end in a message without a place.
    """
    null: Schema = {"type": "null"}
    inner = {"anyOf": [ref(name), null]}
    mapping: Schema = {"type": "object", "additionalProperties": inner}
    named = {"type": "object", "required": ["type"], "properties": {"type": {"type": "string"}}}
    return {
        "if": {**named, "not": {"properties": {"type": {"enum": ["list", "tuple"]}}}},
        "then": ref(leaf),
        "else": {"anyOf": [*more, *_lists(inner), mapping]},
    }
