"""``view``: analyse a scene and open a page in which it turns."""

from __future__ import annotations

import webbrowser
from argparse import Namespace
from pathlib import Path

from .. import plots
from . import derived, outputs
from .analysed import shown
from .guard import require_ours, require_writable


def run(options: Namespace) -> int | None:
    """Write and open the page; returns the exit status, 1 if the analysis fails."""
    usual = derived.beside(options.scene, ".html").name
    out = usual if options.save is None else options.save
    outputs.check_suffix(out, outputs.PAGES, "--save")
    require_writable(out, inputs=[options.scene])
    if options.save is None:
        require_ours(out)
    title = Path(options.scene).stem
    solution, page = shown(
        options,
        lambda structure, solution: plots.view(solution, out, structure=structure, title=title),
    )
    print(f"wrote {page.path}")
    if not options.no_open:
        webbrowser.open(page.path.resolve().as_uri())
    return outputs.ended(options.scene, solution)
