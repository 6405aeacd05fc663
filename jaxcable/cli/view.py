"""``view``: analyse a scene and open an interactive 3-D view (HTML) of its phases and results."""

from __future__ import annotations

import webbrowser
from argparse import Namespace
from pathlib import Path

from . import file_names, outputs
from .solving import solve_and_show


def run(options: Namespace) -> int | None:
    """Analyse a scene, write its interactive page, and open it; return 1 if the analysis fails."""
    from .. import plots  # slow to import: matplotlib

    usual = file_names.path_beside(options.scene, ".html").name
    out = outputs.check_output_file(
        options.save, outputs.PAGES, usual=usual, inputs=[options.scene]
    )
    title = Path(options.scene).stem

    def show(scene, solution, units):
        known = {"structure": scene.structure, "names": scene.phase_names, "units": units}
        return plots.view(solution, out, title=title, **known)

    solution, page = solve_and_show(options, show)
    print(f"wrote {page.path}")
    if not options.no_open:
        webbrowser.open(page.path.resolve().as_uri())
    return outputs.report_failure(options, solution)
