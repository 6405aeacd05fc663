"""The JSON Schema of scene files, made from the classes whose objects files can hold.

The fields are those of the classes. Their annotations say which values they take (`value_schemas`),
their docstrings what they mean (`field_docs`), and the rules of their numbers where these end; a
field whose description has "set by" is not offered to persons. What holds for every field of a
kind, and how containers are written, is defined here. `scene.schema.json` beside this module is
the schema as text: ``python -m jaxcable schema --save jaxcable/files/scene.schema.json`` writes it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from ..analysis.phases import Phase
from ..common.selection import Selection
from ..common.units import SYMBOLS
from ..design.actions import Action
from ..design.check import Check
from ..design.checks import RULES
from ..design.combination_rules import names_of_standards
from ..elements.element import Element
from ..loads.load import Load
from ..loads.wind_profiles import WindProfile
from ..materials.law import Law
from ..model.supports import Supports
from ..sections import Section
from .codec import COMMENT, EXPLICIT_CLASSES, IMPLIED_CLASSES, TYPES, has_no_default, user_fields
from .examples import editor_snippets, load_schema_examples
from .field_docs import class_summary, field_descriptions
from .field_rules import joint_field_rules
from .scene import FORMAT, MOST_INCREMENTS, VERSION
from .value_schemas import (
    SEQUENCE_TAGS,
    Schema,
    closed_object,
    if_class_not_in,
    if_json_type,
    reference,
    tagged_object,
    tagged_sequence,
    value_schema,
)

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
        "that are left out have none. One number for all does not apply to beams where there are "
        "cables or bars (a temperature: to groups without `expansion`); name the group to set it "
        "for beams."
    ),
    "PyTree[Bool": (
        ' Keys of groups are a text or a list of texts, elements of groups {"deck": {"type": '
        '"Selection", "elements": [0, 1]}}.'
    ),
}
"""How fields are written that state something by group, by how their annotations begin."""

_PHASE_NAME: Schema = {
    "type": "string",
    "minLength": 1,
    "description": "of the phase, in reports; each phase has another one",
}
_COMMENT: Schema = {"description": "anything, such as a text or a list of lines; it is not read"}
_UNITS: Schema = {
    "description": "units of all numbers in this file, one of force and one of length, such as "
    '"kN, m"; "F" for differences of temperatures in degrees Fahrenheit; default: N, m, K. '
    "Descriptions of fields have SI units; what is N/m2 there is then kN/m2, or kip/ft2.",
    "type": ["string", "object", "null"],
    "examples": ["kN, m", "N, mm", "kip, ft, F", {"force": "kN", "length": "m"}],
    **if_json_type(
        "object",
        closed_object(
            {kind: {"enum": list(names)} for kind, names in SYMBOLS.items()}, ["force", "length"]
        ),
    ),
}
_BEYOND = (
    "Reading also refuses what a schema cannot say: numbers of nodes or elements, and keys of "
    "groups, that the structure does not have; arrays whose lengths do not agree; "
    "links without length, equal or repeated; parts without supports; loads and prestress that "
    "elements cannot take; laws whose points are no curve; whole numbers with a decimal point, "
    "numbers of more than 64 bits, the same field twice in one object. Of a list of numbers it "
    'also takes the form {"type": "list", "items": [...]}, and single numbers in it as '
    '{"type": "float32", ...}, which no field needs.'
)
_OFFERED: dict[tuple[str, ...], type] = {
    **{words: base for base, (words, _) in EXPLICIT_CLASSES.items()},
    **{(cls.__name__,): cls for cls in (Section, Supports, Selection)},
}
"""What editors offer examples of, by how annotations begin."""


def scene_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of scene files, which `load_scene` reads.

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
    objects = {name: _class_schema(cls, defs) for name, cls in TYPES.items()}
    standards: Schema = {"enum": list(RULES)}
    stage, action = (
        {"defaultSnippets": editor_snippets([cls]), **reference(cls)} for cls in ("Phase", "Action")
    )
    return {
        "$schema": _DIALECT,
        "$id": f"urn:jaxcable:scene:{VERSION}",
        "title": "jaxcable scene",
        "description": "A structure of cables, bars and beams, and the phases in which it is "
        'prestressed and loaded, in SI units or in those of "units"; nodes and elements are '
        f"numbered from 0. {_BEYOND}",
        "examples": [load_schema_examples()["scene"]],
        **closed_object(
            {
                "$schema": {"type": "string", "description": "place of this schema, for editors"},
                "format": {"const": FORMAT, "description": "says what the file is"},
                "version": {
                    "enum": [*range(1, VERSION + 1)],
                    "description": "of the format; a whole number",
                },
                COMMENT: _COMMENT,
                "units": _UNITS,
                "structure": {
                    "description": "nodes, elements and supports",
                    **value_schema("Structure", TYPES, defs),
                },
                "phases": {
                    "description": "stages of the analysis, one after the other",
                    "type": "array",
                    "items": stage,
                    "minItems": 1,
                },
                "actions": {
                    "description": "named actions on the prestressed structure, which the rules of "
                    "a standard combine: `jaxcable solve --combinations`",
                    "type": ["array", "null"],
                    "items": action,
                },
                "combinations": {
                    "description": "standard by whose rules `jaxcable solve` combines the actions",
                    "enum": [*names_of_standards(), None],
                },
                "checks": {
                    "description": "what `jaxcable solve` compares the results of all combinations "
                    "with, or those of the last phase: the names of standards for all cables with "
                    "a strength, and checks of groups and nodes",
                    "type": ["string", "array", "null"],
                    **if_json_type("string", standards),
                    "items": {**if_json_type("string", standards), "else": reference("check")},
                },
            },
            ["format", "version", "structure", "phases"],
        ),
        "$defs": {**objects, **_shared_definitions(), **dict(sorted(defs.items()))},
    }


def _class_schema(cls, defs):
    """Return the schema of the objects of a class, with the summary of the class at "type".

    Schemas of arrays are added to `defs`, the definitions of the whole schema.
    """
    name, bounds = cls.__name__, _number_bounds(cls)
    descriptions = field_descriptions(cls, {**TYPES, "Check": Check})
    fields = {
        field.name: _field_schema(cls, field, descriptions, bounds, defs)
        for field in user_fields(cls)
    }
    needs = [f.name for f in user_fields(cls) if has_no_default(f) or (name, f.name) in _NEEDED]
    named = cls not in (*IMPLIED_CLASSES.values(), Phase, Action)
    kind: Schema = {"const": name, "description": f"{name}: {class_summary(cls)}"}
    shown = list(load_schema_examples()["classes"].get(name, {}).values())
    return {
        **closed_object(
            {
                "type": kind if named else {**kind, "doNotSuggest": True},
                COMMENT: _COMMENT,
                **({"name": _PHASE_NAME} if cls is Phase else {}),
                **fields,
            },
            (["type"] if named else []) + needs,
        ),
        **joint_field_rules(cls),
        **({"examples": shown} if shown else {}),
    }


def _field_annotation(cls, field):
    """Return the annotation of a field as text, with "| None" if a static field may be absent."""
    kind = field.type  # text, but for a class without postponed annotations
    text = kind if isinstance(kind, str) else getattr(kind, "__name__", "Any")
    text = text.replace("PyTree[Selection]", "PyTree[Bool]")  # both choose elements
    absent = field.default is None and field.name in getattr(cls, "_static_fields", ())
    return f"{text} | None" if absent and "None" not in text else text


def _number_bounds(cls):
    """Return {"minimum": 0} or {"exclusiveMinimum": 0} by field, where a rule demands this."""
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


def _field_schema(cls, field, descriptions, bounds, defs):
    """Return the schema of one field of a class: its description, examples and allowed values.

    `descriptions` and `bounds` are those of all fields, as of `field_descriptions` and
    `_number_bounds`; schemas of arrays are added to the definitions `defs`.
    """
    annotation = _field_annotation(cls, field)
    text = descriptions.get(field.name) or f"of the {cls.__name__}"
    text += "".join(more for words, more in _BY_GROUP.items() if words in annotation)
    about: Schema = {"description": text}
    if isinstance(field.default, bool | int | str):
        about["default"] = field.default
    if shown := load_schema_examples()["fields"].get(cls.__name__, {}).get(field.name):
        about["examples"] = shown
    if annotation.startswith(("None", "Solution")) or "set by " in text:
        about["doNotSuggest"] = True
    for words, base in _OFFERED.items():
        if annotation.startswith(words):
            names = _subclass_names(base)
            if "LinearSection" in annotation:
                names = [*names, "LinearSection"]
            about["defaultSnippets"] = editor_snippets(names)
    bound = _COUNTS.get((cls.__name__, field.name), bounds.get(field.name))
    return {**about, **value_schema(annotation, TYPES, defs, bound, issubclass(cls, Element))}


def _subclass_names(base):
    """Return the names of the classes in `TYPES` that derive from `base`, a list."""
    return [name for name, cls in TYPES.items() if issubclass(cls, base)]


def _shared_definitions():
    """Return the definitions that several fields refer to, such as "group" and "load": a dict."""
    flag, number, text = ({"type": kind} for kind in ("boolean", "number", "string"))
    numbers = {"type": ["number", "array"], "items": number, "minItems": 1}
    single = tagged_object("float32", "values", numbers)
    choices = ["object", "boolean", "array", "null"]
    by_numbers = {"type": {"const": "LinearSection", "doNotSuggest": True}}
    return {
        "section": {
            "if": {"required": ["type"], "properties": by_numbers},
            "then": reference("LinearSection"),
            "else": reference("Section"),
        },
        "group": _any_subclass_schema(Element),
        "load": _any_subclass_schema(Load),
        "law": _any_subclass_schema(Law),
        "wind_profile": _any_subclass_schema(WindProfile),
        "check": _any_subclass_schema(Check),
        "laws": _one_or_list_schema(reference("law")),
        "loads": _one_or_list_schema(reference("load")),
        "counts": {**_one_or_list_schema({"type": "integer"}), "minItems": 1},
        "elements": _by_group_schema(
            ["object", "array"],
            "a group of elements, or an object or a list of groups",
            _subclass_names(Element),
            "part",
            {"items": {"type": "object"}},
        ),
        "part": {
            "if": {"not": {"type": "null"}},
            "then": reference("elements"),
            "defaultSnippets": editor_snippets(_subclass_names(Element)),
        },
        "statement": _by_group_schema(
            ["object", "number", "array", "null"],
            "a number, a list of numbers, or these by group",
            ["Only"],
            "statement",
            {"items": {"type": ["number", "array"], "items": number}},  # components, in rows
            {"float32": single},
        ),
        "choice": _by_group_schema(
            choices,
            "Selection, true or false, or a list of true and false",
            ["Selection"],
            "choice",
            {"items": flag},
        ),
        "change": _by_group_schema(
            ["string", *choices],
            "the key of a group, a list of keys, or choices by group",
            ["Selection"],
            "choice",
            {"if": {"contains": text}, "then": {"items": text}, "else": {"items": flag}},
        ),
    }


def _any_subclass_schema(base):
    """Return the schema of objects whose "type" names a class that derives from `base`."""
    names = _subclass_names(base)
    return {
        "type": "object",
        "required": ["type"],
        "properties": {
            "type": {
                "description": "which kind it is",
                "enum": names,
                "enumDescriptions": [class_summary(TYPES[name]) for name in names],
            }
        },
        "allOf": [
            {
                "if": {
                    "required": ["type"],
                    "properties": {"type": {"const": name, "doNotSuggest": True}},
                },
                "then": reference(name),
            }
            for name in names
        ],
        "defaultSnippets": editor_snippets(names),
    }


def _one_or_list_schema(item):
    """Return the schema of one value with the schema `item`, or of a list of such values."""
    marked = if_json_type("object", if_class_not_in(SEQUENCE_TAGS, item, tagged_sequence(item)))
    return {"type": ["array", "object"], "items": item, **marked}


def _by_group_schema(
    types: Sequence[str],
    expected: str,
    names: Sequence[str],
    each: str,
    values: Schema,
    marked: Mapping[str, Schema] = MappingProxyType({}),
) -> Schema:
    """Return the schema of a field that has one value for all elements, or values by group.

    Args:
        types: JSON types that the field can have.
        expected: what the field can be, in words for an error.
        names: classes whose objects it can be.
        each: name of the definition of its parts: values under the keys of groups, or items of a
            list.
        values: the schema of lists that have no objects in them.
        marked: schemas of objects with another text under "type", by this text.
    """
    text = {"type": "string", "description": "the class of this object", "examples": names}
    content = {
        "if": {"required": ["type"], "properties": {"type": text}},
        "then": reference(names[0] if len(names) == 1 else "group"),
        "else": {"additionalProperties": reference(each)},
    }
    for tag, schema in marked.items():
        content = if_class_not_in([tag], content, schema)
    content = if_class_not_in(SEQUENCE_TAGS, content, tagged_sequence(reference(each)))
    return {
        "type": list(types),
        "errorMessage": f"Expected {expected}.",
        "if": {"type": "array", "contains": {"type": "object"}},
        "then": {"items": reference(each)},
        "else": values,
        "allOf": [if_json_type("object", content)],
    }
