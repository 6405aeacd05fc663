"""Rules of operations on each entry of arrays: expressions of NumPy, which broadcasts."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy  # its parts are imported where they are first used

from .block import Block, Value
from .rules import NoRuleError, numpy_dtype, rule

_TEMPLATES = {  # {0}, {1}, ... are the operands
    **{
        "neg": "-{0}",
        "not": "~{0}",
        "copy": "{0}",
        "stop_gradient": "{0}",
        "square": "{0}*{0}",
        "one_minus_square": "1-{0}*{0}",
    },
    **{"sqrt": "np.sqrt({0})", "rsqrt": "1/np.sqrt({0})", "cbrt": "np.cbrt({0})"},
    **{"abs": "np.absolute({0})", "sign": "np.sign({0})", "is_finite": "np.isfinite({0})"},
    **{"floor": "np.floor({0})", "ceil": "np.ceil({0})"},
    **{f: f"np.{f}({{0}})" for f in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{f: f"np.{f}({{0}})" for f in ("exp", "exp2", "expm1", "log", "log1p", "log2")},
    **{f"a{f}": f"np.arc{f}({{0}})" for f in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{f: f"scipy.special.{f}({{0}})" for f in ("erf", "erfc")},
    **{"erf_inv": "scipy.special.erfinv({0})", "lgamma": "scipy.special.gammaln({0})"},
    **{"logistic": "1/(1+np.exp(-{0}))", "atan2": "np.arctan2({0},{1})"},
    **{"add": "{0}+{1}", "add_any": "{0}+{1}", "sub": "{0}-{1}", "mul": "{0}*{1}"},
    **{"max": "np.maximum({0},{1})", "min": "np.minimum({0},{1})"},
    **{"and": "{0}&{1}", "or": "{0}|{1}", "xor": "{0}^{1}"},
    **{"eq": "{0}=={1}", "ne": "{0}!={1}", "lt": "{0}<{1}", "le": "{0}<={1}"},
    **{"gt": "{0}>{1}", "ge": "{0}>={1}", "nextafter": "np.nextafter({0},{1})"},
    **{"clamp": "np.minimum(np.maximum({1},{0}),{2})"},
}


FUNCTIONS = {"np": np, "scipy": scipy}
_MOST_CASES = 64  # among which `np.choose` can choose


def held_together(values: Sequence[Value]) -> tuple[int, ...]:
    """Return the shape in which NumPy holds the result of an operation on each entry."""
    return np.broadcast_shapes(*(x.held or () for x in values))


def write_each(block: Block, template: str, inputs: Sequence[Value], aval: Any) -> list[Value]:
    """Write an operation on each entry of its inputs."""
    held = held_together(inputs)
    return [block.write(template, inputs, tuple(aval.shape), np.dtype(aval.dtype), held)]


def _write_template(template, block, equation, inputs):
    return write_each(block, template, inputs, equation.outvars[0].aval)


for _name, _template in _TEMPLATES.items():
    rule(_name)(functools.partial(_write_template, _template))


@rule("div")
def _div(block, equation, inputs):
    template = "{0}/{1}"
    if inputs[0].dtype.kind in "iu":
        template = f"{block.names.helper(lambda: divide_integers)}({{0}},{{1}})"
    return write_each(block, template, inputs, equation.outvars[0].aval)


def divide_integers(a: Any, b: Any) -> Any:
    """Divide integers as XLA does: towards zero; -1 (all bits) by zero."""
    a, b = np.asarray(a), np.asarray(b)
    safe = np.where(b == 0, np.ones((), b.dtype), b)
    quotient = np.floor_divide(a, safe)
    quotient += ((a % safe != 0) & ((a < 0) != (safe < 0))).astype(a.dtype)
    return np.where(b == 0, ~np.zeros((), a.dtype), quotient)[()]


@rule("rem")
def _rem(block, equation, inputs):
    template = "np.fmod({0},{1})"
    if inputs[0].dtype.kind in "iu":
        template = f"{block.names.helper(lambda: remainder_of_integers)}({{0}},{{1}})"
    return write_each(block, template, inputs, equation.outvars[0].aval)


def remainder_of_integers(a: Any, b: Any) -> Any:
    """Return the remainder of integers as XLA does: with the sign of `a`; `a` itself by zero."""
    a, b = np.asarray(a), np.asarray(b)
    return np.where(b == 0, a, np.fmod(a, np.where(b == 0, np.ones((), b.dtype), b)))[()]


@rule("pow")
def _pow(block, equation, inputs):
    aval = equation.outvars[0].aval
    cast = "" if inputs[0].dtype == inputs[1].dtype else f".astype('{aval.dtype}')"
    return write_each(block, f"np.power({{0}},{{1}}{cast})", inputs, aval)


@rule("integer_pow")
def _integer_pow(block, equation, inputs):
    exponent = equation.params["y"]
    products = {2: "{0}*{0}", 3: "{0}*{0}*{0}", -1: "1/{0}", -2: "1/({0}*{0})"}
    template = products.get(exponent, f"{{0}}**{exponent}")
    return write_each(block, template, inputs, equation.outvars[0].aval)


@rule("round")
def _round(block, equation, inputs):
    to_even = int(equation.params["rounding_method"]) == 1
    template = "np.rint({0})"
    if not to_even:
        template = f"{block.names.helper(lambda: round_away_from_zero)}({{0}})"
    return write_each(block, template, inputs, equation.outvars[0].aval)


def round_away_from_zero(x: Any) -> Any:
    """Round to the nearest integer, halves away from zero."""
    whole = np.trunc(x)
    return whole + np.where(np.abs(x - whole) >= 0.5, np.sign(x), 0).astype(whole.dtype)


@rule("convert_element_type")
def _convert(block, equation, inputs):
    (x,), aval = inputs, equation.outvars[0].aval
    new = numpy_dtype(aval)
    if x.dtype == new:
        return [x]
    template = f"{{0}}.astype('{new}')"
    if new.kind == "b":
        template = "{0}!=0"
    elif new.kind in "iu" and x.dtype.kind == "f":
        template = f"{block.names.helper(_to_integers, new)}({{0}})"
    return write_each(block, template, inputs, aval)


def _to_integers(dtype):
    """Return the function that converts floats as XLA does: to the nearest number; NaN to 0."""
    limits = np.iinfo(dtype)
    low, high = float(limits.min), float(limits.max)

    def convert(x):
        inside = (x >= low) & (x < high)
        found = np.where(inside, x, 0).astype(dtype)
        return np.where(
            x >= high, dtype.type(limits.max), np.where(x < low, dtype.type(limits.min), found)
        )[()]

    return convert


@rule("reduce_precision")
def _reduce_precision(block, equation, inputs):
    about, given = np.finfo(inputs[0].dtype), equation.params
    dropped = about.nmant - given["mantissa_bits"]
    if given["exponent_bits"] != about.nexp or dropped < 0:
        raise NotImplementedError("reduce_precision")
    if dropped == 0:
        return inputs
    function = block.names.helper(_make_rounding, inputs[0].dtype, dropped)
    return write_each(block, f"{function}({{0}})", inputs, equation.outvars[0].aval)


def _make_rounding(dtype, dropped):
    """Return the function that rounds floats to fewer bits, halves to even."""
    bits = np.dtype(f"u{dtype.itemsize}").type
    half, one = bits((1 << (dropped - 1)) - 1), bits(1)
    mask, shift = bits(~((1 << dropped) - 1) & ((1 << 8 * dtype.itemsize) - 1)), bits(dropped)

    def rounded(x):
        own = np.asarray(x).view(bits)
        found = ((own + half + ((own >> shift) & one)) & mask).view(dtype)
        return np.where(np.isnan(x), x, found)[()]

    return rounded


@rule("bitcast_convert_type")
def _bitcast(block, equation, inputs):
    (x,), aval = inputs, equation.outvars[0].aval
    if x.dtype.itemsize != np.dtype(aval.dtype).itemsize:
        raise NotImplementedError("bitcast_convert_type")
    return write_each(block, f"{{0}}.view('{np.dtype(aval.dtype)}')", [block.full(x)], aval)


@rule("select_n")
def _select(block, equation, inputs):
    which, *cases = inputs
    aval = equation.outvars[0].aval
    if which.dtype.kind != "b" or len(cases) != 2:
        if len(cases) > _MOST_CASES:
            raise NoRuleError(f"select_n of {len(cases)} cases")
        template = f"np.choose({{0}},({','.join(f'{{{k + 1}}}' for k in range(len(cases)))}))"
        if which.held == () and len({x.held for x in cases}) == 1:
            template = f"({','.join(f'{{{k + 1}}}' for k in range(len(cases)))})[{{0}}]"
        return write_each(block, template, inputs, aval)
    if which.held == () and cases[0].held == cases[1].held:
        if which.depth == 0:
            return [cases[int(block.names.known[which.name])]]
        return write_each(block, "{2} if {0} else {1}", inputs, aval)
    if which.held == () and which.depth == 0:
        return [cases[int(block.names.known[which.name])]]
    return write_each(block, "np.where({0},{2},{1})", inputs, aval)


# --- of this package


@rule("nan_unless")
def _nan_unless(block, equation, inputs):
    ok, _, *arrays = inputs
    nan = block.names.helper(lambda: _nan_like)
    found = []
    for x, own in zip(arrays, equation.outvars, strict=True):
        if ok.shape:  # for each entry along the first axes
            axes = (*ok.shape, *(1,) * (len(x.shape) - len(ok.shape)))
            along = block.write(f"{{0}}.reshape({axes})", [block.full(ok)], axes, ok.dtype)
            found += write_each(
                block, f"np.where({{0}},{{1}},{nan}({{1}}))", [along, block.full(x)], own.aval
            )
        elif ok.depth == 0:
            known = block.names.constant(np.asarray(np.nan, x.dtype), x.shape)
            found.append(x if block.names.known[ok.name] else known)
        else:
            found.append(
                block.write(f"{{1}} if {{0}} else {nan}({{1}})", [ok, x], x.shape, x.dtype, x.held)
            )
    return found


def _nan_like(x):
    """Return NaN in the shape and dtype of an array or a number."""
    return np.full(np.shape(x), np.nan, x.dtype)[()]
