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
from .table import Scales, Table, common_scales, table_texts

# Widths in points of characters of 8 points in the serif face of the PDF: digits, which are all of
# one width, capitals, other letters on average, and points and spaces; bold ones are wider.
_DIGIT, _CAPITAL, _LETTER, _POINT, _BOLD = 3.8, 5.0, 3.4, 2.2, 1.25
_GAP = 7.0  # between columns
_PORTRAIT, _LANDSCAPE = 470.0, 717.0  # width of the text on A4
_LONGEST = 34  # characters of a text, from which on it wraps
_SHORTEST = 20  # the same where a page in portrait format is wide enough then
_MOST_KEYS = 4
"""Columns that name a row, and are repeated where a table is split: group, element, two nodes."""
_FEW = 15
"""Number of rows up to which a wide table is in parts, not on a page in landscape format."""
_PLAIN_TITLE = "Structural analysis"
_MINUS = "\N{MINUS SIGN}"


class Heading(NamedTuple):
    """What the user states of a document: title, author, date, and more; None or "" for none."""

    title: str | None = None
    author: str | None = None
    date: str | datetime.date | None = None
    details: Mapping[str, str] = MappingProxyType({})


class Part(NamedTuple):
    """Columns of a table that fit on a page beside each other: all of them, or some.

    Attributes:
        headings, units: of each column.
        numeric: whether each column has numbers, which are put to the right.
        rows: texts of the cells, row by row.
        landscape: whether the part needs a page in landscape format.
    """

    headings: list[str]
    units: list[str]
    numeric: list[bool]
    rows: list[list[str]]
    landscape: bool


class DocumentTable(NamedTuple):
    """A table of a document: its name, its title, its parts, and its notes."""

    name: str
    title: str
    parts: list[Part]
    notes: list[str]


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
    most: int | None,
) -> Document:
    """Return the `Document` of a report.

    Args:
        summary, tables, units: those of a `Report`.
        heading: `Heading`.
        pictures: matplotlib figures by their captions.
        most: largest number of rows of each table; None for all.
    """
    scales = common_scales(list(tables.values()), units)
    left_out = {} if most is None else {n: t for n, t in tables.items() if _is_left_out(t, most)}
    found = [
        _document_table(name, table, most, scales, units or SI)
        for name, table in tables.items()
        if name not in left_out
    ]
    lines = list(summary)
    if left_out:
        named = ", ".join(f"{name} ({len(table.rows)} rows)" for name, table in left_out.items())
        lines.append(f"not in this document, but in .xlsx, .csv and .json files: {named}")
    return Document(_title(heading), _facts(heading, units), lines, found, picture_svgs(pictures))


def _is_left_out(table, most):
    """Return whether a table has a row for each case, and too many: nobody reads some of them."""
    return "case" in table.columns and len(table.rows) > most


def program_versions() -> str:
    """Return the versions of this program and of jax as text."""
    return f"jaxcable {package_version('jaxcable')}, jax {jax.__version__}"


def _title(heading):
    """Return the title of a document."""
    return str(heading.title or _PLAIN_TITLE)


def _facts(heading, units):
    """Return what stands below the title, pairs of a word and a text."""
    stated = (("author", heading.author), ("date", heading.date), *heading.details.items())
    facts = [(word, str(text)) for word, text in stated if text not in (None, "")]
    facts.append(("program", program_versions()))
    if units is not None:
        facts.append(("units", str(units)))
    return facts


def _document_table(name: str, table: Table, most: int | None, scales: Scales, units: Units):
    """Return a table as `DocumentTable`; arguments as of `make_document` and `table_texts`."""
    shown_units, texts, shown, notes = table_texts(table, most, scales, units)
    names = table.headings or [column.strip() for column in table.columns]
    numeric = [
        all(isinstance(row[k], int | float | None) for row in table.rows)
        for k in range(len(table.columns))
    ]
    texts = [
        [text.replace("-", _MINUS) for text in column] if is_numeric else column
        for column, is_numeric in zip(texts, numeric, strict=False)  # no texts without rows
    ]
    widths, least = (  # in points
        {k: _column_width(names[k], shown_units[k], texts[k], longest) for k in shown}
        for longest in (_LONGEST, _SHORTEST)
    )
    least = {k: widths[k] if numeric[k] else least[k] for k in shown}
    room, space = _PORTRAIT, least
    if sum(least.values()) > _PORTRAIT and len(table.rows) > _FEW:
        room, space = _LANDSCAPE, widths
    parts = []
    for columns in _split_columns(shown, space, [shown_units[k] for k in shown], room):
        every: Any = names, shown_units, numeric, texts
        own_names, own_units, own_numeric, own = ([of[k] for k in columns] for of in every)
        rows = [list(row) for row in zip(*own, strict=True)]
        wide = sum(least[k] for k in columns) > _PORTRAIT
        parts.append(Part(own_names, own_units, own_numeric, rows, wide))
    return DocumentTable(name, table.title, parts, notes)


def _column_width(heading, unit, texts, longest):
    """Return the width of a column in points: of its cells, and of the words of its heading.

    Cells of more than `longest` characters wrap, but a word does only if it has very many.
    """
    words = (word[:_LONGEST] for text in texts for word in text.split())
    cells = max(map(_text_width, (*(text[:longest] for text in texts), *words)))
    word = max(map(_text_width, heading.split()), default=0.0)
    lines = _text_width(heading) / 2  # headings have two or three lines
    return _GAP + max(cells, _BOLD * word, _BOLD * lines, _text_width(unit))


def _text_width(text):
    """Return the width of a text in points."""
    digits = sum(c.isdigit() or c == _MINUS for c in text)
    capitals = sum(c.isupper() for c in text)
    letters = sum(c.isalpha() for c in text) - capitals
    others = len(text) - digits - capitals - letters
    return _DIGIT * digits + _CAPITAL * capitals + _LETTER * letters + _POINT * others


def _split_columns(shown, widths, units, room):
    """Return the columns of each part of a table that fit on a page, a list of lists.

    `room` is the width of a page, points.

    The first columns, which name the row, are in every part; texts stay beside their numbers.
    """
    if not shown:
        return []
    if sum(widths[k] for k in shown) <= room:
        return [shown]
    count = next((k for k, unit in enumerate(units) if unit), len(units))
    keys, others = shown[: min(count, _MOST_KEYS)], shown[min(count, _MOST_KEYS) :]
    room -= sum(widths[k] for k in keys)
    chunks: list[list[int]] = []  # a value, and the case in which it governs behind it
    for k in others:
        if units[shown.index(k)] or not chunks:
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
