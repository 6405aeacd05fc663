"""The table of rules: what NumPy does for each primitive of jax.

A rule is a function ``rule(block, equation, inputs)`` that writes an equation of a jaxpr into a
block of source and returns the values of its results. A primitive without a rule means that the
program is compiled by XLA.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .block import Block, Value

Rule = Callable[[Block, Any, Sequence[Value]], Sequence[Value]]
RULES: dict[str, Rule] = {}
"""Rules by names of primitives."""


class NoRuleError(NotImplementedError):
    """A program has a primitive that has no rule here."""


def numpy_dtype(aval: Any) -> np.dtype[Any]:
    """Return the dtype of an abstract value.

    Raises:
        NoRuleError: NumPy has none (keys of random numbers), or the rules are not written for it
            (complex numbers).
    """
    if not isinstance(aval.dtype, np.dtype) or aval.dtype.kind == "c":
        raise NoRuleError(f"numbers of dtype {aval.dtype}")
    return aval.dtype


def rule(*names: str) -> Callable[[Rule], Rule]:
    """Register a function as the rule of primitives (a decorator)."""

    def register(function: Rule) -> Rule:
        RULES.update(dict.fromkeys(names, function))
        return function

    return register
