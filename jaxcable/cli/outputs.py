"""Output of commands: results, scenes, pictures and reports, by the suffix of the file."""

from __future__ import annotations

import dataclasses
import re
import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..analysis.solution import Solution
from ..common.status import (
    BEYOND_PEAK,
    DRIFTED,
    NOT_CONVERGED,
    OK,
    SINGULAR,
    AnalysisError,
    describe,
    raise_if_failed,
)
from ..common.units import Units
from ..files import save_dxf, save_network, save_opensees, save_result, save_vtk
from ..model.structure import Structure
from ..reporting.result_report import SUFFIXES, Report
from .guard import (
    FAILED,
    BadInput,
    print_message,
    refuse_value_errors,
    require_own_file,
    require_writable,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES = (".png", ".pdf", ".svg")
RESULTS = (".json", ".npz", ".csv", ".vtk", ".py", ".dxf")
PAGES = (".html", ".htm")
REPORTS = SUFFIXES  # of reports

_WRITERS: tuple[tuple[str, Callable[..., list[Path]]], ...] = (
    (".compas.json", save_network),
    (".dxf", save_dxf),
    (".vtk", save_vtk),
    (".py", save_opensees),
)
"""Endings of names of results, and what writes them; `save_result` writes all others."""

_IN_UNITS = (".csv", ".vtk", ".dxf")
"""Endings of results that can be in other units than SI."""


_RESIDUAL = re.compile(r", residual \S+ N(?=: )")
"""The residual in a message of `raise_if_failed`, whose size says nothing if steps diverge."""
_ADVICE = {
    NOT_CONVERGED: (
        "no equilibrium found. Likely: a mechanism (without prestress a net has no stiffness "
        "across its surface; a frame may lack a support or turn about a hinge), or a load beyond "
        "the capacity. Try: more increments; check supports, prestress and units"
    ),
    SINGULAR: (
        "the stiffness of an increment is singular, so the incremental method cannot step. Try: "
        "leave out --corrections, or prestress the structure before it is loaded"
    ),
    DRIFTED: (
        "the unbalanced force of the incremental method is too large. Try: more increments, more "
        "--corrections, or leave out --corrections"
    ),
    BEYOND_PEAK: (
        "no equilibrium found below the peaks of the stress-strain curves, nor beyond them: the "
        "load is more than the structure carries. Reduce it, or strengthen the elements with the "
        "largest strains"
    ),
}
"""What failed and what to try, where the text of the status names arguments of Python."""


def check_suffix(path: str | None, known: Sequence[str], option: str) -> None:
    """Raise `BadInput`, naming the option, if a path has none of the known suffixes.

    No path (None) is accepted.
    """
    if path is not None and Path(path).suffix.lower() not in known:
        raise BadInput(f"{option} {path}: expected a name that ends with {', '.join(known)}")


def check_output_file(
    given: str | None,
    known: Sequence[str],
    option: str = "--save",
    *,
    usual: str | Path | None = None,
    inputs: Sequence[str] = (),
) -> str:
    """Return the path of the file that a command writes; raise before long work if it cannot.

    The path is "" if there is neither a given nor a usual one.

    Args:
        given: path on the command line, or None.
        known: suffixes that the path can have.
        option: option that names the file.

    Options:
        usual: path if none is given; it replaces only a file that this program has written.
        inputs: files that the command reads.
    """
    path = usual if given is None else given
    if path is None:
        return ""
    check_suffix(str(path), known, option)
    require_writable(path, inputs=inputs)
    if given is None:
        require_own_file(path, option)
    return str(path)


def save_picture(figure: Figure, path: str) -> None:
    """Save a figure in the format of the suffix, with 130 pixels per inch."""
    from ..plots import style  # slow to import: matplotlib

    style.save_figure(figure, path, dpi=130)


def check_study_files(
    options: Namespace, saved: Sequence[str], inputs: Sequence[str | None]
) -> None:
    """Raise `BadInput` for files of a study that cannot be written: --save, --plot, --report.

    `saved` are the suffixes of --save, `inputs` the files that the command reads, or None.
    """
    reports = [path for path in options.report if path != "-"]
    check_suffix(options.save, saved, "--save")
    check_suffix(options.plot, PICTURES, "--plot")
    for path in reports:
        check_suffix(path, REPORTS, "--report")
    known = [path for path in inputs if path is not None]
    require_writable(options.save, options.plot, *reports, inputs=known)


def print_study(
    options: Namespace,
    report: Report,
    title: str,
    draw: Callable[[], dict[str, Figure]],
    wrote: Sequence[str | Path],
    shown: Sequence[str] = (),
) -> None:
    """Write the reports and the picture of a study, print it, and the names of all files.

    What is printed are the sentences, and the tables `shown`, or all with ``--report -``.

    Args:
        options: of the command: report, title, plot.
        report: the `Report`.
        title: of the report, where the options have none.
        draw: function that draws the picture, a dict of one figure by its caption.
        wrote: files that the command has written already.
        shown: names of tables of the report.
    """
    names = list(wrote)
    for path in options.report:
        if path != "-":
            pictures = draw() if path.lower().endswith((".pdf", *PAGES)) else None
            names += report.save(path, title=options.title or title, pictures=pictures)
    if options.plot is not None:
        (figure,) = draw().values()
        save_picture(figure, options.plot)
        names.append(options.plot)
    if "-" not in options.report:
        report = dataclasses.replace(report, tables={key: report.tables[key] for key in shown})
    print(report.text().rstrip("\n"))
    for name in names:
        print(f"wrote {name}")


def save_solution(
    path: str | Path, structure: Structure, solution: Solution, units: Units | None = None
) -> list[Path]:
    """Save a result in the format of the path's suffix; return the paths of the files.

    CSV tables, VTK files and drawings are in `units`, None for SI; other formats are in SI units.

    An OpenSees script of a failed analysis is not written, and a message says so.
    """
    save = next((own for end, own in _WRITERS if str(path).lower().endswith(end)), save_result)
    if save is save_opensees and int(solution.status) != OK:
        print_message(
            f"{path}: not written: the analysis failed, so that there is no state for OpenSees"
        )
        return []
    takes_units = str(path).lower().endswith(_IN_UNITS) and units is not None
    with refuse_value_errors(path):
        return save(path, structure, solution, **({"units": units} if takes_units else {}))


def report_failure(options: Namespace, solution: Solution) -> int | None:
    """Print why an analysis has failed; return exit status 1, or None if it has not failed.

    The texts of `status` name arguments of Python; here they name what a user of the command line
    can change.
    """
    if int(solution.status) == OK:
        return None
    sys.stdout.flush()
    try:
        raise_if_failed(solution)
    except AnalysisError as error:
        text = _RESIDUAL.sub("", str(error))
        code = int(solution.status)
        if code in _ADVICE:
            text = text.replace(describe(code), _ADVICE[code])
        print_message(f"{options.scene}: {text}")
    return FAILED
