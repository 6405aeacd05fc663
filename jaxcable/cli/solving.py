"""The analysis of a scene, for commands that show its result."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Sequence
from typing import TypeVar

from ..analysis import solver
from ..analysis.phases import Phase
from ..analysis.solution import Solution
from ..common.units import Units
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..model.structure import Structure
from ..scenes import Scene
from . import inputs
from .guard import refuse_value_errors

_Shown = TypeVar("_Shown")

_LONG_ANALYSIS = 200_000
"""Nodes times increments from which an analysis may take seconds, and its progress is shown.

Smaller ones share their program with all other analyses from Python: it does not report."""


def solve_and_show(
    options: Namespace, show: Callable[[Scene, Solution, Units | None], _Shown]
) -> tuple[Solution, _Shown]:
    """Analyse the scene of a command; return the solution and `show(scene, solution, units)`.

    `units` are those in which the command shows the scene, None for SI.

    A ValueError of either becomes a message with the name of the scene.
    """
    scene = inputs.read_scene(options)
    units = inputs.shown_units(options, scene)
    with refuse_value_errors(options.scene):
        solution = solve_scene(options, *scene)
        return solution, show(scene, solution, units)


def solve_scene(
    options: Namespace,
    structure: Structure,
    phases: Sequence[Phase],
    method: Newton | Incremental | None = None,
) -> Solution:
    """Analyse a scene for a command; show the progress of a long analysis on stderr."""
    long = is_long_analysis(options, structure, sum(phase.increments for phase in phases))
    return solver.solve(structure, phases, method, progress=long or None)


def is_long_analysis(options: Namespace, structure: Structure, increments: int) -> bool:
    """Return whether an analysis with some increments may take seconds, and is to say so."""
    return structure.n_node * increments > _LONG_ANALYSIS and not options.quiet
