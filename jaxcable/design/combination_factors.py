"""Factors of actions in the combinations of a rule: every set of them that may act together."""

from __future__ import annotations

import itertools
from collections.abc import Container, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from .actions import Action
from .combination_rules import ALWAYS, alternatives


def sets_of_variable_actions(
    actions: Sequence[Action], kinds: Container[str]
) -> Iterator[tuple[int, ...]]:
    """Yield the sets of variable actions that may act together, as indices, the empty set first.

    `kinds` are the kinds of variable actions. The sets respect `exclusive` and `excludes`;
    `needs` is checked with the factors.
    """
    slots: dict[Any, list[int | None]] = {}
    for k, one in enumerate(actions):
        if one.kind in kinds:
            slots.setdefault(one.exclusive or (k,), [None]).append(k)
    for choice in itertools.product(*slots.values()):
        acting = tuple(k for k in choice if k is not None)
        names = {actions[k].name for k in acting}
        if not any(names & set(actions[k].excludes) for k in acting):
            yield acting


def factors_of_combinations(
    actions: Sequence[Action],
    rules: Mapping[str, Any],
    rule: Mapping[str, Any],
    sets: Sequence[tuple[int, ...]],
) -> Iterator[tuple[float, ...]]:
    """Yield the factors of all actions in the combinations of one rule.

    Args:
        actions: of which there are n_action.
        rules: all rules, see `combination_rules`.
        rule: one of their combinations.
        sets: sets of variable actions that may act together, of `sets_of_variable_actions`.

    Yields:
        Factors [n_action]; the same ones may come again.
    """
    exceptional = rule.get("exceptional", {})
    special = [k for k, one in enumerate(actions) if one.kind in exceptional]
    if exceptional and not special:
        return
    for always in _factors_of_permanent(actions, rule):
        for acting in sets:
            for variable in _factors_of_variables(actions, rules, rule, acting):
                for k in special or (None,):
                    row = always | variable
                    if k is not None:
                        row[k] = exceptional[actions[k].kind]
                    if _meets_needs_and_excludes(actions, row):
                        yield tuple(row.get(i, 0.0) for i in range(len(actions)))


def _factors_of_permanent(actions, rule) -> Iterator[dict[int, float]]:
    """Yield every choice of factors of permanent actions and prestress, a dict by index of action.

    Actions of one source have the same factor; each source has each factor of the rule in turn.
    """
    sources: dict[Any, list[int]] = {}
    for k, one in enumerate(actions):
        if one.kind in ALWAYS:
            sources.setdefault((one.kind, one.source or k), []).append(k)
    options = [rule[kind] for kind, _ in sources]
    for factors in itertools.product(*options):
        yield {
            k: float(factor)
            for members, factor in zip(sources.values(), factors, strict=True)
            for k in members
        }


def _factors_of_variables(actions, rules, rule, acting) -> Iterator[dict[int, float]]:
    """Yield factors by index of the variable actions `acting`, with each source leading in turn.

    Nothing is yielded if the rule does not let these actions act together.
    """
    if "terms" in rule:
        found = _listed_factors(rule, {actions[k].kind for k in acting})
        if found is not None:
            yield {k: found[actions[k].kind] for k in acting}
        return
    sources = {k: actions[k].source or (k,) for k in acting}
    for leading in dict.fromkeys(sources.values()) or [None]:
        row = {}
        for k in acting:
            kind = rules["kinds"][actions[k].kind]
            psi = dict(zip(("psi0", "psi1", "psi2"), kind.get("psi", ()), strict=False))
            values = {"gamma": kind.get("gamma", rules["gamma"]), **psi}
            terms = rule["leading" if sources[k] == leading else "accompanying"]
            row[k] = float(np.prod([values[term] for term in terms]))
        yield row


def _listed_factors(rule, kinds):
    """Return the factor of each kind by a rule with `terms`; None if they cannot act together."""
    found = {kind: rule["terms"][kind] for kind in kinds if kind in rule["terms"]}
    for one_of in rule.get("one of", ()):
        acting = [table for table in alternatives(one_of) if kinds & set(table)]
        if len(acting) > 1:
            return None
        found |= {kind: table[kind] for table in acting for kind in kinds & set(table)}
    return found if set(found) == kinds else None


def _meets_needs_and_excludes(actions, row):
    """Return whether all acting actions have those that they need, and none that they exclude.

    `row` has factors by index of the action; acting are those whose factor is not zero.
    """
    names = {actions[k].name for k, factor in row.items() if factor != 0}
    active = (actions[k] for k, factor in row.items() if factor != 0)
    return all(set(one.needs) <= names and not names & set(one.excludes) for one in active)
