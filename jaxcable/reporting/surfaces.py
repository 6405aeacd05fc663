"""The table of a report on surfaces: areas and weights of groups whose elements have faces."""

from __future__ import annotations

import numpy as np

from ..analysis.solution import State
from ..loads.faces import face_areas
from ..model.result_parts import named_groups_of, present_elements
from ..model.structure import Structure
from ..stiffness.vibration import STANDARD_GRAVITY
from .table import Column, Table, make_table


def surface_tables(structure: Structure, state: State) -> dict[str, Table]:
    """Return area, weight and mass per area of each group with faces: {"surfaces": `Table`}.

    Only active elements count. The dict is empty if no group has faces.
    """
    rows = []
    groups = (
        named_groups_of(structure),
        state.restart.states,
        present_elements(structure, state.present),
    )
    for (label, group), own, present in zip(*groups, strict=True):
        if group.face is None:
            continue
        corners = group.links.array[present][:, group.face]
        nodes, positions = np.asarray(structure.nodes), np.asarray(state.positions)
        initial, area = (float(face_areas(at[corners]).sum()) for at in (nodes, positions))
        weights = group.weights(own)
        weight = np.nan if weights is None else float(np.asarray(weights)[present].sum())
        mass = weight / STANDARD_GRAVITY / initial if initial > 0 else np.nan
        rows.append((label, int(present.sum()), initial, area, weight, mass))
    if not rows:
        return {}
    units = {"group": "", "elements": "", "initial area": "m2", "area": "m2", "weight": "N"}
    units["mass per initial area"] = "kg/m2"
    columns = [
        Column(name, unit, values)
        for (name, unit), values in zip(units.items(), zip(*rows, strict=True), strict=True)
    ]
    return {"surfaces": make_table("Surfaces", columns)}
