"""Rules for what a phase states of elements, called statements, such as a pretension.

They concern signs, what laws can carry, and spans with a midspan.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import numpy as np

from ..common.rules import Rule, are_rules_kept, not_negative, positive
from ..common.types import Array, ArrayLike, Bool, Float
from ..elements.abilities import STATEMENTS, Sagging, statements_of
from ..elements.element import Element
from ..elements.prestress import StatedValues, call_each_element

_TENSIONS = ("pretension", "force_density", "jacking", "end_tension")

_AT_MIDSPAN = {
    "sag": "middle at which a sag could be measured",
    "built_sag": "middle at which a sag could be measured",
    "horizontal_tension": "direction of a horizontal force",
}


def statements_keep_rules(
    statements: Sequence[dict[str, StatedValues]],
    groups: Sequence[Element],
    nodes: Float[ArrayLike, "n_row 3"],
) -> Bool[Array, ""]:
    """Return whether what a phase states of elements satisfies its rules, scalar bool, traced.

    Rules are, for example, that lengths are positive, that cables are not compressed, and that a
    force is within the capacity of the material.

    Args:
        statements: for every group a dict from name (pretension, ...) to `StatedValues`.
        groups: element groups, before `extrapolated`.
        nodes: initial positions of the rows, [n_row, 3].
    """
    all_kept = are_rules_kept([])
    for group, own in zip(groups, statements, strict=True):
        for name, stated in own.items():
            rules = value_rules(name, stated.values, group)
            if np.ndim(stated.values) > 1:  # a law of one strain says nothing of them
                chosen = None if stated.chosen is None else stated.chosen[:, None]
                all_kept = all_kept & are_rules_kept(rules, chosen)
                continue
            capacity = functools.partial(call_each_element, "capacity", group)
            rules += capacity_rules(name, stated.values, group, capacity)
            rules += span_rules(name, group, nodes)
            all_kept = all_kept & are_rules_kept(rules, stated.chosen)
    return all_kept


def value_rules(
    name: str, values: Float[ArrayLike, " ..."], group: Element, path: str = ""
) -> list[Rule]:
    """Return the rules on sign and size of the values of a statement, a list of `Rule`.

    Args:
        name: name of the statement, such as "pretension".
        values: values for the elements of the group.
        group: element group.
        path: how a user writes it, for messages: ``phases[0].pretension['guys']``.
    """
    path = path or name
    if name not in STATEMENTS:
        return [rule(path, values) for rule in statements_of(group)[name].rules]
    if name == "rest_length":
        return [positive(path, values, "an unstressed length must be positive")]
    if name == "prestrain":
        return [Rule(path, values, lambda v: v <= -1, "a prestrain must be above -1")]
    if name in ("sag", "built_sag"):
        text = "a sag must be positive; a straight cable has no length of its own"
        return [positive(path, values, text)]
    hangs = isinstance(group, Sagging)
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
    name: str,
    group: Element,
    nodes: Float[ArrayLike, "n_row 3"],
    chosen: Bool[np.ndarray, " n_elem"] | None = None,
    path: str = "",
) -> list[Rule]:
    """Return the rule that spans with a stated sag have a middle: no node lies above the other.

    The same holds for a stated horizontal tension, which needs a horizontal direction. The list is
    empty for other statements.

    Args:
        name, group: name of the statement, element group.
        nodes: initial positions, [n_row, 3].
        chosen: elements that the statement concerns, [n_elem] bool; None for all.
        path: the statement in messages; default its name.
    """
    if name not in _AT_MIDSPAN:
        return []

    def upright(nodes):
        chord = nodes[group.links[:, 1]] - nodes[group.links[:, 0]]
        # some roundings of the coordinates: below them the horizontal distance is not known
        least = 64 * np.finfo(chord.dtype).eps ** 2 * (chord**2).sum(axis=1)
        found = (chord[:, :2] ** 2).sum(axis=1) <= least
        return found if chosen is None else found & chosen

    def text(index, *_):
        return (
            f"{path or name}[{index[0]}]: the nodes of the element lie above each other, so that "
            f"the span has no {_AT_MIDSPAN[name]}; give rest_length instead"
        )

    return [Rule(name, nodes, upright, text)]


def capacity_rules(
    name: str,
    values: Float[ArrayLike, " n_elem"],
    group: Element,
    capacity: Callable[[], tuple[Float[ArrayLike, " ..."], Float[ArrayLike, " ..."]]],
    path: str = "",
) -> list[Rule]:
    """Return the rule that the law of a group can carry stated forces `values`, [n_elem], N.

    The list is empty where no force is stated. `capacity` returns the smallest and the largest
    force of every element, `path` is the statement in messages.
    """
    if name not in ("pretension", "jacking", "end_tension") or not group.has_rupture:
        return []
    text = "more than the law of the element can carry; must lie within its curve"

    def beyond(force, low, high):  # a curve with NaN has no capacity, and passes
        more = 1 + 8 * np.finfo(force.dtype).eps  # the peak of the curve itself is allowed
        return (force < low * more) | (force > high * more)

    return [Rule(path or name, (values, *capacity()), beyond, text)]
