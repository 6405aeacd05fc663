"""The table of a report on work and energy."""

from __future__ import annotations

import numpy as np

from ..results.energy import energy_balance
from .table import Column, tabled

_IMBALANCE = 0.05  # imbalance over the largest term of a phase from which there is a note


def energy(structure, solution, phases, start=None, names=None):
    """Work of all that acts, and stored and dissipated energy, with a line per phase.

    Args:
        structure, phases, solution, start: as for `energy_balance`.
        names: of the phases; None for their numbers.
    """
    balance = energy_balance(structure, phases, solution, start)
    terms = ("dead", "following", "supports", "prestress", "stored", "dissipated", "imbalance")
    called = (
        list(range(1, len(balance.relative_imbalance) + 1)) if names is None else [*map(str, names)]
    )
    columns = [
        Column("phase", "", called),
        *(Column(term, "J", np.asarray(getattr(balance, term))) for term in terms),
        Column("part", "%", 100 * np.asarray(balance.relative_imbalance)),
    ]
    notes = [
        f"stored at the end: {float(balance.level[-1]):.6g} J",
        "work by the trapezoidal rule, whose error falls with the square of the increments; "
        "part: imbalance over the largest term",
    ]
    for k, gaps in enumerate(balance.increments):
        if balance.relative_imbalance[k] > _IMBALANCE and len(gaps):
            worst = int(np.abs(gaps).argmax())
            notes.append(
                f"phase {called[k]} is not balanced: {gaps[worst]:.3g} J in increment "
                f"{worst + 1} of {len(gaps)}; it jumped there, began out of balance, or needs more "
                "increments"
            )
    return tabled("Energy: work = stored + dissipated + imbalance", columns, notes)
