"""A table of a report, and its layout as text."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

_SCALED = ("N", "N m", "J")
_SHARED = 4  # columns from which a unit that all of them have is said in the title
_NOTHING = 1e-9  # of the largest number with the same unit, or of 1 N, J, Pa: less is rounding
_LEVER = 1e-3  # m; at it the largest force makes the least moment that counts beside it

Cell: TypeAlias = int | float | str | None


@dataclasses.dataclass(frozen=True)
class Table:
    """A table: title, columns with units, lines, and notes.

    Attributes:
        title: title in words.
        columns: name of each column.
        units: unit of each column, "" for none; forces are in "N" and lengths in "m".
        rows: lines of the table, lists of numbers and texts; None where there is no value.
        notes: sentences on the table.
        governing: number of the column whose largest values the text shows if the table is long, or
            numbers of such columns.
        details: numbers of the columns that the text leaves out.

    Example:
        >>> table = jc.reporting.Table("Loads", ("node", "F"), ("", "N"), [[3, -15.0]])
        >>> table.rows[0]
        [3, -15.0]
    """

    title: str
    columns: tuple[str, ...]
    units: tuple[str, ...]
    rows: list[list[Cell]]
    notes: tuple[str, ...] = ()
    governing: int | tuple[int, ...] | None = None
    details: tuple[int, ...] = ()


class Column(NamedTuple):
    """A column of a table.

    Attributes:
        name: in words; columns may have the same.
        unit: "" for none, "-" for shares; forces are in "N" and lengths in "m".
        values: numbers or texts, an array or a list; NaN and None where there is no value.
        governs: whether the text of a long table shows the lines with its largest values.
        detail: whether the text leaves it out.
    """

    name: str
    unit: str
    values: Sequence[Cell] | np.ndarray
    governs: bool = False
    detail: bool = False


def tabled(title: str, columns: Sequence[Column], notes: Sequence[str] = ()) -> Table:
    """A table from its columns; spaces after a name tell it from the same name before it."""
    names = [column.name for column in columns]
    governing = tuple(k for k, column in enumerate(columns) if column.governs)
    return Table(
        title,
        tuple(name + " " * names[:k].count(name) for k, name in enumerate(names)),
        tuple(column.unit for column in columns),
        [list(row) for row in zip(*(_cells(c.values) for c in columns), strict=True)],
        tuple(notes),
        governing if len(governing) > 1 else next(iter(governing), None),
        tuple(k for k, column in enumerate(columns) if column.detail),
    )


def _cells(values):
    """The values of a column as cells, None for NaN."""
    values = values.tolist() if isinstance(values, np.ndarray) else values
    return [None if isinstance(v, float) and math.isnan(v) else v for v in values]


def headed(table: Table) -> list[str]:
    """The header of a table: names of columns with their units, a list.

    A name that occurs several times follows the column that it belongs to: "lowest in".
    """
    names = [column.strip() for column in table.columns]
    found, owner = [], ""
    for name, unit in zip(names, table.units, strict=True):
        if names.count(name) == 1:
            owner = name
        else:
            name = f"{owner} {name}".strip()
        found.append(f"{name} ({unit})" if unit else name)
    return found


def finite(value: Cell) -> Cell:
    """A value for JSON: None for a number that is not finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def as_text(table, most):
    """A table as text of at most `most` lines; large forces and works in kN and kJ, Pa in MPa."""
    rows, notes = table.rows, list(table.notes)
    if len(rows) > most:
        if table.governing is not None:
            rows = sorted(rows, key=lambda row: -_governing(table, row))
        rows = rows[:most]
        which = "the largest" if table.governing is not None else "the first"
        notes.append(f"{which} {most} of {len(table.rows)}; the tables have all")
    scales = {unit: ("k", 1e-3) for unit in _SCALED if _largest(table, rows, unit) >= 1e4}
    scales["Pa"] = ("M", 1e-6)
    prefixes, factors = zip(*(scales.get(unit, ("", 1.0)) for unit in table.units), strict=True)
    units = [prefix + unit for prefix, unit in zip(prefixes, table.units, strict=True)]
    title, heads = _headings(table, units)
    sizes = {unit: _largest(table, table.rows, unit) for unit in (*_SCALED, "Pa")}
    least = {unit: _NOTHING * max(size, 1.0) for unit, size in sizes.items()}
    least["N m"] = max(least["N m"], _LEVER * least["N"])
    texts = [
        [_cell(value, factor, unit, least.get(unit, 0.0)) for value in column]
        for column, factor, unit in zip(zip(*rows, strict=True), factors, table.units, strict=False)
    ]  # none without rows
    shown = [k for k, column in enumerate(texts) if any(column) and k not in table.details]
    padded = []
    for k in shown:
        width = max(map(len, [heads[k], *texts[k]]))
        padded.append([text.rjust(width) for text in (heads[k], *texts[k])])
    lines = ["  ".join(["", *line]) for line in zip(*padded, strict=True)]
    return "\n".join([title, *lines, *(f"  {note}" for note in notes)])


def _governing(table, row):
    """Size of the largest value of a row in the columns that govern."""
    columns = table.governing if isinstance(table.governing, tuple) else (table.governing,)
    return max(abs(row[k] or 0.0) for k in columns)


def _headings(table, units):
    """Title and names of columns with their units; one that many columns share is in the title."""
    named = {unit for unit in units if unit not in ("", "-")}
    shared = len(named) == 1 and sum(unit in named for unit in units) >= _SHARED
    left = ("", "-", *named) if shared else ("",)
    heads = [
        c.strip() if u in left else f"{c.strip()} ({u})"
        for c, u in zip(table.columns, units, strict=True)
    ]
    return (f"{table.title} ({named.pop()})" if shared else table.title), heads


def _largest(table, rows, unit):
    """Largest absolute number in the columns of a unit."""
    columns = [k for k, other in enumerate(table.units) if other == unit]
    sizes = [abs(row[k]) for row in rows for k in columns if row[k] is not None]
    return max(sizes, default=0.0)


def _cell(value, factor, unit, least):
    """The text of a cell; a number below `least` is rounding and becomes zero."""
    if value is None:
        return ""
    if not isinstance(value, float):
        return str(value)
    if unit == "m":
        return f"{value:.5f}"
    if unit == "-":
        return f"{value:.3f}"
    value = 0.0 if abs(value) < least else value * factor
    return f"{value:.3f}" if abs(value) >= 1e-3 or value == 0 else f"{value:.1e}"
