"""The tables of a report on other results of elements than forces, at all places in an element."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..analysis.results import Results
from ..common.types import Float
from ..elements.element import PRESENT
from ..model.parts import columns, there
from ..model.structure import Structure
from .columns import envelope, of_elements
from .states import State
from .table import Column, Table, tabled


class _Quantity(NamedTuple):
    """A result, or a component of it, at all places of all elements that have it.

    Attributes:
        name, unit: of the column.
        now: in the state of the report, [n_row].
        over: in the states of envelopes, [n_state, n_row].
    """

    name: str
    unit: str
    now: Float[np.ndarray, " n_row"]
    over: Float[np.ndarray, "n_state n_row"]


def own_results(
    structure: Structure, state: Results, states: Mapping[str, State], several: bool
) -> dict[str, Table]:
    """Tables of other results than forces along elements, a dict by name of the result.

    A row is an element, or a place in it where the result has several. ``results`` has the lowest
    and the highest value of each of them.

    Args:
        structure: `Structure`.
        state: the end of the report.
        states: states of the envelopes, by name.
        several: whether envelopes tell more than the end.
    """
    found, ends = {}, []
    for name in state.results or {}:
        if name == PRESENT.name:  # the tables of forces leave out what is not there
            continue
        where, quantities = _quantities(structure, name, state, states)
        title = name.replace("_", " ").capitalize()
        shown = [*where]
        for one in quantities:
            shown.append(Column(one.name, one.unit, one.now, governs=True))
            if several:
                for word, sign in (("lowest", -1), ("highest", 1)):
                    extreme, at = envelope(word, one.unit, one.over, list(states), sign)
                    extreme = extreme._replace(name=f"{word} {one.name}")
                    shown += [x._replace(detail=len(quantities) > 1) for x in (extreme, at)]
            over = one.over if several else one.now[None]
            ends.append(_extremes(name, one, where, over, list(states) if several else [None]))
        if quantities:
            found[name] = tabled(title, shown)
    if not ends:
        return {}
    heads = ["result", "unit"]
    for word in ("lowest", "highest"):
        heads += [word, *("group", "element", "place", "in")]
    lines = zip(heads, zip(*ends, strict=True), strict=True)
    title = "Results of elements: lowest and highest value"
    return {"results": tabled(title, [Column(head, "", list(own)) for head, own in lines]), **found}


def _quantities(structure, name, state, states):
    """Columns that say where the values of a result are, and its quantities, a list."""

    def told(result):
        value = (result.results or {}).get(name)
        return [] if value is None else columns(structure.groups, {name: value})

    now, every = told(state), [told(other.result) for other in states.values()]
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
        for column in of_elements(structure, range(len(structure.groups)))
    ]
    if len(places) > 1:
        where.append(Column("place", "", [place for *_, place in rows]))

    def values(told, result, component):
        mine = {one.place: one.values for one in told if one.component == component}
        masks = there(structure, result.present)
        taken = (mine[place][k][i] if masks[k][i] else np.nan for k, i, place in rows)
        return np.array([*taken] if mine else np.full(len(rows), np.nan), float)

    found = []
    for component, unit in dict.fromkeys((one.component, one.unit) for one in now):
        each = [
            values(told, other.result, component)
            for told, other in zip(every, states.values(), strict=True)
        ]
        over = np.array(each).reshape(len(states), len(rows))
        found.append(_Quantity(component or name, unit, values(now, state, component), over))
    return where, found


def _extremes(name, one, where, over, states):
    """A line of the table ``results``: a quantity [n_state, n_row], its lowest and its highest."""
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
