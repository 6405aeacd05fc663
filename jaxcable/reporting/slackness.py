"""The tables of a report on slack cables, and on nodes that are attached to slack cables only."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..model.result_parts import named_groups_of, present_elements, slack_cables, values_per_group
from ..model.structure import Structure
from .columns import states_heading
from .states import EnvelopeState
from .table import Column, Table, make_table


def slack_cable_table(structure: Structure, states: Mapping[str, EnvelopeState]) -> Table:
    """Return the table of the cables without tension, and of the states in which they are slack."""
    found: dict[tuple[str, int], list[str]] = {}
    for name, (state, _) in states.items():
        for label, _, _, slack in _cable_groups(structure, state):
            for k in np.flatnonzero(slack):
                found.setdefault((label, int(k)), []).append(name)
    columns = [Column("group", "", [label for label, _ in found])]
    columns += [Column("element", "", [k for _, k in found]), _states_column(found)]
    return make_table("Slack cables", columns, () if found else ("none",))


def loose_node_table(structure: Structure, states: Mapping[str, EnvelopeState]) -> Table:
    """Return the table of nodes that only slack cables hold, with the states where this is so.

    Pinned nodes, and inactive nodes of construction stages, do not count.
    """
    found: dict[int, list[str]] = {}
    for name, (state, fixed) in states.items():
        held = np.array(fixed.array[: structure.n_node, :3].all(axis=1))
        attached = np.zeros(structure.n_node, bool)
        for _, links, present, slack in _cable_groups(structure, state):
            attached[links[present]] = True
            held[links[present & ~slack]] = True
        for k in np.flatnonzero(~held & attached):
            found.setdefault(int(k), []).append(name)
    columns = [Column("node", "", list(found)), _states_column(found)]
    return make_table("Nodes attached to slack cables only", columns, () if found else ("none",))


def _cable_groups(structure, state):
    """Generate for every group its name, its links, and which elements are active and slack."""
    parts = values_per_group(structure, state.tension), present_elements(structure, state.present)
    for (label, group), force, present in zip(named_groups_of(structure), *parts, strict=True):
        yield label, group.links.array, present, slack_cables(group, force, present)


def _states_column(found):
    """Return the column "in", which lists for each row the names of states.

    `found` is a dict from node or element, a row each, to the names of the states.
    """
    heading = states_heading([name for names in found.values() for name in names])
    return Column("in", "", [", ".join(names) for names in found.values()], heading=heading)
