"""The tables of a report on what is slack: cables, and nodes that only slack cables touch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..model.parts import groups_by_name, per_group, slack_cables, there
from ..model.structure import Structure
from .states import State
from .table import Table


def slack(structure: Structure, states: Mapping[str, State]) -> Table:
    """Cables without tension, and the states in which they are slack."""
    found = {}
    for name, state in states.items():
        parts = per_group(structure, state.tension), there(structure, state.present)
        for (label, group), force, present in zip(groups_by_name(structure), *parts, strict=True):
            for k in np.flatnonzero(slack_cables(group, force, present)):
                found.setdefault((label, int(k)), []).append(name)
    rows = [[label, k, ", ".join(names)] for (label, k), names in found.items()]
    notes = () if rows else ("none",)
    return Table("Slack cables", ("group", "element", "in"), ("", "", ""), rows, notes)


def loose(structure, states):
    """Nodes that only slack cables touch, but for pinned ones, and the states in which they are."""
    found = {}
    for name, state in states.items():
        taut = state.fixed.array[: structure.n_node, :3].all(axis=1)
        touched = np.zeros(structure.n_node, bool)  # a node that waits is not loose
        parts = (
            structure.groups,
            per_group(structure, state.tension),
            there(structure, state.present),
        )
        for group, force, present in zip(*parts, strict=True):
            slack = slack_cables(group, force, present)
            touched[group.links.array[present]] = True
            taut[group.links.array[present & ~slack]] = True
        for k in np.flatnonzero(~taut & touched):
            found.setdefault(int(k), []).append(name)
    rows = [[k, ", ".join(names)] for k, names in found.items()]
    return Table("Loose nodes", ("node", "in"), ("", ""), rows, () if rows else ("none",))
