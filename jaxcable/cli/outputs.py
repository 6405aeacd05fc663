"""Output of commands: results, scenes, pictures and reports, by the suffix of the file."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from ..analysis.solution import Solution
from ..common.status import OK, AnalysisError, raise_if_failed
from ..files import save_dxf, save_network, save_opensees, save_result, save_vtk
from ..model.structure import Structure
from ..plots import style
from .guard import FAILED, Refused, refusing, require_ours, require_writable, say

PICTURES = (".png", ".pdf", ".svg")
RESULTS = (".json", ".npz", ".csv", ".vtk", ".py", ".dxf")
PAGES = (".html", ".htm")
REPORTS = (".txt", ".json", ".csv")

_WRITERS: tuple[tuple[str, Callable[..., list[Path]]], ...] = (
    (".compas.json", save_network),
    (".dxf", save_dxf),
    (".vtk", save_vtk),
    (".py", save_opensees),
)
"""Ends of names of results, and what writes them; `save_result` writes the others."""


def check_suffix(path: str | None, known: Sequence[str], option: str) -> None:
    """Raise `Refused`, naming the option, if a path has none of the known suffixes."""
    if path is not None and Path(path).suffix.lower() not in known:
        raise Refused(f"{option} {path}: expected a name that ends with {', '.join(known)}")


def target(
    given: str | None,
    known: Sequence[str],
    option: str = "--save",
    *,
    usual: str | Path | None = None,
    inputs: Sequence[str] = (),
) -> str:
    """The path of the file that a command writes, found fit for that before long work begins.

    It is empty if no file is named.

    Args:
        given: path on the command line, or None.
        known: suffixes that it can have.
        option: that names it.

    Options:
        usual: path of the file if none is given; it replaces only what this program has made.
        inputs: files that the command reads.
    """
    path = usual if given is None else given
    if path is None:
        return ""
    check_suffix(str(path), known, option)
    require_writable(path, inputs=inputs)
    if given is None:
        require_ours(path, option)
    return str(path)


def picture(figure: Figure, path: str) -> None:
    """Save a figure as a file of moderate size."""
    style.save(figure, path, dpi=130)


def result(path: str | Path, structure: Structure, solution: Solution) -> list[Path]:
    """Save a result in the format of the path's suffix; returns the paths of the files."""
    save = next((own for end, own in _WRITERS if str(path).lower().endswith(end)), save_result)
    if save is save_opensees and int(solution.status) != OK:
        say(f"{path}: not written: a failed analysis has no state to compute again")
        return []
    with refusing(path):
        return save(path, structure, solution)


def ended(scene: str, solution: Solution) -> int | None:
    """Exit status of a command whose analysis has ended: it says why if that has failed."""
    if int(solution.status) == OK:
        return None
    sys.stdout.flush()
    try:
        raise_if_failed(solution)
    except AnalysisError as error:
        say(f"{scene}: {error}")
    return FAILED
