"""Numbers of scene files: arrays as nested lists, and back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..common.checks import holds_boolean
from ..common.types import ArrayLike
from .reading import FileError


def encode_numbers(value: ArrayLike, where: str) -> Any:
    """Return numbers as nested lists; float32 as {"type": "float32", "values": nested lists}.

    Raise ValueError, which names the place `where`, for anything but finite numbers and booleans.
    """
    array = np.asarray(value)
    if not np.issubdtype(array.dtype, np.number) and array.dtype != bool:
        raise ValueError(f"{where}: an array of {array.dtype} cannot be written to a file")
    if not np.isfinite(array).all():
        index = np.argwhere(~np.isfinite(array))[0].tolist()
        raise ValueError(f"{where}{index or ''}: is not finite; files hold finite numbers only")
    if array.dtype == np.float32 and not isinstance(value, float):
        return {"type": "float32", "values": array.astype(float).tolist()}
    return array.tolist()


def decode_float32(data: Mapping[str, Any], where: str) -> np.ndarray | np.generic:
    """Return the array or number that {"type": "float32", "values": ...} stands for."""
    require_only_key(data, "values", where)
    values = decode_numbers(data["values"], where)
    if np.abs(values).max(initial=0.0) > np.finfo(np.float32).max:
        raise FileError(f"{where}: the number is too large for float32")
    return values.astype(np.float32)[()]


def decode_numbers(data: Any, where: str) -> np.ndarray:
    """Return nested lists of finite numbers or booleans as an array.

    Raise FileError, which names the place `where`, for lists of unequal lengths and other data.
    """
    try:
        array = np.array(data)
    except (ValueError, OverflowError):
        array = None
    if array is None or (array.size and array.dtype.kind not in "bif"):
        place, why = _find_irregular_item(data) or (
            "",
            "expected numbers in lists of equal lengths",
        )
        raise FileError(f"{where}{place}: {why}")
    if array.dtype != bool and holds_boolean(data):  # NumPy would count it as 0 or 1
        raise FileError(f"{where}: expected numbers, got true or false among them")
    if not np.isfinite(array).all():
        index = np.argwhere(~np.isfinite(array))[0].tolist()
        raise FileError(f"{where}{index or ''}: the number is too large")
    return array


def _find_irregular_item(data, place=""):
    """Find the first item of nested lists that is no number, or a list of another length.

    Return its place, such as "[2][0]", and what was expected there, in words; or None.
    """
    if not isinstance(data, list):
        number = isinstance(data, int | float)
        return None if number else (place, f"expected a number, got {json.dumps(data):.40}")
    lengths = [len(item) if isinstance(item, list) else 0 for item in data]
    usual = max(lengths, key=lengths.count, default=0)
    for k, length in enumerate(lengths):
        if length != usual and not isinstance(data[k], str | None):
            text = f"expected numbers in lists of equal lengths, got {length or 'no list'} "
            return f"{place}[{k}]", f"{text}where others have {usual or 'no list'}"
    return next(
        filter(None, (_find_irregular_item(item, f"{place}[{k}]") for k, item in enumerate(data))),
        None,
    )


def require_only_key(data: Mapping[str, Any], key: str, where: str) -> None:
    """Raise FileError unless an object has `key`, beside its "type", and no other field."""
    if key not in data:
        raise FileError(f'{where}: "{key}" is missing; {{"type": "{data["type"]}"}} needs it')
    for other in data.keys() - {"type", key}:
        name = f'{{"type": "{data["type"]}"}}'
        raise FileError(f'{where}: {name} has no key {other!r}, only "{key}"')
