"""Fields that must, or must not, be given together, for the schema of scene files.

Conditions lead to a statement on one field (``if`` and ``then``), so that validators name it.
"""

from __future__ import annotations

from ..elements.straight import Straight
from .kinds import Schema


def together(cls: type) -> Schema:
    """What must, or must not, be given together in the objects of a class."""
    name, rules = cls.__name__, []
    if name == "Supports":
        ways = map(_given, ("mask", "nodes", "clamps", "chosen"))
        rules = [
            _unless({"anyOf": [*ways]}, "nodes, or clamps, or chosen and held, or mask"),
            {"if": _given("chosen"), "then": _given("held")},
            {"if": {"anyOf": [_given("held"), _given("axes")]}, "then": _given("chosen")},
        ]
    elif name == "Beams":
        bare: Schema = {"properties": {"section": {"not": _given("torsion"), "doNotSuggest": True}}}
        twists = {"anyOf": [_given("torsional_stiffness"), {"not": bare}]}
        rules = [_unless(twists, "torsional_stiffness, or torsion in the section")]
    elif name == "LineLoads":
        begun: Schema = {"properties": {"geometry": {"const": "begun", "doNotSuggest": True}}}
        per = {"properties": {"per": {"enum": ["initial", "projected"], "doNotSuggest": True}}}
        given = {"if": {**begun, "required": ["geometry"]}, "then": {**per, "required": ["per"]}}
        rules = [given]
    elif name in ("AreaLoads", "FacePressure"):
        one = _without("on", "elements", why="Give faces, or a group whose elements have them.")
        rules = [{"if": _given("faces"), "then": one}]
    elif issubclass(cls, Straight) and name != "Catenaries":
        both = [_given("area"), _given("law")]
        missing = "axial_stiffness, or area and law, or section"
        either = {**_unless({"anyOf": both}, missing), "else": {"allOf": both}}
        by_section = {"if": _given("section"), "then": _without("area", "law"), "else": either}
        others = _without("section", "area", "law")
        rules = [{"if": _given("axial_stiffness"), "then": others, "else": by_section}]
    return {"allOf": rules} if rules else {}


def _given(name):
    """The condition that an object has a field, and not null in it."""
    return {
        "required": [name],
        "properties": {name: {"not": {"type": "null"}, "doNotSuggest": True}},
    }


def _unless(condition, words):
    """What only holds under a condition; validators name what is missing in words, as a field."""
    return {"if": {"not": condition}, "then": {"required": [words]}}


_STIFF = "Give axial_stiffness, or area and law, or section: one of these."


def _without(*names, why=_STIFF):
    """The schema of objects without some fields, or with null in them, and what else to give."""
    never = {"type": "null", "errorMessage": why, "doNotSuggest": True}
    return {"properties": dict.fromkeys(names, never)}
