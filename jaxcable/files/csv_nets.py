"""Read nets from a pair of CSV tables: nodes and links."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike

import numpy as np

from ..common.units import UnitsLike, as_units
from .csv_tables import read_table, require_same_decimal_mark
from .net_units import net_in_si_or_warn
from .nets import ELEMENT_CLASSES, GROUP_PROPERTIES, PRESTRESS_INPUTS, Net
from .omissions import Omissions
from .reading import LARGEST, FileError

_NODE_COLUMNS = ("node", "x", "y", "z", "support", "free", "fx", "fy", "fz")
_LINK_COLUMNS = ("first", "last", "kind", "group", *GROUP_PROPERTIES, *PRESTRESS_INPUTS)
_WORDS = {"1": True, "1.0": True, "true": True, "yes": True, "": False}
_WORDS |= {"0": False, "0.0": False, "false": False, "no": False}
"""What a flag may be, beside the letters of directions."""


def read_csv(
    nodes: str | PathLike[str],
    links: str | PathLike[str],
    largest: int = LARGEST,
    *,
    columns: Mapping[str, str] | None = None,
    units: UnitsLike | None = None,
) -> Net:
    """Read a net from two CSV tables, whose first lines name their columns.

    - nodes: ``x, y, z``; optional ``node`` (a name; default the number of the node, from 0),
      ``support`` (0, 1, or the held directions, as ``xz``) or ``free`` (the same, of what is not
      held), ``fx, fy, fz`` (loads, N).
    - links: ``first, last`` (names of nodes); optional ``kind`` (cable or bar), ``group``,
      ``axial_stiffness``, ``rest_length``, ``weight``, ``strength``, ``expansion``, ``pretension``,
      ``force_density``, ``prestrain``.

    Fields are separated by commas, semicolons or tabs. Numbers may have decimal commas where fields
    are separated otherwise, and no number of the file has a point; both files have the same mark.
    An empty field means no value;
    lines that start with # are skipped. A column with another name is refused, unless `columns` is
    given.

    Args:
        nodes, links: paths of the two files.
        largest: largest size that is read of each file, bytes.

    Options:
        columns: names in the files of columns above, for tables of other programs, such as
            ``{"x": "X_COORD", "support": "Fixed"}``, or ``{"free": "Fixity"}`` for a program that
            writes 1 where a node is free. Columns that are neither named so nor above are then left
            out, and counted in an `InputWarning` and in ``Net.omissions``.
        units: units of all numbers in both files, such as "kN, m" (see `Units`); default: SI
            units. An `InputWarning` asks for them if the net is larger than 1 km.

    Returns:
        `Net`, in SI units; ``net.scene()`` makes a scene of it.

    Raises:
        FileError: wrong contents; the message names the file, the line and the column.
        ValueError: `columns` names a column that is not above; unknown units.
        OSError: there is no such file, or it cannot be read.

    Example:
        >>> import tempfile, pathlib
        >>> folder = pathlib.Path(tempfile.mkdtemp())
        >>> _ = (folder / "n.csv").write_text("node,x,y,z,Fixed\\nA,0,0,0,1\\nB,1,0,0,1\\n")
        >>> _ = (folder / "l.csv").write_text("first,last,axial_stiffness\\nA,B,1e5\\n")
        >>> columns = {"support": "Fixed"}
        >>> net = jc.files.read_csv(folder / "n.csv", folder / "l.csv", columns=columns)
        >>> net.links.tolist(), net.fixed.all(axis=1).tolist()
        ([[0, 1]], [True, True])
    """
    own = _column_aliases(columns)
    shown = None if units is None else as_units(units)
    table = Omissions(f"{nodes}, {links}")
    lines = read_table(nodes, _NODE_COLUMNS, ("x", "y", "z"), own, table, largest)
    names, places, fixed, loads = {}, [], [], []
    for line in lines:
        name = line.text("node") or str(len(names))
        if name in names:
            raise FileError(f"{line.place}: node {name!r} occurs twice")
        names[name] = len(names)
        places.append([line.number(axis) for axis in "xyz"])
        fixed.append(_is_held_by_direction(line))
        loads.append([line.number("f" + axis, 0.0) for axis in "xyz"])
    pairs, kinds, groups, values = [], [], [], {}
    known = (*GROUP_PROPERTIES, *PRESTRESS_INPUTS)
    rows = read_table(links, _LINK_COLUMNS, ("first", "last"), own, table, largest)
    require_same_decimal_mark(lines, rows)
    for line in rows:
        for column in ("first", "last"):
            if line.text(column) not in names:
                raise FileError(f"{line.place}: {column}: no node {line.text(column)!r}")
        pairs.append([names[line.text("first")], names[line.text("last")]])
        kinds.append(line.text("kind") or "cable")
        if kinds[-1] not in ELEMENT_CLASSES:
            raise FileError(f"{line.place}: kind: {kinds[-1]!r} is neither cable nor bar")
        groups.append(line.text("group"))
        for column in known:
            if column in line.fields:
                values.setdefault(column, []).append(line.number(column, np.nan))
    forces = np.array(loads)
    table.warn()
    net = Net(
        nodes=np.array(places),
        links=np.array(pairs, np.int32),
        fixed=np.array(fixed),
        loads=forces if forces.any() else None,
        values={name: np.array(v) for name, v in values.items() if not np.isnan(v).all()},
        kinds=tuple(kinds),
        groups=tuple(groups) if any(groups) else None,
        names=tuple(names),
        omissions=table.rows(),
    )
    return net_in_si_or_warn(net, nodes, shown)


def _column_aliases(columns):
    """Return a dict from the file's column names, in lower case, to those that `read_csv` knows.

    `columns` has the file's names by known ones; None gives None. Raise ValueError for an unknown
    column, or a name that occurs twice.
    """
    if columns is None:
        return None
    known = (*_NODE_COLUMNS, *_LINK_COLUMNS)
    for name in columns:
        if name not in known:
            raise ValueError(f"columns: no column {name!r}; known are {', '.join(known)}")
    words = [word.strip().lower() for word in columns.values()]
    for word in words:
        if words.count(word) > 1:
            raise ValueError(f"columns: {word!r} is named twice")
    return dict(zip(words, columns, strict=True))


def _is_held_by_direction(line):
    """Return whether x, y and z of a node are held, three bools, by its ``support`` or ``free``.

    `line` is the `TableRow` of the node. Raise FileError if both fields are given, or a field
    cannot be read.
    """
    if "free" not in line.fields:
        return _is_direction_named(line, "support")
    if line.text("support"):
        raise FileError(f"{line.place}: has both support and free; give one")
    if not line.text("free"):
        raise FileError(f"{line.place}: free: is empty; expected 0, 1 or some of xyz")
    return [not free for free in _is_direction_named(line, "free")]


def _is_direction_named(line, column):
    """Return whether a field of a `TableRow` (0, 1 or "xz") names x, y and z, three bools."""
    word = line.text(column).lower()
    if word in _WORDS:
        return [_WORDS[word]] * 3
    if set(word) <= set("xyz"):
        return [axis in word for axis in "xyz"]
    raise FileError(f"{line.place}: {column}: {line.text(column)!r}: expected 0, 1 or some of xyz")
