"""Tables with a unit in the name of each column: CSV files of the package, and files of users.

Values become SI here and nowhere else. The files of the package are read when they are first asked
for.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from importlib import resources
from os import PathLike
from pathlib import Path

from ..files.csv_tables import TableRow, read_table
from ..files.omissions import Omissions
from ..files.reading import LARGEST, FileError, read_json

UNITS = {
    "mm": 1e-3,
    "mm2": 1e-6,
    "cm2": 1e-4,
    "cm3": 1e-6,
    "cm4": 1e-8,
    "kg_per_m": 1.0,
    "gpa": 1e9,
    "mn": 1e6,
    "kn": 1e3,
    "1e-6_per_k": 1e-6,
}
"""Factors to SI units of what a name of a column ends with, in small letters."""

PROFILE_COLUMNS = (
    *("name", "shape", "h_mm", "b_mm", "tw_mm", "tf_mm", "r_mm", "r2_mm", "mass_kg_per_m"),
    *("a_cm2", "iy_cm4", "iz_cm4", "it_cm4", "wpl_y_cm3", "wpl_z_cm3", "source"),
)
HOLLOW_COLUMNS = ("kind", "manufacture", "size_mm", "thicknesses_mm", "source")
CABLE_COLUMNS = (
    *("name", "other_names", "kind", "construction", "diameter_mm", "area_mm2", "modulus_gpa"),
    *("axial_stiffness_mn", "mass_kg_per_m", "breaking_force_kn", "expansion_1e-6_per_k"),
    *("modulus_state", "source"),
)
ROPE_COLUMNS = ("name", "area_factor", "mass_factor", "force_factor", "modulus_gpa")


def si_value(row: TableRow, column: str) -> float | None:
    """Return the number of a row in a column, in SI units, or None where the field is empty.

    The unit of the table is in the name of the column, such as ``area_mm2``.

    Raises:
        FileError: the field is no number, or the number is not positive.
    """
    if not row.text(column):
        return None
    value = row.number(column)
    if not value > 0:
        raise FileError(f"{row.place}: {column} = {value:g}: must be positive")
    unit = column.partition("_")[2]
    while unit not in UNITS and "_" in unit:
        unit = unit.partition("_")[2]
    return value * UNITS[unit]


def needed_value(row: TableRow, column: str) -> float:
    """Return the number of a row in a column, in SI units.

    Raises:
        FileError: the field is empty, no number, or not positive.
    """
    value = si_value(row, column)
    if value is None:
        raise FileError(f"{row.place}: {column}: is empty")
    return value


def read_rows(
    path: str | PathLike[str], columns: Sequence[str], needed: Sequence[str], key: str = "cables"
) -> list[TableRow]:
    """Read the rows of a user's table, ``.csv`` or ``.json``; unknown columns are left out.

    Args:
        path: path of the file.
        columns: names of the columns that are read, in lower case.
        needed: those of them that must be there.
        key: key of the list of rows in a JSON object.

    Raises:
        OSError, FileError: as `files.read_csv`.
    """
    with Omissions(path) as table:
        if Path(path).suffix.lower() != ".json":
            return read_table(path, columns, needed, {}, table, LARGEST)
        rows = read_json(path).get(key)
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise FileError(f"{key}: expected a list of objects, one for each row")
        found = []
        for number, row in enumerate(rows):
            place = f"{path}: {key}[{number}]"
            fields = {str(name).lower(): value for name, value in row.items()}
            for name in needed:
                if name not in fields:
                    raise FileError(f"{place}: {name}: is missing")
            for name in fields.keys() - set(columns):
                table.add(f"column {name!r}", place, "is not one of the columns that are read")
            words = {k: "" if v is None else str(v).strip() for k, v in fields.items()}
            found.append(TableRow(place, {k: v for k, v in words.items() if k in columns}, False))
        return found


@functools.cache
def package_rows(name: str, columns: tuple[str, ...]) -> tuple[TableRow, ...]:
    """Return the rows of a table of the package with these columns, read once.

    `name` is the name of its file beside this module.
    """
    with resources.as_file(resources.files(__package__) / name) as path:
        return tuple(read_table(path, columns, columns, None, Omissions(path), LARGEST))


@functools.cache
def _sources_by_key() -> dict[str, str]:
    """Read the sources of the tables of the package, full texts by their short names."""
    return json.loads((resources.files(__package__) / "sources.json").read_text("utf-8"))


def source_text(key: str) -> str:
    """Return the full text of a source from its short name; other texts as they are."""
    return _sources_by_key().get(key, key)
