"""The analysis of a scene, for commands that show it."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from typing import TypeVar

from ..analysis import solver
from ..analysis.solution import Solution
from ..model.structure import Structure
from . import inputs
from .guard import refusing

_Shown = TypeVar("_Shown")


def shown(
    options: Namespace, show: Callable[[Structure, Solution], _Shown]
) -> tuple[Solution, _Shown]:
    """The solution of the scene of a command, and what `show` makes of structure and solution."""
    structure, phases = inputs.scene(options)
    with refusing(options.scene):
        solution = solver.solve(structure, phases, progress=not options.quiet)
        return solution, show(structure, solution)
