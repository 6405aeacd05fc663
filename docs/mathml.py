"""Formulas of the site as MathML, which browsers draw themselves, without scripts or network."""

from docutils import nodes
from latex2mathml.converter import convert


def _write_inline(writer, node):
    """Write a formula in a line of text."""
    writer.body.append(convert(node.astext(), display="inline"))
    raise nodes.SkipNode


def _write_block(writer, node):
    """Write a formula in lines of its own."""
    writer.body.append(writer.starttag(node, "div", CLASS="math-block"))
    writer.body.append(convert(node.astext(), display="block"))
    writer.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app):
    """Register the writer of formulas, `html_math_renderer = "mathml"`."""
    app.add_html_math_renderer("mathml", (_write_inline, None), (_write_block, None))
    return {"parallel_read_safe": True}
