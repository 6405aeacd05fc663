"""Rules for numbers, each stated once: known numbers are refused, traced ones fail an analysis.

A constructor cannot look at a number that is being traced. An object with rules therefore lists
them in ``rules()``: its constructor refuses known numbers that break a rule (`refuse_if_broken`),
and the compiled core of an analysis, in which all numbers are traced, ends in a status if one is
broken (`are_rules_kept`). Functions that only compute numbers, outside of any analysis, return NaN
(`nan_if_broken`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .checks import array_if_known, numpy_or_jax
from .tree import PerElement
from .types import Array, ArrayLike, Bool, Float, PyTree


class Rule(NamedTuple):
    """A rule that the values of one argument must satisfy, such as "must be positive".

    Attributes:
        name: name of the argument.
        values: the array of the argument, or None if it is not given; or a tuple of this array and
            the arrays that it is compared with.
        broken: function of the values, NumPy or traced arrays, that is True where the rule is
            broken; in the shape of the first array, or a scalar for all of it. NaN must not break a
            rule (comparisons with NaN are False): the analysis has another status for it.
        text: the rule in words; or a function of the index and the values that returns the whole
            message.
    """

    name: str
    values: Float[ArrayLike, " ..."] | tuple[ArrayLike, ...] | None
    broken: Callable[..., Bool[ArrayLike, " ..."]]
    text: str | Callable[..., str]


def positive(
    name: str, values: Float[ArrayLike, " ..."] | None, text: str = "must be positive"
) -> Rule:
    """Return the rule that all `values` of the argument `name` are above zero."""
    return Rule(name, values, lambda v: v <= 0, text)


def not_negative(
    name: str, values: Float[ArrayLike, " ..."] | None, text: str = "must not be negative"
) -> Rule:
    """Return the rule that all `values` of the argument `name` are zero or above."""
    return Rule(name, values, lambda v: v < 0, text)


def whole_number(
    name: str, values: ArrayLike | None, text: str = "expected a whole number"
) -> Rule:
    """Return the rule that all `values` of the argument `name` are whole (also as floats)."""

    def broken(v):
        # the remainder of an integer, which is zero, makes a long program
        return v != v if jnp.issubdtype(jnp.result_type(v), jnp.integer) else v % 1 != 0

    return Rule(name, values, broken, text)


def refuse_if_broken(rules: Sequence[Rule]) -> None:
    """Raise ValueError for the first rule that known numbers break, naming argument and index.

    Traced numbers are not checked, and NaN breaks no rule.
    """
    for rule in rules:
        values: list[Any] = [array_if_known(v) for v in _values_as_tuple(rule.values)]
        if any(value is None for value in values):
            continue
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            broken = np.asarray(rule.broken(*values))
        if not broken.any():
            continue
        index = tuple(int(i) for i in np.argwhere(broken)[0])
        if callable(rule.text):
            raise ValueError(rule.text(index, *values))
        where = f"[{', '.join(map(str, index))}]" if index else ""
        shown = f" = {values[0][index]!s}" if broken.shape == values[0].shape else ""
        raise ValueError(f"{rule.name}{where}{shown}: {rule.text}")


def are_rules_kept(rules: Sequence[Rule]) -> Bool[Array, ""]:
    """Return whether numbers satisfy all `rules`, a scalar bool; traced if any number is."""
    sound: Any = np.bool_(True)
    for rule in rules:
        if rule.values is None:
            continue
        values = _values_as_tuple(rule.values)
        xp = numpy_or_jax(values)
        broken = rule.broken(*map(xp.asarray, values))
        sound = sound & ~numpy_or_jax(broken).any(broken)
    return sound


def nan_if_broken(rule: Rule) -> Float[ArrayLike, " ..."]:
    """Return the values of a rule, with NaN where traced values break it.

    Raises ValueError where values that are known (not traced) break it.
    """
    refuse_if_broken([rule])
    values = _values_as_tuple(rule.values)
    if all(array_if_known(v) is not None for v in values):
        return values[0]
    return jnp.where(rule.broken(*values), jnp.nan, values[0])


def collect_rules(tree: PyTree[Any]) -> list[Rule]:
    """Return the rules of all objects in a pytree: the results of their methods ``rules()``."""
    if isinstance(tree, PerElement):
        return [_rule_of_each_element(tree)]
    rules = tree.rules() if hasattr(tree, "rules") else []
    if dataclasses.is_dataclass(tree):
        parts: Iterable[Any] = [getattr(tree, field.name) for field in dataclasses.fields(tree)]
    elif isinstance(tree, list | tuple):
        parts = tree
    elif isinstance(tree, dict):
        parts = tree.values()
    else:
        parts = []
    return [*rules, *(rule for part in parts for rule in collect_rules(part))]


def _rule_of_each_element(tree):
    """Return a `Rule`: all objects of a `PerElement` keep the rules of their class."""
    leaves, shape = jax.tree.flatten(tree.every)

    def broken(*leaves):
        return jax.vmap(
            lambda *one: ~are_rules_kept(collect_rules(jax.tree.unflatten(shape, one)))
        )(*leaves)

    return Rule("every", tuple(leaves), broken, "breaks a rule of its class")


def _values_as_tuple(values):
    """Return the values of a rule, an array or a tuple of arrays, as a tuple; None as (None,)."""
    values = values if isinstance(values, tuple) else (values,)
    return tuple(v if v is None or isinstance(v, jax.Array) else np.asarray(v) for v in values)
