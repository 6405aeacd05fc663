"""Read nets from the lines of an OBJ file, as modelling programs write them."""

from __future__ import annotations

import dataclasses
from os import PathLike

import numpy as np

from ..common.units import UnitsLike
from . import reading
from .net_units import metres_per_drawing_unit, warn_if_implausibly_large
from .nets import Net
from .omissions import Omissions
from .polylines import Polyline, net_from_polylines
from .reading import LARGEST, FileError, read_text

_APPEARANCE = frozenset("vt vn s usemtl mtllib lod bevel c_interp d_interp usemap maplib".split())
"""Statements that change the look only: textures, normals, smoothing, materials, details."""

_CURVES = (
    "vp cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con ctech stech "
    "bzp bsp cdc cdp res"
)
_FREE_FORM = {
    **dict.fromkeys(_CURVES.split(), "free-form curves are not read: convert them to polylines"),
    **dict.fromkeys(("call", "csh"), "nothing in a file is executed"),
    "p": "single points are not read",
}
"""Why other statements are left out."""


def read_obj(
    path: str | PathLike[str],
    scale: float | None = None,
    *,
    tolerance: float = 1e-6,
    largest: int = LARGEST,
    units: UnitsLike | None = None,
) -> Net:
    """Read points (``v``), lines, polylines (``l``) and edges of faces (``f``) of an OBJ file.

    Programs often write separate points for every line: points nearer than `tolerance` become one
    node, and a link that occurs twice is taken once. Groups (``g``, ``o``) become groups of the
    net. Textures, normals and materials are skipped. What else is left out (free-form
    curves, lines that occur again, points that no line touches) is counted in an `InputWarning` and
    in ``Net.omissions``.

    Args:
        path: path of the file.
        scale: metres per unit of the file: 1e-3 for millimetres; None takes that of `units`.

    Options:
        tolerance: largest distance of points that become one node, m.
        largest: largest size that is read, bytes.
        units: units of the file, such as "kN, mm", of which coordinates have the length (see
            `Units`); default: SI units. An `InputWarning` asks for them if the net is larger than
            1 km.

    Returns:
        `Net`, without supports and stiffness; add them by
        ``net.scene(anchors, axial_stiffness=...)``.

    Raises:
        FileError: no points or lines, an unknown point, a line without length; the message names
            the line.
        ValueError: a scale or tolerance that is not positive; unknown units, or units beside a
            scale.
        OSError: there is no such file, or it cannot be read.

    Example:
        >>> import tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.obj"
        >>> _ = path.write_text("v 0 0 0\\nv 1000 0 0\\nv 2000 0 0\\nl 1 2 3\\n")
        >>> jc.files.read_obj(path, scale=1e-3).links.tolist()
        [[0, 1], [1, 2]]
    """
    doubtful = scale is None and units is None
    scale = metres_per_drawing_unit(units, scale)
    scale = 1.0 if scale is None else scale
    if not 0 < scale < np.inf or not 0 <= tolerance < np.inf:
        raise ValueError(f"scale = {scale}, tolerance = {tolerance}: expected positive numbers")
    text = read_text(path, largest)
    with Omissions(path) as table:
        points, lines = _parse_points_and_lines(text, table)
        if not points or not lines:
            rows = "".join(f"; {row}" for row in table.rows())
            count = sum(len(line.points) - 1 for line in lines)
            raise FileError(
                f"has {len(points)} points (v) and {count} lines (l): no net{rows:.300}"
            )
        with np.errstate(over="ignore"):
            places = scale * np.array(points)
        net = net_from_polylines(places, lines, tolerance, table, "line")
        groups = net.groups if len(set(net.groups or ())) > 1 else None
        net = dataclasses.replace(net, groups=groups, omissions=table.rows())
    if doubtful:
        warn_if_implausibly_large(net, path)
    return net


def _parse_points_and_lines(text, table):
    """Return the points, [x, y, z] each, and the `Polyline`s in the text of a file: two lists."""
    points, lines, group = [], [], ""
    for number, statement in _read_statements(text):
        words, place = statement.split("#")[0].split(), f"line {number}"
        kind, words = (words[0], words[1:]) if words else ("", [])
        try:
            if kind == "v":
                points.append(_parse_point(words, table, place))
            elif kind in ("l", "f"):
                chain = [_point_index(word, len(points)) for word in words]
                if len(chain) < 2:
                    raise ValueError("a line has at least two points")
                ring = chain[:1] if kind == "f" else []
                lines.append(Polyline(place, group, chain + ring, may_repeat=kind == "f"))
            elif kind in ("g", "o"):
                group = " ".join(words)
            elif kind and kind not in _APPEARANCE:
                table.add(f"statement {kind!r}", place, _FREE_FORM.get(kind, ""))
        except ValueError as error:
            raise FileError(f"{place}: {error}") from None
    return points, lines


def _read_statements(text):
    """Generate pairs (line number, statement); a line that ends with a backslash is continued."""
    first, begun = 0, ""
    for number, line in enumerate(text.splitlines(), 1):
        first = first or number
        if line.rstrip().endswith("\\"):
            begun += line.rstrip()[:-1] + " "
            continue
        yield first, begun + line
        first, begun = 0, ""
    if begun:
        yield first, begun


def _parse_point(words, table, place):
    """Return the coordinates [x, y, z] in the words of a point; ValueError if they are not finite.

    A weight other than 1 after them is added to the omissions `table`; colors are ignored. `place`
    is the line, for the table.
    """
    numbers = [reading.parse_number(word) for word in words]
    if len(numbers) < 3 or not np.isfinite(numbers).all():
        raise ValueError("a point has three finite coordinates")
    if len(numbers) == 4 and numbers[3] != 1.0:
        table.add("weight of a point", place, "rational curves are not read")
    if len(numbers) not in (3, 4, 6, 7):
        table.add("point with more numbers than coordinates and color", place)
    return numbers[:3]


def _point_index(word, count):
    """Return the index, from 0, of a point written as "7", "7/1", or "-1" for the last of `count`.

    Raise ValueError for a number that is none of the `count` points read so far.
    """
    try:
        number = reading.parse_integer(word.split("/")[0])
    except ValueError:
        raise ValueError(f"{word!r} is not the number of a point; they begin at 1") from None
    index = number - 1 if number > 0 else count + number
    if number == 0 or not 0 <= index < count:
        raise ValueError(f"point {number} is not among the {count} before this line")
    return index
