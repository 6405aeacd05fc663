"""A report as a PDF file (by the wheel of Typst, the extra `reports`)."""

from __future__ import annotations

import functools
import itertools
import json
import re
from importlib import resources
from types import ModuleType
from typing import Any

from .document import Document


def import_typst() -> ModuleType:
    """Import and return the module `typst`; raise ValueError if it is not installed."""
    try:
        import typst
    except ImportError:
        raise ValueError("PDF: needs typst; pip install 'jaxcable[reports]'") from None
    return typst


@functools.cache
def _template():
    """Return the template of the document, a text in the language of Typst."""
    return resources.files(__package__).joinpath("report.typ.txt").read_bytes()


_WIDE, _HIGH = 470.0, 300.0
"""Points that a picture takes at most; so two of them fit one below the other, with captions."""
_SCALE = 0.85  # of pictures over their own size, for text of some 8 points
_SIZE = re.compile(r'<svg[^>]* width="([\d.]+)pt" height="([\d.]+)pt"')
_NARROW = 360.0
"""Width of pictures, points, up to which they get half a page, two beside each other."""


def pdf_bytes(document: Document) -> bytes:
    """Return a `Document` as a PDF: A4, with contents and numbers of pages.

    Texts are data of the template, so that no character of theirs means anything to Typst.
    """
    data = json.dumps(_document_data(document), ensure_ascii=False)
    return import_typst().compile(_template(), format="pdf", sys_inputs={"data": data})


_LONG_WORD = re.compile(r"\S{21,}")
_BREAK_AFTER = re.compile(r"[^\W_]{12}|[\W_]")


def _breakable(text):
    """Return a text whose long words, as names of groups may be, can go on in the next line."""
    return _LONG_WORD.sub(
        lambda word: _BREAK_AFTER.sub("\\g<0>\N{ZERO WIDTH SPACE}", word[0]), text
    )


def _document_data(document):
    """Return a document as plain data: tables in runs of pages of one format."""
    tables = [(any(part.landscape for part in table.parts), table) for table in document.tables]
    runs = itertools.groupby(tables, key=lambda pair: pair[0])
    middle = tables[(len(tables) - 1) // 2][1].name if tables else None
    return {
        "title": document.title,
        "author": next((text for word, text in document.facts if word == "author"), ""),
        "program": next(text for word, text in document.facts if word == "program"),
        "facts": document.facts,
        "summary": [_breakable(text) for text in document.summary],
        "pictures": _picture_rows(document.pictures),
        "middle": middle,
        "runs": [
            {"landscape": wide, "tables": [_table_data(table) for _, table in pairs]}
            for wide, pairs in runs
        ],
    }


def _picture_rows(pictures):
    """Return pictures with their widths in points, in rows: narrow ones two beside each other."""
    rows: list[list[dict[str, Any]]] = []
    alone: list[dict[str, Any]] = []  # a row of one narrow picture
    for caption, svg in pictures:
        width, height = (float(size) for size in _SIZE.findall(svg)[0])
        most = 0.48 * _WIDE if width <= _NARROW else _WIDE
        one = {"caption": _breakable(caption), "svg": svg}
        one["width"] = min(_SCALE * width, most, _HIGH * width / height)
        if width <= _NARROW and alone:
            alone.append(one)
            alone = []
        else:
            rows.append([one])
            alone = rows[-1] if width <= _NARROW else alone
    return rows


def _table_data(table) -> dict[str, Any]:
    """Return a `DocumentTable` as plain data."""
    parts = [
        {
            "headings": part.headings,
            "units": part.units,
            "align": ["right" if is_numeric else "left" for is_numeric in part.numeric],
            "cells": [_breakable(text) for text in itertools.chain.from_iterable(part.rows)],
        }
        for part in table.parts
    ]
    title, notes = _breakable(table.title), [_breakable(note) for note in table.notes]
    return {"name": table.name, "title": title, "parts": parts, "notes": notes}
