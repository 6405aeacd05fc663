"""``view``: analyse a scene and open a page in which it turns, with its phases and results."""

from __future__ import annotations

import webbrowser
from argparse import Namespace
from pathlib import Path

from .. import plots
from . import derived, outputs
from .analysed import shown


def run(options: Namespace) -> int | None:
    """Write and open the page; returns the exit status, 1 if the analysis fails."""
    usual = derived.beside(options.scene, ".html").name
    out = outputs.target(options.save, outputs.PAGES, usual=usual, inputs=[options.scene])
    title = Path(options.scene).stem
    solution, page = shown(
        options,
        lambda structure, solution: plots.view(solution, out, structure=structure, title=title),
    )
    print(f"wrote {page.path}")
    if not options.no_open:
        webbrowser.open(page.path.resolve().as_uri())
    return outputs.ended(options.scene, solution)
