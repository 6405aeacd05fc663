"""The table of a report on sags, lowest points and horizontal tensions of cables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np

from ..analysis.element_shapes import CATENARIES, StateOrPhase
from ..common.types import Float
from ..model.result_parts import named_groups_of, values_per_group
from ..model.structure import Structure
from ..results import horizontal_tensions, sags
from .columns import element_columns, envelope_columns
from .states import ReportedAnalysis
from .table import Column, Table, make_table

_NOTES = (
    "sag: vertical, from the chord at midspan (half of the horizontal distance of the ends)",
    "deflection: largest distance from the chord, at right angles to it, in any direction",
    "horizontal tension: along the chord in plan, in the middle of the cable",
)


def sag_tables(
    of: ReportedAnalysis, chains: Mapping[str, Sequence[int]] | None
) -> dict[str, Table]:
    """Return the table ``sags`` of all catenaries and named chains; empty without any.

    `chains` are node numbers of chains by name, as for `sags`, or None.
    """
    structure, chains = of.structure, chains or {}
    kept = [k for k, group in enumerate(structure.groups) if isinstance(group, CATENARIES)]
    if not kept and not chains:
        return {}
    results = [of.state, *(state.result for state in of.envelope.values())]
    each = [_sag_values(structure, result, kept, chains) for result in results]
    span, sag, largest, deflection, lowest, tension = each[0]
    rows = [(name, None, int(nodes[0]), int(nodes[-1])) for name, nodes in chains.items()]
    more: list[Any] = [[row[k] for row in rows] for k in range(4)]
    columns = [
        column._replace(values=[*np.asarray(column.values).tolist(), *values])
        for column, values in zip(
            element_columns(structure, kept, segments=True), more, strict=True
        )
    ]
    columns += [
        Column("span", "m", span),
        Column("sag", "m", sag, "final sag", governs=True),
        Column("largest sag", "m", largest),
        Column("deflection", "m", deflection),
        Column("lowest z", "m", lowest, "lowest point, z"),
        Column("horizontal tension", "N", tension),
    ]
    for name, k, sign in (("max. sag", 1, 1), ("min. z", 4, -1)) if of.several else ():
        values = np.array([rows[k] for rows in each[1:]]).reshape(len(each) - 1, -1)
        columns += envelope_columns(name, "m", values, list(of.envelope), sign)
    return {"sags": make_table("Sags and lowest points of cables", columns, _NOTES)}


def _sag_values(
    structure: Structure,
    state: StateOrPhase,
    kept: Sequence[int],
    chains: Mapping[str, Sequence[int]],
) -> Float[np.ndarray, "6 n_row"]:
    """Return the numbers of all rows of the table in a state, [6, n_row].

    They are span, sag at midspan, largest sag, deflection, height of the lowest point, all in m,
    and horizontal tension, N, NaN for chains. Rows are the elements of the groups `kept` (of cables
    that slide the segments), then the chains.
    """
    found: list[tuple[Any, Any]] = []
    if kept:
        every = structure.group_tree.flatten_up_to(sags(structure, state))
        tensions = values_per_group(structure, horizontal_tensions(structure, state))
        for k in kept:
            own, group = (every[k], tensions[k]), structure.groups[k]
            if group.slides:  # without the fillers of shorter cables
                real = group.links.array[:, 1:] != group.links.array[:, :-1]
                own = jax.tree.map(lambda x, real=real: np.asarray(x)[real], own)
            found.append(own)
    if chains:
        found += [(sag, np.nan) for sag in sags(structure, state, chains).values()]
    columns = [
        [sag.span, sag.midspan, sag.largest, sag.deflection, sag.lowest[..., 2], tension]
        for sag, tension in found
    ]
    return np.hstack(
        [np.array(np.broadcast_arrays(*map(np.atleast_1d, x)), float) for x in columns]
    )


def check_chains(structure: Structure, chains: Mapping[str, Sequence[int]] | None) -> None:
    """Raise ValueError for a chain with the name of a group of the structure."""
    groups = {name for name, _ in named_groups_of(structure)}
    for name in chains or {}:
        if name in groups:
            raise ValueError(f"chains[{name!r}]: a group of elements has this name, too")
