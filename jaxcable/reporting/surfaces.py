"""The table of a report on surfaces: areas and weights of groups whose elements have faces."""

from __future__ import annotations

import numpy as np

from ..loads.faces import face_areas
from ..loads.masses import STANDARD_GRAVITY
from ..model.result_parts import named_groups_of, present_elements
from .states import ReportedAnalysis
from .table import Table, columns_of_rows, make_table


def surface_tables(of: ReportedAnalysis) -> dict[str, Table]:
    """Return area, weight and mass per area of each group with faces: {"surfaces": `Table`}.

    Only active elements count. The dict is empty if no group has faces.
    """
    state, rows = of.state, []
    masks = present_elements(of.structure, state.present)
    groups = zip(named_groups_of(of.structure), state.restart.states, masks, strict=True)
    for (label, group), own, present in groups:
        if group.face is None:
            continue
        corners = group.links.array[present][:, group.face]
        places = np.asarray(of.structure.nodes), np.asarray(state.positions)
        initial, area = (float(face_areas(at[corners]).sum()) for at in places)
        weights = group.weights(own)
        weight = np.nan if weights is None else float(np.asarray(weights)[present].sum())
        mass = weight / STANDARD_GRAVITY / initial if initial > 0 else np.nan
        rows.append((label, int(present.sum()), initial, area, weight, mass))
    if not rows:
        return {}
    sizes = ("initial area", "m2"), ("area", "m2"), ("weight", "N")
    columns = columns_of_rows(rows, "group", "elements", *sizes, ("mass per initial area", "kg/m2"))
    return {"surfaces": make_table("Surfaces", columns)}
