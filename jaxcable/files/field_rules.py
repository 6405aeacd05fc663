"""Rules of the schema of scene files on fields that exclude or need each other.

Every rule ends in a statement on one field (``if`` and ``then``), so that validators name it.
"""

from __future__ import annotations

from ..elements.straight import Straight
from .value_schemas import Schema


def joint_field_rules(cls: type) -> Schema:
    """Return the JSON Schema of the fields of a class that must, or must not, be given together."""
    name, rules = cls.__name__, []
    if name == "Supports":
        ways = map(_has_field_condition, ("mask", "nodes", "clamps", "chosen"))
        rules = [
            _require_unless({"anyOf": [*ways]}, "nodes, or clamps, or chosen and held, or mask"),
            {"if": _has_field_condition("chosen"), "then": _has_field_condition("held")},
            {
                "if": {"anyOf": [_has_field_condition("held"), _has_field_condition("axes")]},
                "then": _has_field_condition("chosen"),
            },
        ]
    elif name == "Beams":
        bare: Schema = {
            "properties": {
                "section": {
                    "not": {"anyOf": [_has_field_condition("torsion"), _has_field_condition("GJ")]},
                    "doNotSuggest": True,
                }
            }
        }
        twists = {"anyOf": [_has_field_condition("torsional_stiffness"), {"not": bare}]}
        rules = [_require_unless(twists, "torsional_stiffness, or torsion in the section")]
    elif name == "LineLoads":
        begun: Schema = {"properties": {"geometry": {"const": "begun", "doNotSuggest": True}}}
        per = {"properties": {"per": {"enum": ["initial", "projected"], "doNotSuggest": True}}}
        given = {"if": {**begun, "required": ["geometry"]}, "then": {**per, "required": ["per"]}}
        rules = [given]
    elif name == "WindTable":
        other = _forbid_fields("pressures", why="Give velocities or pressures, not both.")
        missing = _require_unless(_has_field_condition("pressures"), "velocities, or pressures")
        rules = [{"if": _has_field_condition("velocities"), "then": other, "else": missing}]
    elif name == "EurocodeWind":
        own = ("roughness_length", "lowest_height")
        why = "Give a terrain category, or roughness_length and lowest_height."
        both: Schema = {"allOf": [_has_field_condition(field) for field in own]}
        missing = _require_unless(both, "terrain, or roughness_length and lowest_height")
        other = _forbid_fields(*own, why=why)
        rules = [{"if": _has_field_condition("terrain"), "then": other, "else": missing}]
    elif name in ("AreaLoads", "FacePressure"):
        one = _forbid_fields(
            "on", "elements", why="Give faces, or a group whose elements have them."
        )
        rules = [{"if": _has_field_condition("faces"), "then": one}]
    elif issubclass(cls, Straight) and name != "Catenaries":
        two = [_has_field_condition("area"), _has_field_condition("law")]
        needed = "axial_stiffness, or area and law, or section"
        either = {**_require_unless({"anyOf": two}, needed), "else": {"allOf": two}}
        by_section = {
            "if": _has_field_condition("section"),
            "then": _forbid_fields("area", "law"),
            "else": either,
        }
        others = _forbid_fields("section", "area", "law")
        rules = [
            {"if": _has_field_condition("axial_stiffness"), "then": others, "else": by_section}
        ]
        if name == "Contacts":
            one = _forbid_fields("rest_length", why="Give gap or rest_length, not both.")
            rules.append({"if": _has_field_condition("gap"), "then": one})
    return {"allOf": rules} if rules else {}


def _has_field_condition(name):
    """Return the JSON Schema of objects that have the field `name`, and not null."""
    return {
        "required": [name],
        "properties": {name: {"not": {"type": "null"}, "doNotSuggest": True}},
    }


def _require_unless(condition, words):
    """Return the JSON Schema that fails unless an object meets `condition`, itself a schema.

    `words` say what is missing; validators show them as if they were the name of a field.
    """
    return {"if": {"not": condition}, "then": {"required": [words]}}


_STIFFNESS_HINT = "Give axial_stiffness, or area and law, or section: one of these."


def _forbid_fields(*names, why=_STIFFNESS_HINT):
    """Return the JSON Schema of objects that lack the named fields, or have null there.

    `why` is the error message, which says what to give instead.
    """
    never = {"type": "null", "errorMessage": why, "doNotSuggest": True}
    return {"properties": dict.fromkeys(names, never)}
