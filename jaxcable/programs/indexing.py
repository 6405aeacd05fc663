"""Rules of gathers and scatters: indices are prepared apart, once for all that use them.

A gather is ``prepare(indices)``, which is written before a loop if the indices do not change in it,
and ``take(array, prepared)``.
"""

from __future__ import annotations

import math

import numpy as np

from .rules import rule


def _mode(equation):
    """Return "clip" or "fill": what is done with indices outside."""
    name = str(equation.params["mode"]).upper()
    return "fill" if "FILL" in name or "DROP" in name else "clip"


@rule("gather")
def _gather(block, equation, inputs):
    x, indices = inputs
    given, aval = equation.params, equation.outvars[0].aval
    shape, numbers = tuple(aval.shape), given["dimension_numbers"]
    fills, sizes = _mode(equation) == "fill", tuple(given["slice_sizes"])
    axis = _axis_of_rows(numbers, sizes, x.shape, indices.shape, shape)
    if axis is None:
        make = _make_flat_indices, numbers, sizes, x.shape, fills
        prepared = _prepare(block, make, indices)
        text = "{0}.reshape(-1).take({1}[0])"
    else:
        prepared = _prepare(block, (_make_row_indices, x.shape[axis], fills), indices)
        text = f"{{0}}.take({{1}}[0],{axis})"
    if fills:
        value = block.names.constant(_fill_value(given["fill_value"], x.dtype)).name
        fill = block.names.helper(_make_fill, axis, len(shape))
        text = f"{fill}({text},{{1}}[1],{value})"
    if not x.held and not fills:
        return [x._replace(shape=shape)]
    if not math.prod(x.shape):
        return [block.names.constant(np.full(shape, _fill_value(given["fill_value"], x.dtype)))]
    return [block.write(text, [block.full(x), prepared], shape, x.dtype)]


def _prepare(block, make, indices):
    """Write the preparation of indices, ``make[0](*make[1:])``."""
    function = block.names.helper(*make)
    return block.write(f"{function}({{0}})", [block.full(indices)], None, None, work=4)


def _axis_of_rows(numbers, sizes, whole, indices, shape):
    """Return the axis if the gather takes rows along one axis, in their places; else None."""
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


def _make_row_indices(count, fills):
    """Return the function that prepares indices of rows: (indices inside, which are inside)."""

    def prepare(indices):
        rows = indices[..., 0].astype(np.intp)
        inside = (rows >= 0) & (rows < count)
        if inside.all():
            return rows, None
        return np.clip(rows, 0, max(count - 1, 0)), inside if fills else None

    return prepare


def _make_flat_indices(numbers, sizes, whole, fills):
    """Return the function that prepares flat indices of all entries that a gather takes."""
    batching = dict(
        zip(numbers.operand_batching_dims, numbers.start_indices_batching_dims, strict=True)
    )
    gone = {*numbers.collapsed_slice_dims, *batching}
    windows = [k for k in range(len(whole)) if k not in gone]

    def prepare(indices):
        flat, inside = _flat_indices(
            indices, whole, sizes, numbers.start_index_map, batching, windows
        )
        order = _places_of_batch(numbers.offset_dims, flat.ndim)
        flat = flat.transpose(order)
        if inside.all():
            return flat, None
        inside = np.broadcast_to(inside, flat.transpose(np.argsort(order)).shape).transpose(order)
        return flat, inside if fills else None

    return prepare


def _flat_indices(indices, whole, sizes, moving, batching, windows):
    """Return flat indices with the axes of the batch first, and which windows are inside.

    Args:
        indices: [*batch, n]: where windows begin, along the axes `moving`.
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
    for axis, of_indices in batching.items():
        shape = [1] * flat.ndim
        shape[of_indices] = batch[of_indices]
        flat += np.arange(batch[of_indices]).reshape(shape) * strides[axis]
    for k, axis in enumerate(windows):
        shape = [1] * flat.ndim
        shape[len(batch) + k] = sizes[axis]
        flat += np.arange(sizes[axis]).reshape(shape) * strides[axis]
    return flat, inside


def _places_of_batch(offsets, n):
    """Return the order of axes that puts those of windows to `offsets`, others in between."""
    n_batch = n - len(offsets)
    batch, window = iter(range(n_batch)), iter(range(n_batch, n))
    return [next(window) if k in offsets else next(batch) for k in range(n)]


def _make_fill(axis, n):
    """Return the function that fills entries that are not `inside` (None: all are)."""

    def fill(x, inside, value):
        if inside is None:
            return x
        if axis is not None:
            inside = np.asarray(inside)
            inside = inside.reshape((*(1,) * axis, *inside.shape, *(1,) * (n - axis - inside.ndim)))
        return np.where(inside, x, value)[()]

    return fill


def _fill_value(value, dtype):
    """Return what stands for entries outside of an array, as jax has it."""
    if value is not None:
        return np.asarray(value, dtype)
    if dtype.kind in "fc":
        return np.asarray(np.nan, dtype)
    if dtype.kind == "b":
        return np.asarray(True)
    limits = np.iinfo(dtype)
    return np.asarray(limits.min if dtype.kind == "i" else limits.max, dtype)


# --- scatters

_ADD, _SET = "add", "set"
_OPERATIONS = {
    **{"scatter": _SET, "scatter-add": _ADD, "scatter_add": _ADD},
    "scatter-sub": "subtract",
    **{"scatter-mul": "multiply", "scatter_mul": "multiply"},
    **{"scatter-min": "minimum", "scatter_min": "minimum"},
    **{"scatter-max": "maximum", "scatter_max": "maximum"},
}


@rule(*_OPERATIONS)
def _scatter(block, equation, inputs):
    x, indices, updates = inputs
    numbers, clips = equation.params["dimension_numbers"], _mode(equation) == "clip"
    make = _make_flat_places, numbers, x.shape, updates.shape, clips
    prepared = _prepare(block, make, indices)
    zero = x.depth == 0 and x.held == () and not block.names.known[x.name]
    operation = _OPERATIONS[equation.primitive.name]
    function = block.names.helper(_make_scatter, operation, x.shape, x.dtype)
    start = "None" if zero and operation == _ADD and x.dtype == np.float64 else "{2}"
    inputs = [prepared, block.full(updates), x if start == "None" else block.full(x)]
    if start == "None":
        inputs = inputs[:2]
    return [block.write(f"{function}({start},{{0}},{{1}})", inputs, x.shape, x.dtype, work=3)]


def _make_flat_places(numbers, whole, updates, clips):
    """Return the function that prepares flat indices of all entries that a scatter sets.

    The result has these indices, [n], and the order of axes and the mask by which the updates
    become [n]; None for none.
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


def _make_scatter(operation, shape, dtype):
    """Return the function that scatters updates to a copy of an array of this shape."""
    size = math.prod(shape)

    def arranged(prepared, updates):
        places, order, mask = prepared
        if order is not None:
            updates = updates.transpose(order)
        updates = np.reshape(updates, -1)
        return places, updates if mask is None else updates[mask]

    def add(x, prepared, updates):
        places, updates = arranged(prepared, updates)
        total = np.bincount(places, updates, size).reshape(shape)
        return total if x is None else x + total

    def others(x, prepared, updates):
        places, updates = arranged(prepared, updates)
        found = np.array(x).reshape(-1)
        if operation == _SET:
            found[places] = updates
        else:
            getattr(np, operation).at(found, places, updates)
        return found.reshape(shape)

    return add if operation == _ADD and dtype == np.float64 else others
