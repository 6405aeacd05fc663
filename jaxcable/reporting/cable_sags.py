"""The table of a report on sags, lowest points and horizontal tensions of cables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..analysis.results import Results
from ..elements.abilities import Sagging
from ..model.result_parts import named_groups_of, values_per_group
from ..model.structure import Structure
from ..results import horizontal_tensions, sags
from .columns import element_columns, envelope_columns
from .states import EnvelopeState
from .table import Column, Table, make_table

_NOTES = (
    "sag: vertical, from the chord at midspan (half of the horizontal distance of the ends)",
    "deflection: largest distance from the chord, at right angles to it, in any direction",
    "horizontal tension: along the chord in plan, in the middle of the cable",
)


def sag_tables(
    structure: Structure,
    state: Results,
    states: Mapping[str, EnvelopeState],
    several: bool,
    chains: Mapping[str, Sequence[int]] | None,
) -> dict[str, Table]:
    """Return the table ``sags`` of all catenaries and named chains; empty without any.

    Args:
        structure: `Structure`.
        state: the final state.
        states: states of the envelope, by name.
        several: whether the text shows the envelope.
        chains: node numbers of chains by name, as for `sags`, or None.
    """
    kept = [k for k, group in enumerate(structure.groups) if isinstance(group, Sagging)]
    chains = dict(chains or {})
    if not kept and not chains:
        return {}
    now = _sag_rows(structure, state, kept, chains)
    names = list(states)
    over = [_sag_rows(structure, other.result, kept, chains) for other in states.values()]
    columns = [
        column._replace(values=[*np.asarray(column.values).tolist(), *more])
        for column, more in zip(
            element_columns(structure, kept), _chain_columns(chains), strict=True
        )
    ]
    columns += [
        Column("span", "m", now["span"]),
        Column("sag", "m", now["midspan"], heading="final sag", governs=True),
        Column("largest sag", "m", now["largest"]),
        Column("deflection", "m", now["deflection"]),
        Column("lowest z", "m", now["lowest"], heading="lowest point, z"),
        Column("horizontal tension", "N", now["tension"]),
    ]
    if several:
        for name, key, unit, sign in (
            ("max. sag", "midspan", "m", 1),
            ("min. z", "lowest", "m", -1),
        ):
            values = np.array([rows[key] for rows in over]).reshape(len(names), -1)
            columns += envelope_columns(name, unit, values, names, sign)
    return {"sags": make_table("Sags and lowest points of cables", columns, _NOTES)}


def _chain_columns(chains):
    """Return the values of the columns group, element, start and end node of chains, four lists."""
    ends = [np.asarray(nodes)[[0, -1]].tolist() for nodes in chains.values()]
    return [*chains], [None] * len(chains), [a for a, _ in ends], [b for _, b in ends]


def _sag_rows(structure, state, kept, chains):
    """Return the numbers of all rows in a state, arrays [n_row] by name: catenaries, then chains.

    `kept` are the indices of the groups of catenaries; `chains` is a dict of node numbers.
    """
    found: list[tuple[Any, Any]] = []
    if kept:
        every = structure.group_tree.flatten_up_to(sags(structure, state))
        tensions = values_per_group(structure, horizontal_tensions(structure, state))
        found += [(every[k], tensions[k]) for k in kept]
    if chains:
        own = sags(structure, state, chains)
        found += [(sag, np.nan) for sag in own.values()]
    rows = {
        name: [np.atleast_1d(np.asarray(getattr(sag, name), float)) for sag, _ in found]
        for name in ("span", "midspan", "largest", "deflection")
    }
    rows["lowest"] = [np.atleast_1d(np.asarray(sag.lowest, float)[..., 2]) for sag, _ in found]
    rows["tension"] = [np.atleast_1d(np.asarray(tension, float)) for _, tension in found]
    return {name: np.concatenate(values) for name, values in rows.items()}


def check_chains(structure: Structure, chains: Mapping[str, Sequence[int]] | None) -> None:
    """Raise ValueError for a chain with the name of a group of the structure."""
    groups = {name for name, _ in named_groups_of(structure)}
    for name in chains or {}:
        if name in groups:
            raise ValueError(f"chains[{name!r}]: a group of elements has this name, too")
