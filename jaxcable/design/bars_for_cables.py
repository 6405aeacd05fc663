"""Bars in place of cables: no kinks of slack cables while a search is far from its end."""

from __future__ import annotations

import dataclasses

from ..common.tree import replace
from ..elements import Bars, Cables
from ..model.structure import Structure


def replace_cables_by_bars(structure: Structure) -> Structure | None:
    """Return the structure with its cables replaced by bars, which also bear compression.

    None if it has no `Cables`, or nothing but groups that bear tension only.
    """
    kinds = {type(group) for group in structure.groups}
    if Cables not in kinds or all(group.tension_only for group in structure.groups):
        return None
    kept = [field.name for field in dataclasses.fields(Bars)]
    groups = [
        Bars(**{name: getattr(group, name) for name in kept}) if type(group) is Cables else group
        for group in structure.groups
    ]
    return replace(structure, elements=structure.arrange(groups))
