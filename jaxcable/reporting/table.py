"""A table of a report, and its layout as text."""

from __future__ import annotations

import dataclasses
import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from ..common.negligible import NEGLIGIBLE
from ..common.units import SI, Units

_KILO_UNITS = ("N", "N m", "N m2", "J")
_KILO = 1e4
"""Size from which a report gives all forces (works, bending stiffnesses) in kN (kJ, kN m2).

Nets of models in the laboratory carry hundreds of newtons, structures tens of kilonewtons; below
the limit a number has at most four digits before its point.
"""
_WIDTH = 110  # columns of notes, as of the widest table; a landscape page has 120 of 9 points
_WIDEST_CELL = 60  # characters of a cell, beyond which it goes on in the next line
_OVERHANG = 4  # characters by which a heading may be wider than the values below it
_SHARED = 4
"""Number of columns from which a unit that all of them have is in the title, not in each heading.

Two or three units make no line too long; section forces have seven."""
_FORCES = (*_KILO_UNITS, "Pa")
"""Units whose numbers are compared with those of all tables; others with those of their own."""
_LEVER = 1e-3
"""Lever, m, at which the largest force of a table makes the least moment that is shown beside it.

A force of 100 kN in the position of a node that is known to 1e-12 m makes moments of 1e-7 N m.
"""

_SHOWN = 1e-5
"""Share of the largest number of a unit in a table that its text still tells from zero."""
_MANY = 1e5  # size from which a number has one decimal: seven digits
_DECIMALS = {"mm": 2, "cm": 3, "in": 4}
"""Decimals of small lengths."""

Cell: TypeAlias = int | float | str | None
Scales: TypeAlias = Mapping[str, tuple[str, float]]
"""Unit and factor with which a text gives numbers of a unit, by unit: ``{"N": ("kN", 1e-3)}``."""


@dataclasses.dataclass(frozen=True)
class Table:
    """A table: title, columns with units, rows, and notes.

    Attributes:
        title: title in words.
        columns: name of each column, as in CSV and JSON; spaces after a name tell it from the same
            name before it.
        units: unit of each column, "" for none; forces are in "N" and lengths in "m", unless
            `report` was asked for other units.
        rows: rows of the table, lists of numbers and texts; None where there is no value.
        notes: sentences on the table.
        governing: index of the column whose largest values the text shows if the table is long, or
            indices of such columns.
        details: indices of the columns that the text leaves out.
        headings: heading of each column in the text; None for the names.
        millimeters: indices of the columns of lengths that the text gives in mm.

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
    headings: tuple[str, ...] | None = None
    millimeters: tuple[int, ...] = ()


class Column(NamedTuple):
    """A column of a table, from which `make_table` makes a `Table`.

    Attributes:
        name: name in CSV and JSON; columns may have the same.
        unit: "" for none, "-" for ratios; forces are in "N" and lengths in "m".
        values: numbers or texts, an array or a list; NaN and None where there is no value.
        governs: whether the text of a long table shows the rows with the largest values in here.
        detail: whether the text leaves the column out.
        heading: heading in the text; "" for the name.
        millimeters: whether the text gives the lengths of the column in mm.
    """

    name: str
    unit: str
    values: Sequence[Cell] | np.ndarray
    governs: bool = False
    detail: bool = False
    heading: str = ""
    millimeters: bool = False


def make_table(title: str, columns: Sequence[Column], notes: Sequence[str] = ()) -> Table:
    """Return the `Table` of some columns.

    Names of columns that occur again get spaces at their end, so that all names differ.
    """
    names = [column.name for column in columns]
    governing = tuple(k for k, column in enumerate(columns) if column.governs)
    return Table(
        title,
        tuple(name + " " * names[:k].count(name) for k, name in enumerate(names)),
        tuple(column.unit for column in columns),
        [list(row) for row in zip(*(_cell_values(c.values) for c in columns), strict=True)],
        tuple(notes),
        governing if len(governing) > 1 else next(iter(governing), None),
        tuple(k for k, column in enumerate(columns) if column.detail),
        tuple(column.heading or column.name for column in columns),
        tuple(k for k, column in enumerate(columns) if column.millimeters),
    )


def _cell_values(values):
    """Return the values of a column as a list, with None for NaN."""
    values = values.tolist() if isinstance(values, np.ndarray) else values
    return [None if isinstance(v, float) and math.isnan(v) else v for v in values]


def table_in_units(table: Table, units: Units) -> Table:
    """Return a table in SI units with its numbers and its units converted to other ones."""
    at = table.columns.index("unit") if "unit" in table.columns else None
    rows = []
    for row in table.rows:
        cells = [
            units.from_si(value, unit) if isinstance(value, float) else value
            for value, unit in zip(row, _units_of_row(table, row), strict=True)
        ]
        if at is not None:
            cells[at] = units.shown(str(row[at]))
        rows.append(cells)
    names = tuple(units.shown(unit) for unit in table.units)
    return dataclasses.replace(table, units=names, rows=rows)


def tables_without_noise(tables: Mapping[str, Table]) -> dict[str, Table]:
    """Return tables in SI units by name, with zero for numbers that are rounding errors.

    A number is zero if it is negligible (`common.negligible`) beside the largest one of its unit:
    forces, moments, works and stresses beside those of all tables and 1 N, N m, J, Pa, and moments
    also beside the largest force at a short lever; lengths and others beside those of their own
    table. Numbers without unit stay.
    """
    cells = {name: _sizes_by_unit(table) for name, table in tables.items()}
    largest = {unit: max([1.0, *(s.get(unit, 0.0) for s in cells.values())]) for unit in _FORCES}
    largest["N m"] = max(largest["N m"], _LEVER * largest["N"])
    return {
        name: dataclasses.replace(table, rows=_rows_without_noise(table, cells[name] | largest))
        for name, table in tables.items()
    }


def _units_of_row(table, row):
    """Return the unit of each cell of a row; a column may name that of the row."""
    if "unit" not in table.columns:
        return table.units
    own = str(row[table.columns.index("unit")])
    return [own if unit == "" else unit for unit in table.units]


def _sizes_by_unit(table):
    """Return the largest size of the finite numbers of each unit of a table, a dict; no ratios."""
    sizes: dict[str, float] = {}
    for row in table.rows:
        for unit, value in zip(_units_of_row(table, row), row, strict=True):
            if isinstance(value, float) and math.isfinite(value) and unit not in ("", "-"):
                sizes[unit] = max(sizes.get(unit, 0.0), abs(value))
    return sizes


def _rows_without_noise(table, most):
    """Return the rows of a table, with zero for numbers negligible beside `most`, by unit."""
    return [
        [
            0.0
            if isinstance(value, float) and abs(value) <= NEGLIGIBLE * most.get(unit, 0)
            else value
            for unit, value in zip(_units_of_row(table, row), row, strict=True)
        ]
        for row in table.rows
    ]


def csv_header(table: Table) -> list[str]:
    """Return the names of the columns with their units, the first line of a CSV table, a list.

    A name that occurs several times follows the column that it belongs to: "lowest in".
    """
    names = [column.strip() for column in table.columns]
    header, owner = [], ""
    for name, unit in zip(names, table.units, strict=True):
        if names.count(name) == 1:
            owner = name
        else:
            name = f"{owner} {name}".strip()
        header.append(f"{name} ({unit})" if unit else name)
    return header


def finite_or_none(value: Cell) -> Cell:
    """Return a value for JSON: None for a number that is not finite, others as they are."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def common_scales(tables: Sequence[Table], units: Units | None = None) -> Scales:
    """Return the unit and the factor with which texts show numbers of a unit: a dict by unit.

    Forces are in kN, and then moments in kN m, if one of either is at least 10 kN (kN m); works
    and bending stiffnesses likewise in kJ and kN m2; stresses are in MPa. An example is
    ``{"N": ("kN", 1e-3)}``. Tables in stated `units` keep these, but for stresses, which are in
    MPa, kip/in2, lbf/in2 or kgf/cm2.
    """
    if units is not None:
        name, factor = units.stress
        return {units.name("Pa"): (name, float(factor))}
    largest = {
        unit: max((sizes.get(unit, 0.0) for sizes in map(_sizes_by_unit, tables)), default=0.0)
        for unit in _KILO_UNITS
    }
    largest["N"] = largest["N m"] = max(largest["N"], largest["N m"])
    scales = {unit: (f"k{unit}", 1e-3) for unit, size in largest.items() if size >= _KILO}
    return {**scales, "Pa": ("MPa", 1e-6)}


class TableTexts(NamedTuple):
    """Cells of a table as a text shows them: result of `table_texts`.

    Attributes:
        units: unit of every column, as shown.
        texts: texts of the cells, for every column a list.
        shown: indices of the columns to show: neither details nor empty.
        notes: notes, with one on rows that are left out.
    """

    units: list[str]
    texts: list[list[str]]
    shown: list[int]
    notes: list[str]


def table_texts(
    table: Table, most: int | None, scales: Scales, units_of_table: Units = SI
) -> TableTexts:
    """Return the cells of a table as texts, of at most `most` rows (None: of all).

    These are the rows with the largest values in the columns `table.governing`, or else the first
    ones. `scales` are the shown units and factors, as of `common_scales`.
    """
    rows, notes = table.rows, list(table.notes)
    if most is not None and len(rows) > most:
        if table.governing is not None:
            rows = sorted(rows, key=lambda row: -_governing_size(table, row))
        rows = rows[:most]
        which = "largest" if table.governing is not None else "first"
        notes.append(f"the {which} {most} of {len(table.rows)} rows; files have all rows")
    scaled = [scales.get(unit, (unit, 1.0)) for unit in table.units]
    for k in table.millimeters:
        small, factor = units_of_table.small_length
        scaled[k] = (small, float(factor))
    largest = _sizes_by_unit(table)
    columns = zip(*rows, strict=True)  # none without rows
    texts = [
        [_cell_text(value, factor, unit, factor * largest.get(own, 0.0)) for value in column]
        for column, (unit, factor), own in zip(columns, scaled, table.units, strict=False)
    ]
    shown = [k for k, column in enumerate(texts) if any(column) and k not in table.details]
    return TableTexts([unit for unit, _ in scaled], texts, shown, notes)


def table_text(table: Table, most: int | None, scales: Scales, units_of_table: Units = SI) -> str:
    """Return a table as text of at most `most` rows; arguments as of `table_texts`."""
    units, texts, shown, notes = table_texts(table, most, scales, units_of_table)
    title, headings = _title_and_headings(table, units)
    widths = [min(max(map(len, texts[k])), _WIDEST_CELL) for k in shown]
    wrapped = _wrap_headings([headings[k] for k in shown], widths)
    height = max(map(len, wrapped), default=0)
    padded = []
    folded = [[textwrap.wrap(text, _WIDEST_CELL) or [""] for text in texts[k]] for k in shown]
    heights = [max(map(len, row)) for row in zip(*folded, strict=True)]
    for heading, cells in zip(wrapped, folded, strict=True):
        lines = [*[""] * (height - len(heading)), *heading]
        for cell, lines_of_row in zip(cells, heights, strict=True):
            lines += [*cell, *[""] * (lines_of_row - len(cell))]
        width = max(map(len, lines))
        padded.append([line.rjust(width) for line in lines])
    lines = ["  ".join(["", *line]).rstrip() for line in zip(*padded, strict=True)]
    wrapped_notes = [
        line
        for note in notes
        for line in textwrap.wrap(note, _WIDTH, initial_indent="  ", subsequent_indent="    ")
    ]
    return "\n".join([title, *lines, *wrapped_notes])


def _wrap_headings(headings, widths):
    """Break headings into lines that suit the widths of their columns: a list of lines for each.

    If one is wider than the values of its column, all break before their units; names break if
    they are too wide.
    """
    if all(len(heading) <= width for heading, width in zip(headings, widths, strict=True)):
        return [[heading] for heading in headings]
    wrapped = []
    for heading, width in zip(headings, widths, strict=True):
        name, _, unit = heading.rpartition(" (")
        if name:
            lines = _break_heading_in_two(name) if len(name) > width + _OVERHANG else [name]
            wrapped.append([*lines, f"({unit}"])
        else:
            wrapped.append(_break_heading_in_two(heading) if len(heading) > width else [heading])
    return wrapped


def _break_heading_in_two(heading):
    """Break a heading of several words into two lines, the longer as short as possible; a list."""
    words = heading.split()
    breaks = [[" ".join(words[:k]), " ".join(words[k:])] for k in range(1, len(words))]
    return min(breaks, key=lambda lines: max(map(len, lines)), default=[heading])


def _governing_size(table, row):
    """Return the largest absolute value of a row in the columns `table.governing`."""
    columns = table.governing if isinstance(table.governing, tuple) else (table.governing,)
    return max(abs(row[k] or 0.0) for k in columns)


def _title_and_headings(table, units):
    """Return title and headings with the units; a unit that many columns share is in the title."""
    named = {unit for unit in units if unit not in ("", "-")}
    shared = len(named) == 1 and sum(unit in named for unit in units) >= _SHARED
    left = ("", "-", *named) if shared else ("", "-")
    names = table.headings or [name.strip() for name in table.columns]
    headings = [
        name if unit in left else f"{name} ({unit})"
        for name, unit in zip(names, units, strict=True)
    ]
    return (f"{table.title} ({named.pop()})" if shared else table.title), headings


_LARGE_FORCES = ("kip", "tf", "MN")
"""Units of force in which usual forces are small numbers."""


def _cell_text(value, factor, unit, largest):
    """Return the text of a cell.

    Args:
        value: number, text, or None for an empty cell.
        factor: factor from the number to the unit of the text.
        unit: unit of the text.
        largest: size of the largest number of its unit in the table, in the unit of the text.
    """
    if value is None:
        return ""
    if not isinstance(value, float):
        return str(value)
    if unit in ("m", "ft"):
        return f"{value:.5f}"
    if unit in _DECIMALS:
        digits = _DECIMALS[unit]
        return f"{round(value * factor, digits) + 0.0:.{digits}f}"  # no "-0.00"
    if unit == "-":
        return f"{value:.3f}"
    value *= factor
    if abs(value) >= _MANY:
        return f"{value:.1f}"
    if unit.startswith(_LARGE_FORCES) and abs(value) < 1.0:
        value = 0.0 if abs(value) < _SHOWN * largest else value
        return f"{value:.4g}"
    if value != 0.0 and abs(value) < 1e-3 and largest < 0.1:
        return f"{value:.4g}"
    return f"{round(value, 3) + 0.0:.3f}"
