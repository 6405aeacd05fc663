"""The table of rules: what NumPy does for each primitive of jax.

A rule is a function ``rule(block, equation, inputs)`` that writes an equation of a jaxpr into a
block of source and returns the values of its results. A primitive without a rule means that the
program is compiled by XLA.
"""

from __future__ import annotations

import functools
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
            (complex numbers, floats of fewer than 32 bits).
    """
    is_number = isinstance(aval.dtype, np.dtype) and aval.dtype.kind in "biu"
    if not is_number and aval.dtype not in (np.float32, np.float64):
        raise NoRuleError(f"numbers of dtype {aval.dtype}")
    return aval.dtype


def rule(*names: str) -> Callable[[Rule], Rule]:
    """Register a function as the rule of primitives (a decorator)."""

    def register(function: Rule) -> Rule:
        RULES.update(dict.fromkeys(names, function))
        return function

    return register


def result_of(equation: Any, k: int = 0) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return shape and dtype of the result with index `k` of an equation."""
    aval = equation.outvars[k].aval
    return tuple(aval.shape), numpy_dtype(aval)


def places(inputs: Sequence[Any], first: int = 0) -> str:
    """Return the placeholders of inputs in a template, separated by commas: "{0},{1}".

    `first` is the number of the first one.
    """
    return ",".join(f"{{{first + k}}}" for k in range(len(inputs)))


def write_full(
    block: Block, equation: Any, template: str, inputs: Sequence[Value], work: float | None = None
) -> list[Value]:
    """Write an expression of arrays in their full shapes; return its value in a list of one.

    It is the first result of the equation; `template` and `work` are as of `Block.write`.
    """
    full = [block.full(x) for x in inputs]
    return [block.write(template, full, *result_of(equation), work=work)]


def moves_entries(write: Callable[..., Value]) -> Rule:
    """Return the rule of an operation that only moves entries of its first input (a decorator).

    It is written by ``write(block, parameters, inputs, shape)``, with the shape of the result. If
    all entries are alike nothing is written: the value gets another shape.
    """

    @functools.wraps(write)
    def rule(block, equation, inputs):
        shape, _ = result_of(equation)
        if inputs[0].held == ():
            return [inputs[0]._replace(shape=shape)]
        return [write(block, equation.params, inputs, shape)]

    return rule
