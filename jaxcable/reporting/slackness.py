"""The tables of a report on slack cables, open contacts, and nodes that only these hold."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..model.result_parts import (
    loose_nodes,
    named_groups_of,
    present_elements,
    slack_elements,
    values_per_group,
)
from .columns import states_heading
from .states import ReportedAnalysis
from .table import Table, columns_of_rows, make_table


def slackness_tables(of: ReportedAnalysis) -> dict[str, Table]:
    """Return the tables "slack" and "loose" as a dict, without those that would be empty.

    The first has the cables without tension, and open contacts and bearings, with the states in
    which they are slack; the second the nodes that only slack elements hold. Pinned nodes, and
    inactive nodes of construction stages, do not count.
    """
    structure = of.structure
    slack_in: dict[tuple[Any, ...], list[str]] = {}
    loose_in: dict[tuple[Any, ...], list[str]] = {}
    for name, (state, fixed) in of.every.items():
        tensions = values_per_group(structure, state.tension)
        masks = present_elements(structure, state.present)
        for (label, group), force, present in zip(
            named_groups_of(structure), tensions, masks, strict=True
        ):
            for k in np.flatnonzero(slack_elements(group, force, present)):
                slack_in.setdefault((label, int(k)), []).append(name)
        for k in np.flatnonzero(loose_nodes(structure, state, fixed.array)):
            loose_in.setdefault((int(k),), []).append(name)
    words = "slack cables"
    if any(group.compression_only for group in structure.groups):
        words = "slack cables, open contacts"
    parts = (
        ("slack", words.capitalize(), ("group", "element"), slack_in),
        ("loose", f"Nodes attached to {words} only", ("node",), loose_in),
    )
    tables = {}
    for key, title, names, found in parts:
        heading = states_heading([name for names in found.values() for name in names])
        rows = [(*place, ", ".join(states)) for place, states in found.items()]
        if rows:
            columns = columns_of_rows(rows, *names, ("in", "", heading))
            tables[key] = make_table(title, columns)
    return tables
