"""A report as a document of pages: what its PDF and HTML files show, before it is set."""

from __future__ import annotations

import datetime
import io
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import jax

from ..common.units import SI, Units
from ..studies.task import package_version
from .table import Scales, ShownTable, Table, common_scales, show_table

_PORTRAIT, _LANDSCAPE = 124, 188  # digits of 8 points beside each other on A4, within margins
_GAP = 1.4  # digits between columns; points in numbers are narrower than digits
_LONGEST = 34  # digits of a text, from which on it wraps
_SHORTEST = 20  # the same where a page in portrait format is wide enough then
_MOST_KEYS = 4  # columns that name a row, repeated in each part: group, element, two nodes
_MOST_LINES = 8  # of a text in a table on a page in portrait format
_FEW = 15  # rows up to which a wide table is in parts, not on a page in landscape format
_PLAIN_TITLE = "Structural analysis"
_MINUS = "\N{MINUS SIGN}"


class Heading(NamedTuple):
    """Title block of a document: title, author, date and details; None or "" for none."""

    title: str | None = None
    author: str | None = None
    date: str | datetime.date | None = None
    details: Mapping[str, str] = MappingProxyType({})

    def facts(self, units: Units | str | None) -> list[tuple[str, str]]:
        """Return the lines below the title, pairs of a word and a text: author, date, program.

        Details and, unless they are None, `units` are among them.
        """
        stated = ("author", self.author), ("date", self.date), *self.details.items()
        every = *stated, ("program", program_versions()), ("units", units)
        return [(word, str(text)) for word, text in every if text not in (None, "")]


class DocumentTable(NamedTuple):
    """A table of a document.

    Attributes:
        name: name of the table, for links.
        parts: `ShownTable` of all columns, or several of columns that fit on a page beside each
            other; none for a table without columns.
        title, notes: those of the whole table.
        landscape: whether it needs pages in landscape format.
    """

    name: str
    parts: list[ShownTable]
    title: str
    notes: list[str]
    landscape: bool


class Document(NamedTuple):
    """A document of pages.

    Attributes:
        title: what it is on.
        facts: pairs of a word and a text, as ("author", "A. Muller").
        summary: sentences.
        tables: list of `DocumentTable`.
        pictures: pairs of a caption and the text of an SVG picture.
    """

    title: str
    facts: list[tuple[str, str]]
    summary: list[str]
    tables: list[DocumentTable]
    pictures: list[tuple[str, str]]


def make_document(
    summary: Sequence[str],
    tables: Mapping[str, Table],
    units: Units | None,
    heading: Heading,
    pictures: Mapping[str, Any],
    most: int,
) -> Document:
    """Return the `Document` of a report.

    Args:
        summary, tables, units: those of a `Report`.
        heading: `Heading`.
        pictures: matplotlib figures by their captions.
        most: largest number of rows of each table.
    """
    scales = common_scales(list(tables.values()), units)
    found, lines, left_out = [], list(summary), []
    for name, table in tables.items():
        if "case" in table.columns and len(table.rows) > most:  # nobody reads some of the cases
            left_out.append(f"{name} ({len(table.rows)} rows)")
        else:
            found.append(_document_table(name, table, most, scales, units or SI))
    if left_out:
        named = ", ".join(left_out)
        lines.append(f"not in this document, but in .xlsx, .csv and .json files: {named}")
    title = str(heading.title or _PLAIN_TITLE)
    return Document(title, heading.facts(units), lines, found, picture_svgs(pictures))


def program_versions() -> str:
    """Return the versions of this program and of jax as text."""
    return f"jaxcable {package_version('jaxcable')}, jax {jax.__version__}"


def _document_table(name: str, table: Table, most: int, scales: Scales, units: Units):
    """Return a `Table` as `DocumentTable`, its columns split into parts that fit on a page.

    Each part repeats the first columns, which name the row. The paper is landscape if a part, or
    long texts, need it. Minus signs replace hyphens in numbers. Arguments as of `make_document` and
    `show_table`.
    """
    shown = show_table(table, most, scales, units)
    columns = [
        [text.replace("-", _MINUS) for text in texts] if is_numeric else texts
        for texts, is_numeric in zip(zip(*shown.rows, strict=True), shown.is_numeric, strict=True)
    ]
    narrow, wide = (
        [
            _column_width(*of, _LONGEST if of[2] else most)
            for of in zip(*shown[1:4], columns, strict=True)
        ]
        for most in (_SHORTEST, _LONGEST)
    )
    longest = max((len(t) for own in columns for t in own), default=0)
    is_wordy = longest > _MOST_LINES * (_PORTRAIT - sum(narrow) + _SHORTEST)
    is_turned = is_wordy or (sum(narrow) > _PORTRAIT and len(table.rows) > _FEW)
    widths, room = (wide, _LANDSCAPE) if is_turned else (narrow, _PORTRAIT)
    parts = _split_columns(shown.units, widths, room)
    landscape = is_wordy or any(sum(narrow[k] for k in part) > _PORTRAIT for part in parts)

    def part_of(part):
        headings, units, is_numeric = ([of[k] for k in part] for of in shown[1:4])
        rows = [list(row) for row in zip(*(columns[k] for k in part), strict=True)]
        return ShownTable(table.title, headings, units, is_numeric, rows, [])

    every = [part_of(part) for part in parts]
    return DocumentTable(name, every, table.title, shown.notes, landscape)


def _column_width(heading, unit, is_numeric, texts, longest):
    """Return the width of a column in digits: of its cells, and of the words of its heading.

    Args:
        heading, unit, is_numeric: those of the column, as of `ShownTable`.
        texts: texts of its cells.
        longest: number of characters from which cells wrap; a single word wraps only if it has very
            many.
    """
    words = (len(word[:_LONGEST]) for text in texts for word in text.split())
    cells = max(max(min(len(text), longest) for text in texts), *words)
    word = max(map(len, heading.split()), default=0)
    lines = len(heading) / 2  # headings have two or three lines
    return _GAP + max(cells, word, lines, len(unit))


def _split_columns(units, widths, room):
    """Return the indices of the columns of each part of a table that fits on a page, lists.

    The first columns, which name the row, are in every part; texts stay beside their numbers.

    Args:
        units: unit of each column, "" for texts.
        widths: widths of the columns, in digits.
        room: width of the page, in digits.
    """
    count = len(units)
    if sum(widths) <= room:
        return [[*range(count)]] if count else []
    first = next((k for k, unit in enumerate(units) if unit), count)
    keys = [*range(min(first, _MOST_KEYS))]
    room -= sum(widths[: len(keys)])
    chunks: list[list[int]] = []  # a value, and the case in which it governs behind it
    for k in range(len(keys), count):
        if units[k] or not chunks:
            chunks.append([])
        chunks[-1].append(k)
    parts: list[list[int]] = [[]]
    for chunk in chunks:
        if parts[-1] and sum(widths[j] for j in (*parts[-1], *chunk)) > room:
            parts.append([])
        parts[-1] += chunk
    return [[*keys, *part] for part in parts]


def picture_svgs(pictures: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return matplotlib figures as SVG, pairs of caption and text; equal figures give equal texts.

    Raises:
        ValueError: something else than a figure.
    """
    found = []
    for caption, figure in pictures.items():
        if not hasattr(figure, "savefig"):
            kind = type(figure).__name__
            raise ValueError(f"pictures[{caption!r}]: expected a matplotlib Figure, got {kind}")
        import matplotlib  # where a figure is, it is loaded already

        stream = io.StringIO()
        with matplotlib.rc_context({"svg.hashsalt": "jaxcable"}):
            figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
        found.append((str(caption), stream.getvalue()))
    return found
