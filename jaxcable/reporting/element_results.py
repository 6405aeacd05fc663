"""The tables of a report on results of elements other than forces, such as stresses of surfaces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..analysis.results import Results
from ..common.types import Float
from ..elements.abilities import POINT_LOADS
from ..elements.element import PRESENT
from ..model.result_parts import present_elements, result_columns
from ..model.structure import Structure
from .columns import element_columns, envelope_columns, states_heading
from .states import EnvelopeState
from .table import Column, Table, make_table


class _ResultComponent(NamedTuple):
    """A component of a result of elements: its values in all rows of a table.

    Attributes:
        name, unit: name and unit of the column.
        now: values in the final state, [n_row].
        over: values in the states of the envelope, [n_state, n_row].
    """

    name: str
    unit: str
    now: Float[np.ndarray, " n_row"]
    over: Float[np.ndarray, "n_state n_row"]


def element_result_tables(
    structure: Structure, state: Results, states: Mapping[str, EnvelopeState], several: bool
) -> dict[str, Table]:
    """Return the tables of results of elements other than forces, a dict by name of the result.

    A row is an element, or a place in an element where the result has several. The table
    ``results`` has the smallest and the largest value of each result.

    Args:
        structure: `Structure`.
        state: the final state.
        states: states of the envelope, by name.
        several: whether there are columns for the envelope.
    """
    tables, lines = {}, []
    for name in state.results or {}:
        if name in (PRESENT.name, POINT_LOADS.name):  # tables of forces leave out what is not there
            continue
        where, components = _result_components(structure, name, state, states)
        title = name.replace("_", " ").capitalize()
        shown = [*where]
        for one in components:
            shown.append(Column(one.name, one.unit, one.now, governs=True))
            if several:
                for word, head, sign in (("lowest", "min", -1), ("highest", "max", 1)):
                    extreme, at = envelope_columns(word, one.unit, one.over, list(states), sign)
                    extreme = extreme._replace(
                        name=f"{word} {one.name}", heading=f"{head} {one.name}"
                    )
                    shown += [x._replace(detail=len(components) > 1) for x in (extreme, at)]
            over = one.over if several else one.now[None]
            lines.append(_extremes_row(name, one, where, over, list(states) if several else [None]))
        if components:
            tables[name] = make_table(title, shown)
    if not lines:
        return {}
    names = ["result", "unit"]
    for word in ("lowest", "highest"):
        names += [word, *("group", "element", "place", "in")]
    headings = {"lowest": "min", "highest": "max"}
    headings["in"] = states_heading(list(states))
    found = [
        Column(head, "", list(values), heading=headings.get(head, ""))
        for head, values in zip(names, zip(*lines, strict=True), strict=True)
    ]
    title = "Results of elements: smallest and largest value"
    return {"results": make_table(title, found), **tables}


def _result_components(structure, name, state, states):
    """Return the columns that name the rows of a result's table, and its `_ResultComponent`s.

    A row is an element, or a place in an element; `name` is that of the result, and other arguments
    are those of `element_result_tables`.
    """

    def columns_of(result):
        value = (result.results or {}).get(name)
        return [] if value is None else result_columns(structure.groups, {name: value})

    now = columns_of(state)
    every = [columns_of(other.result) for other in states.values()]
    places = list(dict.fromkeys(column.place for column in now))
    # group, element and place of every row
    rows = [
        (k, i, place)
        for k, group in enumerate(structure.groups)
        for i in range(len(group.links))
        for place in places
        if any(one.place == place and one.values[k] is not None for one in now)
    ]
    first = np.cumsum([0, *(len(group.links) for group in structure.groups)])
    at = np.array([first[k] + i for k, i, _ in rows], int)
    where = [
        column._replace(values=np.asarray(column.values)[at].tolist())
        for column in element_columns(structure, range(len(structure.groups)))
    ]
    if len(places) > 1:
        where.append(Column("place", "", [place for *_, place in rows]))

    def component_values(own, result, component):
        mine = {one.place: one.values for one in own if one.component == component}
        masks = present_elements(structure, result.present)
        taken = (mine[place][k][i] if masks[k][i] else np.nan for k, i, place in rows)
        return np.array([*taken] if mine else np.full(len(rows), np.nan), float)

    found = []
    for component, unit in dict.fromkeys((one.component, one.unit) for one in now):
        each = [
            component_values(own, other.result, component)
            for own, other in zip(every, states.values(), strict=True)
        ]
        over = np.array(each).reshape(len(states), len(rows))
        own = component_values(now, state, component)
        found.append(_ResultComponent(component or name, unit, own, over))
    return where, found


def _extremes_row(name, one, where, over, states):
    """Return a row of the table ``results``: the extremes of a component, and where they are.

    `one` is the `_ResultComponent`, `where` the columns that name element and place of each value,
    and `over` the values in the named states, [n_state, n_row].
    """
    line = [name if one.name == name else f"{name} {one.name}", one.unit]
    places = {column.name: column.values for column in where}
    for sign in (-1, 1):
        sizes = np.where(np.isnan(over), -np.inf, sign * over)
        k, row = np.unravel_index(sizes.argmax(), sizes.shape)
        place = places["place"][row] if "place" in places else None
        known = bool(np.isfinite(sizes[k, row]))
        found = [
            float(over[k, row]),
            places["group"][row],
            places["element"][row],
            place,
            states[k],
        ]
        line += found if known else [None] * 5
    return line
