"""The table of a report on work and energy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..analysis.phases import Phase
from ..analysis.solution import Solution, State
from ..results.energy import energy_balance
from .states import ReportedAnalysis
from .table import Column, Table, make_table

# Imbalance over the largest term of a phase from which there is a note: the trapezoidal rule leaves
# a few per cent where a net stiffens in ten increments; more shows a jump.
_IMBALANCE = 0.05
_TERMS = {  # of `EnergyBalance`, which are columns, and their headings
    "dead": "gravity-type loads",
    "following": "follower loads",
    "supports": "support movements",
    "prestress": "prestress",
    "stored": "stored energy",
    "dissipated": "dissipated energy",
    "imbalance": "imbalance",
}


def energy_table(
    of: ReportedAnalysis,
    phases: Sequence[Phase],
    start: Solution | State | None,
    names: Sequence[str] | None,
) -> Table:
    """Return the energy balance as a table: works, stored and dissipated energy of each phase, J.

    Args:
        of: `ReportedAnalysis`.
        phases, start: as for `energy_balance`.
        names: names of the phases; None for their numbers.
    """
    balance = energy_balance(of.structure, phases, of.solution, start)
    labels = [*range(1, len(phases) + 1)] if names is None else [*map(str, names)]
    columns = [
        Column("phase", "", labels),
        *(Column(k, "J", np.asarray(getattr(balance, k)), head) for k, head in _TERMS.items()),
        Column("part", "%", 100 * np.asarray(balance.relative_imbalance), "imbalance"),
    ]
    notes = [
        f"energy stored at the end: {of.units.text(balance.level[-1], 'J')}",
        "work is summed over load steps by the trapezoidal rule: four times more accurate with "
        "twice as many increments",
        "imbalance in %: of the largest term of the phase",
    ]
    for k, gaps in enumerate(balance.increments):
        if balance.relative_imbalance[k] > _IMBALANCE and len(gaps):
            worst = int(np.abs(gaps).argmax())
            notes.append(
                f"phase {labels[k]} does not balance: {of.units.text(gaps[worst], 'J', '.3g')} in "
                f"increment {worst + 1} of {len(gaps)}. Either the structure jumped there, or it "
                "was not in equilibrium when the phase began, or more increments are needed"
            )
    return make_table("Energy: work = stored + dissipated + imbalance", columns, notes)
