"""The tables of a report on slack cables, open contacts, and nodes that only these hold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..model.result_parts import named_groups_of, present_elements, slack_elements, values_per_group
from ..model.structure import Structure
from .columns import states_heading
from .states import EnvelopeState
from .table import Column, Table, make_table


def slackness_tables(structure: Structure, states: Mapping[str, EnvelopeState]) -> dict[str, Table]:
    """Return the tables "slack" and "loose" as a dict, without those that would be empty."""
    found = {
        "slack": _slack_cable_table(structure, states),
        "loose": _loose_node_table(structure, states),
    }
    return {name: table for name, table in found.items() if table.rows}


def _slack_cable_table(structure, states):
    """Return the table of the cables without tension, and of the states in which they are slack.

    It has the open contacts and bearings, too, if the structure has such elements.
    """
    found: dict[tuple[str, int], list[str]] = {}
    for name, (state, _) in states.items():
        for label, _, _, slack in _cable_groups(structure, state):
            for k in np.flatnonzero(slack):
                found.setdefault((label, int(k)), []).append(name)
    columns = [Column("group", "", [label for label, _ in found])]
    columns += [Column("element", "", [k for _, k in found]), _states_column(found)]
    return make_table(_slack_words(structure).capitalize(), columns)


def _loose_node_table(structure, states):
    """Return the table of nodes that only slack elements hold, with the states where this is so.

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
    return make_table(f"Nodes attached to {_slack_words(structure)} only", columns)


def _slack_words(structure):
    """Return what the slack elements of a structure are called in titles."""
    if any(group.compression_only for group in structure.groups):
        return "slack cables, open contacts"
    return "slack cables"


def _cable_groups(structure, state):
    """Generate for every group its name, its links, and which elements are active and slack."""
    parts = values_per_group(structure, state.tension), present_elements(structure, state.present)
    for (label, group), force, present in zip(named_groups_of(structure), *parts, strict=True):
        yield label, group.links.array, present, slack_elements(group, force, present)


def _states_column(found):
    """Return the column "in", which lists for each row the names of states.

    `found` is a dict from node or element, a row each, to the names of the states.
    """
    heading = states_heading([name for names in found.values() for name in names])
    return Column("in", "", [", ".join(names) for names in found.values()], heading=heading)
