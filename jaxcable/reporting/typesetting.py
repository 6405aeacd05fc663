"""A report as a PDF file (by the wheel of Typst, the extra `reports`)."""

from __future__ import annotations

import itertools
import json
import re
from importlib import resources
from typing import Any

from ..common import checks
from .document import Document

_LONG_WORD = re.compile(r"\S{21,}")
_BREAK_AFTER = re.compile(r"[^\W_]{12}|[\W_]")


def pdf_bytes(document: Document) -> bytes:
    """Return a `Document` as a PDF: A4, with contents and numbers of pages.

    Texts are data of the template, so that no character of theirs means anything to Typst.
    """
    data = json.dumps(_document_data(document), ensure_ascii=False)
    template = resources.files(__package__).joinpath("report.typ.txt").read_bytes()
    typst = checks.import_library("typst", "PDF", "reports")
    return typst.compile(template, format="pdf", sys_inputs={"data": data})


def _breakable(text):
    """Return a text in which long words, such as names of groups, have places for line breaks."""
    return _LONG_WORD.sub(
        lambda word: _BREAK_AFTER.sub("\\g<0>\N{ZERO WIDTH SPACE}", word[0]), text
    )


def _document_data(document):
    """Return a `Document` as plain data for the template.

    Tables are grouped in runs of pages in one format, portrait or landscape.
    """
    tables, facts = document.tables, dict(document.facts)
    runs = itertools.groupby(tables, key=lambda table: table.landscape)
    return {
        **{"title": document.title, "author": facts.get("author", ""), "facts": document.facts},
        "program": facts["program"],
        "summary": [_breakable(text) for text in document.summary],
        "pictures": [{"caption": _breakable(text), "svg": svg} for text, svg in document.pictures],
        "middle": tables[(len(tables) - 1) // 2].name if tables else None,
        "runs": [
            {"landscape": landscape, "tables": [_table_data(table) for table in run]}
            for landscape, run in runs
        ],
    }


def _table_data(table) -> dict[str, Any]:
    """Return a `DocumentTable` as plain data for the template."""
    parts = [
        {
            "headings": part.headings,
            "units": part.units,
            "align": ["right" if is_numeric else "left" for is_numeric in part.is_numeric],
            "cells": [_breakable(text) for text in itertools.chain.from_iterable(part.rows)],
        }
        for part in table.parts
    ]
    title, notes = _breakable(table.title), [_breakable(note) for note in table.notes]
    return {"name": table.name, "title": title, "parts": parts, "notes": notes}
