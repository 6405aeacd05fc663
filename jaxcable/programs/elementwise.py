"""Rules of operations on each entry of arrays: expressions of NumPy, which broadcasts."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy  # its parts are imported where they are first used

from .block import Block, Value
from .rules import NoRuleError, numpy_dtype, places, result_of, rule

_NUMPY = (  # names of functions that NumPy and jax share
    "sqrt cbrt sign floor ceil sin cos tan sinh cosh tanh exp exp2 expm1 log log1p log2"
)
_ARC_FUNCTIONS = "sin cos tan sinh cosh tanh"
_TEMPLATES = {  # {0}, {1}, ... are the operands
    **{f: f"np.{f}({{0}})" for f in _NUMPY.split()},
    **{f"a{f}": f"np.arc{f}({{0}})" for f in _ARC_FUNCTIONS.split()},
    **{"neg": "-{0}", "not": "~{0}", "square": "{0}*{0}", "one_minus_square": "1-{0}*{0}"},
    **{"rsqrt": "1/np.sqrt({0})", "abs": "np.absolute({0})", "is_finite": "np.isfinite({0})"},
    **{"erf": "scipy.special.erf({0})", "erfc": "scipy.special.erfc({0})"},
    **{"erf_inv": "scipy.special.erfinv({0})", "lgamma": "scipy.special.gammaln({0})"},
    **{"logistic": "1/(1+np.exp(-{0}))", "atan2": "np.arctan2({0},{1})"},
    **{"add": "{0}+{1}", "add_any": "{0}+{1}", "sub": "{0}-{1}", "mul": "{0}*{1}"},
    **{"max": "np.maximum({0},{1})", "min": "np.minimum({0},{1})"},
    **{"and": "{0}&{1}", "or": "{0}|{1}", "xor": "{0}^{1}", "nextafter": "np.nextafter({0},{1})"},
    **{"eq": "{0}=={1}", "ne": "{0}!={1}", "lt": "{0}<{1}", "le": "{0}<={1}"},
    **{"gt": "{0}>{1}", "ge": "{0}>={1}", "clamp": "np.minimum(np.maximum({1},{0}),{2})"},
}
_INTEGER_TEMPLATES = {  # division as XLA has it: towards zero; by zero all bits, and no remainder
    "div": "np.where({1}==0,{1}*0-1,({0}-np.fmod({0},{1}))//{1})[()]",
    "rem": "np.where({1}==0,{0},np.fmod({0},{1}))[()]",
}
_TEMPLATES_OF_FLOATS = {"div": "{0}/{1}", "rem": "np.fmod({0},{1})"}
_PRODUCTS = {2: "{0}*{0}", 3: "{0}*{0}*{0}", -1: "1/{0}", -2: "1/({0}*{0})"}
# halves away from zero
_ROUNDED = "np.trunc({0})+np.sign({0})*(np.absolute({0}-np.trunc({0}))>=0.5)"

FUNCTIONS = {"np": np, "scipy": scipy}
_MOST_CASES = 64  # among which `np.choose` can choose


def write_each(block: Block, template: str, inputs: Sequence[Value], equation: Any) -> list[Value]:
    """Write an expression of the entries of its inputs; return its value, a list of one.

    It is the first result of the equation. `template` has {0}, {1}, ... for the inputs, which NumPy
    broadcasts.
    """
    held = np.broadcast_shapes(*(x.held or () for x in inputs))
    return [block.write(template, inputs, *result_of(equation), held)]


def _write_template(template, block, equation, inputs):
    """Write an operation with a fixed template; a rule once the template is bound."""
    return write_each(block, template, inputs, equation)


for _name, _template in _TEMPLATES.items():
    rule(_name)(functools.partial(_write_template, _template))


@rule("copy", "stop_gradient", "optimization_barrier")
def _identity(block, equation, inputs):
    """Return the inputs: copies and barriers do nothing here."""
    return inputs


@rule("div", "rem")
def _divide(block, equation, inputs):
    """Write a quotient or remainder; integers are divided as XLA does, towards zero."""
    by_dtype = _INTEGER_TEMPLATES if inputs[0].dtype.kind in "iu" else _TEMPLATES_OF_FLOATS
    return write_each(block, by_dtype[equation.primitive.name], inputs, equation)


@rule("pow")
def _pow(block, equation, inputs):
    """Write a power with a computed exponent."""
    cast = "" if inputs[0].dtype == inputs[1].dtype else f".astype('{inputs[0].dtype}')"
    return write_each(block, f"np.power({{0}},{{1}}{cast})", inputs, equation)


@rule("integer_pow")
def _integer_pow(block, equation, inputs):
    """Write a power with a static integer exponent; small ones as products."""
    exponent = equation.params["y"]
    return write_each(block, _PRODUCTS.get(exponent, f"{{0}}**{exponent}"), inputs, equation)


@rule("round")
def _round(block, equation, inputs):
    """Write a rounding to integers: halves to even, or away from zero."""
    to_even = int(equation.params["rounding_method"]) == 1
    return write_each(block, "np.rint({0})" if to_even else _ROUNDED, inputs, equation)


@rule("convert_element_type")
def _convert_dtype(block, equation, inputs):
    """Write a conversion to another dtype; from floats to integers as XLA, within their range."""
    (x,), new = inputs, numpy_dtype(equation.outvars[0].aval)
    if x.dtype == new:
        return [x]
    template = f"{{0}}.astype('{new}')"
    if new.kind == "b":
        template = "{0}!=0"
    elif new.kind in "iu" and x.dtype.kind == "f":  # as XLA: to the nearest number; NaN to 0
        limits = np.iinfo(new)
        low, high = float(limits.min), float(limits.max)
        inside = f"np.where({{0}}=={{0}},{{0}},0).astype('{new}')"
        below = f"np.where({{0}}<{low},{limits.min},{inside})"
        template = f"np.where({{0}}>={high},{limits.max},{below})[()]"
    return write_each(block, template, inputs, equation)


@rule("reduce_precision")
def _reduce_precision(block, equation, inputs):
    """Write a rounding to fewer bits of the mantissa, halves to even."""
    about, given, size = np.finfo(inputs[0].dtype), equation.params, inputs[0].dtype.itemsize
    dropped = about.nmant - given["mantissa_bits"]
    if given["exponent_bits"] != about.nexp or dropped < 0:
        raise NoRuleError("reduce_precision")
    if dropped == 0:
        return inputs
    mask, half = (1 << 8 * size) - (1 << dropped), (1 << (dropped - 1)) - 1
    bits = f"{{0}}.view('u{size}')"
    rounded = f"(({bits}+{half}+(({bits}>>{dropped})&1))&{mask}).view('{inputs[0].dtype}')"
    return write_each(block, f"np.where({{0}}=={{0}},{rounded},{{0}})[()]", inputs, equation)


@rule("select_n")
def _select(block, equation, inputs):
    """Write ``select_n``: by a computed index, one of several cases for each entry or for all."""
    which, *cases = inputs
    if len(cases) == 1:
        return cases
    if which.held == ():  # one case for all entries
        if which.depth == 0:
            return [cases[int(block.names.space[which.name])]]
        if len({x.held for x in cases}) > 1:
            cases = [block.full(x) for x in cases]
        inputs = [which, *cases]
        one = "{2} if {0} else {1}" if which.dtype.kind == "b" else f"({places(cases, 1)})[{{0}}]"
        return write_each(block, one, inputs, equation)
    if which.dtype.kind == "b":
        return write_each(block, "np.where({0},{2},{1})", inputs, equation)
    if len(cases) > _MOST_CASES:
        raise NoRuleError(f"select_n of {len(cases)} cases")
    return write_each(block, f"np.choose({{0}},({places(cases, 1)}))", inputs, equation)
