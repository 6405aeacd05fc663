"""Rules that numbers keep, each stated once: known numbers are refused, traced ones fail.

A constructor cannot look at a number that is being traced. So an object with rules gives them as
a list, from ``rules()``: the constructor refuses what is known (`refuse`), and the compiled core of
an analysis, to which all numbers are traced, makes a status of what breaks them (`kept`). Helpers
that only compute numbers, outside of any analysis, give NaN (`or_nan`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .checks import concrete
from .tree import Each
from .types import Array, ArrayLike, Bool, Float, PyTree


class Rule(NamedTuple):
    """One rule of one argument.

    Attributes:
        name: of the argument.
        values: its array, None if there is none, or a tuple with what it is judged by.
        broken: function of these that is True where the rule is broken, in the shape of the first
            of them or [] for all of it, of NumPy and traced arrays alike. A NaN is no error but a
            status of its own, so that comparisons, which are False there, say what is wrong.
        text: the rule in words; or a function of the index and the values that says all.
    """

    name: str
    values: Float[ArrayLike, " ..."] | tuple[ArrayLike, ...] | None
    broken: Callable[..., Bool[ArrayLike, " ..."]]
    text: str | Callable[..., str]


def positive(
    name: str, values: Float[ArrayLike, " ..."] | None, text: str = "must be positive"
) -> Rule:
    """The rule that numbers are above zero."""
    return Rule(name, values, lambda v: v <= 0, text)


def not_negative(
    name: str, values: Float[ArrayLike, " ..."] | None, text: str = "must not be negative"
) -> Rule:
    """The rule that numbers are zero or above."""
    return Rule(name, values, lambda v: v < 0, text)


def refuse(rules: Sequence[Rule]) -> None:
    """Raise ValueError for the first rule that known numbers break, naming the argument and index.

    Numbers that are being traced pass, and so does NaN.
    """
    for rule in rules:
        values: list[Any] = (
            [None] if rule.values is None else [concrete(v) for v in _all(rule.values)]
        )
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


def kept(rules: Sequence[Rule], among: Bool[ArrayLike, " ..."] | None = None) -> Bool[Array, ""]:
    """Whether numbers keep the rules, scalar bool, traced.

    Args:
        rules: list of `Rule`.
        among: the entries that count, bool; None for all.
    """
    whole = jnp.ones((), bool)
    for rule in rules:
        if rule.values is None:
            continue
        broken = rule.broken(*map(jnp.asarray, _all(rule.values)))
        whole = whole & ~jnp.any(broken if among is None else broken & among)
    return whole


def or_nan(rule: Rule) -> Float[ArrayLike, " ..."]:
    """The values of a rule: refused if they are known to break it, NaN where traced ones do."""
    refuse([rule])
    values = _all(rule.values)
    if all(concrete(v) is not None for v in values):
        return values[0]
    return jnp.where(rule.broken(*values), jnp.nan, values[0])


def rules_of(tree: PyTree[Any]) -> list[Rule]:
    """The rules of all objects in a tree of pytree objects, lists, tuples and dicts: a list."""
    if isinstance(tree, Each):
        return [_of_each(tree)]
    own = tree.rules() if hasattr(tree, "rules") else []
    if dataclasses.is_dataclass(tree):
        inner: Iterable[Any] = [getattr(tree, field.name) for field in dataclasses.fields(tree)]
    elif isinstance(tree, list | tuple):
        inner = tree
    elif isinstance(tree, dict):
        inner = tree.values()
    else:
        inner = []
    return [*own, *(rule for part in inner for rule in rules_of(part))]


def _of_each(tree):
    """The rules of every one of `Each` as one."""
    leaves, shape = jax.tree.flatten(tree.every)

    def broken(*leaves):
        return jax.vmap(lambda *own: ~kept(rules_of(jax.tree.unflatten(shape, own))))(*leaves)

    return Rule("every", tuple(leaves), broken, "breaks a rule of its kind")


def _all(values):
    """The arrays of a rule, a tuple: lists of numbers are one array."""
    values = values if isinstance(values, tuple) else (values,)
    return tuple(v if isinstance(v, jax.Array) else np.asarray(v) for v in values)
