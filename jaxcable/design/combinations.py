"""Combinations of actions by the rules of a standard: names, factors, and the cases as a batch."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.phases import Phase
from ..common import checks
from ..common.tree import pytree
from ..common.types import Float
from ..loads import NodalLoads, as_list, combine
from .actions import Action, check_actions
from .combination_factors import factors_of_combinations, sets_of_variable_actions
from .combination_rules import (
    ALWAYS,
    ActionKindFactors,
    clause_noting_changes,
    combination_rules,
    describe_factors,
    factors_of_kind,
)

_MOST = 20_000  # combinations: more than anybody would look at, and seconds to enumerate


@pytree(
    static=(
        *("names", "rules", "limit_states", "clauses", "increments", "rule_factors"),
        *("kind_factors", "source"),
    )
)
class Combinations:
    """Combinations of actions, each with its name and its factors: result of `combinations`.

    Attributes:
        actions: list of `Action`.
        factors: factor of every action in every combination, [n_combination, n_action], -.
        names: of the combinations: that of the rule and a number.
        rules: name of the rule of each combination, such as "ULS 6.10".
        limit_states: of the combinations: "ultimate", "serviceability" and so on.
        clauses: what the factors are taken from, for each combination.
        increments: in how many equal steps a case is applied.
        rule_factors: by which factors the rule of each combination multiplies actions, in words.
        kind_factors: gamma and psi of the kinds of variable actions, each `ActionKindFactors`, as
            far as the rules have these.
        source: what the rules are taken from.

    Example:
        >>> snow = jc.design.Action("snow", "snow", jc.NodalLoads([1], (0.0, 0.0, -1e3)))
        >>> found = jc.design.combinations([snow])
        >>> print(found.select_rules("SLS frequent").formula(1))
        0.2 snow
        >>> print(found.select_limit_states("ultimate").cases.loads[0].forces[1])
        [    0.     0. -1500.]
    """

    actions: list[Action]
    factors: Float[np.ndarray, "n_combination n_action"]
    names: tuple[str, ...]
    rules: tuple[str, ...]
    limit_states: tuple[str, ...]
    clauses: tuple[str, ...]
    increments: int = 1
    rule_factors: tuple[str, ...] = ()
    kind_factors: tuple[ActionKindFactors, ...] = ()
    source: str = ""

    def __len__(self) -> int:
        return len(self.names)

    def formula(self, k: int) -> str:
        """Return combination `k` as a sum: ``1.35 self-weight + 1.5 snow + 0.9 wind``."""
        terms = zip(np.asarray(self.factors[k]), self.actions, strict=True)
        return " + ".join(f"{factor:.4g} {one.name}" for factor, one in terms if factor != 0)

    def __str__(self) -> str:
        width = max(map(len, self.names), default=0)
        return "\n".join(f"{name:<{width}}  {self.formula(k)}" for k, name in enumerate(self.names))

    def select_limit_states(self, *limit_states: str) -> Combinations:
        """Return the combinations of the named limit states, such as "serviceability".

        Raises ValueError for a limit state of which there are none.
        """
        return self._select_combinations(self.limit_states, limit_states, "limit_states")

    def select_rules(self, *rules: str) -> Combinations:
        """Return the combinations of the named rules, such as "SLS quasi-permanent".

        Raises ValueError for a rule of which there are none.
        """
        return self._select_combinations(self.rules, rules, "rules")

    def _select_combinations(self, have, wanted, argument):
        """Return the combinations whose entry in `have`, a tuple of texts, is one of `wanted`.

        Raises ValueError, which names `argument`, for a text that no combination has.
        """
        for one in wanted:
            if one not in have:
                hint = checks.suggest_names(one, dict.fromkeys(have))
                raise ValueError(f"{argument} = {one!r}: no combination is of it{hint}")
        chosen = [k for k, one in enumerate(have) if one in wanted]
        every = "names", "rules", "limit_states", "clauses", "rule_factors"
        texts = {name: tuple(getattr(self, name)[k] for k in chosen) for name in every}
        return dataclasses.replace(self, factors=self.factors[np.array(chosen)], **texts)

    @property
    def cases(self) -> Phase:
        """The cases as a batch, for `solve_cases`: a `Phase` with a leading axis [n_combination].

        Each applies what its factors add to the phases before: all of an action, or, of one that is
        `in_phases`, by factor - 1.

        Raises:
            ValueError: an action that is only in the phases would need another factor than 1 in a
                combination; two actions that state temperatures, shortenings or lost elements in
                different forms.
        """
        held = np.array([one.in_phases for one in self.actions], float)
        added = np.asarray(self.factors) - held
        for j, one in enumerate(self.actions):
            if not one.has_effects and added[:, j].any():
                k = int((added[:, j] != 0).argmax())
                raise ValueError(
                    f"actions: {one.name!r} has factor {self.factors[k][j]:g} in combination "
                    f"{self.names[k]!r}, but is in the phases by factor 1, and has no loads or "
                    "changes by which a case could add the rest"
                )
        acting = [k for k in range(len(self.actions)) if (added[:, k] != 0).any()]
        loads = {k: as_list(self.actions[k].loads) for k in acting}
        loads = {k: one for k, one in loads.items() if one}
        if not acting:  # the phases have all: a load of zero gives the batch its axis
            loads = {0: [NodalLoads([0], (0.0, 0.0, 0.0))]}
        batch = combine(loads, added[:, list(loads)]) if loads else None
        changes = {
            name: self._sum_inputs(name, acting, added) for name in ("temperature", "shortening")
        }
        lost = self._masks_of_lost_elements(acting, added)
        return Phase(loads=batch, increments=self.increments, removes=lost, **changes)

    def _sum_inputs(self, name, acting, added):
        """Return the factored sum of an input of actions in each case, [n_combination, ...].

        Args:
            name: field of `Action`: "temperature" or "shortening".
            acting: indices of the actions that a case changes.
            added: factors of all actions, [n_combination, n_action].

        Returns:
            A pytree in the form in which actions state the input; None if none does.
        """
        trees = self._inputs_of_actions(name, acting)
        if not trees:
            return None
        factors = jnp.asarray(added[:, list(trees)])
        return jax.tree.map(
            lambda *values: sum(
                jnp.multiply.outer(column, jnp.asarray(value, float))
                for column, value in zip(factors.T, values, strict=True)
            ),
            *trees.values(),
        )

    def _masks_of_lost_elements(self, acting, added):
        """Return which elements are lost in each case, bool [n_combination, n_elem] by group.

        Arguments as of `_sum_inputs`; None if no acting action removes elements.
        """
        trees = self._inputs_of_actions("removes", acting)
        if not trees:
            return None
        does = added[:, list(trees)].T != 0
        return jax.tree.map(
            lambda *masks: (
                sum(np.multiply.outer(d, m) for d, m in zip(does, masks, strict=True)) > 0
            ),
            *trees.values(),
        )

    def _inputs_of_actions(self, name, acting):
        """Return the field `name` of the actions `acting`, by their index, where it is given.

        Raises ValueError if two actions give it as pytrees of different structure or
        shapes.
        """
        trees = {k: getattr(self.actions[k], name) for k in acting}
        trees = {k: tree for k, tree in trees.items() if tree is not None}
        forms = {k: (jax.tree.structure(x), _leaf_shapes(x)) for k, x in trees.items()}
        first = next(iter(forms), None)
        for k, form in forms.items():
            if form != forms[first]:
                raise ValueError(
                    f"actions: {name} of {self.actions[k].name!r} has another form than that of "
                    f"{self.actions[first].name!r}; give both as one number, or as arrays [n_elem] "
                    "for the same groups"
                )
        return trees


def _leaf_shapes(tree):
    """Return the shapes of the arrays in a pytree, a list."""
    return [np.shape(leaf) for leaf in jax.tree.leaves(tree)]


def combinations(
    actions: Sequence[Action],
    rules: str | PathLike[str] | Mapping[str, Any] = "EN 1990",
    *,
    which: Sequence[str] | None = None,
    increments: int = 1,
) -> Combinations:
    """Combine named actions by the rules of a standard.

    Effects on cable structures cannot be superposed, and which actions are favourable is not known
    before the analysis. So every set of variable actions that may act together is combined, with
    each of them as the leading one, and permanent actions by both of their factors. Combinations
    with the same factors are listed once for each rule.

    Args:
        actions: list of `Action`.
        rules: "EN 1990" or "ASCE 7-16"; or a JSON file, or a dict, see `combination_rules`.

    Options:
        which: rules to combine by, as names such as ["ULS 6.10a", "ULS 6.10b"], or as limit states
            such as ["serviceability"] for all of their rules that are not marked "on request";
            default: all rules that are not. Accidental and seismic actions have the factor zero
            where these rules leave their kind out.
        increments: in how many equal steps each case is applied.

    Returns:
        `Combinations`. Their `cases` are analysed all at once by `solve_cases`; a report with
        ``names=combinations.names`` says which of them governs.

    Raises:
        ValueError: wrong actions or rules; a kind that the rules do not have; an action that no
            combination has; more than 20 000 combinations.

    Example:
        >>> dead = jc.NodalLoads([1], (0.0, 0.0, -400.0))
        >>> snow = jc.NodalLoads([1], (0.0, 0.0, -1000.0))
        >>> wind = jc.NodalLoads([1], (300.0, 0.0, 0.0))
        >>> actions = [
        ...     jc.design.Action("dead", "permanent", dead, in_phases=True),
        ...     jc.design.Action("snow", "snow", snow),
        ...     jc.design.Action("wind", "wind", wind),
        ... ]
        >>> found = jc.design.combinations(actions, "EN 1990", which=["ULS 6.10"])
        >>> print(found)  # doctest: +NORMALIZE_WHITESPACE
        ULS 6.10-1   1.35 dead
        ULS 6.10-2   1.35 dead + 1.5 wind
        ULS 6.10-3   1.35 dead + 1.5 snow
        ULS 6.10-4   1.35 dead + 1.5 snow + 0.9 wind
        ULS 6.10-5   1.35 dead + 0.75 snow + 1.5 wind
        ULS 6.10-6   1 dead
        ULS 6.10-7   1 dead + 1.5 wind
        ULS 6.10-8   1 dead + 1.5 snow
        ULS 6.10-9   1 dead + 1.5 snow + 0.9 wind
        ULS 6.10-10  1 dead + 0.75 snow + 1.5 wind
    """
    actions = check_actions(actions)
    checks.require_whole_number(increments, "increments")
    rules = combination_rules(rules)
    chosen = _chosen_rules(rules, which)
    _require_known_kinds(actions, rules, chosen)
    sets = list(itertools.islice(sets_of_variable_actions(actions, rules["kinds"]), _MOST + 1))
    _require_feasible_count(len(sets))
    rows: list[tuple[float, ...]] = []
    texts: list[tuple[str, str, str, str, str]] = []
    for name, rule in chosen.items():
        select_rules: dict[tuple[float, ...], None] = {}
        for row in factors_of_combinations(actions, rules, rule, sets):
            select_rules[row] = None
            _require_feasible_count(len(rows) + len(select_rules))
        rows += select_rules
        clause = clause_noting_changes(rule.get("clause", ""), name, rules)
        same = name, rule["limit state"], clause, describe_factors(rule)
        texts += [(f"{name}-{k}", *same) for k in range(1, 1 + len(select_rules))]
    if not rows:
        raise ValueError(f"actions: the rules {', '.join(chosen)} make no combination of them")
    factors = np.array(rows)
    left_out = _exceptional_kinds(rules["combinations"]) - _exceptional_kinds(chosen)
    for one, column in zip(actions, factors.T, strict=True):
        if not column.any() and one.kind not in left_out:
            raise ValueError(
                f"actions: {one.name!r} is in no combination of these rules: none has {one.kind!r} "
                "together with what the action needs, or its factors are zero"
            )
    names, of_rules, limit_states, clauses, rule_factors = zip(*texts, strict=True)
    kinds = (factors_of_kind(kind, rules) for kind in dict.fromkeys(one.kind for one in actions))
    return Combinations(
        actions,
        factors,
        names,
        of_rules,
        limit_states,
        clauses,
        increments,
        rule_factors,
        tuple(kind for kind in kinds if kind is not None),
        str(rules.get("source", "")),
    )


def _exceptional_kinds(combinations_by_name):
    """Return the kinds of exceptional actions (accidental, seismic) that some combinations have."""
    every = combinations_by_name.values()
    return {kind for rule in every for kind in rule.get("exceptional", ())}


def _require_feasible_count(count):
    """Raise ValueError if `count` combinations are more than 20 000, too many to analyse."""
    if count > _MOST:
        raise ValueError(
            f"actions: make more than {_MOST} combinations; say which of them are exclusive, or of "
            "one source"
        )


def _chosen_rules(rules, which):
    """Return the rules of combinations named by `which`, by name; ValueError for unknown names.

    `which` has names of rules or limit states; None: all rules that are not "on request".
    """
    every = rules["combinations"]
    usual = {name: rule for name, rule in every.items() if not rule.get("on request")}
    if which is None:
        return usual
    states = dict.fromkeys(rule["limit state"] for rule in every.values())
    which = [which] if isinstance(which, str) else list(which)
    if not which:
        raise ValueError(f"which: no rule{checks.suggest_names('', every)}")
    chosen = {}
    for word in which:
        if word not in every and word not in states:
            hint = checks.suggest_names(word, [*every, *states])
            raise ValueError(f"which: {word!r}: is no rule and no limit state{hint}")
        own = {name: rule for name, rule in usual.items() if rule["limit state"] == word}
        chosen |= {word: every[word]} if word in every else own
    if not chosen:
        raise ValueError(f"which: {which[0]!r}: all rules of it are on request: name them")
    return chosen


def _require_known_kinds(actions, rules, chosen):
    """Raise ValueError if the rules lack the kind of an action, or its combination factors psi.

    `rules` are all rules of a standard, `chosen` the rules of the wanted combinations, by name;
    only these need factors psi.
    """
    # rules that are not chosen may be the ones that have an exceptional kind
    known = [*ALWAYS, *sorted(_exceptional_kinds(rules["combinations"])), *rules["kinds"]]
    used = {
        f
        for rule in chosen.values()
        for key in ("leading", "accompanying")
        for f in rule.get(key, ())
    }
    for k, one in enumerate(actions):
        if one.kind not in known:
            hint = checks.suggest_names(one.kind, known)
            raise ValueError(f"actions[{k}]: kind = {one.kind!r}: the rules do not have it{hint}")
        variable = one.kind in rules["kinds"]
        if variable and used - {"gamma"} and "psi" not in rules["kinds"][one.kind]:
            raise ValueError(f"rules: kinds[{one.kind!r}] has no factors 'psi'")
        if one.exclusive is not None and not variable:
            raise ValueError(f"actions[{k}]: exclusive: {one.name!r} is no variable action")
        if one.source is not None and not variable and one.kind != "permanent":
            raise ValueError(
                f"actions[{k}]: source: {one.name!r} is neither a permanent nor a variable action"
            )
        if one.in_phases and variable and not one.has_effects:
            raise ValueError(
                f"actions[{k}]: {one.name!r} is a variable action in the phases and has no loads: "
                "combinations without it need them"
            )
