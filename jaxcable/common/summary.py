"""Short texts for objects, a few lines each: what `repr` shows of structures and results.

A text is made of what an object holds: nothing is computed but the range of its numbers. It has the
status of a result in words, the sizes of its arrays and their extremes, and the shapes alone where
numbers are traced.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sized
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from . import status

_LINES, _WIDTH = 5, 96  # of a text, at most
_DEEPEST_LEVEL = 3  # levels of containers that are opened
_MOST_NUMBERS = 10_000_000  # numbers of an array whose range is found in some milliseconds


def summarize(obj: Any) -> str:
    """Return a description of a `pytree` object for `repr`, in five lines at most.

    It shows all fields, or those that a class lists, with units, in ``_shown``, such as ``"loss,
    tension N"``. It never raises: what cannot be described is shown as its type.
    """
    name = type(obj).__name__
    try:
        parts = []
        for key, unit in _fields_to_show(obj).items():
            text = _describe_safely(getattr(obj, key, None))
            if text and key != "status":
                parts.append(f"{key} {text} {unit}".strip())
        head = _describe_status(obj.__dict__["status"]) if "status" in obj.__dict__ else ""
        # what a status leaves open, such as targets that are missed
        head = "; ".join(filter(None, (head, getattr(obj, "targets_missed", ""))))
        return _fold_lines(f"{name}: {head}" if head else name, parts)
    except Exception:  # a text of an object must not add an error to another one
        return f"{name}(...)"


def _fields_to_show(obj):
    """Return {name: unit} of the fields of an object that its summary shows; "" for no unit."""
    chosen = getattr(type(obj), "_shown", None)
    if chosen is None:
        return dict.fromkeys(type(obj)._all_fields, "")
    return {name: unit for name, _, unit in (part.partition(" ") for part in chosen.split(", "))}


def _fold_lines(head, parts):
    """Return the summary text of an object: on one line if it fits, else on up to five.

    `head` is its first line, and `parts` are descriptions of fields, a list of texts. What is
    longer is cut off, with " ...".
    """
    together = f"{head}({', '.join(parts)})"
    if ":" not in head and len(together) <= _WIDTH:
        return together
    lines = [textwrap.shorten(head, _WIDTH, placeholder=" ...")]
    for part in parts:
        part = textwrap.shorten(part, _WIDTH - 4, placeholder=" ...")
        if len(lines) > 1 and len(lines[-1]) + len(part) + 2 <= _WIDTH - 4:
            lines[-1] += f"; {part}"
        elif len(lines) < _LINES:
            lines.append(f"  {part}")
        else:
            lines[-1] += " ..."
            break
    return "\n".join(lines)


def _describe_status(code):
    """Return the text of a status code; for a batch the number converged and the first failure."""
    if isinstance(code, jax.core.Tracer):
        return "traced"
    codes = np.asarray(code)
    if codes.dtype.kind not in "iu":
        return "status unknown"
    failed = codes[codes != status.OK]
    first = _status_code_text(int(failed[0])) if failed.size else ""
    if codes.ndim == 0:
        return first or status.describe(status.OK)
    return f"{codes.size - failed.size} of {codes.size} converged" + (first and f"; one: {first}")


def _status_code_text(code):
    """Return a status code with its text; the code alone if it is unknown."""
    try:
        return f"status {code}, {status.describe(code)}"
    except ValueError:
        return f"status {code}"


def _describe_safely(value, depth=0):
    """Return a value in a few words, "" for None, or its type if it cannot be described."""
    try:
        return _describe_value(value, depth)
    except Exception:  # such as an array that has been deleted
        return type(value).__name__


def _describe_value(value, depth):
    """Return a value in a few words, "" for None; may raise, such as for a deleted array.

    `depth` is the number of containers that it is in; those in many are not opened.
    """
    if value is None:
        return ""
    if isinstance(value, jax.core.Tracer):
        return f"{value.dtype}{list(value.shape)} traced"
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        return _shape_and_range_text(value)
    if isinstance(value, str | bool | int | float | complex):
        return repr(value)
    if hasattr(value, "_all_fields") or depth == _DEEPEST_LEVEL:
        return _type_and_length_text(value)
    if isinstance(value, dict):
        items = (
            f"{key!r}: {_describe_safely(item, depth + 1) or None}" for key, item in value.items()
        )
        return "{" + ", ".join(items) + "}"
    if isinstance(value, list | tuple):
        kinds = {type(item).__name__ for item in value}
        if len(value) > 3 or (len(kinds) == 1 and all(hasattr(v, "_all_fields") for v in value)):
            return f"{len(value)} of {', '.join(sorted(kinds))}"
        return "[" + ", ".join(_describe_safely(item, depth + 1) or "None" for item in value) + "]"
    if hasattr(value, "shape"):
        return f"{list(value.shape)}"
    return _type_and_length_text(value)


def _type_and_length_text(value):
    """Return the type of an object and its length; for a group, the number of its elements."""
    links = value.__dict__.get("links") if hasattr(value, "__dict__") else None
    sized = links if isinstance(links, Sized) else value
    count = f"[{len(sized)}]" if isinstance(sized, Sized) else ""
    return getattr(value, "__name__", type(value).__name__) + count


def _shape_and_range_text(value):
    """Return the shape of an array and the range of its numbers, as a text.

    A scalar gives its value instead; booleans give the number of True. NaN are counted apart from
    the range. Arrays that are empty, very large or not of numbers give dtype and shape only.
    """
    shape = list(value.shape)
    numeric = jnp.issubdtype(value.dtype, jnp.number) or value.dtype == bool
    if not numeric or not 0 < value.size <= _MOST_NUMBERS:
        return f"{value.dtype}{shape}"
    array = np.asarray(value)
    if array.ndim == 0:
        return f"{array.item():.6g}" if array.dtype.kind != "b" else str(bool(array))
    if array.dtype.kind == "b":
        return f"{shape} {int(array.sum())} True"
    numbers = array.astype(float, copy=False)
    known = numbers[~np.isnan(numbers)]
    if not known.size:
        return f"{shape} NaN"
    low, high = f"{known.min():.6g}", f"{known.max():.6g}"
    extent = low if low == high else f"{low} to {high}"
    return f"{shape} {extent}" + (
        f" ({array.size - known.size} NaN)" if known.size < array.size else ""
    )
