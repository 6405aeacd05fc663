"""Tests of the states of an element class: inputs for no element, activated elements."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import copy_with
from .abilities import Hanging, accepted_inputs, component_names
from .element import Element
from .element_state import OwnState
from .phase_input import InputValues
from .prestress import call_each_element

_NO_CHANGE_AT_ONCE = ("jacking", "end_tension", "horizontal_tension", "built_sag")
"""Inputs that `apply_phase_inputs` never gets: they hold in equilibrium."""


def phase_input_faults(group: Element, state: OwnState, ends: Any) -> Iterator[str]:
    """Yield faults of `apply_phase_inputs` where an input selects no element.

    A phase without an input gets one for no element if another phase has the input.
    """
    stateable: Any = group  # a `Prestressable`, if it accepts any input
    for name in accepted_inputs(group):
        if not _can_test_input(name, group):
            continue
        shape = (len(group.links), *filter(None, [len(component_names(group, name))]))
        nothing = {name: InputValues(jnp.zeros(shape), jnp.zeros(len(group.links), bool))}
        words = "the same state where the input concerns no element"
        try:
            after: Any = stateable.apply_phase_inputs(state, ends, nothing)
            wrong = _describe_state_difference(state, after)
        except Exception as error:  # of the author's code
            yield describe_error(f"apply_phase_inputs: {name}", words, error)
            continue
        pairs = zip(*map(jax.tree.leaves, (state, after)), strict=not wrong)
        if not wrong and not all(np.array_equal(a, b, equal_nan=True) for a, b in pairs):
            wrong = "other numbers; take `stated.select(new, old)`"
        if wrong:
            yield f"apply_phase_inputs: {name}: expected {words}, got {wrong}"


def activation_faults(group: Element, state: OwnState, ends: Any, motion: Any) -> Iterator[str]:
    """Yield faults of `state_at_activation`: the state of elements activated in a motion."""
    if type(group).state_at_activation is Element.state_at_activation:
        return
    words = "a state like that of `start`"
    begins = group.with_activation(state, jnp.ones(len(group.links), bool))
    if group.has_memory:
        begins = copy_with(begins, memory=group.initial_memory())
    try:
        wrong = _describe_state_difference(
            begins, call_each_element("state_at_activation", group, begins, ends, motion)
        )
    except Exception as error:  # of the author's code
        yield describe_error("state_at_activation", words, error)
        return
    if wrong:
        yield f"state_at_activation: expected {words}, got {wrong}"


def _can_test_input(name, group):
    """Return whether an input, by name, can be tested with `apply_phase_inputs` of the group.

    A sag needs a weight, a temperature a coefficient of expansion; those that hold in equilibrium
    only are never applied at once.
    """
    needs = {
        "sag": isinstance(group, Hanging) and group.weight is not None,
        "temperature": group.expansion is not None,
    }
    return name not in _NO_CHANGE_AT_ONCE and needs.get(name, True)


def _describe_state_difference(before, after):
    """Return words that say how class, fields or shapes of two states differ.

    The text is empty if they do not; values are not compared.
    """
    if type(after) is not type(before):
        return describe_type(after)
    if jax.tree.structure(after) != jax.tree.structure(before):
        return "other fields that are None"
    for name in type(before)._all_fields:
        pairs = zip(*(jax.tree.leaves(getattr(x, name)) for x in (before, after)), strict=True)
        for a, b in pairs:
            if np.shape(a) != np.shape(b) or jnp.result_type(a) != jnp.result_type(b):
                return f"`{name}` {jnp.result_type(b)} of shape {np.shape(b)}"
    return ""


def describe_error(name: str, words: str, error: Exception) -> str:
    """Return the sentence that the method `name`, expected to give `words`, raised an `error`."""
    text = next(iter(str(error).strip().splitlines()), "")
    return f"{name}: expected {words}, got {type(error).__name__}: {text}"


def describe_type(value: Any) -> str:
    """Return in words the type of a value that should be an array."""
    return "None" if value is None else f"a {type(value).__name__}"
