"""The page that `view` writes: arrays of a solution in text, in a page without other files."""

from __future__ import annotations

import base64
import html
import json
import os
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from ..common.types import ArrayLike
from ..common.writing import atomic_write

_TYPES: dict[str, Any] = {"f": np.dtype("<f4"), "u": np.dtype("<u4"), "b": np.dtype("u1")}
SCRIPTS = ("data", "camera", "shape", "draw", "pick", "panel", "main")
"""Names of the scripts, in their order: each knows those before it."""


class Page:
    """A page that shows a solution; notebooks show it as the last value of a cell.

    Attributes:
        html: the whole page, text.
        path: where it has been written, or None.
    """

    def __init__(self, html: str, path: Path | None):
        self.html, self.path = html, path

    def _repr_html_(self) -> str:
        """The page in a frame of a notebook, which keeps its style and its keys apart."""
        return (
            '<iframe title="structure" width="100%" height="560" style="border: 0" '
            f'allowfullscreen srcdoc="{html.escape(self.html)}"></iframe>'
        )


class Arrays:
    """Arrays for the page, one after the other in one block of bytes.

    Attributes:
        listed: for every array its type ("f", "u" or "b": float32, uint32, uint8), its offset in
            bytes and its shape, by name.
    """

    def __init__(self) -> None:
        self.listed: dict[str, list[Any]] = {}
        self._blocks: list[bytes] = []
        self._size = 0

    def put(self, name: str, kind: str, values: ArrayLike) -> None:
        """Add an array of a type."""
        array = np.ascontiguousarray(values, _TYPES[kind])
        block = array.tobytes()
        block += bytes(-len(block) % 4)  # the page reads numbers of four bytes in place
        self.listed[name] = [kind, self._size, list(array.shape)]
        self._blocks.append(block)
        self._size += len(block)

    def text(self) -> str:
        """All bytes as base64."""
        return base64.b64encode(b"".join(self._blocks)).decode()


def filled(name: str, parts: Mapping[str, str]) -> str:
    """A page made of a file in ``viewer``, with texts in place of marks that occur once in it."""
    before = source(name)
    pieces = []
    for mark, text in sorted(parts.items(), key=lambda pair: before.rindex(pair[0]), reverse=True):
        before, after = before.split(mark)  # marks in the texts stay what they are
        pieces[:0] = [text, after]
    return "".join([before, *pieces])


def source(name: str) -> str:
    """The text of a file in ``viewer``."""
    return (resources.files(__package__) / "viewer" / name).read_text(encoding="utf-8")


def write(
    title: str, told: dict[str, Any], arrays: Arrays, path: str | os.PathLike[str] | None
) -> Page:
    """Make the `Page` of a description `told` and its arrays, and write it unless path is None."""
    # in a script nothing ends it but "</script", nor begins a comment but "<!--"
    data = json.dumps(told | {"arrays": arrays.listed}).replace("<", "\\u003c")
    parts = {
        "@TITLE@": html.escape(title),
        "@STYLE@": source("view.css"),
        "@DATA@": data,
        "@SCRIPT@": "\n".join(source(f"{script}.js") for script in SCRIPTS),
        "@BYTES@": arrays.text(),
    }
    whole = filled("view.html", parts)
    if path is not None:
        path = Path(path)
        with atomic_write(path) as stream:
            stream.write(whole)
    return Page(whole, path)
