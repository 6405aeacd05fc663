"""Rules of loops, branches and calls: they become those of Python."""

from __future__ import annotations

import functools

import jax
import numpy as np

from ..common import host_calls, jaxprs
from ..common import jax_internals as internals
from .block import Value
from .rules import NoRuleError, places, rule
from .writing import count_calls, inner_jaxpr, write_callable, write_equations


def _new_variable(block, aval):
    """Return a new variable of a block, a `Value` in the shape and dtype of an abstract array."""
    shape = tuple(aval.shape)
    return Value(block.names.new(), shape, np.dtype(aval.dtype), shape, block.depth)


def _start_carry(block, body, inner, initial, following):
    """Write initial values of the variables that a loop carries; return their values in its body.

    Args:
        block, body: block with the loop, and the loop's body.
        inner: variables of the jaxpr for the values at the beginning of an iteration.
        initial: values before the first iteration.
        following: variables of the jaxpr for the values at its end.

    Returns:
        Values in the body, and those among them that change from iteration to iteration, two lists.
    """
    carried, changing = [], []
    for x, value, then in zip(inner, initial, following, strict=True):
        if then is x:  # it never changes
            carried.append(value)
            continue
        own = _new_variable(body, x.aval)
        block.assign([own.name], [block.full(value)])
        carried.append(own)
        changing.append(own)
    return carried, changing


def _write_next_carry(body, carried, changing, results):
    """Write the end of a loop's body: carried variables get the values for the next iteration.

    Args:
        body: body of the loop.
        carried, changing: results of `_start_carry`.
        results: values of the carried variables at the end of the body.
    """
    names = {x.name for x in changing}
    pairs = [
        (own.name, body.full(new))
        for own, new in zip(carried, results, strict=True)
        if own.name in names and own.depth == body.depth
    ]
    body.assign([name for name, _ in pairs], [value for _, value in pairs])


@rule("scan")
def _scan(block, equation, inputs):
    """Write ``scan`` as a ``for`` loop; of length 0 or 1 without a loop.

    Stacked results are allocated before it, and set turn by turn.
    """
    given = equation.params
    jaxpr, constants = inner_jaxpr(given["jaxpr"])
    n_const, n_carry = jaxprs.scan_operand_counts(given)
    length, first = given["length"], n_const + n_carry
    shared, initial, xs = inputs[:n_const], inputs[n_const:first], inputs[first:]
    stacked = [x.aval for x in equation.outvars[n_carry:]]
    if length == 0:
        return [*initial, *(block.names.constant(np.zeros(a.shape, a.dtype)) for a in stacked)]
    if length == 1:  # no loop: what is known is computed while the program is written
        body, index, carried, changing = block, block.names.constant(np.intp(0)), initial, []
    else:
        body = block.child(is_loop=True)
        index = Value(block.names.new("i"), (), np.dtype(np.intp), (), body.depth)
        variables = jaxpr.invars[n_const:first], initial, jaxpr.outvars[:n_carry]
        carried, changing = _start_carry(block, body, *variables)
    rows = [
        x._replace(shape=x.shape[1:])
        if x.held == ()
        else body.write("{0}[{1}]", [block.full(x), index], x.shape[1:], x.dtype, work=0.3)
        for x in xs
    ]
    found = write_equations(body, jaxpr, constants, [*shared, *carried, *rows])
    if length == 1:
        ys = [
            block.write("np.asarray({0})[None]", [block.full(x)], (1, *x.shape), x.dtype, work=0.3)
            for x in found[n_carry:]
        ]
        return [*found[:n_carry], *ys]
    ys = [_new_variable(block, aval) for aval in stacked]
    for own, value in zip(ys, found[n_carry:], strict=True):
        block.allocate(own)
        body.lines.append(f"{own.name}[{index.name}]={value.name}")
    _write_next_carry(body, carried, changing, found[:n_carry])
    order = f"range({length - 1},-1,-1)" if given["reverse"] else f"range({length})"
    return [*_write_loop(block, body, f"for {index.name} in {order}:", carried, changing), *ys]


def _write_loop(block, body, header, carried, changing):
    """Write a loop, a header with its body; return the values of carried variables after it.

    `carried` and `changing` are results of `_start_carry`.
    """
    body.write_work_count()
    block.lines.append((header, body))
    return [x._replace(depth=block.depth) if x in changing else x for x in carried]


@rule("while")
def _while(block, equation, inputs):
    """Write ``while`` as an endless loop with a break; in a batch, cases that have ended stay."""
    given = equation.params
    test, of_test = inner_jaxpr(given["cond_jaxpr"])
    jaxpr, constants = inner_jaxpr(given["body_jaxpr"])
    n_test, n_body = given["cond_nconsts"], given["body_nconsts"]
    for_test, for_body, initial = (
        inputs[:n_test],
        inputs[n_test:][:n_body],
        inputs[n_test + n_body :],
    )
    body = block.child(is_loop=True)
    carried, changing = _start_carry(block, body, jaxpr.invars[n_body:], initial, jaxpr.outvars)
    (goes_on,) = write_equations(body, test, of_test, [*for_test, *carried])
    goes_on = body.full(goes_on)
    any_ = f"{goes_on.name}.any()" if goes_on.shape else goes_on.name
    body.lines.append(f"if not {any_}: break")
    found = write_equations(body, jaxpr, constants, [*for_body, *carried])
    if goes_on.shape:  # of a batch: cases that have ended stay
        cases = len(goes_on.shape)
        select = body.names.helper(_make_case_select, cases)
        found = [
            body.write(
                f"{select}({{0}},{{1}},{{2}})",
                [goes_on, body.full(new), body.full(old)],
                new.shape,
                new.dtype,
            )
            for new, old in zip(found, carried, strict=True)
        ]
    _write_next_carry(body, carried, changing, found)
    return _write_loop(block, body, "while True:", carried, changing)


def _make_case_select(n_axis):
    """Return the function (goes_on, new, old) -> array that selects between values case by case.

    ``goes_on`` is bool with `n_axis` axes, those of the batch; the values have these first. Cases
    that go on get the new values, others keep the old ones.
    """

    def select(goes_on, new, old):
        shape = goes_on.shape + (1,) * (np.ndim(new) - n_axis)
        return np.where(goes_on.reshape(shape), new, old)

    return select


@rule("cond")
def _cond(block, equation, inputs):
    """Write ``cond`` or ``switch`` as if, elif, else; a known index selects its branch now."""
    which, *operands = inputs
    branches = equation.params["branches"]
    if which.depth == 0:
        index = min(max(int(block.names.space[which.name]), 0), len(branches) - 1)
        return write_equations(block, *inner_jaxpr(branches[index]), operands)
    avals = [x.aval for x in equation.outvars]
    results = [_new_variable(block, aval) for aval in avals]
    names = [x.name for x in results]
    for k, branch in enumerate(branches):
        own = block.child()
        found = write_callable(own, branch, operands, avals)
        own.assign(names, [own.full(x) for x in found])
        last = k == len(branches) - 1
        sign = "<=" if k == 0 else "=="
        header = "else:" if last else f"{'if' if k == 0 else 'elif'} {which.name}{sign}{k}:"
        block.lines.append((header, own))
    return results


# --- calls


@rule("jit", "closed_call", "eval_jaxpr", "remat2", "checkpoint")
@rule("custom_jvp_call", "custom_vjp_call", "custom_vmap_call")
def _call(block, equation, inputs):
    """Write a call of a jaxpr: a function under `jax.jit`, a checkpoint, one with own derivatives.

    Rules of derivatives do not matter here.
    """
    given = equation.params
    names = ("jaxpr", "call_jaxpr", "call", "fun_jaxpr")
    program = next(given[name] for name in names if name in given)
    return write_callable(block, program, inputs, [x.aval for x in equation.outvars], once=True)


@rule("call_hi_primitive")  # of jax 0.12, where `lax.custom_root` is one
def _high_level_call(block, equation, inputs):
    """Write a primitive that jax 0.12 states by a function of others, traced here."""
    expand = functools.partial(equation.primitive.to_lojax, **equation.params)
    shapes = [
        jax.ShapeDtypeStruct(x.aval.shape, x.aval.dtype, weak_type=x.aval.weak_type)
        for x in equation.invars
    ]
    program = jax.make_jaxpr(expand)(*shapes)
    return write_callable(block, program, inputs, [x.aval for x in equation.outvars], once=True)


@rule("custom_linear_solve")
def _linear_solve(block, equation, inputs):
    """Write ``custom_linear_solve`` as a call of its function that solves."""
    counts = equation.params["const_lengths"]
    n = [counts.matvec, counts.vecmat, counts.solve, counts.transpose_solve]
    first = sum(n[:2])
    operands = [*inputs[first : first + n[2]], *inputs[sum(n) :]]
    jaxpr = equation.params["jaxprs"].solve
    return write_callable(block, jaxpr, operands, [x.aval for x in equation.outvars], once=True)


@rule("platform_index")
def _platform_index(block, equation, _):
    """Return the constant index of the branch for CPUs."""
    for k, platforms in enumerate(equation.params["platforms"]):
        if platforms is None or "cpu" in platforms:
            return [block.names.constant(np.int32(k))]
    raise NoRuleError("platform_index")


# --- functions on the host


@rule("ffi_call")
def _host_call(block, equation, inputs):
    """Write a call through XLA's foreign function interface as a call of its NumPy function."""
    given, avals = equation.params, [x.aval for x in equation.outvars]
    function = host_calls.function_of_call_name(given["target_name"])
    return write_host_call(block, function, inputs, avals, not given["has_side_effect"])


@rule("pure_callback", "io_callback", "debug_callback")
def _callback(block, equation, inputs):
    """Write a callback of jax as a call of its Python function, with copies of the arrays."""
    avals = [x.aval for x in equation.outvars]
    function = equation.params["callback"]
    pure = equation.primitive.name == "pure_callback"
    return write_host_call(block, function, inputs, avals, pure, copies=True)


def write_host_call(block, function, inputs, avals, pure, copies=False):
    """Write a call of a NumPy function, and return the values of its results, a list.

    Args:
        block: `Block` in which it is written.
        function: NumPy function that returns a sequence of arrays.
        inputs: values of its arguments.
        avals: abstract arrays with the shapes and dtypes of the results.
        pure: whether it has no side effects; otherwise NumPy runs the program to its end after the
            call.
        copies: whether it gets arrays of its own, and may keep those that it returns: a user's
            function, which may change them.
    """
    shapes = tuple((tuple(a.shape), np.dtype(a.dtype)) for a in avals)
    helper = block.names.helper(_make_host_call, function, shapes, copies)
    inputs = [block.full(x) for x in inputs]
    found = block.write_call(f"{helper}({places(inputs)})", inputs, avals, pure)
    if not pure:  # the call does not begin again after it: what was heard would be heard twice
        block.lines.append("w[1]=np.inf")
    return found


def _make_host_call(function, shapes, copies):
    """Return the function that calls a NumPy function, with results in given shapes and dtypes.

    `shapes` has a pair (shape, dtype) for each result; with `copies` arguments and results are
    copied.
    """
    array = np.array if copies else np.asarray

    def call(*arrays):
        found = jax.tree.leaves(function(*(array(x, order="C") for x in arrays)))
        pairs = zip(found, shapes, strict=True)
        return tuple(array(x, dtype).reshape(shape)[()] for x, (shape, dtype) in pairs)

    return call


@rule("traced")
def write_by_tracing(block, equation, inputs):
    """Write an equation of a primitive of this package by tracing the function of its value."""
    avals = [jax.ShapeDtypeStruct(x.aval.shape, x.aval.dtype) for x in equation.invars]
    evaluate = internals.functions_of_primitives[equation.primitive]
    program = jax.make_jaxpr(functools.partial(evaluate, **equation.params))(*avals)
    return write_equations(block, *inner_jaxpr(program), inputs)


@rule("deferred")
def _deferred(block, equation, inputs):
    """Write a call of a deferred function (`common.deferred`), traced when it is first called."""
    avals = [jax.ShapeDtypeStruct(x.aval.shape, x.aval.dtype) for x in equation.invars]
    function = equation.params["function"]

    def make():
        program = jax.make_jaxpr(function)(*avals)
        block.names.add_call_counts(count_calls(program))
        return program

    name = block.names.deferred_function_name(function, make)
    results = [x.aval for x in equation.outvars]
    return block.write_call(f"{name}(w,{places(inputs)})", [block.full(x) for x in inputs], results)
