"""A report as a workbook of spreadsheets (by XlsxWriter, the extra `reports`)."""

from __future__ import annotations

import datetime
import io
import math
import re
from collections.abc import Mapping, Sequence

from ..common import checks
from .document import Heading, program_versions
from .table import Table

_LONGEST_NAME = 31  # characters of the name of a sheet
_REFUSED = re.compile(r"[\[\]:*?/\\]")  # in names of sheets
_WIDEST = 300  # pixels of a column
# How numbers of a unit are shown; the file has all digits.
_FORMATS = {"m": "0.00000", "ft": "0.00000", "mm": "0.00", "in": "0.0000", "-": "0.000"}
_SMALL, _LARGE = 0.01, 1e6  # numbers that need exponents, and no decimals
# When the workbook was made, for its properties, if no date is given: that of its ZIP entries.
_EPOCH = datetime.datetime(1980, 1, 1)
_TEXTS_STAY = dict.fromkeys(("strings_to_formulas", "strings_to_urls", "strings_to_numbers"), False)


class _AllDigits(float):
    """A number that XlsxWriter writes with all digits; it would write 16, not always enough."""

    def __format__(self, _):
        return float.__repr__(self)


def workbook_bytes(
    summary: Sequence[str],
    tables: Mapping[str, Table],
    heading: Heading,
    facts: Sequence[tuple[str, str]],
) -> bytes:
    """Return a workbook with a sheet of the summary, and one for each table.

    Args:
        summary, tables: those of a `Report`.
        heading: `Heading`.
        facts: what stands below the title, pairs of a word and a text.
    """
    stream = io.BytesIO()
    xlsxwriter = checks.import_library("xlsxwriter", "XLSX", "reports")
    book = xlsxwriter.Workbook(stream, {"in_memory": True, **_TEXTS_STAY})
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
    sheet = book.add_worksheet(names[0])
    sheet.set_column(0, 0, 28)
    sheet.set_column(1, 1, 100)
    top = [([str(heading.title)], look["title"])] if heading.title else []
    lines = [*top, *((fact, None) for fact in facts), ([], None)]
    lines += [*(([sentence], None) for sentence in summary), ([], None)]
    for row, (cells, shown) in enumerate([*lines, (["sheet", "table"], look["bold"])]):
        sheet.write_row(row, 0, cells, shown)
    for row, (name, table) in enumerate(
        zip(names[1:], tables.values(), strict=True), len(lines) + 1
    ):
        place = name.replace("'", "''")
        sheet.write_url(row, 0, f"internal:'{place}'!A1", look["link"], name)
        sheet.write(row, 1, table.title)
        _write_table(book, book.add_worksheet(name), table, look)
    book.close()
    return stream.getvalue()


def _sheet_names(names):
    """Return names of sheets that Excel allows, from names of tables, a list.

    They are at most 31 characters long, and unique whatever the case of letters.
    """
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


def _write_table(book, sheet, table, look):
    """Write a `Table` to a sheet: title, headings, units with filters, rows, and notes.

    `look` has formats of the workbook `book` by name.
    """
    names = [name.strip() for name in table.headings or table.columns]
    sheet.write_row(1, 0, names, look["bold"])
    sheet.write_row(2, 0, table.units, look["unit"])
    for k, unit in enumerate(table.units):
        values = [row[k] for row in table.rows]
        sheet.write_column(3, k, map(_cell_value, values), _number_format(book, unit, values))
    sheet.autofit(_WIDEST)  # before title and notes, which go on over other columns
    sheet.write(0, 0, table.title, look["title"])
    sheet.write_column(4 + len(table.rows), 0, table.notes, look["note"])
    if table.columns:
        sheet.autofilter(2, 0, 2 + len(table.rows), len(table.columns) - 1)
    keys = next((k for k, unit in enumerate(table.units) if unit), 0)
    sheet.freeze_panes(3, min(keys, 2))
    sheet.set_landscape()
    sheet.set_paper(9)  # A4
    sheet.fit_to_pages(1, 0)  # as wide as a page
    sheet.repeat_rows(1, 2)
    sheet.set_footer("&C&P / &N")


def _cell_value(value):
    """Return a value as a workbook has it: floats with all digits, infinite ones as text."""
    if not isinstance(value, float):
        return value
    return _AllDigits(value) if math.isfinite(value) else str(value)


def _number_format(book, unit, values):
    """Return the number format of a column by its unit and largest value; None without floats.

    Small numbers have powers of ten.
    """
    numbers = [abs(v) for v in values if isinstance(v, float) and math.isfinite(v)]
    size = max(numbers, default=0.0)
    shown = _FORMATS.get(unit, "#,##0" if size >= _LARGE else "#,##0.000")
    shown = "0.000E+00" if 0.0 < size < _SMALL else shown
    return book.add_format({"num_format": shown}) if numbers else None
