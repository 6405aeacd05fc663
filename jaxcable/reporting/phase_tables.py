"""The tables of a report on the ends of all phases: forces, reactions, displacements in stages."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..analysis.solution import Solution
from ..common.negligible import NEGLIGIBLE
from ..common.types import Float
from ..model.structure import Structure
from .axial_forces import peak_forces
from .columns import concatenate_groups, element_columns
from .displacements import displacement_tables
from .reactions import ground_rows, supported_components, total_reaction
from .states import EnvelopeState
from .table import Column, Table, make_table

_LEAST = 3
"""Phases from which on there are these tables: two are prestress and loading, which others show."""
_COMPONENTS = {"Rx": "N", "Ry": "N", "Rz": "N", "Mx": "N m", "My": "N m", "Mz": "N m"}


def phase_tables(
    structure: Structure, solution: Solution, phases: Mapping[str, EnvelopeState], cases: bool
) -> dict[str, Table]:
    """Return the tables ``forces_by_phase``, ``reactions_by_phase``, ``displacements_by_phase``.

    Args:
        structure: `Structure`.
        solution: `Solution`; of one with less than three phases the dict is empty.
        phases: ends of its converged phases, by name.
        cases: whether the report is on load cases: table ``displacements`` then is on these, and
            that of phases comes here.
    """
    if len(solution.phases) < _LEAST or not phases:
        return {}
    found = {
        "forces_by_phase": _force_table(structure, phases),
        "reactions_by_phase": _reaction_table(structure, phases),
    }
    if cases:
        moved = displacement_tables(structure, solution, phases, False).get("displacements")
        if moved is not None:
            found["displacements_by_phase"] = moved
    return found


def _force_table(structure, phases):
    """Return the table of axial forces of all elements, with a column for the end of each phase."""
    each = [peak_forces(structure, end.result) for end in phases.values()]
    kept = [k for k, force in enumerate(each[0]) if force is not None]
    columns = element_columns(structure, kept)
    columns += [
        Column(name, "N", concatenate_groups(structure, forces, kept))
        for name, forces in zip(phases, each, strict=True)
    ]
    title = "Axial forces at the end of each phase (largest along each element), tension positive"
    return make_table(title, columns, ["blank: the element is not active"])


def _reaction_table(structure, phases):
    """Return the table of reactions at the end of each phase, with their sums."""
    values = {name: _reactions_by_place(structure, end) for name, end in phases.items()}
    every = np.abs(np.array(list(values.values())))  # NaN: not supported, which is no reaction
    force = np.nanmax(every[..., :3], initial=0.0)
    limits = NEGLIGIBLE * np.repeat([force, np.nanmax(every, initial=0.0)], 3)
    acts = (every > limits).any(axis=0)  # [n_place, 6]; NaN is not above
    rows = [
        [node, name, *(values[name][k] + 0.0)]
        for k, node in enumerate(_places(structure, next(iter(phases.values()))))
        if acts[k].any()
        for name in phases
    ]
    columns = [
        Column("node", "", [row[0] for row in rows]),
        Column("phase", "", [row[1] for row in rows]),
        *(
            Column(component, unit, np.array([row[2 + k] for row in rows], float))
            for k, (component, unit) in enumerate(_COMPONENTS.items())
            if k < 3 or acts[:, k].any()
        ),
    ]
    notes = ["sum: of the forces on all supports, springs and bearings; blank: not supported then"]
    return make_table("Reactions at the end of each phase (on the structure)", columns, notes)


def _places(structure, end):
    """Return what is in the rows of `_reactions_by_place`: nodes, nodes of springs, and "sum"."""
    pairs = zip(*ground_rows(structure, end.result)[:2], strict=True)
    ground = [f"{node}, {by}" for node, by in pairs]
    return [*range(structure.n_node), *ground, "sum"]


def _reactions_by_place(structure, end) -> Float[np.ndarray, "n_place 6"]:
    """Return reactions of a state by place, N and N m; NaN where it is not supported."""
    forces = np.asarray(end.result.reactions, float)
    moments = np.full_like(forces, np.nan)
    if end.result.reaction_moments is not None:
        moments = np.asarray(end.result.reaction_moments, float)
    held = supported_components(structure, end.fixed)
    found = np.where(held, np.hstack([forces, moments]), np.nan)
    total = np.full((1, 6), np.nan)  # moments about different places have no sum
    total[0, :3] = total_reaction(structure, end.result)
    return np.vstack([found, ground_rows(structure, end.result).values, total])
