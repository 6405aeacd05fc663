"""JSON that a person can read: objects indented, lists of numbers on one line."""

from __future__ import annotations

import json
from typing import Any


def format_json(data: Any, indent: int = 0) -> str:
    """Return plain data as JSON text that a person can read, with all digits of numbers.

    Objects and nested lists are indented, and lists of numbers stand on one line. NaN raises
    ValueError. `indent` is the number of spaces before the fields of the enclosing object.
    """
    inner = "\n" + " " * (indent + 1)
    if isinstance(data, dict) and data:
        items = (f"{json.dumps(key)}: {format_json(v, indent + 1)}" for key, v in data.items())
        return "{" + inner + ("," + inner).join(items) + "\n" + " " * indent + "}"
    if isinstance(data, list) and any(isinstance(item, dict | list) for item in data):
        lines = (format_json(item, indent + 1) for item in data)
        return "[" + inner + ("," + inner).join(lines) + "\n" + " " * indent + "]"
    return json.dumps(data, allow_nan=False, ensure_ascii=False)
