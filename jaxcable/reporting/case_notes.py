"""Notes of tables over cases: which numbers are of the state before them, and which envelopes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from .table import Table

_STATE = {"equilibrium", "stresses", "cutting_list", "cables", "surfaces", "energy"}
_ENVELOPES = {"groups", "reaction_envelope", "displacement_envelope", "stress_envelope"}
_BOTH = {"reactions", "members", "tilts", "sags", "results", "N", "Vy", "Vz", "T", "My", "Mz"}


def with_case_notes(tables: Mapping[str, Table], count: int) -> dict[str, Table]:
    """Return tables with a note on which state, or which envelope, their numbers are of.

    Args:
        tables: tables of a report by name; those that have a row for each case get no note.
        count: number of cases in the envelopes.
    """
    cases = f"over {count} case" + "s" * (count != 1)
    state = "before the cases, without their loads and factors"
    notes = {
        **dict.fromkeys(_STATE, f"of the final state of the phases, {state}"),
        **dict.fromkeys(_ENVELOPES, f"envelope {cases}"),
        **dict.fromkeys(
            _BOTH,
            f"with a case beside it, or min. or max.: envelope {cases}; other numbers: final state "
            f"of the phases, {state}",
        ),
    }
    return {
        name: dataclasses.replace(table, notes=(*table.notes, notes[name]))
        if name in notes
        else table
        for name, table in tables.items()
    }
