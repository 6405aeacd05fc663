"""Examples in the schema of scene files: what a person types most often, in JSON.

Editors offer them, and a test reads every one of them in a scene that it fits. They stand in
`examples.json` beside this module: a whole scene; objects, by the name of their class and by what
each of them is; and values of fields, by class and field ("guys" and "mast" are keys of groups).
"""

from __future__ import annotations

import functools
import json
from importlib import resources
from typing import Any


@functools.cache
def load_schema_examples() -> dict[str, Any]:
    """Load the examples of scene files in the schema, a dict of objects as JSON has them.

    "scene" is a whole scene; "classes" has ``{class: {label: object}}``; "fields" has
    ``{class: {field: [value, ...]}}``.
    """
    return json.loads((resources.files(__package__) / "examples.json").read_text("utf-8"))


def editor_snippets(names: list[str]) -> list[dict[str, Any]]:
    """Return the examples of the named classes as editors take them.

    The result is a list of {"label": text, "body": example in JSON data}.
    """
    return [
        {"label": label, "body": example}
        for name in names
        for label, example in load_schema_examples()["classes"].get(name, {}).items()
    ]
