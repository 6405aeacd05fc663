"""Columns that several tables have: elements and their values, envelopes over states."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from ..common.negligible import NEGLIGIBLE
from ..common.types import Float
from ..model.result_parts import end_nodes, named_groups_of, straight_pieces
from ..model.structure import Structure
from .table import Column


def element_columns(
    structure: Structure, groups: Sequence[int], segments: bool = False
) -> list[Column]:
    """Return the columns that name elements: group, element, start node, end node.

    Args:
        structure: `Structure`.
        groups: indices of the groups; each of their elements has a row.
        segments: whether cables that slide over nodes have a row for each segment instead.
    """
    named, parts = named_groups_of(structure), []
    for k in groups:
        label, group = named[k]
        ends, number = end_nodes(group), np.arange(len(group.links))
        if segments and group.slides:
            ends, number, _ = straight_pieces([group])
        parts.append((label, ends, number.tolist()))
    ends = np.concatenate([np.zeros((0, 2), int), *(own for _, own, _ in parts)])
    return [
        Column("group", "", [label for label, _, number in parts for _ in number]),
        Column("element", "", [k for *_, number in parts for k in number]),
        Column("first", "", ends[:, 0], "start node"),
        Column("last", "", ends[:, 1], "end node"),
    ]


def concatenate_groups(
    structure: Structure,
    parts: Sequence[Float[np.ndarray, " n_elem"] | None],
    groups: Sequence[int],
) -> Float[np.ndarray, " n"]:
    """Return the element values of some groups in one array; NaN for a group without values.

    Args:
        structure: `Structure`.
        parts: for every group of the structure an array [n_elem], or None.
        groups: indices of the groups that the result has.
    """
    arrays = (
        np.full(len(structure.groups[k].links), np.nan) if parts[k] is None else parts[k]
        for k in groups
    )
    return np.concatenate([np.zeros(0), *arrays])


def without_blank_rows(columns: Sequence[Column], n_name: int = 2) -> list[Column]:
    """Return columns without the rows that have a value in none but the first `n_name` columns."""
    known = ~np.isnan([np.asarray(column.values, float) for column in columns[n_name:]])
    kept = known.any(axis=0)
    return [column._replace(values=np.array(column.values, object)[kept]) for column in columns]


def envelope_columns(
    name: str,
    unit: str,
    values: Float[np.ndarray, "n_state n"],
    states: Sequence[str],
    sign: int,
    beside: Sequence[tuple[str, str, Float[np.ndarray, "n_state n"]]] = (),
    *,
    rounding: float = 0.0,
    hidden: Collection[str] = (),
    **look: Any,
) -> list[Column]:
    """Return the columns of the extreme values over some states, and of the state of each.

    Args:
        name, unit: those of the column of extreme values, see `Column`.
        values: values in every state, [n_state, n]; NaN where there is no value.
        states: names of the states.
        sign: 1 for the maximum, -1 for the minimum.
        beside: name, unit and values, [n_state, n], of columns that give more of the state in which
            the value is extreme.
        rounding: of states whose values differ by at most this the first one governs.
        hidden: names of those of these columns that the text leaves out.
        look: further fields of the `Column` of extreme values.

    Returns:
        The column `name`, those of `beside`, and "in" with the names of states; cells are empty
        where no state has a value, and no state is named where all have values that are rounding.
    """
    nowhere = np.full((1, values.shape[1]), np.nan)
    sizes = np.concatenate([nowhere, sign * values])
    sizes = np.where(np.isnan(sizes), -np.inf, sizes)
    which = (sizes >= sizes.max(axis=0) - rounding).argmax(axis=0)

    def governing(array):
        return np.take_along_axis(np.concatenate([nowhere, array]), which[None], axis=0)[0]

    columns = [Column(name, unit, governing(values), **look)]
    columns += [Column(head, of, governing(array)) for head, of, array in beside]
    largest = np.nanmax(np.abs(values), axis=0, initial=0.0)
    counts = largest > NEGLIGIBLE * largest.max(initial=0.0)
    names = [None, *states]
    governing_states = [names[k] if c else None for k, c in zip(which, counts, strict=True)]
    shown = [name for name in governing_states if name is not None]
    columns.append(Column("in", "", governing_states, states_heading(shown or states)))
    return [column._replace(detail=column.name in hidden) for column in columns]


def states_heading(states: Sequence[str]) -> str:
    """Return the heading of a column with names of states: "phase", "case" or both.

    It is "phase, load factor" if names have load factors.
    """
    kinds = {name.split(" ")[0] for name in states}
    kind = kinds.pop() if kinds in ({"phase"}, {"case"}) else "phase or case"
    within = kind == "phase" and any(", " in name for name in states)
    return "phase, load factor" if within else kind
