"""The analysis of a scene, for commands that show its result."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from typing import TypeVar

from ..analysis import solver
from ..analysis.solution import Solution
from ..model.structure import Structure
from . import inputs
from .guard import refuse_value_errors

_Shown = TypeVar("_Shown")


def solve_and_show(
    options: Namespace, show: Callable[[Structure, Solution], _Shown]
) -> tuple[Solution, _Shown]:
    """Analyse the scene of a command; return the solution and `show(structure, solution)`.

    A ValueError of either becomes a message with the name of the scene.
    """
    structure, phases = inputs.read_scene(options)
    with refuse_value_errors(options.scene):
        solution = solver.solve(structure, phases, progress=not options.quiet)
        return solution, show(structure, solution)
