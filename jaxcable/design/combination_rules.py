"""Rules of standards on combinations of actions: data in one file, and files of users.

Rules are a dict, as JSON holds it:

- ``source``: where the numbers are from.
- ``gamma``: partial factor of variable actions, default 1.
- ``kinds``: variable actions by name: ``{"snow": {"psi": [psi0, psi1, psi2], "gamma": 1.5}}``, both
  optional.
- ``combinations``: by name, each with ``limit state``; ``clause``; factors of ``permanent`` actions
  (unfavourable, favourable, or one number) and ``prestress``; ``exceptional``, kind and factor of
  the one exceptional action that is in it (accidental, seismic); ``on request``, true for a
  combination that is taken only where it is asked for by name; and of variable actions either

  - ``leading``, ``accompanying``: factors to multiply, among "gamma", "psi0", "psi1", "psi2", as
    in EN 1990: each action that acts leads in turn; or
  - ``terms``, factor by kind, and ``one of``, list of such dicts of which one kind each acts, as in
    ASCE 7. A list of dicts in place of such a dict: the kinds of one of them act, together.
"""

from __future__ import annotations

import copy
import functools
import json
from collections.abc import Mapping
from importlib import resources
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from ..common import checks

FACTORS = "gamma", "psi0", "psi1", "psi2"
"""What factors of leading and accompanying actions are products of."""
_LARGEST = 10.0  # a factor, not a percentage
ALWAYS = "permanent", "prestress"
"""Kinds of actions that are in every combination."""
_COMBINATION_KEYS = {
    *("limit state", "clause", "permanent", "prestress", "exceptional", "on request"),
    *("leading", "accompanying", "terms", "one of"),
}


@functools.cache
def _rules_of_package():
    """Return the rules of all standards in the package's JSON file, a dict by name."""
    text = resources.files(__package__).joinpath("combination_rules.json").read_text("utf-8")
    return json.loads(text)


def names_of_standards() -> list[str]:
    """Return the names of the standards whose rules the package has."""
    return list(_rules_of_package())


def combination_rules(rules: str | PathLike[str] | Mapping[str, Any]) -> dict[str, Any]:
    """Return the rules of a standard on combinations, to be read, or changed as an annex says.

    Args:
        rules: "EN 1990" or "ASCE 7-16"; or the name of a JSON file of yours; or rules as a dict.

    Returns:
        A dict of its own: ``source``, ``gamma``, ``kinds`` (of variable actions) and
        ``combinations``, see the module `jaxcable.design.combination_rules`.

    Raises:
        ValueError: unknown name, or a rule that is incomplete or has an unknown entry.
        OSError: the file cannot be read.

    Example:
        A National Annex with another partial factor:

        >>> rules = jc.design.combination_rules("EN 1990")
        >>> print(rules["kinds"]["wind"]["psi"], rules["gamma"])
        [0.6, 0.2, 0.0] 1.5
        >>> rules["gamma"] = 1.6
    """
    if isinstance(rules, Mapping):
        found = copy.deepcopy(dict(rules))
    elif isinstance(rules, str) and rules in _rules_of_package():
        found = copy.deepcopy(_rules_of_package()[rules])
    elif isinstance(rules, str | PathLike) and str(rules).endswith(".json"):
        try:
            found = json.loads(Path(rules).read_text(encoding="utf-8"))
        except ValueError as error:
            raise ValueError(f"rules: {rules} is no JSON file: {error}") from None
    else:
        hint = checks.suggest_names(rules, _rules_of_package())
        raise ValueError(f"rules = {rules!r}: expected a name, a .json file or a dict{hint}")
    _check_rules(found)
    return found


def _check_rules(rules):
    """Raise ValueError if rules lack an entry or have an unknown one; put in default entries."""
    if not isinstance(rules, dict) or not isinstance(rules.get("combinations"), dict):
        raise ValueError("rules: expected a dict with the entry 'combinations', a dict by name")
    unknown = set(rules) - {"source", "gamma", "kinds", "combinations"}
    if unknown:
        raise ValueError(f"rules: unknown entry {min(unknown)!r}")
    kinds = rules.setdefault("kinds", {})
    _check_factor(rules.setdefault("gamma", 1.0), "gamma")
    for name, kind in kinds.items():
        where = f"kinds[{name!r}]"
        if not isinstance(kind, dict) or set(kind) - {"psi", "gamma"}:
            raise ValueError(f"rules: {where}: expected a dict with 'psi' and 'gamma' at most")
        if name in ALWAYS:
            raise ValueError(f"rules: {where}: this kind is no variable action")
        if "gamma" in kind:
            _check_factor(kind["gamma"], f"{where}['gamma']")
        if "psi" in kind and (not isinstance(kind["psi"], list) or len(kind["psi"]) != 3):
            raise ValueError(f"rules: {where}['psi']: expected [psi0, psi1, psi2]")
        for psi in kind.get("psi", ()):
            _check_factor(psi, f"{where}['psi']", 1.0)
    for name, rule in rules["combinations"].items():
        _check_combination(f"combinations[{name!r}]", rule, kinds)


def _check_combination(where, rule, kinds):
    """Raise ValueError, which names `where`, if the rule of a combination is wrong.

    It has known entries only, a limit state, factors of permanent actions, and either "leading" or
    "terms"; factors and kinds of actions are known ones. `kinds` are the kinds of variable actions;
    the default factors of a leading action are put in.
    """
    if not isinstance(rule, dict) or not isinstance(rule.get("limit state"), str):
        raise ValueError(f"rules: {where}: expected a dict with 'limit state', a text")
    unknown = set(rule) - _COMBINATION_KEYS
    if unknown:
        raise ValueError(f"rules: {where}: unknown entry {min(unknown)!r}")
    for key in ALWAYS:
        if not isinstance(rule.get(key), list) or not rule[key]:
            raise ValueError(f"rules: {where}[{key!r}]: expected a list of factors")
        for factor in rule[key]:
            _check_factor(factor, f"{where}[{key!r}]")
    if ("terms" in rule) == ("leading" in rule):
        raise ValueError(f"rules: {where}: expected either 'leading' or 'terms'")
    for key in ("leading", "accompanying"):
        for factor in rule.setdefault(key, []) if "leading" in rule else ():
            if factor not in FACTORS:
                raise ValueError(
                    f"rules: {where}[{key!r}] = {factor!r}: expected one of {', '.join(FACTORS)}"
                )
    tables = [("exceptional", rule.get("exceptional", {})), ("terms", rule.get("terms", {}))]
    for k, one_of in enumerate(rule.get("one of", ())):
        tables += [(f"one of[{k}]", table) for table in alternatives(one_of)]
    for key, table in tables:
        for kind, factor in table.items():
            if key != "exceptional" and kind not in kinds:
                hint = checks.suggest_names(kind, kinds)
                raise ValueError(f"rules: {where}: {key}: {kind!r} is none of 'kinds'{hint}")
            _check_factor(factor, f"{where}: {key}: {kind!r}")


def _check_factor(value, name, most=_LARGEST):
    """Raise ValueError, with `name`, unless `value` is a number from 0 to `most`, by default 10."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= most:
        raise ValueError(f"rules: {name} = {value!r}: expected a number from 0 to {most:g}")


def clause_noting_changes(clause: str, name: str, rules: Mapping[str, Any]) -> str:
    """Return the clause of a combination, with a note if the factors are not those of the standard.

    Args:
        clause: clause of the standard that the combination is taken from.
        name: name of the combination.
        rules: all rules, of which the combination is one.
    """
    for published in _rules_of_package().values():
        same = published["combinations"].get(name)
        if same is not None and same.get("clause") == clause:
            parts = ("gamma", "kinds")
            if same != rules["combinations"][name] or any(
                published.get(part, 1.0) != rules.get(part, 1.0) for part in parts
            ):
                return f"{clause}; CHANGED factors, source: {rules.get('source', 'not given')}"
    return clause


def alternatives(one_of: Mapping[str, float] | list[dict[str, float]]) -> list[dict[str, float]]:
    """Return the alternatives of an entry of ``one of``: dicts, each of kinds that act together."""
    if isinstance(one_of, list):
        return one_of
    return [{kind: factor} for kind, factor in one_of.items()]


def describe_factors(rule: Mapping[str, Any]) -> str:
    """Return the factors of a rule as text: "permanent 1.35 or 1, leading gamma" and so on."""
    parts = [f"{kind} {' or '.join(f'{f:g}' for f in rule[kind])}" for kind in ALWAYS]
    parts += [f"{kind} {factor:g}" for kind, factor in rule.get("exceptional", {}).items()]
    if "leading" in rule:
        for key in ("leading", "accompanying"):
            parts.append(f"{key} {' '.join(rule[key]) or 1}")
    parts += [f"{kind} {factor:g}" for kind, factor in rule.get("terms", {}).items()]
    for one_of in rule.get("one of", ()):
        words = (
            " and ".join(f"{kind} {f:g}" for kind, f in table.items())
            for table in alternatives(one_of)
        )
        parts.append(f"one of ({', '.join(words)})")
    return ", ".join(parts)


class ActionKindFactors(NamedTuple):
    """Partial factor gamma and combination factors psi of a kind of variable action, or None."""

    kind: str
    gamma: float | None
    psi0: float | None
    psi1: float | None
    psi2: float | None


def factors_of_kind(kind: str, rules: Mapping[str, Any]) -> ActionKindFactors | None:
    """Return the `ActionKindFactors` of a kind of actions; None if the rules have none for it.

    Those are permanent and exceptional actions, and all kinds of rules that have the factors of
    each kind in each combination, as those of ASCE 7.
    """
    uses_kinds = any("leading" in rule for rule in rules["combinations"].values())
    if kind not in rules["kinds"] or not uses_kinds:
        return None
    own = rules["kinds"][kind]
    return ActionKindFactors(kind, own.get("gamma", rules["gamma"]), *own.get("psi", (None,) * 3))
