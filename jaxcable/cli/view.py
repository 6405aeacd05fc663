"""``view``: analyse a scene and open a page in which it turns."""

from __future__ import annotations

import webbrowser
from argparse import Namespace
from pathlib import Path

from .. import plots
from ..analysis import solver
from . import inputs, outputs
from .guard import Refused, require_writable


def run(options: Namespace) -> int | None:
    """Write and open the page; returns the exit status, 1 if the analysis fails."""
    out = Path(options.scene).with_suffix(".html").name if options.out is None else options.out
    outputs.check_suffix(out, outputs.PAGES, "--out")
    require_writable(out)
    structure, phases = inputs.scene(options)
    try:
        solution = solver.solve(structure, phases, progress=not options.quiet)
        page = plots.view(solution, out, structure=structure, title=Path(options.scene).stem)
    except ValueError as error:
        raise Refused(f"{options.scene}: {error}") from None
    if not options.quiet:
        print(f"wrote {page.path}")
    if not options.no_open:
        webbrowser.open(page.path.resolve().as_uri())
    return outputs.ended(options.scene, solution)
