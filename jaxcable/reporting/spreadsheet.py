"""A report as a workbook of spreadsheets (by XlsxWriter, the extra `reports`)."""

from __future__ import annotations

import datetime
import io
import math
import re
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

from .document import Heading, program_versions
from .table import Table

_LONGEST_NAME = 31  # characters of the name of a sheet
_REFUSED = re.compile(r"[\[\]:*?/\\]")  # in names of sheets
_WIDEST = 40  # characters of a column
_FORMATS = {"m": "0.00000", "ft": "0.00000", "mm": "0.00", "in": "0.0000", "-": "0.000"}
"""How numbers of a unit are shown; the file has all digits."""
_SMALL, _LARGE = 0.01, 1e6  # numbers that need exponents, and no decimals
_EPOCH = datetime.datetime(1980, 1, 1)
"""When the workbook was made, for its properties, if no date is given: that of its ZIP entries."""


class _Exact(float):
    """A number that XlsxWriter writes with all digits; it would write 16, not always enough."""

    def __format__(self, _):
        return float.__repr__(self)


def import_xlsxwriter() -> ModuleType:
    """Import and return the module `xlsxwriter`; raise ValueError if it is not installed."""
    try:
        import xlsxwriter
    except ImportError:
        raise ValueError("XLSX: needs xlsxwriter; pip install 'jaxcable[reports]'") from None
    return xlsxwriter


def workbook_bytes(
    summary: Sequence[str], tables: Mapping[str, Table], units: str, heading: Heading
) -> bytes:
    """Return a workbook with a sheet of the summary, and one for each table.

    Args:
        summary, tables: those of a `Report`.
        units: the units of the tables, in words.
        heading: `Heading`.
    """
    stream = io.BytesIO()
    book = import_xlsxwriter().Workbook(stream, {"in_memory": True})
    when = heading.date if isinstance(heading.date, datetime.date) else _EPOCH
    if not isinstance(when, datetime.datetime):
        when = datetime.datetime.combine(when, datetime.time())
    book.set_properties(
        {
            "title": str(heading.title or ""),
            "author": str(heading.author or ""),
            "comments": program_versions(),
            "created": when.replace(tzinfo=None),
        }
    )
    look = {
        "bold": book.add_format({"bold": True, "text_wrap": True, "valign": "bottom"}),
        "title": book.add_format({"bold": True, "font_size": 13}),
        "unit": book.add_format({"italic": True, "bottom": 1}),
        "note": book.add_format({"italic": True}),
        "link": book.add_format({"font_color": "blue", "underline": 1}),
    }
    names = _sheet_names(["summary", *tables])
    _write_summary(book.add_worksheet(names[0]), summary, tables, names[1:], units, heading, look)
    for name, table in zip(names[1:], tables.values(), strict=True):
        _write_table(book, book.add_worksheet(name), table, look)
    book.close()
    return stream.getvalue()


def _sheet_names(names):
    """Return names of sheets: unique in any case, allowed, and not too long; a list."""
    found: list[str] = []
    for name in names:
        plain = _REFUSED.sub("_", name).strip("'")[:_LONGEST_NAME] or "table"
        plain = f"{plain}_"[:_LONGEST_NAME] if plain.lower() == "history" else plain  # Excel's own
        unique, k = plain, 1
        while unique.lower() in {other.lower() for other in found}:
            k += 1
            unique = f"{plain[: _LONGEST_NAME - len(f' {k}')]} {k}"
        found.append(unique)
    return found


def _write_summary(sheet, summary, tables, names, units, heading, look):
    """Write the sheet with title, sentences and a list of the tables, which leads to each."""
    sheet.set_column(0, 0, 28)
    sheet.set_column(1, 1, 100)
    row = 0
    if heading.title:
        sheet.write_string(row, 0, str(heading.title), look["title"])
        row += 1
    facts = (
        *(("author", heading.author), ("date", heading.date), *heading.details.items()),
        ("program", program_versions()),
    )
    for word, text in (*facts, ("units", units)):
        if text not in (None, ""):
            sheet.write_string(row, 0, word)
            sheet.write_string(row, 1, str(text))
            row += 1
    for sentence in summary:
        sheet.write_string(row + 1, 0, sentence)
        row += 1
    row += 2
    for k, text in enumerate(("sheet", "table")):
        sheet.write_string(row, k, text, look["bold"])
    for name, table in zip(names, tables.values(), strict=True):
        row += 1
        place = name.replace("'", "''")
        sheet.write_url(row, 0, f"internal:'{place}'!A1", look["link"], name)
        sheet.write_string(row, 1, table.title)


def _write_table(book, sheet, table, look):
    """Write the sheet of a table: title, headings, units with filters, rows, and notes."""
    sheet.write_string(0, 0, table.title, look["title"])
    names = table.headings or table.columns
    formats = []
    for k, (name, unit) in enumerate(zip(names, table.units, strict=True)):
        sheet.write_string(1, k, name.strip(), look["bold"])
        sheet.write_string(2, k, unit, look["unit"])
        values = [row[k] for row in table.rows]
        formats.append(book.add_format({"num_format": _number_format(unit, values)}))
        cells = [_shown_width(value) for value in values]
        words = max(map(len, name.split()), default=0)
        sheet.set_column(k, k, min(max([len(unit) + 3, words + 1, 6, *cells]), _WIDEST))
    for r, row in enumerate(table.rows, 3):
        for k, value in enumerate(row):
            _write_cell(sheet, r, k, value, formats[k])
    if table.columns:
        sheet.autofilter(2, 0, 2 + len(table.rows), len(table.columns) - 1)
    keys = next((k for k, unit in enumerate(table.units) if unit), 0)
    sheet.freeze_panes(3, min(keys, 2))
    for r, note in enumerate(table.notes, 4 + len(table.rows)):
        sheet.write_string(r, 0, note, look["note"])
    sheet.set_landscape()
    sheet.set_paper(9)  # A4
    sheet.fit_to_pages(1, 0)  # as wide as a page
    sheet.repeat_rows(1, 2)
    sheet.set_footer("&C&P / &N")


def _write_cell(sheet, row, column, value: Any, shown):
    """Write a value: numbers as numbers with all digits, texts as texts whatever they begin with.

    `shown` is the format of numbers with a point.
    """
    if value is None:
        return
    if isinstance(value, bool | str):
        sheet.write_string(row, column, str(value))
    elif isinstance(value, int):
        sheet.write_number(row, column, value)
    elif math.isfinite(value):
        sheet.write_number(row, column, _Exact(value), shown)
    else:
        sheet.write_string(row, column, str(value))


def _number_format(unit, values):
    """Return how the numbers of a column are shown: with three decimals, small ones as powers."""
    sizes = [abs(v) for v in values if isinstance(v, float) and math.isfinite(v)]
    size = max(sizes, default=0.0)
    if 0.0 < size < _SMALL:
        return "0.000E+00"
    return _FORMATS.get(unit, "#,##0" if size >= _LARGE else "#,##0.000")


def _shown_width(value):
    """Return the number of characters of a value as it is shown."""
    return len(f"{value:,.3f}") + 1 if isinstance(value, float) else len(str(value or ""))
