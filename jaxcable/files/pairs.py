"""Nets from a pair of CSV tables: nodes and links."""

from __future__ import annotations

import csv
import io
from os import PathLike

import numpy as np

from . import reading
from .nets import KINDS, PROPERTIES, STATEMENTS, Net
from .reading import LARGEST, FileError, read_text

_NODE_COLUMNS = ("node", "x", "y", "z", "support", "fx", "fy", "fz")
_LINK_COLUMNS = ("first", "last", "kind", "group", *PROPERTIES, *STATEMENTS)


def read_csv(nodes: str | PathLike[str], links: str | PathLike[str], largest: int = LARGEST) -> Net:
    """Read a net from two CSV tables, whose first lines name their columns; SI units.

    - nodes: ``x, y, z``; optional ``node`` (a name; default the number of the node, from 0),
      ``support`` (0, 1, or the held directions, as ``xz``), ``fx, fy, fz`` (loads, N).
    - links: ``first, last`` (names of nodes); optional ``kind`` (cable or bar), ``group``,
      ``axial_stiffness``, ``rest_length``, ``weight``, ``strength``, ``expansion``, ``pretension``,
      ``force_density``, ``prestrain``.

    Fields are separated by commas or semicolons; an empty field means no value; lines that start
    with # are skipped. A column with another name is refused, so that nothing is lost silently.

    Args:
        nodes, links: paths of the two files.
        largest: largest size that is read of each file, bytes.

    Returns:
        `Net`; ``net.scene()`` makes a scene of it.

    Raises:
        FileError: wrong contents; the message names the file, the line and the column.
        OSError: there is no such file, or it cannot be read.

    Example:
        >>> import tempfile, pathlib
        >>> folder = pathlib.Path(tempfile.mkdtemp())
        >>> _ = (folder / "n.csv").write_text("node,x,y,z,support\\nA,0,0,0,1\\nB,1,0,0,1\\n")
        >>> _ = (folder / "l.csv").write_text("first,last,axial_stiffness\\nA,B,1e5\\n")
        >>> jc.files.read_csv(folder / "n.csv", folder / "l.csv").links.tolist()
        [[0, 1]]
    """
    lines = _rows(nodes, _NODE_COLUMNS, ("x", "y", "z"), largest)
    names, places, fixed, loads = {}, [], [], []
    for line, fields in lines:
        name = fields.get("node") or str(len(names))
        if name in names:
            raise FileError(f"{nodes}: line {line}: node {name!r} occurs twice")
        names[name] = len(names)
        places.append([_number(nodes, line, fields, axis) for axis in "xyz"])
        fixed.append(_held(nodes, line, fields.get("support", "")))
        loads.append([_number(nodes, line, fields, "f" + axis, 0.0) for axis in "xyz"])
    pairs, kinds, groups, values = [], [], [], {}
    known = (*PROPERTIES, *STATEMENTS)
    for line, fields in _rows(links, _LINK_COLUMNS, ("first", "last"), largest):
        for column in ("first", "last"):
            if fields[column] not in names:
                raise FileError(f"{links}: line {line}: {column}: no node {fields[column]!r}")
        pairs.append([names[fields["first"]], names[fields["last"]]])
        kinds.append(fields.get("kind") or "cable")
        if kinds[-1] not in KINDS:
            raise FileError(f"{links}: line {line}: kind: {kinds[-1]!r} is neither cable nor bar")
        groups.append(fields.get("group", ""))
        for column in known:
            if column in fields:
                value = _number(links, line, fields, column, np.nan)
                values.setdefault(column, []).append(value)
    forces = np.array(loads)
    return Net(
        nodes=np.array(places),
        links=np.array(pairs, np.int32),
        fixed=np.array(fixed),
        loads=forces if forces.any() else None,
        values={name: np.array(v) for name, v in values.items() if not np.isnan(v).all()},
        kinds=tuple(kinds),
        groups=tuple(groups) if any(groups) else None,
        names=tuple(names),
    )


def _rows(path, known, needed, largest):
    """The lines of a table after its header: pairs (line number, dict from column to text)."""
    text = read_text(path, largest)
    lines = [
        (k, line)
        for k, line in enumerate(io.StringIO(text, newline=None), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise FileError(f"{path}: is empty")
    comma = ";" if ";" in lines[0][1] else ","
    try:
        header, *records = csv.reader([line for _, line in lines], delimiter=comma, strict=True)
    except csv.Error as error:
        raise FileError(f"{path}: no table: {error}") from None
    header = [word.strip().lower() for word in header]
    for word in header:
        if word not in known:
            raise FileError(
                f"{path}: line {lines[0][0]}: unknown column {word!r}; known are {known}"
            )
        if header.count(word) > 1:
            raise FileError(f"{path}: line {lines[0][0]}: column {word!r} occurs twice")
    for word in needed:
        if word not in header:
            raise FileError(f"{path}: line {lines[0][0]}: column {word!r} is missing")
    if not records:
        raise FileError(f"{path}: has no rows")
    found = []
    if len(records) != len(lines) - 1:
        raise FileError(f"{path}: a field with a line break; quotes are not closed")
    for (line, _), record in zip(lines[1:], records, strict=True):
        if len(record) != len(header):
            raise FileError(
                f"{path}: line {line}: {len(record)} fields, the header has {len(header)}"
            )
        found.append((line, dict(zip(header, map(str.strip, record), strict=True))))
    return found


def _number(path, line, fields, column, absent=None):
    """The number in a column of a line; `absent`, unless it is None, for an empty field."""
    word = fields.get(column, "")
    if not word and absent is not None:
        return absent
    try:
        value = reading.number(word)
    except ValueError as error:
        raise FileError(f"{path}: line {line}: {column}: {error}") from None
    if not np.isfinite(value):
        raise FileError(f"{path}: line {line}: {column}: {word!r} is not finite")
    return value


def _held(path, line, word):
    """Which of x, y, z the field `support` holds, a list of three bools."""
    if word in ("", "0"):
        return [False] * 3
    if word == "1":
        return [True] * 3
    if set(word) <= set("xyz"):
        return [axis in word for axis in "xyz"]
    raise FileError(f"{path}: line {line}: support: {word!r}: expected 0, 1 or some of xyz")
