"""Columns that several tables have: elements and their values, envelopes over states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common.types import Float
from ..model.parts import first_and_last, groups_by_name
from ..model.structure import Structure
from .table import Column


def of_elements(structure: Structure, numbers: Sequence[int]) -> list[Column]:
    """Columns that name all elements of the groups `numbers`: group, element, first, last node."""
    named = groups_by_name(structure)
    parts = [(named[k][0], first_and_last(named[k][1])) for k in numbers]
    ends = np.concatenate([np.zeros((0, 2), int), *(ends for _, ends in parts)])
    return [
        Column("group", "", [label for label, ends in parts for _ in ends]),
        Column("element", "", [k for _, ends in parts for k in range(len(ends))]),
        Column("first", "", ends[:, 0]),
        Column("last", "", ends[:, 1]),
    ]


def joined(
    structure: Structure,
    parts: Sequence[Float[np.ndarray, " n_elem"] | None],
    numbers: Sequence[int],
) -> Float[np.ndarray, " n"]:
    """Values of the groups `numbers`, one after the other; NaN for a group without values.

    Args:
        structure: `Structure`.
        parts: for every group an array [n_elem], or None.
        numbers: of groups.
    """
    every = (
        np.full(len(structure.groups[k].links), np.nan) if parts[k] is None else parts[k]
        for k in numbers
    )
    return np.concatenate([np.zeros(0), *every])


def joined_each(
    structure: Structure,
    states: Sequence[Sequence[Float[np.ndarray, " n_elem"] | None]],
    numbers: Sequence[int],
) -> Float[np.ndarray, "n_state n"]:
    """Values of groups in several states, each `joined`, [n_state, n]."""
    count = sum(len(structure.groups[k].links) for k in numbers)
    found = [joined(structure, parts, numbers) for parts in states]
    return np.array(found).reshape(len(states), count)


def envelope(
    name: str,
    unit: str,
    values: Float[np.ndarray, "n_state n"],
    states: Sequence[str],
    sign: int,
    beside: Sequence[tuple[str, str, Float[np.ndarray, "n_state n"]]] = (),
    nothing: float = 0.0,
) -> list[Column]:
    """The extreme values over some states, and the state in which each of them is.

    Args:
        name, unit: of the column of extreme values.
        values: in every state, [n_state, n]; NaN where there is no value.
        states: their names.
        sign: 1 for the highest values, -1 for the lowest.
        beside: name, unit and values of columns that tell more of the same state.
        nothing: of states that differ by this the first one governs.

    Returns:
        The column `name`, those `beside`, and ``in``; without values where no state has one.
    """
    nowhere = np.full((1, values.shape[1]), np.nan)
    sizes = np.concatenate([nowhere, sign * values])
    sizes = np.where(np.isnan(sizes), -np.inf, sizes)
    which = (sizes >= sizes.max(axis=0) - nothing).argmax(axis=0)
    found = [
        Column(head, of, np.take_along_axis(np.concatenate([nowhere, x]), which[None], axis=0)[0])
        for head, of, x in ((name, unit, values), *beside)
    ]
    names = [None, *states]
    return [*found, Column("in", "", [names[k] for k in which])]
