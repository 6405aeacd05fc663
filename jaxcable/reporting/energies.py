"""The table of a report on work and energy."""

from __future__ import annotations

import numpy as np

from ..results.energy import energy_balance
from .table import Table

_IMBALANCE = 0.05  # imbalance over the largest term of a phase from which there is a note


def energy(structure, solution, phases, start=None):
    """Work of all that acts, and stored and dissipated energy, with a line per phase.

    Args:
        structure, phases, solution, start: as for `energy_balance`.
    """
    balance = energy_balance(structure, phases, solution, start)
    names = ("dead", "following", "supports", "prestress", "stored", "dissipated", "imbalance")
    values = [getattr(balance, name) for name in names]
    values = np.column_stack([*values, 100 * balance.relative]).tolist()
    rows = [[k, *terms] for k, terms in enumerate(values, 1)]
    notes = [
        f"stored at the end: {float(balance.level[-1]):.6g} J",
        "work by the trapezoidal rule, whose error falls with the square of the increments; "
        "part: imbalance over the largest term",
    ]
    for k, gaps in enumerate(balance.increments):
        if balance.relative[k] > _IMBALANCE and len(gaps):
            worst = int(np.abs(gaps).argmax())
            notes.append(
                f"phase {k + 1} is not balanced: {gaps[worst]:.3g} J in increment {worst + 1} of "
                f"{len(gaps)}; it jumped there, began out of balance, or needs more increments"
            )
    columns, units = ("phase", *names, "part"), ("", *["J"] * len(names), "%")
    return Table(
        "Energy: work = stored + dissipated + imbalance", columns, units, rows, tuple(notes)
    )
