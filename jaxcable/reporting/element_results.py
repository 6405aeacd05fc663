"""The tables of a report on results of elements other than forces, such as stresses of surfaces."""

from __future__ import annotations

import numpy as np

from ..elements.abilities import POINT_LOADS
from ..elements.element import PRESENT
from ..elements.friction_state import CLAMP_FORCE, DEVIATOR_RESULTS, SEGMENT_TENSION
from ..elements.sliding_catenaries import SEGMENT_PULL
from ..model.result_parts import present_elements, result_columns
from .columns import element_columns, envelope_columns, states_heading
from .states import ReportedAnalysis
from .table import Column, Table, columns_of_rows, make_table


def element_result_tables(of: ReportedAnalysis) -> dict[str, Table]:
    """Return the tables of results of elements other than forces, a dict by name of the result.

    A row is an element, or a place in an element where the result has several. The table
    ``results`` has the smallest and the largest value of each result.
    """
    tables, lines, names = {}, [], list(of.envelope)
    for name in of.state.results or {}:
        # forces leave out what is not there; those of segments on nodes are no quantity to look up
        if name in (PRESENT.name, POINT_LOADS.name, SEGMENT_PULL.name):
            continue
        where, components = _rows_and_components(of, name)
        if name == CLAMP_FORCE.name and not any(np.nan_to_num(own[-1]).any() for own in components):
            continue  # no cable is clamped
        columns = [*where]
        for component, unit, now, over in components:
            columns.append(Column(component, unit, now, governs=True))
            if of.several:
                for word, heading, sign in (("lowest", "min", -1), ("highest", "max", 1)):
                    columns += envelope_columns(
                        *(f"{word} {component}", unit, over, names, sign),
                        hidden=("in", f"{word} {component}") if len(components) > 1 else (),
                        heading=f"{heading} {component}",
                    )
            values, states = (over, names) if of.several else (now[None], [None])
            label = name if component == name else f"{name} {component}"
            lines.append([label, unit, *_extremes_with_places(where, values, states)])
        if components:
            tables[name] = make_table(name.replace("_", " ").capitalize(), columns)
    if not lines:
        return {}
    place = "group", "element", "place", ("in", "", states_heading(names))
    heads = "result", "unit", ("lowest", "", "min"), *place, ("highest", "", "max"), *place
    title = "Results of elements: smallest and largest value"
    return {"results": make_table(title, columns_of_rows(lines, *heads)), **tables}


def _rows_and_components(of, name):
    """Return the columns that name the rows of a result's table, and the values of its components.

    A row is an element, or a place in an element. Each component is a tuple: name, unit, values in
    the final state, [n_row], and in those of the envelope, [n_state, n_row]. `of` is the
    `ReportedAnalysis`, `name` that of the result.
    """
    groups = of.structure.groups

    def parts(result):
        value = (result.results or {}).get(name)
        found = [] if value is None else result_columns(groups, {name: value})
        return {(one.component, one.place): one for one in found}

    now = parts(of.state)
    places = list(dict.fromkeys(place for _, place in now))
    rows = {  # group, element and place, and how the place is called
        (k, i, place): text
        for k, group in enumerate(groups)
        for i in range(len(group.links))
        for place in places
        if any(one.place == place and one.values[k] is not None for one in now.values())
        and (text := _place_text(group, i, name, place)) is not None
    }
    first = np.cumsum([0, *(len(group.links) for group in groups)])
    at = np.array([first[k] + i for k, i, _ in rows], int)
    where = [
        column._replace(values=np.asarray(column.values)[at].tolist())
        for column in element_columns(of.structure, range(len(groups)))
    ]
    if len(places) > 1 or any(text != place for (*_, place), text in rows.items()):
        where.append(Column("place", "", list(rows.values())))

    def component_values(result, component):
        own, masks = parts(result), present_elements(of.structure, result.present)
        found = np.full(len(rows), np.nan)
        for row, (k, i, place) in enumerate(rows):
            if own and masks[k][i]:
                found[row] = own[component, place].values[k][i]
        return found

    components = dict.fromkeys((one.component, one.unit) for one in now.values())
    return where, [
        (
            component or name,
            unit,
            *of.values(lambda result, c=component: component_values(result, c)),
        )
        for component, unit in components
    ]


def _place_text(group, element, name, place):
    """Return a place in an element as text; along cables with friction the nodes of it.

    None for segments and deviators that only fill up a shorter chain. `name` is that of the result.
    """
    if SEGMENT_TENSION not in group.results or not place.isdigit():
        return place
    # else it is a deviator, the end of a segment
    of_segment = name not in [result.name for result in DEVIATOR_RESULTS]
    first, last = group.links.array[element, int(place) + (not of_segment) :][:2]
    text = f"{first} to {last}" if of_segment else f"node {first}"
    return text if first != last else None


def _extremes_with_places(where, values, states):
    """Return the smallest and the largest of some values, and where they are, a list of ten.

    For each of the two: value, group, element, place, state; five times None without values.

    Args:
        where: columns that name group, element and place of each row.
        values: [n_state, n_row]; NaN where there is none.
        states: names of the states.
    """
    places = {column.name: column.values for column in where}
    found: list[object] = []
    for sign in (-1, 1):
        sizes = np.where(np.isnan(values), -np.inf, sign * values)
        k, row = np.unravel_index(sizes.argmax(), sizes.shape)
        names = [
            places[name][row] if name in places else None for name in ("group", "element", "place")
        ]
        known = bool(np.isfinite(sizes[k, row]))
        found += [float(values[k, row]), *names, states[k]] if known else [None] * 5
    return found
