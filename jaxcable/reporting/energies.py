"""The table of a report on work and energy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..analysis.phases import Phase
from ..analysis.solution import Solution, State
from ..common.units import SI, Units
from ..model.structure import Structure
from ..results.energy import energy_balance
from .table import Column, Table, make_table

_IMBALANCE = 0.05
"""Imbalance over the largest term of a phase from which there is a note.

The trapezoidal rule leaves a few per cent where a net stiffens in ten increments; more shows a
jump.
"""
_TERMS = {
    "dead": "gravity-type loads",
    "following": "follower loads",
    "supports": "support movements",
    "prestress": "prestress",
    "stored": "stored energy",
    "dissipated": "dissipated energy",
    "imbalance": "imbalance",
}
"""Terms of `EnergyBalance`, which are columns, and their headings."""


def energy_table(
    structure: Structure,
    solution: Solution,
    phases: Sequence[Phase],
    start: Solution | State | None = None,
    names: Sequence[str] | None = None,
    *,
    units: Units = SI,
) -> Table:
    """Return the energy balance as a table: works, stored and dissipated energy of each phase, J.

    Args:
        structure, phases, solution, start: as for `energy_balance`.
        names: names of the phases; None for their numbers.

    Options:
        units: `Units` of the numbers in the notes.
    """
    balance = energy_balance(structure, phases, solution, start)
    count = len(balance.relative_imbalance)
    labels = list(range(1, count + 1)) if names is None else [*map(str, names)]
    columns = [
        Column("phase", "", labels),
        *(
            Column(term, "J", np.asarray(getattr(balance, term)), heading=heading)
            for term, heading in _TERMS.items()
        ),
        Column("part", "%", 100 * np.asarray(balance.relative_imbalance), heading="imbalance"),
    ]
    notes = [
        f"energy stored at the end: {units.text(balance.level[-1], 'J')}",
        "work is summed over load steps by the trapezoidal rule: four times more accurate with "
        "twice as many increments",
        "imbalance in %: of the largest term of the phase",
    ]
    for k, gaps in enumerate(balance.increments):
        if balance.relative_imbalance[k] > _IMBALANCE and len(gaps):
            worst = int(np.abs(gaps).argmax())
            notes.append(
                f"phase {labels[k]} does not balance: {units.text(gaps[worst], 'J', '.3g')} in "
                f"increment {worst + 1} of {len(gaps)}. Either the structure jumped there, or it "
                "was not in equilibrium when the phase began, or more increments are needed"
            )
    return make_table("Energy: work = stored + dissipated + imbalance", columns, notes)
