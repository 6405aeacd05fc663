"""The JSON Schema of scene files, made from the classes whose objects files can hold.

The fields are those of the classes. Their annotations say which values they take (`value_schemas`),
their docstrings what they mean (`field_docs`), and the rules of their numbers where these end; a
field whose description has "set by" is not offered to persons. What no class states is in
`schema_parts.json` beside this module: the frame of a scene, the definitions that fields share, and
by class the fields that need or exclude each other. `_computed_parts` says what texts such as
"=names Element" stand for in it, and `_expand_part` what ``has``, ``lacks`` and ``list of`` mean.
`scene.schema.json` is the schema as text: ``python -m jaxcable schema --save
jaxcable/files/scene.schema.json`` writes it.
"""

from __future__ import annotations

import contextlib
import functools
import json
from importlib import resources
from typing import Any

import numpy as np

from ..analysis.phases import Phase
from ..common.selection import Selection
from ..common.units import SYMBOLS
from ..design.actions import Action
from ..design.check import Check
from ..design.checks import RULES
from ..design.combination_rules import names_of_standards
from ..elements import Catenaries
from ..elements.element import Element
from ..elements.straight import Straight
from ..loads.load import Load
from ..loads.wind_profiles import WindProfile
from ..materials.law import Law
from ..model.supports import Supports
from ..sections import Section
from .codec import COMMENT, EXPLICIT_CLASSES, IMPLIED_CLASSES, TYPES, has_no_default, user_fields
from .examples import editor_snippets, load_schema_examples
from .field_docs import class_summary, field_descriptions
from .value_schemas import Schema, closed_object, reference, value_schema

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
    arrays: dict[str, Schema] = {}
    classes = {name: _class_schema(cls, arrays) for name, cls in TYPES.items()}
    stand_for = _computed_parts()
    shared = _expand_part(_file_parts()["definitions"], stand_for)
    definitions = {**classes, **shared, **dict(sorted(arrays.items()))}
    return {**_expand_part(_file_parts()["scene"], stand_for), "$defs": definitions}


@functools.cache
def _file_parts():
    """Return the parts of the schema that no class states, `schema_parts.json`, as a dict."""
    return json.loads((resources.files(__package__) / "schema_parts.json").read_text("utf-8"))


def _computed_parts():
    """Return by text, such as "=names Element", the part of the schema that it stands for."""
    bases = {"group": Element, "load": Load, "law": Law, "check": Check}
    bases["wind_profile"] = WindProfile
    return {
        **{f"={name}": _any_subclass_schema(base) for name, base in bases.items()},
        "=scene": [load_schema_examples()["scene"]],
        "=units": {kind: {"enum": list(names)} for kind, names in SYMBOLS.items()},
        "=combinations": [*names_of_standards(), None],
        "=standards": list(RULES),
        "=names Element": _subclass_names(Element),
        "=snippets Element": editor_snippets(_subclass_names(Element)),
        "=snippets Phase": editor_snippets(["Phase"]),
        "=snippets Action": editor_snippets(["Action"]),
    }


def _expand_part(part, computed):
    """Return a part of the schema with `computed` parts in place, and these words expanded.

    - ``{"has": field}``: objects with this field, and not null in it.
    - ``{"lacks": [field, ...], "why": text}``: objects without these fields, or null there; the
      error message `text` says what to give instead.
    - ``{"list of": item, "or": other}``: ``{"type": "list", "items": [...]}``, or a tuple; values
      of any other kind are as `other` says. The condition is negative so that editors offer what
      fits before the type has been typed.
    """
    if isinstance(part, str):
        return computed.get(part, part)
    if isinstance(part, list):
        return [_expand_part(item, computed) for item in part]
    if not isinstance(part, dict):
        return part
    part = {key: _expand_part(value, computed) for key, value in part.items()}
    if "has" in part:
        given = {"not": {"type": "null"}, "doNotSuggest": True}
        return {"required": [part["has"]], "properties": {part["has"]: given}}
    if "lacks" in part:
        never = {"type": "null", "errorMessage": part["why"], "doNotSuggest": True}
        return {"properties": dict.fromkeys(part["lacks"], never)}
    if "list of" in part:
        tags = {"enum": ["list", "tuple"]}
        items = {"type": "array", "items": part["list of"]}
        fields = {"type": {**tags, "doNotSuggest": True}, "items": items}
        return {
            "if": {"properties": {"type": {"not": tags, "doNotSuggest": True}}},
            "then": part["or"],
            "else": closed_object(fields, ["type", "items"]),
        }
    return part


def _class_schema(cls, arrays):
    """Return the schema of the objects of a class, with the summary of the class at "type".

    Schemas of arrays are added to `arrays`, definitions of the whole schema by name.
    """
    name, bounds, parts = cls.__name__, _number_bounds(cls), _file_parts()
    descriptions = field_descriptions(cls, {**TYPES, "Check": Check})
    fields = {
        field.name: _field_schema(cls, field, descriptions, bounds, arrays)
        for field in user_fields(cls)
    }
    needs = [
        field.name
        for field in user_fields(cls)
        if has_no_default(field) or f"{name}.{field.name}" in parts["needed"]
    ]
    named = cls not in (*IMPLIED_CLASSES.values(), Phase, Action)
    kind: Schema = {"const": name, "description": f"{name}: {class_summary(cls)}"}
    by_force = issubclass(cls, Straight) and not issubclass(cls, Catenaries)
    rules = [*(parts["rules"]["Straight"] if by_force else ()), *parts["rules"].get(name, ())]
    shown = list(load_schema_examples()["classes"].get(name, {}).values())
    return {
        **closed_object(
            {
                "type": kind if named else {**kind, "doNotSuggest": True},
                COMMENT: parts["comment"],
                **({"name": parts["phase_name"]} if cls is Phase else {}),
                **fields,
            },
            (["type"] if named else []) + needs,
        ),
        **({"allOf": _expand_part(rules, {})} if rules else {}),
        **({"examples": shown} if shown else {}),
    }


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


def _field_schema(cls, field, descriptions, bounds, arrays):
    """Return the schema of one field of a class: its description, examples and allowed values.

    `descriptions` and `bounds` are those of all fields, as of `field_descriptions` and
    `_number_bounds`; schemas of arrays are added to `arrays`.
    """
    kind = field.type  # text, but for a class without postponed annotations
    annotation = kind if isinstance(kind, str) else getattr(kind, "__name__", "Any")
    annotation = annotation.replace("PyTree[Selection]", "PyTree[Bool]")  # both choose elements
    if field.default is None and field.name in getattr(cls, "_static_fields", ()):
        annotation += "" if "None" in annotation else " | None"
    text = descriptions.get(field.name) or f"of the {cls.__name__}"
    text += "".join(more for key, more in _file_parts()["by_group"].items() if key in annotation)
    about: Schema = {"description": text}
    if isinstance(field.default, bool | int | str):
        about["default"] = field.default
    if shown := load_schema_examples()["fields"].get(cls.__name__, {}).get(field.name):
        about["examples"] = shown
    if annotation.startswith(("None", "Solution")) or "set by " in text:
        about["doNotSuggest"] = True
    for words, base in _OFFERED.items():
        if annotation.startswith(words):
            other = ["LinearSection"] if "LinearSection" in annotation else []
            about["defaultSnippets"] = editor_snippets([*_subclass_names(base), *other])
    bound = _file_parts()["bounds"].get(f"{cls.__name__}.{field.name}", bounds.get(field.name))
    return {**about, **value_schema(annotation, TYPES, arrays, bound, issubclass(cls, Element))}


def _subclass_names(base):
    """Return the names of the classes in `TYPES` that derive from `base`, a list."""
    return [name for name, cls in TYPES.items() if issubclass(cls, base)]


def _any_subclass_schema(base):
    """Return the schema of objects whose "type" names a class that derives from `base`."""
    names = _subclass_names(base)
    summaries = [class_summary(TYPES[name]) for name in names]
    about = {"description": "which kind it is", "enum": names, "enumDescriptions": summaries}
    chosen = [{"const": name, "doNotSuggest": True} for name in names]
    return {
        "type": "object",
        "required": ["type"],
        "properties": {"type": about},
        "allOf": [
            {"if": {"required": ["type"], "properties": {"type": one}}, "then": reference(name)}
            for name, one in zip(names, chosen, strict=True)
        ],
        "defaultSnippets": editor_snippets(names),
    }
