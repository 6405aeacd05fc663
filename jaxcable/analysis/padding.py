"""Sizes in steps, and arrays of NumPy padded to them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..common.types import ArrayLike

_SMALL_SIZES = 12, 24, 36, 48, 72, 96, 120, 150
_STEP = 1.25  # ratio of larger sizes: the work of a solve grows by little more than its unknowns


def doubled_size(count: int, first: int) -> int:
    """Return the smallest of the sizes `first`, 2 `first`, 4 `first`, ... of at least `count`."""
    while first < count:
        first *= 2
    return first


def common_size(count: int) -> int:
    """Return the smallest of the sizes of what takes time, at least `count`."""
    for size in _SMALL_SIZES:
        if size >= count:
            return size
    while size < count:
        size = int(np.ceil(_STEP * size / 10)) * 10
    return size


def repeat_last(x: ArrayLike, size: int, axis: int = 0) -> np.ndarray:
    """Pad an array along `axis` to `size` entries with copies of the last one."""
    return fill(x, size, axis, None)


def fill(x: ArrayLike, size: int, axis: int, value: Any) -> np.ndarray:
    """Pad an array along `axis` to `size` entries with `value`; None: with the last entry."""
    x = np.asarray(x)
    count = x.shape[axis]
    if count == size:
        return x
    padded = np.empty((*x.shape[:axis], size, *x.shape[axis + 1 :]), x.dtype)
    before = (slice(None),) * axis
    padded[(*before, slice(count))] = x
    padded[(*before, slice(count, None))] = (
        x[(*before, slice(count - 1, count))] if value is None else value
    )
    return padded
