"""A table of a report as text, for the screen and for text files."""

from __future__ import annotations

import textwrap

from ..common.units import SI, Units
from .table import Scales, Table, show_table

_WIDTH = 110  # columns of notes, as of the widest table; a landscape page has 120 of 9 points
_WIDEST_CELL = 60  # characters of a cell, beyond which it goes on in the next line
_OVERHANG = 4  # characters by which a heading may be wider than the values below it
# Number of columns from which a unit that all of them have is in the title, not in each heading.
# Two or three units make no line too long; section forces have seven.
_SHARED = 4


def table_text(table: Table, most: int | None, scales: Scales, units_of_table: Units = SI) -> str:
    """Return a table as text of at most `most` rows; arguments as of `show_table`."""
    shown = show_table(table, most, scales, units_of_table)
    title, headings = _title_and_headings(table, shown)
    folded = [[textwrap.wrap(text, _WIDEST_CELL) or [""] for text in row] for row in shown.rows]
    widths = [
        max(len(line) for cell in column for line in cell) for column in zip(*folded, strict=True)
    ]
    wrapped = _wrap_headings(headings, widths)
    height = max(map(len, wrapped), default=0)
    blocks = [[[""] * (height - len(lines)) + lines for lines in wrapped], *folded]
    widths = [
        max(len(line) for cell in column for line in cell) for column in zip(*blocks, strict=True)
    ]
    lines = []
    for row in blocks:
        for k in range(max(map(len, row), default=0)):
            cells = (cell[k] if k < len(cell) else "" for cell in row)
            padded = (text.rjust(width) for text, width in zip(cells, widths, strict=True))
            lines.append("  ".join(["", *padded]).rstrip())
    for note in shown.notes:
        lines += textwrap.wrap(note, _WIDTH, initial_indent="  ", subsequent_indent="    ")
    return "\n".join([title, *lines])


def _title_and_headings(table, shown):
    """Return title and headings of a table with units; a unit of all numbers is in the title only.

    `table` is the `Table`, and `shown` the `ShownTable` of it.
    """
    named = {unit for unit in shown.units if unit not in ("", "-")}
    stated = [unit for unit in table.units if unit not in ("", "-")]
    shared = len(named) == len({*stated}) == 1 and len(stated) >= _SHARED
    left = {"", "-"} | (named if shared else set())
    headings = [
        name if unit in left else f"{name} ({unit})"
        for name, unit in zip(shown.headings, shown.units, strict=True)
    ]
    return (f"{shown.title} ({named.pop()})" if shared else shown.title), headings


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
        lines, limit = ([f"({unit}"], width + _OVERHANG) if name else ([], width)
        wrapped.append(_break_in_two(name or heading, limit) + lines)
    return wrapped


def _break_in_two(heading, width):
    """Return a heading of more than `width` characters as two lines, as short as possible."""
    words = heading.split()
    breaks = [[" ".join(words[:k]), " ".join(words[k:])] for k in range(1, len(words))]
    if len(heading) <= width or not breaks:
        return [heading]
    return min(breaks, key=lambda lines: max(map(len, lines)))
