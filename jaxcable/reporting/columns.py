"""Columns that several tables have: elements and their values, envelopes over states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common.types import Float
from ..model.result_parts import end_nodes, named_groups_of
from ..model.structure import Structure
from .table import Column


def element_columns(structure: Structure, groups: Sequence[int]) -> list[Column]:
    """Return the columns that name elements: group, element, start node, end node.

    Args:
        structure: `Structure`.
        groups: indices of the groups, all of whose elements have a row.
    """
    named = named_groups_of(structure)
    parts = [(named[k][0], end_nodes(named[k][1])) for k in groups]
    ends = np.concatenate([np.zeros((0, 2), int), *(ends for _, ends in parts)])
    return [
        Column("group", "", [label for label, ends in parts for _ in ends]),
        Column("element", "", [k for _, ends in parts for k in range(len(ends))]),
        Column("first", "", ends[:, 0], heading="start node"),
        Column("last", "", ends[:, 1], heading="end node"),
    ]


def concatenate_groups(
    structure: Structure,
    parts: Sequence[Float[np.ndarray, " n_elem"] | None],
    groups: Sequence[int],
) -> Float[np.ndarray, " n"]:
    """Return the values of some groups in one array; NaN for a group without values.

    Args:
        structure: `Structure`.
        parts: for every group an array [n_elem], or None.
        groups: indices of the groups that are meant.
    """
    arrays = (
        np.full(len(structure.groups[k].links), np.nan) if parts[k] is None else parts[k]
        for k in groups
    )
    return np.concatenate([np.zeros(0), *arrays])


def concatenate_states(
    structure: Structure,
    states: Sequence[Sequence[Float[np.ndarray, " n_elem"] | None]],
    groups: Sequence[int],
) -> Float[np.ndarray, "n_state n"]:
    """Return `concatenate_groups` of the values in each of some states, [n_state, n]."""
    count = sum(len(structure.groups[k].links) for k in groups)
    arrays = [concatenate_groups(structure, parts, groups) for parts in states]
    return np.array(arrays).reshape(len(states), count)


def envelope_columns(
    name: str,
    unit: str,
    values: Float[np.ndarray, "n_state n"],
    states: Sequence[str],
    sign: int,
    beside: Sequence[tuple[str, str, Float[np.ndarray, "n_state n"]]] = (),
    rounding: float = 0.0,
    heading: str = "",
) -> list[Column]:
    """Return the columns of the extreme values over some states, and of the state of each.

    Args:
        name, unit, heading: of the column of extreme values.
        values: in every state, [n_state, n]; NaN where there is no value.
        states: their names.
        sign: 1 for the maximum, -1 for the minimum.
        beside: name, unit and values of columns that give more of the governing state.
        rounding: of states whose values differ by at most this the first one governs.

    Returns:
        The column `name`, those `beside`, and ``in``; without values where no state has one.
    """
    nowhere = np.full((1, values.shape[1]), np.nan)
    sizes = np.concatenate([nowhere, sign * values])
    sizes = np.where(np.isnan(sizes), -np.inf, sizes)
    which = (sizes >= sizes.max(axis=0) - rounding).argmax(axis=0)

    def governing(array):
        return np.take_along_axis(np.concatenate([nowhere, array]), which[None], axis=0)[0]

    columns = [Column(name, unit, governing(values), heading=heading)]
    columns += [Column(head, of, governing(array)) for head, of, array in beside]
    names = [None, *states]
    governing_states = [names[k] for k in which]
    shown = [name for name in governing_states if name is not None]
    heading = states_heading(shown or states)
    return [*columns, Column("in", "", governing_states, heading=heading)]


def states_heading(states: Sequence[str]) -> str:
    """Return the heading of a column with names of states: "phase" or "case" if all are such."""
    kinds = {name.split(" ")[0] for name in states}
    kind = kinds.pop() if kinds in ({"phase"}, {"case"}) else "phase or case"
    within = kind == "phase" and any(", " in name for name in states)
    return "phase, load factor" if within else kind
