"""The tables of a report on what is slack: cables, and nodes that only slack cables touch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..model.parts import groups_by_name, per_group, slack_cables, there
from ..model.structure import Structure
from .states import State
from .table import Column, Table, tabled


def slack(structure: Structure, states: Mapping[str, State]) -> Table:
    """Cables without tension, and the states in which they are slack."""
    found = {}
    for name, (state, _) in states.items():
        for label, _, _, slack in _groups(structure, state):
            for k in np.flatnonzero(slack):
                found.setdefault((label, int(k)), []).append(name)
    columns = [Column("group", "", [label for label, _ in found])]
    columns += [Column("element", "", [k for _, k in found]), _states(found)]
    return tabled("Slack cables", columns, () if found else ("none",))


def loose(structure, states):
    """Nodes that only slack cables touch, but for pinned ones, and the states in which they are."""
    found = {}
    for name, (state, fixed) in states.items():
        taut = fixed.array[: structure.n_node, :3].all(axis=1)
        touched = np.zeros(structure.n_node, bool)  # a node that waits is not loose
        for _, links, present, slack in _groups(structure, state):
            touched[links[present]] = True
            taut[links[present & ~slack]] = True
        for k in np.flatnonzero(~taut & touched):
            found.setdefault(int(k), []).append(name)
    columns = [Column("node", "", list(found)), _states(found)]
    return tabled("Loose nodes", columns, () if found else ("none",))


def _groups(structure, state):
    """Of every group its name, its links, and which elements are there, and which slack."""
    parts = per_group(structure, state.tension), there(structure, state.present)
    for (label, group), force, present in zip(groups_by_name(structure), *parts, strict=True):
        yield label, group.links.array, present, slack_cables(group, force, present)


def _states(found):
    """The column that says in which states a node or an element is what it is."""
    return Column("in", "", [", ".join(names) for names in found.values()])
