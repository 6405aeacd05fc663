"""Fields that must, or must not, be given together, for the schema of scene files.

Conditions lead to a statement on one field (``if`` and ``then``), so that validators name it.
"""

from __future__ import annotations

from ..elements.straight import Straight
from .kinds import Schema


def together(cls: type) -> Schema:
    """What must, or must not, be given together in the objects of a class."""
    rules: list[Schema] = []
    if cls.__name__ == "Supports":
        ways = "mask", "nodes", "clamps", "chosen"
        rules = [
            {
                "if": {"not": {"anyOf": [_given(name) for name in ways]}},
                "then": _missing("nodes, or clamps, or chosen and held, or mask"),
            },
            {"if": _given("chosen"), "then": _given("held")},
            {"if": {"anyOf": [_given("held"), _given("axes")]}, "then": _given("chosen")},
        ]
    if cls.__name__ == "Beams":
        bare = {"properties": {"section": {"not": _given("torsion"), "doNotSuggest": True}}}
        rules = [
            {
                "if": {"not": {"anyOf": [_given("torsional_stiffness"), {"not": bare}]}},
                "then": _missing("torsional_stiffness, or torsion in the section"),
            },
        ]
    if cls.__name__ == "LineLoads":
        begun: Schema = {"properties": {"geometry": {"const": "begun", "doNotSuggest": True}}}
        begun["required"] = ["geometry"]
        per = {"properties": {"per": {"enum": ["initial", "projected"], "doNotSuggest": True}}}
        rules = [{"if": begun, "then": {**per, "required": ["per"]}}]
    if issubclass(cls, Straight) and cls.__name__ != "Catenaries":
        one = "Give axial_stiffness, or area and law, or section: one of these."
        rules = [
            _first_of(
                (_given("axial_stiffness"), _no(("section", "area", "law"), one)),
                (_given("section"), _no(("area", "law"), one)),
                ({"anyOf": [_given("area"), _given("law")]}, _all_given("area", "law")),
                otherwise=_missing("axial_stiffness, or area and law, or section"),
            )
        ]
    return {"allOf": rules} if rules else {}


def _given(name):
    """The condition that an object has a field, and not null in it."""
    return {
        "required": [name],
        "properties": {name: {"not": {"type": "null"}, "doNotSuggest": True}},
    }


def _missing(words):
    """What no object satisfies, with the words for it where validators name a missing field."""
    return {"required": [words]}


def _no(names, why):
    """The schema of objects without some fields, or with null in them."""
    never = {"type": "null", "errorMessage": why, "doNotSuggest": True}
    return {"properties": dict.fromkeys(names, never)}


def _all_given(*names):
    """The schema of objects that have some fields, and not null in them."""
    return {"allOf": [_given(name) for name in names]}


def _first_of(*cases, otherwise):
    """What holds where the first of some conditions does: pairs (condition, schema)."""
    for condition, then in reversed(cases):
        otherwise = {"if": condition, "then": then, "else": otherwise}
    return otherwise
