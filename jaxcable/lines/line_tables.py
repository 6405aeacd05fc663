"""Tables of a section: towers, tensions, clearances, stringing chart, swings, loads on towers."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from ..reporting.table import Column, Table, columns_of_rows, make_table
from .line_analysis import LineResults
from .line_section import LineSection
from .line_states import LineState
from .span_tables import RulingSpan, SagTension
from .stringing import PulleyStates

_COMPONENTS = "longitudinal", "transverse", "vertical"


def load_trees(
    section: LineSection, results: LineResults
) -> dict[str, dict[str, dict[str, dict[str, float]]]]:
    """Return the loads of the line on its towers as trees: by state, tower, attachment, component.

    Components are "longitudinal", along the bisector of the tower towards the next one,
    "transverse", to the left, and "vertical", downwards; negative vertical loads are uplift, N.
    Attachments are "conductor", or "back" and "ahead" of a strain tower.

    Args:
        section: `LineSection`.
        results: its `LineResults`.

    Returns:
        Dict by the names of states, of dicts by the names of towers.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "strain")
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> found = jc.lines.analyse(section, strung, {"calm": jc.lines.LineState(15.0)})
        >>> tree = jc.lines.load_trees(section, found)
        >>> print({k: round(v) for k, v in tree["calm"]["1"]["ahead"].items()})
        {'longitudinal': 23949, 'transverse': 0, 'vertical': 2397}
    """
    forces = np.asarray(results.attachment_forces)
    found: dict[str, dict[str, dict[str, dict[str, float]]]] = {}
    for k, state in enumerate(results.names):
        towers = found.setdefault(state, {})
        for j, one in enumerate(section.layout.attachments):
            parts = dict(zip(_COMPONENTS, map(float, forces[k, j] + 0.0), strict=True))
            towers.setdefault(section.names[one.tower], {})[one.side or "conductor"] = parts
    return found


def section_tables(
    section: LineSection,
    states: Mapping[str, LineState],
    results: LineResults,
    pulleys: PulleyStates | None = None,
    ruling: RulingSpan | None = None,
) -> dict[str, Table]:
    """Return the tables of a section by name, each a `reporting.Table`.

    Args:
        section: `LineSection`.
        states: `LineState` by name.
        results: `LineResults` of these states.
        pulleys: `PulleyStates`, for the stringing chart; None: no chart.
        ruling: `RulingSpan` of these states; None: no comparison.

    Returns:
        Dict of the tables ``towers``, ``states``, ``spans``, ``stringing``, ``swings``,
        ``tower_loads``, ``ruling_span``.

    Raises:
        ValueError: none.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> states = {"hot": jc.lines.LineState(75.0)}
        >>> found = jc.lines.analyse(section, strung, states)
        >>> print(list(jc.lines.section_tables(section, states, found)))
        ['towers', 'states', 'spans', 'tower_loads']
    """
    tables = {
        "towers": _tower_table(section),
        "states": _state_table(states),
        "spans": _span_table(section, results),
    }
    if pulleys is not None:
        tables["stringing"] = _stringing_table(section, pulleys)
    if np.isfinite(np.asarray(results.swing)).any():
        tables["swings"] = _swing_table(section, results)
    tables["tower_loads"] = _load_table(section, results)
    if ruling is not None:
        tables["ruling_span"] = _ruling_table(section, results, ruling)
    return tables


def _table_of_spans(title, section, names, heads, values, notes=()):
    """Return a table with a row for each state and span: its name, "1-2" of the towers, values.

    `heads` are as of `columns_of_rows`, `values` arrays [n_state, n_span]; infinite ones are none.
    """
    spans = [f"{a}-{b}" for a, b in itertools.pairwise(section.names)]
    every = [np.asarray(x, float).tolist() for x in values]
    rows = [
        [name, span, *(None if x[k][j] == np.inf else x[k][j] for x in every)]
        for k, name in enumerate(names)
        for j, span in enumerate(spans)
    ]
    return make_table(title, columns_of_rows(rows, *heads), notes)


def _tower_table(section):
    """Return the table of towers, as they are given."""
    names = "station", "ground", "height", "offset", "string_length", "string_weight", "angle"
    units = "m", "m", "m", "m", "m", "N", "deg"
    numbers = (np.asarray(getattr(section, name), float).tolist() for name in names)
    rows = [*zip(section.names, section.kinds, *numbers, strict=True)]
    heads = ((name.replace("_", " "), unit) for name, unit in zip(names, units, strict=True))
    notes = (f"conductor {section.conductor.name}: {section.conductor.source}",)
    return make_table("Towers", columns_of_rows(rows, "tower", "kind", *heads), notes)


def _state_table(states):
    """Return the table of states, as they are given."""
    rows = []
    for name, s in states.items():
        broken = "" if s.broken is None else f"span {s.broken + 1}"
        ice = np.atleast_1d(np.asarray(s.ice))
        numbers = (s.temperature, ice.min(), ice.max(), s.wind, s.wind_direction, s.drag, s.extra)
        rows.append([name, s.condition, *map(float, numbers), broken])
    heads = (
        *("state", "condition", ("temperature", "degC"), ("least ice", "m"), ("most ice", "m")),
        *(("wind", "N/m2"), ("direction", "deg"), ("drag", "-"), ("extra", "N/m"), "broken"),
    )
    return make_table("States", columns_of_rows(rows, *heads))


def _span_table(section, results):
    """Return the table of tensions, sags and clearances of every state and span."""
    ends, near = np.asarray(results.tensions).max(axis=-1), results.crossings
    values = results.horizontal, ends, results.utilization, results.sag, results.clearance
    values += tuple(near.values())
    heads = (
        *("state", "span", ("H", "N", "horizontal tension"), ("largest tension", "N")),
        *(("utilization", "-", "of rated strength"), ("sag", "m", "vertical sag at midspan")),
        ("clearance", "m", "above the ground"),
        *((name, "m", f"distance from {name}") for name in near),
    )
    return _table_of_spans("Tensions, sags, clearances", section, results.names, heads, values)


def _stringing_table(section, pulleys):
    """Return the stringing chart: sags on pulleys and clamped, offsets, for every temperature."""
    clamped = pulleys.clamped
    offsets = np.pad(pulleys.offsets, ((0, 0), (0, 1)), constant_values=np.nan)
    values = pulleys.horizontal, pulleys.sag, clamped.horizontal, clamped.sag, offsets
    heads = (
        *("temperature", "span", ("H on pulleys", "N"), ("sag on pulleys", "m")),
        *(("H clamped", "N"), ("sag clamped", "m"), ("offset", "m", "forward at its second tower")),
    )
    note = "offset: by how much the conductor is moved forward over the pulley before it is clamped"
    return _table_of_spans("Stringing chart", section, clamped.names, heads, values, (note,))


def _swing_table(section, results):
    """Return the table of the swing angles of strings, of every state and suspension tower."""
    rows = [
        [state, section.names[one.tower], *map(float, results.swing[k, j])]
        for k, state in enumerate(results.names)
        for j, one in enumerate(section.layout.attachments)
        if np.isfinite(np.asarray(results.swing[k, j])).all()
    ]
    heads = ("state", "tower", ("across", "deg", "to the left"), ("along", "deg", "forward"))
    return make_table("Swing of insulator strings", columns_of_rows(rows, *heads))


def _load_table(section, results):
    """Return the table of the loads on towers: one row for each attachment in each state."""
    trees = load_trees(section, results)
    rows = [
        [state, tower, side, *parts.values(), "uplift" if parts["vertical"] < 0 else ""]
        for state, towers in trees.items()
        for tower, sides in towers.items()
        for side, parts in sides.items()
    ]
    heads = ("state", "tower", "attachment", *((name, "N") for name in _COMPONENTS), "uplift")
    notes = ("longitudinal: towards the next tower; transverse: to the left; vertical: downwards",)
    return make_table("Loads on towers", columns_of_rows(rows, *heads), notes)


def _ruling_table(section, results, ruling):
    """Return the table of the ruling span beside the exact answer."""
    values = results.horizontal, ruling.horizontal, results.sag, ruling.sag, ruling.sag_error
    heads = (
        *("state", "span", ("H", "N", "H exact"), ("H ruling", "N", "H of the ruling span")),
        *(("sag", "m", "sag exact"), ("sag ruling", "m", "sag by the ruling span"), ("error", "m")),
    )
    spans = ", ".join(f"{x:.2f}" for x in section.ruling_spans())
    notes = (f"ruling spans: {spans} m",)
    return _table_of_spans("Ruling span", section, results.names, heads, values, notes)


def sag_tension_table(found: SagTension) -> Table:
    """Return a sag-tension table: sags and tensions before and after stretch, of three methods.

    Args:
        found: `SagTension`, of `sag_tension`.

    Returns:
        `reporting.Table`.

    Example:
        >>> states = {"15 C": jc.lines.LineState(15.0)}
        >>> drake = jc.catalogue.conductor("Drake")
        >>> found = jc.lines.sag_tension(drake, 300.0, states, {"15 C": 28e3})
        >>> jc.lines.sag_tension_table(found).columns[:4]
        ('state', 'load', 'sag', 'tension')
    """
    columns = [
        Column("state", "", found.names),
        Column("load", "N/m", np.asarray(found.load), "resultant load"),
    ]
    every = np.stack([found.sag, found.tension], axis=-1)  # state, condition, sag or tension
    for method, values in (("", every), ("parabola", found.parabola), ("catenary", found.catenary)):
        for k, condition in enumerate(("initial", "final")):
            for j, (name, unit) in enumerate((("sag", "m"), ("tension", "N"))):
                heading = f"{name} {condition} {method}".strip()
                columns.append(Column(name, unit, np.asarray(values)[:, k, j], heading))
    note = f"governed by the limit of {found.governing!r}; without method: exact elastic catenary"
    return make_table("Sags and tensions", columns, (note,))
