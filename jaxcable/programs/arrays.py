"""Rules of operations that change the shape of arrays, or reduce and sort their entries."""

from __future__ import annotations

import functools
import math

import numpy as np

from .rules import rule


def _shape(equation, k=0):
    """Return shape and dtype of a result."""
    aval = equation.outvars[k].aval
    return tuple(aval.shape), np.dtype(aval.dtype)


def _reshaped(block, x, held, shape):
    """Return a value in another shape, `held` as it is stored."""
    if held == x.held:
        return x._replace(shape=shape)
    text = f"{{0}}.reshape({held})" if held else "{0}.reshape(())[()]"
    return block.write(text, [x], shape, x.dtype, held, work=0.3)


@rule("broadcast_in_dim")
def _broadcast(block, equation, inputs):
    x, (shape, _) = inputs[0], _shape(equation)
    if x.held == ():
        return [x._replace(shape=shape)]
    held = [1] * len(shape)
    for axis, size in zip(equation.params["broadcast_dimensions"], x.held, strict=True):
        held[axis] = size
    return [_reshaped(block, x, tuple(held), shape)]


@rule("reshape", "squeeze")
def _reshape(block, equation, inputs):
    x, (shape, _) = inputs[0], _shape(equation)
    if equation.params.get("dimensions") is not None and equation.primitive.name == "reshape":
        raise NotImplementedError("reshape with dimensions")
    if x.held == ():
        return [x._replace(shape=shape)]
    if equation.primitive.name == "squeeze":
        gone = [d % len(x.shape) for d in equation.params["dimensions"]]
        held = tuple(size for k, size in enumerate(x.held) if k not in gone)
        return [_reshaped(block, x, held, shape)]
    return [_reshaped(block, block.full(x), shape, shape)]


@rule("transpose")
def _transpose(block, equation, inputs):
    x, (shape, _), order = inputs[0], _shape(equation), tuple(equation.params["permutation"])
    if x.held == () or order == tuple(range(len(order))):
        return [x._replace(shape=shape)]
    held = tuple(x.held[k] for k in order)
    return [block.write(f"{{0}}.transpose({order})", [x], shape, x.dtype, held, work=0.3)]


@rule("rev")
def _rev(block, equation, inputs):
    x, axes = inputs[0], equation.params["dimensions"]
    if x.held == ():
        return [x]
    index = ",".join("::-1" if k in axes else ":" for k in range(len(x.shape)))
    return [block.write(f"{{0}}[{index}]", [block.full(x)], x.shape, x.dtype, work=0.3)]


@rule("slice")
def _slice(block, equation, inputs):
    x, (shape, _), given = inputs[0], _shape(equation), equation.params
    if x.held == ():
        return [x._replace(shape=shape)]
    steps = given["strides"] or (1,) * len(shape)
    limits = zip(given["start_indices"], given["limit_indices"], steps, strict=True)
    index = ",".join(f"{a}:{b}" + (f":{c}" if c != 1 else "") for a, b, c in limits)
    return [block.write(f"{{0}}[{index}]", [block.full(x)], shape, x.dtype, work=0.3)]


@rule("concatenate")
def _concatenate(block, equation, inputs):
    shape, dtype = _shape(equation)
    places = ",".join(f"{{{k}}}" for k in range(len(inputs)))
    text = f"np.concatenate(({places},),{equation.params['dimension']})"
    return [block.write(text, [block.full(x) for x in inputs], shape, dtype)]


@rule("split")
def _split(block, equation, inputs):
    axis, found, begin = equation.params["axis"], [], 0
    for k, size in enumerate(equation.params["sizes"]):
        index = ":," * axis + f"{begin}:{begin + size}"
        text, begin = f"{{0}}[{index}]", begin + size
        found.append(block.write(text, [block.full(inputs[0])], *_shape(equation, k), work=0.3))
    return found


@rule("iota")
def _iota(block, equation, _):
    shape, dtype = _shape(equation)
    axis = equation.params["dimension"]
    counted = np.arange(shape[axis], dtype=dtype).reshape(
        [-1 if k == axis else 1 for k in range(len(shape))]
    )
    return [block.names.constant(np.ascontiguousarray(np.broadcast_to(counted, shape)))]


@rule("empty", "empty2")
def _empty(block, equation, _):
    """Whatever it holds: a scan that runs backwards fills it."""
    shape, dtype = _shape(equation)
    return [block.names.constant(np.zeros((), dtype), shape)]


@rule("pad")
def _pad(block, equation, inputs):
    shape, dtype = _shape(equation)
    pad = block.names.helper(_make_pad, shape, tuple(equation.params["padding_config"]))
    return [block.write(f"{pad}({{0}},{{1}})", [block.full(inputs[0]), inputs[1]], shape, dtype)]


def _make_pad(shape, configuration):
    """Return the function that pads an array to `shape`; negative padding takes entries away."""

    def pad(x, value):
        found = np.full(shape, value, x.dtype)
        places, taken = [], []
        for (low, _, inner), count, size in zip(configuration, x.shape, shape, strict=True):
            at = low + np.arange(count) * (inner + 1)
            inside = (at >= 0) & (at < size)
            places.append(at[inside])
            taken.append(np.flatnonzero(inside))
        found[np.ix_(*places)] = x[np.ix_(*taken)]
        return found

    def pad_outside(x, value):
        found = np.full(shape, value, x.dtype)
        found[inside] = x
        return found

    if all(low >= 0 and high >= 0 and inner == 0 for low, high, inner in configuration):
        inside = tuple(
            slice(low, size - high)
            for (low, high, _), size in zip(configuration, shape, strict=True)
        )
        return pad_outside
    return pad


@rule("tile")
def _tile(block, equation, inputs):
    text = f"np.tile({{0}},{tuple(equation.params['reps'])})"
    return [block.write(text, [block.full(inputs[0])], *_shape(equation))]


# --- reductions and scans over entries

_REDUCTIONS = {
    **{"reduce_sum": "np.add", "reduce_prod": "np.multiply"},
    **{"reduce_max": "np.maximum", "reduce_min": "np.minimum"},
    **{"reduce_and": "np.logical_and", "reduce_or": "np.logical_or"},
}


def _reduce(function, block, equation, inputs):
    x, (shape, dtype), axes = inputs[0], _shape(equation), tuple(equation.params["axes"])
    if not axes:
        return [x]
    empty = not math.prod(x.shape)
    if function in ("np.logical_and", "np.logical_or") and dtype.kind != "b":
        function = {"np.logical_and": "np.bitwise_and", "np.logical_or": "np.bitwise_or"}[function]
    if function in ("np.maximum", "np.minimum") and empty:
        return [block.names.constant(np.full(shape, _limit(function == "np.minimum", dtype)))]
    repeats = function not in ("np.add", "np.multiply")
    if x.held == () and repeats and not empty:
        return [x._replace(shape=shape)]
    typed = f",dtype='{dtype}'" if dtype.kind in "iu" else ""
    axis = axes[0] if len(axes) == 1 else axes
    x = block.full(x)
    work = 1 + math.prod(x.shape) / 1000
    return [block.write(f"{function}.reduce({{0}},{axis}{typed})", [x], shape, dtype, work=work)]


def _limit(largest, dtype):
    """Return the largest or the smallest number of a dtype: the minimum or maximum of nothing."""
    if dtype.kind == "b":
        return np.bool_(largest)
    if dtype.kind == "f":
        return dtype.type(np.inf if largest else -np.inf)
    return dtype.type(np.iinfo(dtype).max if largest else np.iinfo(dtype).min)


for _name, _function in _REDUCTIONS.items():
    rule(_name)(functools.partial(_reduce, _function))


@rule("argmax", "argmin")
def _argmax(block, equation, inputs):
    shape, dtype = _shape(equation)
    (axis,) = equation.params["axes"]
    text = f"np.{equation.primitive.name}({{0}},{axis}).astype('{dtype}')"
    return [block.write(text, [block.full(inputs[0])], shape, dtype)]


@rule("cumsum", "cumprod", "cummax", "cummin")
def _cumulate(block, equation, inputs):
    shape, dtype = _shape(equation)
    axis, kinds = equation.params["axis"], {"cumsum": "add", "cumprod": "multiply"}
    kinds |= {"cummax": "maximum", "cummin": "minimum"}
    text = f"np.{kinds[equation.primitive.name]}.accumulate({{0}},{axis},dtype='{dtype}')"
    if equation.params["reverse"]:
        flip = "[" + ":," * axis + "::-1]"
        text = text.replace("{0}", "{0}" + flip) + flip
    return [block.write(text, [block.full(inputs[0])], shape, dtype)]


@rule("sort")
def _sort(block, equation, inputs):
    given = equation.params
    function = block.names.helper(_make_sort, given["dimension"], given["num_keys"])
    places = ",".join(f"{{{k}}}" for k in range(len(inputs)))
    avals = [x.aval for x in equation.outvars]
    return block.write_call(f"{function}({places})", [block.full(x) for x in inputs], avals)


def _make_sort(axis, n_key):
    """Return the function that sorts arrays by the first `n_key` of them, NaN last."""

    def sort(*arrays):
        keys = [x + 0.0 if x.dtype.kind == "f" else x for x in arrays[:n_key]]  # -0.0 is 0.0
        if n_key == 1:
            order = np.argsort(keys[0], axis=axis, kind="stable")
        else:
            order = np.lexsort(keys[::-1], axis=axis)
        return tuple(np.take_along_axis(x, order, axis) for x in arrays)

    return sort


# --- parts of arrays


@rule("dynamic_slice")
def _dynamic_slice(block, equation, inputs):
    (x, *starts), (shape, dtype) = inputs, _shape(equation)
    if x.held == ():
        return [x._replace(shape=shape)]
    function = block.names.helper(_make_dynamic_slice, x.shape, shape)
    places = ",".join(f"{{{k + 1}}}" for k in range(len(starts)))
    return [block.write(f"{function}({{0}},{places})", [block.full(x), *starts], shape, dtype)]


def _window(starts, sizes, limits):
    """Return the slices of a window of these sizes that begins at `starts`, moved inside."""
    return tuple(
        slice(a, a + size)
        for a, size in zip(map(min, (max(int(s), 0) for s in starts), limits), sizes, strict=True)
    )


def _make_dynamic_slice(whole, sizes):
    limits = [n - size for n, size in zip(whole, sizes, strict=True)]
    return lambda x, *starts: x[_window(starts, sizes, limits)]


@rule("dynamic_update_slice")
def _dynamic_update_slice(block, equation, inputs):
    x, part, *starts = inputs
    function = block.names.helper(_make_dynamic_update, x.shape, part.shape)
    places = ",".join(f"{{{k}}}" for k in range(len(inputs)))
    inputs = [block.full(x), block.full(part), *starts]
    return [block.write(f"{function}({places})", inputs, *_shape(equation))]


def _make_dynamic_update(whole, sizes):
    limits = [n - size for n, size in zip(whole, sizes, strict=True)]

    def update(x, part, *starts):
        found = np.array(x)
        found[_window(starts, sizes, limits)] = part
        return found

    return update


@rule("stack")
def _stack(block, equation, inputs):
    shape, dtype = _shape(equation)
    places = ",".join(f"{{{k}}}" for k in range(len(inputs)))
    text = f"np.array(({places},))"
    if len(shape) > 1:
        stack = block.names.helper(_make_stack, shape, dtype, _stacking_axis(equation))
        text = f"{stack}({places})"
    return [block.write(text, [block.full(x) for x in inputs], shape, dtype, work=2)]


def _make_stack(shape, dtype, axis):
    """Return the function that stacks arrays along an axis to an array of this shape."""
    places = [(*(slice(None),) * axis, k) for k in range(shape[axis])]

    def stack(*arrays):
        found = np.empty(shape, dtype)
        for place, x in zip(places, arrays, strict=True):
            found[place] = x
        return found

    return stack


@rule("unstack")
def _unstack(block, equation, inputs):
    index, x = ":," * _stacking_axis(equation), block.full(inputs[0])
    return [
        block.write(f"{{0}}[{index}{k}]", [x], *_shape(equation, k), work=0.3)
        for k in range(len(equation.outvars))
    ]


def _stacking_axis(equation):
    """Return the axis along which arrays are stacked."""
    given = equation.params
    return given["axis"] if "axis" in given else given["dimension"]
