"""The table of a report on natural modes: frequencies, periods, shares of mass."""

from __future__ import annotations

import numpy as np

from ..common import checks
from ..dynamics.modes import NaturalModes
from .table import Column, Table, make_table


def mode_table(modes: NaturalModes) -> Table:
    """Return the table of natural modes: frequency, period, effective masses over those that move.

    Sums of shares say how much of the mass the modes have up to each of them.

    Raises:
        ValueError: no `NaturalModes`, or modes that were not found.
    """
    if not isinstance(modes, NaturalModes):
        kind = checks.describe_type(modes, "dynamics.modes(structure, solution)")
        raise ValueError(f"modes: expected NaturalModes, got {kind}")
    if np.ndim(modes.status) != 0 or int(modes.status) != 0:
        raise ValueError("modes: were not found, or are a batch; see describe(modes.status)")
    frequency, total = np.asarray(modes.frequency), np.asarray(modes.total_mass)
    moves = total > 0
    share = np.where(moves, np.asarray(modes.effective_mass) / np.where(moves, total, 1.0), np.nan)
    sums = np.cumsum(share, axis=0)
    columns = [
        Column("mode", "", np.arange(1, len(frequency) + 1)),
        Column("frequency", "Hz", frequency),
        Column("period", "s", 1 / frequency),
        *[Column(f"mass {axis}", "-", share[:, k]) for k, axis in enumerate("xyz")],
        *[Column(f"sum {axis}", "-", sums[:, k]) for k, axis in enumerate("xyz")],
    ]
    notes = [
        "effective masses over the mass that can move: "
        + ", ".join(f"{mass:.4g} kg along {axis}" for mass, axis in zip(total, "xyz", strict=True))
    ]
    if np.asarray(modes.repeated).any():
        repeated = ", ".join(str(k + 1) for k in np.flatnonzero(modes.repeated))
        notes.append(f"modes {repeated}: equal frequencies, shapes are one basis of many")
    if np.isnan(frequency).any():
        notes.append("modes without a frequency have no stiffness: the state is not stable")
    return make_table("Natural modes about the final state", columns, notes)
