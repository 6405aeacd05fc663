"""Rules for phase inputs: what a phase gives for elements, such as a pretension.

They concern signs, what laws can carry, and spans with a midspan.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import numpy as np

from ..common.rules import Rule, are_rules_kept, not_negative, positive
from ..common.types import Array, ArrayLike, Bool, Float
from ..elements.abilities import PHASE_INPUTS, Hanging, accepted_inputs
from ..elements.element import Element
from ..elements.phase_input import InputValues
from ..elements.prestress import call_each_element

_TENSIONS = ("pretension", "force_density", "jacking", "end_tension")

_AT_MIDSPAN = {
    "sag": "middle at which a sag could be measured",
    "built_sag": "middle at which a sag could be measured",
    "horizontal_tension": "direction of a horizontal force",
}


def phase_inputs_keep_rules(
    inputs: Sequence[dict[str, InputValues]],
    groups: Sequence[Element],
    nodes: Float[ArrayLike, "n_row 3"],
) -> Bool[Array, ""]:
    """Return whether what a phase states of elements satisfies its rules, scalar bool, traced.

    Rules are, for example, that lengths are positive, that cables are not compressed, and that a
    force is within the capacity of the material.

    Args:
        inputs: for every group a dict from name (pretension, ...) to `InputValues`.
        groups: element groups, before `extrapolated`.
        nodes: initial positions of the rows, [n_row, 3].
    """
    rules = []
    for group, own in zip(groups, inputs, strict=True):
        capacity = functools.partial(call_each_element, "capacity", group)
        for name, stated in own.items():
            rules += phase_input_rules(name, stated, group, nodes, capacity)
    return are_rules_kept(rules)


def phase_input_rules(
    name: str,
    stated: InputValues,
    group: Element,
    nodes: Float[ArrayLike, "n_row 3"],
    capacity: Callable[[], tuple[Float[ArrayLike, " ..."], Float[ArrayLike, " ..."]]],
    path: str = "",
) -> list[Rule]:
    """Return all rules of a phase input of a group, for the elements that it concerns.

    They are `sign_rules`, `capacity_rules` and `span_rules`.

    Args:
        name: name of the input, such as "pretension".
        stated: its values for the elements of the group.
        group: element group.
        nodes: initial positions, [n_row, 3].
        capacity: function that returns the smallest and the largest force of every element, N.
        path: how a user writes it, for messages: ``phases[0].pretension['guys']``.
    """
    path = path or name
    rules = sign_rules(name, stated.values, group, path)
    if np.ndim(stated.values) < 2:  # a law of one strain says nothing of several components
        rules += capacity_rules(name, stated.values, group, capacity, path)
        rules += span_rules(name, group, nodes, path)
    if stated.chosen is None:
        return rules
    return [_restrict_to_elements(rule, stated.chosen) for rule in rules]


def _restrict_to_elements(rule, chosen):
    """Return a rule that looks at `chosen` elements only, [n_elem] bool."""

    def broken(*values):
        wrong = rule.broken(*values)
        return wrong & chosen.reshape(-1, *(1,) * (np.ndim(wrong) - 1))

    return rule._replace(broken=broken)


def sign_rules(
    name: str, values: Float[ArrayLike, " ..."], group: Element, path: str
) -> list[Rule]:
    """Return the rules on sign and size of the values of a phase input.

    Unstressed lengths and sags are positive, and prestrains above -1. Tensions of cables are not
    negative, of cables that hang positive; forces of contacts are not positive. Arguments are those
    of `phase_input_rules`; `values` are numbers, one for each element or one.
    """
    if name not in PHASE_INPUTS:
        return [rule(path, values) for rule in accepted_inputs(group)[name].rules]
    if name == "rest_length":
        return [positive(path, values, "an unstressed length must be positive")]
    if name == "prestrain":
        return [Rule(path, values, lambda v: v <= -1, "a prestrain must be above -1")]
    if name in ("sag", "built_sag"):
        text = "a sag must be positive; a straight cable has no length of its own"
        return [positive(path, values, text)]
    hangs = isinstance(group, Hanging)
    if name == "horizontal_tension" or (hangs and name in ("jacking", "end_tension")):
        text = "must be positive: a cable that hangs has a tension"
        return [positive(path, values, text)]
    if name in _TENSIONS and group.tension_only:
        text = "a cable carries tension only; must not be negative (use Bars)"
        return [not_negative(path, values, text)]
    if name in _TENSIONS and group.compression_only:
        text = "a contact carries compression only; must not be positive (use Bars)"
        return [Rule(path, values, lambda v: v > 0, text)]
    return []


def span_rules(
    name: str, group: Element, nodes: Float[ArrayLike, "n_row 3"], path: str
) -> list[Rule]:
    """Return the rule that spans with a stated sag have a middle: no node lies above the other.

    The same holds for a stated horizontal tension, which needs a horizontal direction. The list is
    empty for other inputs. Arguments are those of `phase_input_rules`.
    """
    if name not in _AT_MIDSPAN:
        return []

    def upright(nodes):
        chord = nodes[group.links[:, 1]] - nodes[group.links[:, 0]]
        # some roundings of the coordinates: below them the horizontal distance is not known
        least = 64 * np.finfo(chord.dtype).eps ** 2 * (chord**2).sum(axis=1)
        return (chord[:, :2] ** 2).sum(axis=1) <= least

    def text(index, *_):
        return (
            f"{path}[{index[0]}]: the nodes of the element lie above each other, so that "
            f"the span has no {_AT_MIDSPAN[name]}; give rest_length instead"
        )

    return [Rule(name, nodes, upright, text)]


def capacity_rules(
    name: str,
    values: Float[ArrayLike, " n_elem"],
    group: Element,
    capacity: Callable[[], tuple[Float[ArrayLike, " ..."], Float[ArrayLike, " ..."]]],
    path: str,
) -> list[Rule]:
    """Return the rule that the law of a group can carry stated forces `values`, [n_elem], N.

    The list is empty where no force is stated. Other arguments are those of `phase_input_rules`.
    """
    if name not in ("pretension", "jacking", "end_tension") or not group.has_rupture:
        return []
    text = "more than the law of the element can carry; must lie within its curve"

    def beyond(force, low, high):  # a curve with NaN has no capacity, and passes
        more = 1 + 8 * np.finfo(force.dtype).eps  # the peak of the curve itself is allowed
        return (force < low * more) | (force > high * more)

    return [Rule(path, (values, *capacity()), beyond, text)]
