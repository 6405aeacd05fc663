"""A report as one HTML file that asks no other host for anything, and that prints well."""

from __future__ import annotations

import base64
from html import escape

from .document import Document

_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.4 system-ui, "Segoe UI", "Liberation Sans", Arial, sans-serif; color: #1a1a1a;
  background: #fff; margin: 2rem auto; padding: 0 1rem; max-width: 75rem; }
h1 { font-size: 1.6rem; margin: 0 0 .4rem; } h2 { font-size: 1.15rem; margin: 2rem 0 .5rem; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1rem; margin: 0 0 1rem; }
dt { color: #595959; } dd { margin: 0; }
h1, h2, p, dd, li, figcaption { overflow-wrap: anywhere; }
.contents { columns: 21rem; column-gap: 3rem; padding-left: 2rem; }
.contents li { break-inside: avoid; } .contents a { color: #00558a; }
.table { overflow-x: auto; margin-bottom: .5rem; }
table { border-collapse: collapse; font-size: .85rem; font-variant-numeric: tabular-nums; }
th, td { padding: .12rem .55rem; text-align: left; vertical-align: top; }
th { vertical-align: bottom; } th.n, td.n { text-align: right; } td.n { white-space: nowrap; }
tr.units th { font-weight: normal; font-style: italic; }
thead { border-top: 1px solid #333; border-bottom: 1px solid #333; }
tbody tr:nth-child(even) { background: #f3f5f7; } tbody { border-bottom: 1px solid #333; }
.note { font-size: .85rem; margin: .1rem 0; color: #404040; max-width: 60rem; }
figure { margin: 1rem 0; } figure img { max-width: 100%; max-height: 60rem; }
figcaption { font-size: .9rem; }
@page { size: A4; margin: 18mm 18mm 20mm; @bottom-center { content: counter(page) " / "
  counter(pages); font: 8pt sans-serif; } }
@page wide { size: A4 landscape; }
@media print {
  body { font-size: 9.5pt; margin: 0; padding: 0; max-width: none; }
  h2, figcaption { break-after: avoid; } figure, tr { break-inside: avoid; }
  thead { display: table-header-group; } table { font-size: 7.5pt; }
  th, td { padding: .5pt 3pt; } .table { overflow: visible; } .wide { page: wide; }
  .contents a { color: inherit; text-decoration: none; } figure img { max-height: 200mm; }
}
"""
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


def page_text(document: Document) -> str:
    """Return the text of an HTML file of a `Document`."""
    title = escape(document.title)
    facts = "".join(f"<dt>{escape(word)}<dd>{escape(text)}" for word, text in document.facts)
    contents = [("summary", "Summary"), *((f"table-{t.name}", t.title) for t in document.tables)]
    if document.pictures:
        contents.insert(1, ("pictures", "Pictures"))
    links = "".join(
        f'<li><a href="#{escape(place)}">{escape(text)}</a>' for place, text in contents
    )
    summary = "".join(f"<p>{escape(sentence)}" for sentence in document.summary)
    pictures = "".join(_picture(caption, svg) for caption, svg in document.pictures)
    if pictures:
        pictures = f'<h2 id="pictures">Pictures</h2>{pictures}'
    tables = "\n".join(_table(table) for table in document.tables)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="generator" content="jaxcable">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title><style>{_STYLE}</style></head>\n<body><main>"
        f'<h1>{title}</h1><dl>{facts}</dl>\n<nav><ol class="contents">{links}</ol></nav>\n'
        f'<h2 id="summary">Summary</h2>{summary}\n{pictures}\n{tables}\n</main></body></html>\n'
    )


def _picture(caption, svg):
    """Return a picture with its caption."""
    data = base64.b64encode(svg.encode()).decode()
    text = escape(caption)
    return (
        f'<figure><img alt="{text}" src="data:image/svg+xml;base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>\n"
    )


def _table(table):
    """Return a `DocumentTable` with its title and its notes."""
    parts = "\n".join(
        _part(part, f"{table.title}, part {k} of {len(table.parts)}")
        for k, part in enumerate(table.parts, 1)
    )
    notes = "".join(f'<p class="note">{escape(note)}' for note in table.notes)
    title = f'<h2 id="table-{escape(table.name)}">{escape(table.title)}</h2>'
    empty = "" if parts or notes else '<p class="note">none'
    return f"<section{' class=wide' * table.landscape}>{title}{parts}{empty}{notes}</section>"


def _part(part, label):
    """Return a part of a table; `label` says what it is to those who cannot see it."""
    kinds = [' class="n"' if is_numeric else "" for is_numeric in part.is_numeric]

    def cells(texts, tag, more=""):
        pairs = zip(texts, kinds, strict=True)
        return "".join(f"<{tag}{kind}{more}>{escape(text)}" for text, kind in pairs)

    rows = "\n".join(f"<tr>{cells(row, 'td')}" for row in part.rows)
    names, units = cells(part.headings, "th", ' scope="col"'), cells(part.units, "th")
    units = f'<tr class="units">{units}' * any(part.units)
    return (
        f'<div class="table" tabindex="0" role="region" aria-label="{escape(label)}"><table>'
        f"<thead><tr>{names}{units}</thead><tbody>\n{rows}</tbody></table></div>"
    )
