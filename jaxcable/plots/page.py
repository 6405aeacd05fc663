"""The page that `view` writes: one HTML file that contains all arrays, scripts and styles."""

from __future__ import annotations

import base64
import html
import json
import os
import re
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
    """An HTML page that shows a solution; notebooks show it as the last value of a cell.

    Attributes:
        html: text of the whole page.
        path: path of the file to which it was written, or None.
    """

    def __init__(self, html: str, path: Path | None):
        self.html, self.path = html, path

    def _repr_html_(self) -> str:
        """Return an iframe with the page for a notebook, whose style and keys stay separate."""
        return (
            '<iframe title="structure" width="100%" height="560" style="border: 0" '
            f'allowfullscreen srcdoc="{html.escape(self.html)}"></iframe>'
        )


class PageArrays:
    """Arrays for the page, joined into one block of bytes.

    Attributes:
        listed: dict from the name of each array to its type ("f", "u" or "b": float32, uint32,
            uint8), its offset in the block, bytes, and its shape.
    """

    def __init__(self) -> None:
        self.listed: dict[str, list[Any]] = {}
        self._blocks: list[bytes] = []
        self._size = 0

    def add(self, name: str, kind: str, values: ArrayLike) -> None:
        """Add an array under a name, converted to the type `kind`.

        That is "f" (float32), "u" (uint32) or "b" (uint8).
        """
        array = np.ascontiguousarray(values, _TYPES[kind])
        block = array.tobytes()
        block += bytes(-len(block) % 4)  # the page reads numbers of four bytes in place
        self.listed[name] = [kind, self._size, list(array.shape)]
        self._blocks.append(block)
        self._size += len(block)

    def base64_text(self) -> str:
        """Return the block of all arrays as base64 text."""
        return base64.b64encode(b"".join(self._blocks)).decode()


def fill_template(name: str, parts: Mapping[str, str]) -> str:
    """Return the text of a file in the folder ``viewer`` with its placeholders replaced.

    `parts` is a dict from placeholder, such as ``@TITLE@``, to the text in its place.
    """
    # in one pass, so that marks in the texts stay what they are
    return re.sub("|".join(parts), lambda mark: parts[mark[0]], read_viewer_file(name))


def read_viewer_file(name: str) -> str:
    """Return the text of a file in the folder ``viewer`` of this package."""
    return (resources.files(__package__) / "viewer" / name).read_text(encoding="utf-8")


def write_page(
    title: str,
    description: dict[str, Any],
    arrays: PageArrays,
    path: str | os.PathLike[str] | None,
) -> Page:
    """Make the `Page` of an interactive view, and write it to `path` unless that is None.

    Args:
        title: title of the page.
        description: what the scripts of the page need beside arrays, as data for JSON.
        arrays: `PageArrays`.
        path: path of the HTML file.
    """
    # in a script nothing ends it but "</script", nor begins a comment but "<!--"
    data = json.dumps(description | {"arrays": arrays.listed}).replace("<", "\\u003c")
    parts = {
        "@TITLE@": html.escape(title),
        "@STYLE@": read_viewer_file("view.css"),
        "@DATA@": data,
        "@SCRIPT@": "\n".join(read_viewer_file(f"{script}.js") for script in SCRIPTS),
        "@BYTES@": arrays.base64_text(),
    }
    whole = fill_template("view.html", parts)
    if path is not None:
        path = Path(path)
        with atomic_write(path) as stream:
            stream.write(whole)
    return Page(whole, path)
