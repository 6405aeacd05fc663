"""Rules of gathers and scatters: indices are prepared apart, once for all that use them.

A gather is ``prepare(indices)``, which is written before a loop if the indices do not change in it,
and ``take(array, prepared)``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .rules import NoRuleError, result_of, rule


def _out_of_bounds_mode(equation):
    """Return what is done with indices outside: "clip" (moved inside) or "fill" (dropped)."""
    name = str(equation.params["mode"]).upper()
    return "fill" if "FILL" in name or "DROP" in name else "clip"


@rule("gather")
def _gather(block, equation, inputs):
    """Write a gather: entries, rows or windows of an array at computed indices."""
    (x, indices), given = inputs, equation.params
    shape, numbers = result_of(equation)[0], given["dimension_numbers"]
    fills, sizes = _out_of_bounds_mode(equation) == "fill", tuple(given["slice_sizes"])
    if not x.held and not fills:
        return [x._replace(shape=shape)]
    value = block.names.constant(_fill_value(given["fill_value"], x.dtype))
    if not math.prod(x.shape):
        return [value._replace(shape=shape)]
    axis = _axis_of_rows(numbers, sizes, x.shape, indices.shape, shape)
    make = _make_gather_indices, numbers, sizes, x.shape, axis, len(shape)
    prepared = _write_preparation(block, make, indices)
    text = "{0}.reshape(-1).take({1}[0])" if axis is None else f"{{0}}.take({{1}}[0],{axis})"
    if fills:
        text = f"{block.names.helper(lambda: _fill_outside)}({text},{{1}}[1],{value.name})"
    return [block.write(text, [block.full(x), prepared], shape, x.dtype)]


def _write_preparation(block, make, indices):
    """Write the preparation of `indices` by ``make[0](*make[1:])``; return the prepared value."""
    function = block.names.helper(*make)
    return block.write(f"{function}({{0}})", [block.full(indices)], None, None, work=4)


def _axis_of_rows(numbers, sizes, whole, indices, shape):
    """Return the axis along which a gather takes whole rows, without moving other axes; else None.

    Args:
        numbers: dimension numbers of the gather (jax).
        sizes: sizes of the slices along each axis of the array.
        whole, indices, shape: shapes of the array, of the indices, and of the result.
    """
    if numbers.operand_batching_dims or len(numbers.start_index_map) != 1:
        return None
    (axis,) = numbers.start_index_map
    if tuple(numbers.collapsed_slice_dims) != (axis,) or sizes[axis] != 1:
        return None
    if any(a != b for k, (a, b) in enumerate(zip(sizes, whole, strict=True)) if k != axis):
        return None
    n_batch = len(indices) - 1
    offsets = [k for k in range(len(shape)) if not axis <= k < axis + n_batch]
    return axis if list(numbers.offset_dims) == offsets else None


def _make_gather_indices(numbers, sizes, whole, axis, n_axis):
    """Return the function that prepares the indices of a gather: (indices into the array, mask).

    They are flat indices of all entries of the result or, if it takes rows along `axis`, indices of
    rows. All are moved inside of the array; the mask says which ones were inside, None if all were.

    Args:
        numbers, sizes, whole: as of `_axis_of_rows`.
        axis: axis of the rows, or None.
        n_axis: number of axes of the result.
    """
    moving, gone = numbers.start_index_map, set(numbers.collapsed_slice_dims)
    batching = dict(
        zip(numbers.operand_batching_dims, numbers.start_indices_batching_dims, strict=True)
    )
    windows = [k for k in range(len(whole)) if k not in gone and k not in batching]

    def prepare_rows(indices):  # quick, for indices that change in a loop
        rows, last = indices[..., 0].astype(np.intp), whole[axis] - 1
        inside = (rows >= 0) & (rows <= last)
        if inside.all():
            return rows, None
        shape = *(1,) * axis, *inside.shape, *(1,) * (n_axis - axis - inside.ndim)
        return np.clip(rows, 0, max(last, 0)), inside.reshape(shape)

    def prepare(indices):
        flat, inside = _flat_indices(indices, whole, sizes, moving, batching, windows)
        order = _window_axis_order(numbers.offset_dims, flat.ndim)
        inside = None if inside.all() else np.broadcast_to(inside, flat.shape).transpose(order)
        return flat.transpose(order), inside

    return prepare if axis is None else prepare_rows


def _flat_indices(indices, whole, sizes, moving, batching, windows):
    """Return flat indices of entries in windows, with axes of the batch first, and a mask.

    The mask is True for windows that are inside of the array; others are moved inside.

    Args:
        indices: [*batch, n], where windows begin, along the axes `moving`.
        whole, sizes: shapes of the array, and of a window.
        moving: axes of the array that the last axis of `indices` is for.
        batching: axes of the array by which it is mapped, each with the axis of `indices`.
        windows: axes of the array that are axes of a window.
    """
    batch = indices.shape[:-1]
    ones = (1,) * len(windows)
    strides = np.cumprod([1, *whole[:0:-1]])[::-1]
    flat = np.zeros((*batch, *(sizes[k] for k in windows)), np.intp)
    inside = np.ones((*batch, *ones), bool)
    for k, axis in enumerate(moving):
        begin = indices[..., k].astype(np.intp).reshape((*batch, *ones))
        last = whole[axis] - sizes[axis]
        inside &= (begin >= 0) & (begin <= last)
        flat += np.clip(begin, 0, max(last, 0)) * strides[axis]
    along = [(axis, own, batch[own]) for axis, own in batching.items()]
    along += [(axis, len(batch) + k, sizes[axis]) for k, axis in enumerate(windows)]
    for axis, own, size in along:
        flat += np.arange(size).reshape(-1, *(1,) * (flat.ndim - own - 1)) * strides[axis]
    return flat, inside


def _window_axis_order(offsets, n):
    """Return the order of `n` axes that moves those of windows, the last ones, to `offsets`.

    Axes of the batch, the first ones, keep their order in between.
    """
    n_batch = n - len(offsets)
    batch, window = iter(range(n_batch)), iter(range(n_batch, n))
    return [next(window) if k in offsets else next(batch) for k in range(n)]


def _fill_outside(x, inside, value):
    """Return `x` with `value` in place of entries that are not `inside` (a mask; None: all are)."""
    return x if inside is None else np.where(inside, x, value)[()]


def _fill_value(value, dtype):
    """Return the number that jax reads outside of an array: `value`, or None for a default.

    Default is NaN of floats, the largest of unsigned and the smallest of signed integers, True of
    bool.
    """
    if value is None and dtype.kind in "iu":
        limits = np.iinfo(dtype)
        value = limits.min if dtype.kind == "i" else limits.max
    return np.asarray(np.nan if value is None else value, dtype)  # of bool: True


# --- scatters

_OPERATIONS: dict[str, Any] = {"": None, "add": np.add, "sub": np.subtract, "mul": np.multiply}
_OPERATIONS |= {"min": np.minimum, "max": np.maximum}


@rule("scatter", *(f"scatter{sign}{name}" for sign in "-_" for name in _OPERATIONS if name))
def _scatter(block, equation, inputs):
    """Write a scatter: updates that are set, added, multiplied ... at computed indices."""
    x, indices, updates = inputs
    if equation.primitive.name == "scatter" and equation.params["update_jaxpr"] is not None:
        raise NoRuleError("scatter of a function of the entries")  # ``x.at[i].apply(f)``
    numbers, clips = equation.params["dimension_numbers"], _out_of_bounds_mode(equation) == "clip"
    make = _make_scatter_indices, numbers, x.shape, updates.shape, clips
    prepared = _write_preparation(block, make, indices)
    operation = _OPERATIONS[equation.primitive.name[len("scatter_") :]]
    function = block.names.helper(_make_scatter, operation, x.shape)
    inputs, text = [prepared, block.full(updates)], f"{function}(None,{{0}},{{1}})"
    if operation is not np.add or x.dtype != np.float64:
        inputs, text = [*inputs, block.full(x)], f"{function}({{2}},{{0}},{{1}})"
    elif x.depth > 0 or x.held or block.names.space[x.name]:
        inputs, text = [*inputs, x], "{2}+" + text
    return [block.write(text, inputs, x.shape, x.dtype, work=3)]


def _make_scatter_indices(numbers, whole, updates, clips):
    """Return the function that prepares the indices of a scatter: (flat indices, axes, mask).

    The flat indices, [n], are those of all entries that are changed. The updates become [n] by the
    order of their axes and by the mask of those inside; None where this changes nothing.

    Args:
        numbers: dimension numbers of the scatter (jax).
        whole, updates: shapes of the array, and of the updates.
        clips: whether windows outside are moved inside, not dropped.
    """
    batching = dict(
        zip(numbers.operand_batching_dims, numbers.scatter_indices_batching_dims, strict=True)
    )
    gone = {*numbers.inserted_window_dims, *batching}
    windows = [k for k in range(len(whole)) if k not in gone]
    of_window, n = list(numbers.update_window_dims), len(updates)
    sizes = [1] * len(whole)
    for axis, own in zip(windows, of_window, strict=True):
        sizes[axis] = updates[own]
    order = [k for k in range(n) if k not in of_window] + of_window
    order = None if order == sorted(order) else order

    def prepare(indices):
        flat, inside = _flat_indices(
            indices, whole, sizes, numbers.scatter_dims_to_operand_dims, batching, windows
        )
        if clips or inside.all():
            return flat.reshape(-1), order, None
        mask = np.broadcast_to(inside, flat.shape).reshape(-1)
        return flat.reshape(-1)[mask], order, mask

    return prepare


def _make_scatter(operation, shape):
    """Return the function (array, prepared indices, updates) -> copy of the array with updates.

    `operation` is NumPy's function that combines entries and updates, None to replace entries;
    `shape` is that of the array. Array None stands for zeros, to which float64 updates are added.
    """

    def scatter(x, prepared, updates):
        places, order, mask = prepared
        updates = np.reshape(updates if order is None else updates.transpose(order), -1)
        updates = updates if mask is None else updates[mask]
        if x is None:
            return np.bincount(places, updates, math.prod(shape)).reshape(shape)
        found = np.array(x).reshape(-1)
        if operation is None:
            found[places] = updates
        else:
            operation.at(found, places, updates)
        return found.reshape(shape)

    return scatter
