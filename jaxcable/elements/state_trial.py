"""A trial of the states of an element class: statements that concern nothing, added elements."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import copy_with
from .abilities import Sagging, components_of, statements_of
from .element import Element
from .element_state import OwnState
from .prestress import of_each
from .stated import Stated


def restated(group: Element, state: OwnState, ends: Any) -> Iterator[str]:
    """Iterate over what is wrong with the state after a statement that concerns no element.

    Such ones stand in phases that state nothing, where another phase states something.
    """
    stateable: Any = group  # a `Prestressable`, if it accepts any statement
    for name in statements_of(group):
        if not _can_be_stated(name, group):
            continue
        shape = (len(group.links), *filter(None, [len(components_of(group, name))]))
        nothing = {name: Stated(jnp.zeros(shape), jnp.zeros(len(group.links), bool))}
        words = "the same state where the statement concerns no element"
        try:
            after: Any = stateable.restate(state, ends, nothing)
            wrong = _unlike(state, after)
        except Exception as error:  # of the author's code
            yield raised(f"restate: {name}", words, error)
            continue
        pairs = zip(*map(jax.tree.leaves, (state, after)), strict=not wrong)
        if not wrong and not all(np.array_equal(a, b, equal_nan=True) for a, b in pairs):
            wrong = "other numbers; take `stated.over(new, old)`"
        if wrong:
            yield f"restate: {name}: expected {words}, got {wrong}"


def added(group: Element, state: OwnState, ends: Any, motion: Any) -> Iterator[str]:
    """Iterate over what is wrong with the state of elements that are added after a motion."""
    if type(group).found is Element.found:
        return
    words = "a state like that of `start`"
    begins = group.partly(state, jnp.ones(len(group.links), bool))
    if group.remembers:
        begins = copy_with(begins, memory=group.initial_memory())
    try:
        wrong = _unlike(begins, of_each("found", group, begins, ends, motion))
    except Exception as error:  # of the author's code
        yield raised("found", words, error)
        return
    if wrong:
        yield f"found: expected {words}, got {wrong}"


def _can_be_stated(name, group):
    """Whether a statement can be tried: the class accepts it, and the group has what it needs."""
    needs = {
        "sag": isinstance(group, Sagging) and group.weight is not None,
        "temperature": group.expansion is not None,
    }
    return name != "jacking" and needs.get(name, True)


def _unlike(before, after):
    """What a state has otherwise than the one before it, in words; empty if it is like it."""
    if type(after) is not type(before):
        return kind_of(after)
    if jax.tree.structure(after) != jax.tree.structure(before):
        return "other fields that are None"
    for name in type(before)._all_fields:
        pairs = zip(*(jax.tree.leaves(getattr(x, name)) for x in (before, after)), strict=True)
        for a, b in pairs:
            if np.shape(a) != np.shape(b) or jnp.result_type(a) != jnp.result_type(b):
                return f"`{name}` {jnp.result_type(b)} of shape {np.shape(b)}"
    return ""


def raised(name: str, words: str, error: Exception) -> str:
    """The sentence on a method that raises an error."""
    text = next(iter(str(error).strip().splitlines()), "")
    return f"{name}: expected {words}, got {type(error).__name__}: {text}"


def kind_of(value: Any) -> str:
    """What a value is that is no array, in words."""
    return "None" if value is None else f"a {type(value).__name__}"
