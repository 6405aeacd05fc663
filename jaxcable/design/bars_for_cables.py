"""Bars in place of cables: no kinks of slack cables while a search is far from its end."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import numpy as np

from ..analysis.phases import Phase
from ..analysis.preparation import prepare
from ..analysis.solution import Solution
from ..analysis.solver import solve
from ..common import checks, status
from ..common.compilation import is_top_level_call
from ..common.tree import copy_with, replace
from ..elements import Bars, Cables
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..model import plausibility
from ..model.result_parts import values_per_group
from ..model.structure import Structure
from ..model.topology import topology_of

_TAUT = 1e-4  # part of the largest force of a group above which a cable is taut: far above rounding


def replace_cables_by_bars(structure: Structure) -> Structure | None:
    """Return the structure with its cables replaced by bars, which also bear compression.

    None if it has no `Cables`, or nothing but groups that bear tension only.
    """
    kinds = {type(group) for group in structure.groups}
    if Cables not in kinds or all(group.tension_only for group in structure.groups):
        return None
    kept = [field.name for field in dataclasses.fields(Bars)]
    groups = [
        Bars(**{name: getattr(group, name) for name in kept}) if type(group) is Cables else group
        for group in structure.groups
    ]
    return replace(structure, elements=structure.arrange(groups))


def solve_with_bars_if_taut(
    structure: Structure,
    pressing: Structure,
    phases: Sequence[Phase],
    method: Newton | Incremental | None,
) -> Solution:
    """Solve phases by the program with bars in place of cables, which the search has compiled.

    Where all cables are taut at the end of every increment, these are equilibria with cables, too.
    Else, and while traced, the phases are solved with cables.

    Args:
        structure, phases, method: as for `solve`.
        pressing: the structure with bars in place of cables.

    Raises:
        ValueError: as `solve`, also where bars would take it, such as a force below zero.
    """
    if not is_top_level_call(jax.tree.leaves((structure, phases))):
        return solve(structure, phases, method)
    with checks.without_warnings():  # about bars; the search has warned about the input
        task = prepare(structure, phases, method, None, to_end=True)  # refuse what cables refuse
        solution = solve(pressing, phases, method)
    if not _all_cables_are_taut(structure, solution):
        return solve(structure, phases, method)
    if task.warns_if_unstable:
        plausibility.warn_if_unstable(solution)
    return copy_with(solution, last=copy_with(solution.last, topology=topology_of(structure)))


def _all_cables_are_taut(structure, solution):
    """Return whether an analysis has converged with all cables taut, as far as they are there.

    They are at the end of every increment.
    """
    if solution.status != status.OK:
        return False
    for phase in solution.phases:
        forces = values_per_group(structure, phase.path.tension)
        present = values_per_group(structure, phase.path.present)
        for group, force, there in zip(structure.groups, forces, present, strict=True):
            if type(group) is Cables:
                absent = False if there is None else ~np.asarray(there, bool)
                if not np.all((force > _TAUT * np.max(force, initial=0.0)) | absent):
                    return False
    return True
