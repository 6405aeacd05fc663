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
def examples() -> dict[str, Any]:
    """The examples, under "scene", "classes" and "fields"."""
    return json.loads((resources.files(__package__) / "examples.json").read_text("utf-8"))


def snippets(names: list[str]) -> list[dict[str, Any]]:
    """Snippets for editors, the examples of some classes, a list."""
    return [
        {"label": label, "body": example}
        for name in names
        for label, example in examples()["classes"].get(name, {}).items()
    ]
