"""A report as one HTML file that asks no other host for anything, and that prints well."""

from __future__ import annotations

import base64
import string
from html import escape
from importlib import resources

from .document import Document


def page_text(document: Document) -> str:
    """Return the text of an HTML file of a `Document`."""
    template = resources.files(__package__).joinpath("report.html.txt").read_text("utf-8")
    pictures = "".join(_picture_html(caption, svg) for caption, svg in document.pictures)
    contents = [("summary", "Summary"), *[("pictures", "Pictures")] * bool(pictures)]
    contents += [(f"table-{table.name}", table.title) for table in document.tables]
    links = (f'<li><a href="#{escape(place)}">{escape(text)}</a>' for place, text in contents)
    return string.Template(template).substitute(
        title=escape(document.title),
        facts="".join(f"<dt>{escape(word)}<dd>{escape(text)}" for word, text in document.facts),
        links="".join(links),
        summary="".join(f"<p>{escape(sentence)}" for sentence in document.summary),
        pictures='<h2 id="pictures">Pictures</h2>' * bool(pictures) + pictures,
        tables="\n".join(_table_html(table) for table in document.tables),
    )


def _picture_html(caption, svg):
    """Return the HTML of a picture, given as SVG text, with its caption."""
    data = base64.b64encode(svg.encode()).decode()
    text = escape(caption)
    return (
        f'<figure><img alt="{text}" src="data:image/svg+xml;base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>\n"
    )


def _table_html(table):
    """Return the HTML of a `DocumentTable` with its title and its notes."""
    parts = "\n".join(
        _table_part_html(part, f"{table.title}, part {k} of {len(table.parts)}")
        for k, part in enumerate(table.parts, 1)
    )
    notes = "".join(f'<p class="note">{escape(note)}' for note in table.notes)
    title = f'<h2 id="table-{escape(table.name)}">{escape(table.title)}</h2>'
    empty = "" if parts or notes else '<p class="note">none'
    return f"<section{' class=wide' * table.landscape}>{title}{parts}{empty}{notes}</section>"


def _table_part_html(part, label):
    """Return the HTML of a `ShownTable`; screen readers read `label`."""
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
