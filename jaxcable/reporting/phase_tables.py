"""The tables of a report on the ends of all phases: forces, reactions, displacements in stages."""

from __future__ import annotations

from collections.abc import Mapping

from .axial_forces import peak_forces
from .columns import concatenate_groups, element_columns, without_blank_rows
from .displacements import displacement_tables
from .reactions import reactions_by_phase_table
from .states import EnvelopeState, ReportedAnalysis
from .table import Column, Table, make_table

_LEAST = 3  # phases from which on there are these tables: others show two, prestress and loading


def phase_tables(of: ReportedAnalysis, phases: Mapping[str, EnvelopeState]) -> dict[str, Table]:
    """Return the tables ``forces_by_phase``, ``reactions_by_phase``, ``displacements_by_phase``.

    The dict is empty for less than three phases. Displacements are in it where a report is on load
    cases, on which its table ``displacements`` is then. `phases` are the ends of the converged
    phases, by name.
    """
    if len(of.solution.phases) < _LEAST or not phases:
        return {}
    found = {
        "forces_by_phase": _force_table(of.structure, phases),
        "reactions_by_phase": reactions_by_phase_table(of.structure, phases),
    }
    if of.cases is not None:
        moved = displacement_tables(of._replace(envelope=phases, cases=None))
        if moved:
            found["displacements_by_phase"] = moved["displacements"]
    return found


def _force_table(structure, phases):
    """Return the table of axial forces of all elements, with a column for the end of each phase.

    `phases` are the ends of phases by name, `EnvelopeState`.
    """
    each = [peak_forces(structure, end.result) for end in phases.values()]
    kept = [k for k, force in enumerate(each[0]) if force is not None]
    columns = element_columns(structure, kept)
    columns += [
        Column(name, "N", concatenate_groups(structure, forces, kept))
        for name, forces in zip(phases, each, strict=True)
    ]
    title = "Axial forces at the end of each phase (largest along each element), tension positive"
    return make_table(title, without_blank_rows(columns, 4), ["blank: the element is not active"])
