"""The cutting list of a report: unstressed lengths of all elements."""

from __future__ import annotations

import numpy as np

from ..analysis import solution as results
from ..model.parts import first_and_last, groups_by_name, per_group
from ..model.structure import Structure
from .table import Table


def cutting_list(structure: Structure, solution: results.Solution) -> Table:
    """Unstressed lengths of all elements, at the temperature before the first phase."""
    lengths = per_group(structure, solution.last.rest_length)
    warmth = [state.warmth for state in solution.last.carry.states]
    lengths = [
        length if length is None or warm is None else length / np.asarray(warm)
        for length, warm in zip(lengths, warmth, strict=True)
    ]
    notes = ["at the temperature before the first phase"]
    rows = []
    for (label, group), length in zip(groups_by_name(structure), lengths, strict=True):
        if length is None:  # a group without unstressed lengths
            continue
        ends = first_and_last(group).tolist()
        rows += [[label, k, *ends[k], float(length[k])] for k in range(len(ends))]
        notes.append(
            f"{label or 'all'}: {len(ends)} pieces, {float(np.sum(length)):.3f} m in total"
        )
    columns = ("group", "element", "first", "last", "unstressed length")
    return Table("Cutting list", columns, ("", "", "", "", "m"), rows, tuple(notes))
