"""Read CSV tables whose first line names the columns."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import NamedTuple

import numpy as np

from . import reading
from .omissions import Omissions
from .reading import FileError, read_text

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_SEPARATOR = re.compile(r'("?)sep=([^\w\s"]|\t)\1[;,\t ]*', re.IGNORECASE)
_EMPTY = ' ;,\t\r\n"'  # of which lines consist that have no contents
_DECIMAL_POINT = re.compile(r"[+-]?\d*\.\d*([eE][+-]?\d+)?")


class TableRow(NamedTuple):
    """A row of a table: its fields by column.

    Attributes:
        place: the file and the line, in words.
        fields: dict from column to text.
        decimal_commas: whether numbers have decimal commas.
        decimal_mark: the mark that numbers of this table have, "," or "."; "" if none shows.
    """

    place: str
    fields: dict[str, str]
    decimal_commas: bool
    decimal_mark: str = ""

    def text(self, column: str) -> str:
        """Return the text of this row in a column; empty if the table has no such column."""
        return self.fields.get(column, "")

    def number(self, column: str, absent: float | None = None) -> float:
        """Return the number of this row in a column.

        An empty field gives `absent`, or raises FileError if that is None.
        """
        word = self.text(column)
        if not word and absent is not None:
            return absent
        if self.decimal_commas and _DECIMAL_COMMA.fullmatch(word):
            word = word.replace(",", ".")
        try:
            value = reading.parse_number(word)
        except ValueError as error:
            raise FileError(f"{self.place}: {column}: {error}") from None
        if not np.isfinite(value):
            raise FileError(f"{self.place}: {column}: {word!r} is not finite")
        return value


def read_table(
    path: str | PathLike[str],
    known: Sequence[str],
    needed: Sequence[str],
    aliases: Mapping[str, str] | None,
    table: Omissions,
    largest: int,
) -> list[TableRow]:
    """Return the rows of a CSV table below its header; raise FileError for wrong columns.

    Args:
        path: path of the file.
        known: names of the columns that are read.
        needed: those of them that the table must have.
        aliases: dict from the file's names of columns, in small letters, to ours; other columns
            are left out. None raises FileError for a column with another name.
        table: table of omissions, to which columns that are left out are added.
        largest: largest size that is read, bytes.
    """
    lines, mark = _lines_and_separator(read_text(path, largest))
    if not lines:
        raise FileError(f"{path}: is empty, or has comments only")
    try:
        header, *records = csv.reader([line for _, line in lines], delimiter=mark, strict=True)
    except csv.Error as error:
        raise FileError(f"{path}: not a CSV table: {error}") from None
    columns = _column_names(f"{path}: line {lines[0][0]}", header, known, needed, aliases, table)
    if not records:
        raise FileError(f"{path}: has no rows below its header")
    if len(records) != len(lines) - 1:
        raise FileError(f"{path}: a quote is not closed, or a field has a line break")
    words = [word.strip() for record in records for word in record]
    points = any(_DECIMAL_POINT.fullmatch(word) and word != "." for word in words)
    commas = mark != "," and any(_DECIMAL_COMMA.fullmatch(word) for word in words)
    decimal_mark = "." if points else "," if commas else ""
    found = []
    for (line, _), record in zip(lines[1:], records, strict=True):
        place = f"{path}: line {line}"
        if len(record) != len(header):
            raise FileError(f"{place}: {len(record)} fields, the header has {len(header)}")
        pairs = zip(columns, map(str.strip, record), strict=True)
        fields = {name: word for name, word in pairs if name is not None}
        found.append(TableRow(place, fields, mark != "," and not points, decimal_mark))
    return found


def require_same_decimal_mark(*tables: Sequence[TableRow]) -> None:
    """Raise FileError if some tables have decimal commas and others decimal points.

    One of them then has thousands marks that read as decimal ones: 1,200 as 1.2.
    """
    shown = {rows[0].decimal_mark: rows[0].place.rpartition(": ")[0] for rows in reversed(tables)}
    if "," in shown and "." in shown:
        raise FileError(
            f"{shown[',']} has decimal commas, and {shown['.']} decimal points: write both files "
            "with the same mark, and no mark of thousands"
        )


def _lines_and_separator(text):
    """Return the lines of a table as pairs (line number, line), and the character between fields.

    Empty lines and comments are left out. Spreadsheets write rows of empty fields, ``;;;``, and may
    name the separator in a line of its own before the header, ``sep=;``.
    """
    lines = list(enumerate(io.StringIO(text, newline=None), 1))
    stated = _SEPARATOR.fullmatch(lines[0][1].rstrip("\r\n")) if lines else None
    empty = _EMPTY + (stated[2] if stated else "")
    lines = [
        (k, line)
        for k, line in (lines[1:] if stated else lines)
        if line.strip(empty) and not line.lstrip().startswith("#")
    ]
    usual = next((mark for mark in ";\t" if lines and mark in lines[0][1]), ",")
    return lines, stated[2] if stated else usual


def _column_names(place, header, known, needed, aliases, table):
    """Return for each column of a header its known name, or None for a column that is left out.

    Args:
        place: file and line of the header, in words, for messages.
        header: texts of its fields, a list.
        known, needed: names of the columns that are read, and of those that must be there.
        aliases: known names by the file's names, in lower case. With a dict unknown columns are
            left out and added to `table`; with None they raise FileError, as missing and repeated
            columns do in either case.
        table: table of omissions.
    """
    words = [word.strip().lower() for word in header]
    named = aliases or {}
    columns = [named.get(word, word if word not in named.values() else None) for word in words]
    for number, (word, name) in enumerate(zip(words, columns, strict=True)):
        if name in known:
            continue
        if aliases is None:
            raise FileError(
                f"{place}: unknown column {word!r}; known are {', '.join(known)}; for the names of "
                "another program give columns=... (--columns)"
            )
        columns[number] = None
        table.add(f"column {word!r}", place, "is not one of the columns that are read")
    for word, name in named.items():
        if name in known and name not in columns:
            raise FileError(f"{place}: {name}: there is no column {word!r}")
    for name in known:
        if columns.count(name) > 1:
            raise FileError(f"{place}: column {name!r} occurs twice")
    for name in needed:
        if name not in columns:
            raise FileError(f"{place}: column {name!r} is missing")
    return columns
