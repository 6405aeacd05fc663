"""A table of a report: the only form in which results go to text, HTML, XLSX, PDF, CSV and JSON."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..common.negligible import NEGLIGIBLE
from ..common.units import SI, Units

_KILO_UNITS = ("N", "N m", "N m2", "J")
# Size from which a report gives all forces (works, bending stiffnesses) in kN (kJ, kN m2). Nets of
# models in the laboratory carry hundreds of newtons, structures tens of kilonewtons; below the
# limit a number has at most four digits before its point.
_KILO = 1e4
# Units whose numbers are compared with those of all tables; others with those of their own.
_FORCES = (*_KILO_UNITS, "Pa")
# Lever, m, at which the largest force of a table makes the least moment that is shown beside it: a
# force of 100 kN in the position of a node that is known to 1e-12 m makes moments of 1e-7 N m.
_LEVER = 1e-3
_SHOWN = 1e-5  # share of the largest number of a unit in a table that its text tells from zero
_MANY = 1e5  # size from which the numbers of a column have one decimal: seven digits
_DECIMALS = {"mm": 2, "cm": 3, "in": 4, "m": 5, "ft": 5, "-": 3}  # of lengths and ratios
_LARGE_FORCES = ("kip", "tf", "MN")  # units of force in which usual forces are small numbers

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
        heading: heading in the text; "" for the name.
        governs: whether the text of a long table shows the rows with the largest values in here.
        detail: whether the text leaves the column out.
        millimeters: whether the text gives the lengths of the column in mm.
    """

    name: str
    unit: str
    values: Sequence[Cell] | np.ndarray
    heading: str = ""
    governs: bool = False
    detail: bool = False
    millimeters: bool = False


def columns_of_rows(
    rows: Sequence[Sequence[Cell]], *heads: str | tuple[str, str] | tuple[str, str, str]
) -> list[Column]:
    """Return the columns of a table given by rows, a list of `Column`.

    `heads` has for each column its name, or a tuple of name and unit, or of name, unit and heading.
    """
    cells = zip(*rows, strict=True) if rows else [()] * len(heads)
    named = [(head, "") if isinstance(head, str) else head for head in heads]
    return [
        Column(name, unit, values, *heading)  # type: ignore[arg-type]  # none or one
        for (name, unit, *heading), values in zip(named, cells, strict=True)
    ]


def make_table(title: str, columns: Sequence[Column], notes: Sequence[str] = ()) -> Table:
    """Return the `Table` of some columns.

    Names of columns that occur again get spaces at their end, so that all names differ.
    """
    names = [column.name for column in columns]
    governing, details, millimeters = (
        tuple(k for k, column in enumerate(columns) if getattr(column, name))
        for name in ("governs", "detail", "millimeters")
    )
    return Table(
        title,
        tuple(name + " " * names[:k].count(name) for k, name in enumerate(names)),
        tuple(column.unit for column in columns),
        [list(row) for row in zip(*(_cell_values(c.values) for c in columns), strict=True)],
        tuple(notes),
        governing if len(governing) > 1 else next(iter(governing), None),
        details,
        tuple(column.heading or column.name for column in columns),
        millimeters,
    )


def _cell_values(values):
    """Return the values of a column, an array or a list, as a list with None for NaN."""
    values = values.tolist() if isinstance(values, np.ndarray) else values
    return [None if isinstance(v, float) and math.isnan(v) else v for v in values]


def _units_of_row(table, row):
    """Return the unit of each cell of a row; a column "unit" may state that of the row."""
    if "unit" not in table.columns:
        return table.units
    own = str(row[table.columns.index("unit")])
    return [own if unit == "" else unit for unit in table.units]


def _convert_numbers(table: Table, convert: Callable[[float, str], float]) -> Table:
    """Return a table with ``convert(value, unit)`` in place of each float."""
    rows = [
        [
            convert(value, unit) if isinstance(value, float) else value
            for value, unit in zip(row, _units_of_row(table, row), strict=True)
        ]
        for row in table.rows
    ]
    return dataclasses.replace(table, rows=rows)


def table_in_units(table: Table, units: Units) -> Table:
    """Return a table in SI units with its numbers and its units converted to other ones."""
    rows = _convert_numbers(table, units.from_si).rows
    if "unit" in table.columns:
        at = table.columns.index("unit")
        rows = [[*row[:at], units.shown(str(row[at])), *row[at + 1 :]] for row in rows]
    return dataclasses.replace(table, units=tuple(map(units.shown, table.units)), rows=rows)


def tables_without_noise(tables: Mapping[str, Table]) -> dict[str, Table]:
    """Return tables in SI units by name, with zero for numbers that are rounding errors.

    A number is zero if it is negligible (`common.negligible`) beside the largest one of its unit:
    forces, moments, works and stresses beside those of all tables and 1 N, N m, J, Pa, and moments
    also beside the largest force at a short lever; lengths and others beside those of their own
    table. Numbers without unit stay.
    """
    sizes = {name: _sizes_by_unit(table) for name, table in tables.items()}
    common = {unit: max([1.0, *(s.get(unit, 0.0) for s in sizes.values())]) for unit in _FORCES}
    common["N m"] = max(common["N m"], _LEVER * common["N"])

    def without_noise(table, largest):
        return _convert_numbers(
            table, lambda v, unit: 0.0 if abs(v) <= NEGLIGIBLE * largest.get(unit, 0) else v
        )

    return {name: without_noise(table, sizes[name] | common) for name, table in tables.items()}


def _sizes_by_unit(table):
    """Return the largest magnitude of the finite floats of a table by unit; not of ratios."""
    sizes: dict[str, float] = {}
    for row in table.rows:
        for unit, value in zip(_units_of_row(table, row), row, strict=True):
            if isinstance(value, float) and math.isfinite(value) and unit not in ("", "-"):
                sizes[unit] = max(sizes.get(unit, 0.0), abs(value))
    return sizes


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


def common_scales(tables: Sequence[Table], units: Units | None = None) -> Scales:
    """Return unit and factor with which texts show numbers of a unit, by unit: {"N": ("kN", 1e-3)}.

    Forces are in kN, and then moments in kN m, if one of either is at least 10 kN (kN m); works and
    bending stiffnesses likewise in kJ and kN m2; stresses are in MPa. Tables in stated `units` keep
    these, but for stresses, which are in MPa, kip/in2, lbf/in2 or kgf/cm2.
    """
    if units is not None:
        name, factor = units.stress
        return {units.name("Pa"): (name, float(factor))}
    sizes = [_sizes_by_unit(table) for table in tables]
    largest = {u: max((own.get(u, 0.0) for own in sizes), default=0.0) for u in _KILO_UNITS}
    largest["N"] = largest["N m"] = max(largest["N"], largest["N m"])
    scales = {unit: (f"k{unit}", 1e-3) for unit, size in largest.items() if size >= _KILO}
    return {**scales, "Pa": ("MPa", 1e-6)}


class ShownTable(NamedTuple):
    """A table as texts, for a text file or a page: the result of `show_table`.

    Attributes:
        title: title in words.
        headings, units: of the columns that are shown: neither details nor empty.
        is_numeric: whether each column has numbers, which are put to the right.
        rows: texts of the cells, row by row.
        notes: notes, with one on rows that are left out.
    """

    title: str
    headings: list[str]
    units: list[str]
    is_numeric: list[bool]
    rows: list[list[str]]
    notes: list[str]


def show_table(
    table: Table, most: int | None, scales: Scales, units_of_table: Units = SI
) -> ShownTable:
    """Return a table as texts, with at most `most` rows (None: with all).

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
    sizes, names = _sizes_by_unit(table), table.headings or [name.strip() for name in table.columns]
    columns: list[tuple[Any, ...]] = []
    for k, own in enumerate(table.units):
        unit, factor = scales.get(own, (own, 1.0))
        if k in table.millimeters:
            unit, factor = units_of_table.small_length[0], float(units_of_table.small_length[1])
        largest = factor * sizes.get(own, 0.0)
        numbers = [abs(v) for v in (row[k] for row in table.rows) if own and isinstance(v, float)]
        is_large = factor * max(numbers, default=0.0) >= _MANY
        texts = [_cell_text(row[k], factor, unit, largest, is_large) for row in rows]
        if k not in table.details and any(texts):
            is_number = all(isinstance(row[k], int | float | None) for row in table.rows)
            columns.append((names[k], unit, is_number, texts))
    headings, units, is_numeric, texts = ([c[k] for c in columns] for k in range(4))
    cells = [list(row) for row in zip(*texts, strict=True)]
    return ShownTable(table.title, headings, units, is_numeric, cells, notes)


def _governing_size(table, row):
    """Return the largest absolute value of a row in the columns `table.governing`, seven digits.

    Equal values stay in their order, whatever their rounding errors.
    """
    columns = table.governing if isinstance(table.governing, tuple) else (table.governing,)
    return float(f"{max(abs(row[k] or 0.0) for k in columns):.6e}")


def _cell_text(value, factor, unit, largest, is_large):
    """Return the text of a cell, with the decimals of its unit.

    Args:
        value: number, text, or None for an empty cell.
        factor: factor from the number to the unit of the text.
        unit: unit of the text.
        largest: magnitude of the largest number of its unit in the table, in the unit of the text.
        is_large: whether a number of the column is `_MANY` or more: all have one decimal then.
    """
    if value is None:
        return ""
    if not isinstance(value, float):
        return str(value)
    value *= factor
    digits = _DECIMALS.get(unit, 3)
    if unit not in _DECIMALS:
        if is_large or abs(value) >= _MANY:
            return f"{round(value, 1) + 0.0:.1f}"
        if unit.startswith(_LARGE_FORCES) and abs(value) < 1.0:
            return f"{0.0 if abs(value) < _SHOWN * largest else value:.4g}"
        if value != 0.0 and abs(value) < 1e-3 and largest < 0.1:
            return f"{value:.4g}"
    return f"{round(value, digits) + 0.0:.{digits}f}"  # no "-0.00"
