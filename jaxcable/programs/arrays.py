"""Rules of operations that change the shape of arrays, or reduce and sort their entries."""

from __future__ import annotations

import functools
import math

import numpy as np

from .rules import NoRuleError, moves_entries, places, result_of, rule, write_full


def _write_reshape(block, x, held, shape):
    """Write the value `x` in another shape of jax's program, and return the new value.

    `held` is the shape of the array that stands for the new value (see `Value`).
    """
    if held == x.held:
        return x._replace(shape=shape)
    text = f"{{0}}.reshape({held})" if held else "{0}.reshape(())[()]"
    return block.write(text, [x], shape, x.dtype, held, work=0.3)


def _write_slice(block, x, index, shape):
    """Write a slice of the value `x`, and return its value, of a given shape.

    `index` is the text between the brackets of NumPy's indexing, such as "0:3,::-1".
    """
    return block.write(f"{{0}}[{index}]", [block.full(x)], shape, x.dtype, work=0.3)


@rule("broadcast_in_dim")
@moves_entries
def _broadcast(block, given, inputs, shape):
    """Write ``broadcast_in_dim``: new axes and axes of length 1 that NumPy broadcasts later."""
    held = [1] * len(shape)
    for axis, size in zip(given["broadcast_dimensions"], inputs[0].held, strict=True):
        held[axis] = size
    return _write_reshape(block, inputs[0], tuple(held), shape)


@rule("reshape")
@moves_entries
def _reshape(block, given, inputs, shape):
    """Write a reshape of an array to another shape with as many entries."""
    if given.get("dimensions") is not None:
        raise NoRuleError("reshape with dimensions")
    return _write_reshape(block, block.full(inputs[0]), shape, shape)


@rule("squeeze")
@moves_entries
def _squeeze(block, given, inputs, shape):
    """Write an array without some of its axes of length 1."""
    gone = [d % len(inputs[0].shape) for d in given["dimensions"]]
    held = tuple(size for k, size in enumerate(inputs[0].held) if k not in gone)
    return _write_reshape(block, inputs[0], held, shape)


@rule("transpose")
@moves_entries
def _transpose(block, given, inputs, shape):
    """Write a transpose: axes in the order of the parameter ``permutation``."""
    (x,), order = inputs, tuple(given["permutation"])
    if order == tuple(range(len(order))):
        return x
    held = tuple(x.held[k] for k in order)
    return block.write(f"{{0}}.transpose({order})", [x], shape, x.dtype, held, work=0.3)


@rule("rev")
@moves_entries
def _rev(block, given, inputs, shape):
    """Write an array with the order of entries reversed along some axes."""
    index = ",".join("::-1" if k in given["dimensions"] else ":" for k in range(len(shape)))
    return _write_slice(block, inputs[0], index, shape)


@rule("slice")
@moves_entries
def _slice(block, given, inputs, shape):
    """Write a slice with static limits and strides along each axis."""
    steps = given["strides"] or (1,) * len(shape)
    limits = zip(given["start_indices"], given["limit_indices"], steps, strict=True)
    return _write_slice(block, inputs[0], ",".join(f"{a}:{b}:{c}" for a, b, c in limits), shape)


@rule("split")
def _split(block, equation, inputs):
    """Write the parts of an array that is split along an axis into given sizes."""
    before, found, begin = ":," * equation.params["axis"], [], 0
    for k, size in enumerate(equation.params["sizes"]):
        index, begin = f"{before}{begin}:{begin + size}", begin + size
        found.append(_write_slice(block, inputs[0], index, result_of(equation, k)[0]))
    return found


@rule("unstack")
def _unstack(block, equation, inputs):
    """Write the entries of an array along an axis, each as an array without this axis."""
    before, (shape, _) = ":," * _stacking_axis(equation), result_of(equation)
    count = range(len(equation.outvars))
    return [_write_slice(block, inputs[0], f"{before}{k}", shape) for k in count]


def _stacking_axis(equation):
    """Return the axis along which an equation stacks or unstacks arrays."""
    given = equation.params
    return given["axis"] if "axis" in given else given["dimension"]


@rule("stack")
def _stack(block, equation, inputs):
    """Write arrays of equal shapes stacked along a new axis."""
    text = f"np.stack(({places(inputs)},),{_stacking_axis(equation)})"
    if not inputs[0].shape:
        text = f"np.array(({places(inputs)},))"
    return write_full(block, equation, text, inputs, work=2)


@rule("concatenate")
def _concatenate(block, equation, inputs):
    """Write arrays joined along an existing axis."""
    text = f"np.concatenate(({places(inputs)},),{equation.params['dimension']})"
    return write_full(block, equation, text, inputs)


@rule("tile")
def _tile(block, equation, inputs):
    """Write an array repeated a number of times along each axis."""
    return write_full(block, equation, f"np.tile({{0}},{tuple(equation.params['reps'])})", inputs)


@rule("iota")
def _iota(block, equation, _):
    """Return the constant whose entries are their indices along one axis."""
    (shape, dtype), axis = result_of(equation), equation.params["dimension"]
    along = np.arange(shape[axis], dtype=dtype).reshape(-1, *(1,) * (len(shape) - axis - 1))
    return [block.names.constant(np.array(np.broadcast_to(along, shape)))]


@rule("empty", "empty2")
def _empty(block, equation, _):
    """Return zeros for an array without defined entries, as a scan that runs backwards fills it."""
    shape, dtype = result_of(equation)
    return [block.names.constant(np.zeros((), dtype), shape)]


@rule("pad")
def _pad(block, equation, inputs):
    """Write a padded array: with a value around it and between its entries, or cut if negative."""
    given = inputs[0].shape, result_of(equation)[0], tuple(equation.params["padding_config"])
    return write_full(
        block, equation, f"{block.names.helper(_make_pad, *given)}({{0}},{{1}})", inputs
    )


def _make_pad(whole, shape, configuration):
    """Return the function (array, value) -> array padded to `shape`, as jax's ``pad``.

    `whole` is the shape of the array, and `configuration` has (low, high, interior) for each axis;
    negative low and high take entries away.
    """
    taken, filled = [], []
    for (low, _, inner), count, size in zip(configuration, whole, shape, strict=True):
        step = inner + 1
        first, end = max(0, -(low // step)), min(count, -((low - size) // step))
        taken.append(slice(first, end))
        filled.append(slice(low + first * step, max(0, low + (end - 1) * step + 1), step))
    taken, filled = tuple(taken), tuple(filled)

    def pad(x, value):
        found = np.full(shape, value, x.dtype)
        found[filled] = x[taken]
        return found

    return pad


# --- reductions and scans over entries

_REDUCTIONS = {
    **{"reduce_sum": "add", "reduce_prod": "multiply"},
    **{"reduce_max": "maximum", "reduce_min": "minimum"},
    **{"reduce_and": "logical_and", "reduce_or": "logical_or"},
}
_CUMULATIONS = {
    **{"cumsum": "add", "cumprod": "multiply", "cummax": "maximum", "cummin": "minimum"},
}


@rule(*_REDUCTIONS)
def _reduce(block, equation, inputs):
    """Write a sum, product, extreme or logical reduction of an array over some axes."""
    (x,), (shape, dtype), axes = inputs, result_of(equation), tuple(equation.params["axes"])
    function = _REDUCTIONS[equation.primitive.name]
    if not axes:
        return [x]
    if function not in ("add", "multiply"):
        if function[:7] == "logical" and dtype.kind != "b":
            raise NoRuleError(f"{function} of bits")
        if function[:7] != "logical" and not math.prod(x.shape):
            low, high = (-np.inf, np.inf) if dtype.kind == "f" else _integer_limits(dtype)
            return [block.names.constant(np.full(shape, high if "min" in function else low, dtype))]
        if x.held == () and math.prod(x.shape):
            return [x._replace(shape=shape)]
    typed = f",dtype='{dtype}'" if dtype.kind in "iu" else ""
    text = f"np.{function}.reduce({{0}},{axes[0] if len(axes) == 1 else axes}{typed})"
    return write_full(block, equation, text, inputs, work=1 + math.prod(x.shape) / 1000)


def _integer_limits(dtype):
    """Return the smallest and the largest number of a dtype of integers or bool."""
    return (False, True) if dtype.kind == "b" else (np.iinfo(dtype).min, np.iinfo(dtype).max)


@rule("argmax", "argmin")
def _argmax(block, equation, inputs):
    """Write the index of the largest or smallest entry along an axis."""
    (axis,), (_, dtype) = equation.params["axes"], result_of(equation)
    text = f"np.{equation.primitive.name}({{0}},{axis}).astype('{dtype}')"
    return write_full(block, equation, text, inputs)


@rule(*_CUMULATIONS)
def _cumulate(block, equation, inputs):
    """Write a cumulative sum, product or extreme along an axis, from either end."""
    (_, dtype), axis = result_of(equation), equation.params["axis"]
    flip = "[" + ":," * axis + "::-1]" if equation.params["reverse"] else ""
    function = f"np.{_CUMULATIONS[equation.primitive.name]}.accumulate"
    text = f"{function}({{0}}{flip},{axis},dtype='{dtype}'){flip}"
    return write_full(block, equation, text, inputs)


@rule("sort")
def _sort(block, equation, inputs):
    """Write arrays sorted along an axis by the first ``num_keys`` of them."""
    given = equation.params
    given = given["dimension"], given["num_keys"]
    sort = block.names.helper(functools.partial, _sort_arrays, *given)
    full, avals = [block.full(x) for x in inputs], [x.aval for x in equation.outvars]
    return block.write_call(f"{sort}({places(inputs)})", full, avals)


def _sort_arrays(axis, n_key, *arrays):
    """Return arrays sorted along `axis` by the first `n_key` of them, NaN last, a tuple."""
    keys = [x + 0.0 if x.dtype.kind == "f" else x for x in arrays[:n_key]]  # -0.0 is 0.0
    order = np.lexsort(keys[::-1], axis=axis)
    return tuple(np.take_along_axis(x, order, axis) for x in arrays)


# --- parts of arrays


@rule("dynamic_slice")
@moves_entries
def _dynamic_slice(block, given, inputs, shape):
    """Write a slice of static size that begins at computed indices, moved inside if needed."""
    window = block.names.helper(_make_window_index, inputs[0].shape, shape)
    text = f"{{0}}[{window}({places(inputs[1:], 1)})]"
    return block.write(text, [block.full(inputs[0]), *inputs[1:]], shape, inputs[0].dtype)


@rule("dynamic_update_slice")
def _dynamic_update_slice(block, equation, inputs):
    """Write a copy of an array in which another one replaces a window at computed indices."""
    update = block.names.helper(_make_window_update, inputs[0].shape, inputs[1].shape)
    return write_full(block, equation, f"{update}({places(inputs)})", inputs)


def _make_window_index(whole, sizes):
    """Return the function from start indices to the index (slices) of a window in an array.

    `whole` is the shape of the array, `sizes` that of the window. Windows that begin outside are
    moved inside, as in jax.
    """
    limits = [n - size for n, size in zip(whole, sizes, strict=True)]

    def window(*starts):
        inside = map(min, (max(int(s), 0) for s in starts), limits)
        return tuple(slice(a, a + size) for a, size in zip(inside, sizes, strict=True))

    return window


def _make_window_update(whole, sizes):
    """Return the function (array, part, *starts) -> copy of the array with the part in a window.

    `whole` and `sizes` are the shapes of array and part; starts are as of `_make_window_index`.
    """
    window = _make_window_index(whole, sizes)

    def update(x, part, *starts):
        found = np.array(x)
        found[window(*starts)] = part
        return found

    return update
