"""Nets from the lines of an OBJ file, as modelling programs write them."""

from __future__ import annotations

import dataclasses
import itertools
from os import PathLike

import numpy as np

from . import reading
from .lines import net_of
from .nets import Net
from .reading import LARGEST, FileError, read_text


def read_obj(
    path: str | PathLike[str],
    scale: float = 1.0,
    *,
    tolerance: float = 1e-6,
    largest: int = LARGEST,
) -> Net:
    """Read points (``v``), lines, polylines (``l``) and edges of faces (``f``) of an OBJ file.

    Programs often write separate points for every line: points nearer than `tolerance` become one
    node, and a link that occurs twice is taken once. Groups (``g``, ``o``) become groups of the
    net. Everything else in the file is skipped.

    Args:
        path: path of the file.
        scale: metres per unit of the file: 1e-3 for millimetres.

    Options:
        tolerance: largest distance of points that become one node, m.
        largest: largest size that is read, bytes.

    Returns:
        `Net`, without supports and stiffness; add them by
        ``net.scene(anchors, axial_stiffness=...)``.

    Raises:
        FileError: no points or lines, an unknown point, a line without length; the message names
            the line.
        OSError: there is no such file, or it cannot be read.

    Example:
        >>> import tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.obj"
        >>> _ = path.write_text("v 0 0 0\\nv 1000 0 0\\nv 2000 0 0\\nl 1 2 3\\n")
        >>> jc.files.read_obj(path, scale=1e-3).links.tolist()
        [[0, 1], [1, 2]]
    """
    if not 0 < scale < np.inf or not 0 <= tolerance < np.inf:
        raise ValueError(f"scale = {scale}, tolerance = {tolerance}: expected positive numbers")
    points, lines, group, named = [], [], "", False
    for number, text in enumerate(read_text(path, largest).splitlines(), 1):
        words = text.split("#")[0].split()
        kind, words = (words[0], words[1:]) if words else ("", [])
        try:
            if kind == "v":
                points.append([reading.number(word) for word in words[:3]])
                if len(points[-1]) != 3 or not np.isfinite(points[-1]).all():
                    raise ValueError("a point has three finite coordinates")
            elif kind in ("l", "f"):
                chain = [_point(word, len(points)) for word in words]
                if len(chain) < 2:
                    raise ValueError("a line has at least two points")
                chain += chain[:1] if kind == "f" else []
                lines += [(f"line {number}", group, *pair) for pair in itertools.pairwise(chain)]
            elif kind in ("g", "o"):
                group, named = " ".join(words), True
        except ValueError as error:
            raise FileError(f"{path}: line {number}: {error}") from None
    if not points or not lines:
        raise FileError(f"{path}: has {len(points)} points (v) and {len(lines)} lines (l): no net")
    with np.errstate(over="ignore"):
        places = scale * np.array(points)
    try:
        drawn = net_of(places, lines, tolerance)
    except ValueError as error:
        raise FileError(f"{path}: {error}") from None
    groups = drawn.net.groups
    several = named and groups is not None and len(set(groups)) > 1
    return dataclasses.replace(drawn.net, groups=groups if several else None)


def _point(word, count):
    """Index of a point, from 0, of a word like "7", "7/1" or "-1" (the last point so far)."""
    try:
        number = reading.whole(word.split("/")[0])
    except ValueError:
        raise ValueError(f"{word!r} is no point; points are numbered from 1") from None
    index = number - 1 if number > 0 else count + number
    if number == 0 or not 0 <= index < count:
        raise ValueError(f"point {number} is not among the {count} before this line")
    return index
