"""From a jaxpr to Python source: equations by their rules, calls inline or as functions."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from ..common import jax_internals as internals
from ..common import jaxprs
from .block import Block, Names, Value
from .rules import RULES, NoRuleError, numpy_dtype, places

_INLINE = 40  # equations up to which a function or branch is written where it is called


def inner_jaxpr(program: Any) -> tuple[Any, Sequence[Any]]:
    """Return a jaxpr without its constants, and the constants; () for one that has none."""
    return getattr(program, "jaxpr", program), getattr(program, "consts", ())


def inner_programs(equation: Any) -> list[Any]:
    """Return the jaxprs in the parameters of an equation, with constants where they have some."""
    values = equation.params.values()
    each = [x for value in values for x in (value if isinstance(value, tuple | list) else (value,))]
    return [x for x in each if jaxprs.is_jaxpr(x)]


def inner_jaxprs(equation: Any) -> list[Any]:
    """Return the jaxprs in the parameters of an equation, without constants."""
    return [inner_jaxpr(x)[0] for x in inner_programs(equation)]


def write_equations(
    block: Block, jaxpr: Any, constants: Sequence[Any], inputs: Sequence[Value]
) -> list[Value]:
    """Write all equations of a jaxpr into a block; return the values of its results."""
    values: dict[Any, Value] = dict(zip(jaxpr.invars, inputs, strict=True))
    for x, own in zip(jaxpr.constvars, constants, strict=True):
        values[x] = block.names.constant(np.asarray(own, numpy_dtype(x.aval)))

    def read(x):
        if jaxprs.is_jaxpr_literal(x):
            return block.names.constant(np.asarray(x.val, numpy_dtype(x.aval)))
        return values[x]

    for equation in jaxpr.eqns:
        name = equation.primitive.name
        write = RULES.get(name)
        if write is None:
            known = equation.primitive in internals.functions_of_primitives
            write = RULES["traced"] if known else write_compiled
        found = write(block, equation, [read(x) for x in equation.invars])
        values.update(zip(equation.outvars, found, strict=True))
    return [read(x) for x in jaxpr.outvars]


def write_compiled(block: Block, equation: Any, inputs: Sequence[Value]) -> list[Value]:
    """Write a call of the XLA program of one equation, which has no rule.

    Raises:
        NoRuleError: it has programs in its parameters, or effects: the whole program is compiled.
    """
    if inner_programs(equation) or equation.effects:
        raise NoRuleError(equation.primitive.name)
    avals = [x.aval for x in equation.outvars]
    for aval in avals:
        numpy_dtype(aval)
    compiled = jax.jit(functools.partial(equation.primitive.bind, **equation.params))

    def compute(*arrays):
        found = compiled(*arrays)
        found = found if equation.primitive.multiple_results else [found]
        return [np.asarray(x) for x in found]

    name = block.names.new("x")
    block.names.space[name] = compute
    return block.write_call(f"{name}({places(inputs)})", [block.full(x) for x in inputs], avals)


def write_callable(
    block: Block, program: Any, inputs: Sequence[Value], avals: Sequence[Any], once: bool = False
) -> list[Value]:
    """Write a call of a jaxpr: its equations here if they are few, else a call of a function.

    The function is written when it is first called.

    Args:
        block: `Block` in which it is written.
        program: jaxpr, with its constants or without.
        inputs: values of its arguments.
        avals: abstract arrays with the shapes and dtypes of the results.
        once: whether to write the equations here also if this is the only call in the program.
    """
    jaxpr, constants = inner_jaxpr(program)
    if len(jaxpr.eqns) <= _INLINE or (once and block.names.is_called_once(jaxpr)):
        return write_equations(block, jaxpr, constants, inputs)
    name = block.names.function_name(program)
    text, full = f"{name}(w,{places(inputs)})", [block.full(x) for x in inputs]
    return block.write_call(text, full, avals, pure=not jaxpr.effects)


def count_calls(program: Any) -> dict[int, int]:
    """Return the number of calls of each jaxpr in a program, by the address of the jaxpr."""
    counts: dict[int, int] = {}

    def visit(jaxpr):
        for own in (inner for equation in jaxpr.eqns for inner in inner_jaxprs(equation)):
            counts[id(own)] = counts.get(id(own), 0) + 1
            if counts[id(own)] == 1:
                visit(own)

    visit(inner_jaxpr(program)[0])
    return counts


class LimitReachedError(Exception):
    """The limit of work of a call is reached before its result is known."""


def make_function(names: Names, program: Any) -> Callable[..., Any]:
    """Return the Python function that computes a jaxpr by NumPy.

    Its first argument is a list of two numbers, the work done so far and the most that is allowed;
    the others are arrays in the shapes of the jaxpr, numbers for those without axes. It returns a
    tuple of arrays.
    """
    jaxpr, constants = inner_jaxpr(program)
    block = Block(names)
    inputs = [
        Value(names.new("a"), tuple(x.aval.shape), numpy_dtype(x.aval), tuple(x.aval.shape), 1)
        for x in jaxpr.invars
    ]
    with np.errstate(all="ignore"):
        found = [block.full(x) for x in write_equations(block, jaxpr, constants, inputs)]
    name, arguments = names.new("f"), ",".join(["w", *(x.name for x in inputs)])
    lines = [f"def {name}({arguments}):", f" w[0]+={round(block.work, 1)}"]
    lines += block.render(" ")
    lines.append(f" return ({''.join(x.name + ',' for x in found)})")
    exec(compile("\n".join(lines), f"<jaxcable program {name}>", "exec"), names.space)
    return names.space[name]
