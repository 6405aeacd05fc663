"""Output of commands: results, scenes, pictures and reports, by the suffix of the file."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from ..analysis.solution import Solution
from ..common.status import OK, AnalysisError, raise_if_failed
from ..files import save_dxf, save_network, save_opensees, save_result, save_vtk
from ..model.structure import Structure
from ..plots import style
from .guard import FAILED, Refused, say

PICTURES = (".png", ".pdf", ".svg")
RESULTS = (".json", ".npz", ".csv", ".vtk", ".py", ".dxf")
PAGES = (".html", ".htm")
REPORTS = (".txt", ".json", ".csv")


def check_suffix(path: str | None, known: Sequence[str], option: str) -> None:
    """Raise `Refused`, naming the option, if a path has none of the known suffixes."""
    if path is not None and Path(path).suffix.lower() not in known:
        raise Refused(f"{option} {path}: expected a name that ends with {', '.join(known)}")


def picture(figure: Figure, path: str) -> None:
    """Save a figure as a file of moderate size."""
    style.save(figure, path, dpi=130)


def result(path: str | Path, structure: Structure, solution: Solution) -> list[Path]:
    """Save a result in the format of the path's suffix; returns the paths of the files."""
    path = Path(path)
    try:
        if path.suffix.lower() == ".dxf":
            return save_dxf(path, structure, solution)
        if path.name.lower().endswith(".compas.json"):
            return save_network(path, structure, solution)
    except ValueError as error:
        raise Refused(f"{path}: {error}") from None
    suffix = path.suffix.lower()
    if suffix == ".vtk":
        return save_vtk(path, structure, solution)
    if suffix == ".py":
        if int(solution.status) != OK:
            say(f"{path}: not written: a failed analysis has no state to compute again")
            return []
        return save_opensees(path, structure, solution)
    return save_result(path, structure, solution)


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
