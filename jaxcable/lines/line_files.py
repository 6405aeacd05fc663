"""Lines in files: tables of towers, states, ground and crossings, CSV and JSON."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from ..catalogue import conductor
from ..catalogue.tables import read_rows
from ..common import checks
from ..common.writing import atomic_write
from ..files.reading import FileError, read_json
from . import line_section, line_states
from .line_section import KINDS, LineSection
from .line_states import LineState

_COLUMNS = {
    "towers": (
        *("tower", "kind", "station_m", "ground_m", "height_m", "offset_m", "angle_deg"),
        *("string_length_m", "string_weight_n", "string_area_m2"),
    ),
    "states": (
        *("state", "condition", "role", "ice_mm", "temperature_c", "wind_pa", "wind_direction_deg"),
        *("drag", "extra_n_per_m", "ice_density_kg_per_m3", "broken_span"),
    ),
    "ground": ("station_m", "elevation_m"),
    "crossings": ("crossing", "station_m", "offset_m", "elevation_m"),
}
"""Columns of the tables of a line."""
_TOWERS = dict(zip(line_section.NUMBERS, _COLUMNS["towers"][2:], strict=True))
"""Columns of tables of towers by fields of `LineSection`; from `offset` on they may be left out."""
_STATES = dict(zip(line_states.NUMBERS, _COLUMNS["states"][4:-1], strict=True))
"""Columns of tables of states by fields of `LineState`, beside ice, condition and broken span."""
_NEEDED = _COLUMNS | {"towers": _COLUMNS["towers"][:5], "states": ("state",)}
_SPELLING = {
    name.lower(): name
    for name in ("temperature_C", "wind_Pa", "extra_N_per_m", "string_weight_N", "tension_N")
}
"""Names of columns and keys with units in capitals, as files have them, by those in lower case."""
_ROLES = "stretches", "creeps"
_TEMPERATURES = 0.0, 15.0, 30.0  # of a stringing chart, degrees C
_STRINGING = {
    **{"parameter_m": "parameter", "tension_n": "horizontal_tension", "sag_m": "sag"},
    **{"span": "span", "temperature_c": "temperature"},
}
"""Keys in files, in lower case, by which arguments of `string` are stated."""


class Line(NamedTuple):
    """A line as in its file: a section, how it is strung, its states.

    Attributes:
        section: `LineSection`.
        stringing: arguments of `string`, by name.
        states: `LineState` by name.
        loads: names of the states whose load stretches the conductor for good.
        creep: name of the state in which it creeps for ten years; None: it does not.
        temperatures: of the stringing chart, degrees C.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> line = jc.lines.Line(section, {"parameter": 1500.0}, {"hot": jc.lines.LineState(75.0)})
        >>> print(line.temperatures)
        (0.0, 15.0, 30.0)
    """

    section: LineSection
    stringing: dict[str, Any]
    states: dict[str, LineState]
    loads: tuple[str, ...] = ()
    creep: str | None = None
    temperatures: tuple[float, ...] = _TEMPERATURES


def load_line(
    path: str | PathLike[str],
    *,
    states: str | PathLike[str] | None = None,
    ground: str | PathLike[str] | None = None,
    crossings: str | PathLike[str] | None = None,
    conductor_name: str | None = None,
    stringing: Mapping[str, Any] | None = None,
) -> Line:
    """Load a line from a JSON file, or from CSV tables of towers, states, ground and crossings.

    Columns, of which all but the first five of towers and the first of states may be left out:

    - towers: ``tower, kind, station_m, ground_m, height_m, offset_m, angle_deg, string_length_m,
      string_weight_N, string_area_m2``;
    - states: ``state, temperature_C, ice_mm, wind_Pa, wind_direction_deg, drag, extra_N_per_m,
      ice_density_kg_per_m3, condition, broken_span, role``; uneven ice is a list, ``0 20 20``;
      spans count from 1; the role is "stretches", "creeps" (of one state) or both, with a space;
    - ground: ``station_m, elevation_m``; crossings: ``crossing, station_m, offset_m, elevation_m``.

    A JSON file has lists of objects with these keys, and ``"conductor": "Drake"``, ``"stringing":
    {"parameter_m": 1500, "temperature_C": 15}`` (or ``tension_N``; or ``sag_m`` and ``span``),
    ``"temperatures_C"`` of the stringing chart.

    Args:
        path: JSON file, or CSV table of towers.

    Options:
        states, ground, crossings: CSV tables beside one of towers.
        conductor_name: of the conductor (`catalogue.conductor`), in place of that of the file.
        stringing: arguments of `string`, in place of those of the file.

    Returns:
        `Line`.

    Raises:
        OSError: there is no such file.
        FileError: wrong contents; names file and line.
        ValueError: numbers that a section or state cannot have.

    Example:
        >>> import pathlib, tempfile
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "towers.csv"
        >>> _ = path.write_text(
        ...     "tower,kind,station_m,ground_m,height_m\\n1,post,0,5,20\\n2,post,300,8,20\\n"
        ... )
        >>> line = jc.lines.load_line(path, conductor_name="Drake", stringing={"parameter": 1500})
        >>> print(line.section.names, line.section.conductor.name)
        ('1', '2') Drake
    """
    path = Path(path)
    files = {"towers": path, "states": states, "ground": ground, "crossings": crossings}
    head: dict[str, Any] = {}
    if path.suffix.lower() == ".json":
        head = read_json(path)
        files = {key: path if key in {"towers", *head} else None for key in files}
    name = conductor_name or head.get("conductor")
    if not isinstance(name, str):
        raise FileError(f"{path}: conductor: name one of the catalogue, such as Drake")
    rows = {key: _rows(file, key) for key, file in files.items()}
    section = _section_of_rows(rows, name, files["crossings"])
    found, loads, creep = _states_of_rows(rows["states"], len(section.layout.spans))
    for argument in stringing or ():
        checks.require_one_of(argument, "stringing", tuple(_STRINGING.values()))
    strung = _stringing_of(head, path) if stringing is None else dict(stringing)
    temperatures = tuple(map(float, head.get("temperatures_C", _TEMPERATURES)))
    return Line(section, strung, found, loads, creep, temperatures)


def _rows(path, key):
    """Return the rows of a table of a kind, of a CSV or JSON file; none without a path."""
    try:
        return [] if path is None else read_rows(path, _COLUMNS[key], _NEEDED[key], key)
    except FileError as error:  # may have the path twice: from the line, and from the whole file
        text = str(error).removeprefix(f"{path}: ")
        raise FileError(f"{path}: {text.removeprefix(f'{path}: ')}") from None


def _section_of_rows(rows, name, crossings_file):
    """Return the `LineSection` of the rows of all tables, with the conductor of this name."""
    profile = [[row.number(column) for column in _COLUMNS["ground"]] for row in rows["ground"]]
    for row, (before, here) in zip(rows["ground"][1:], itertools.pairwise(profile), strict=True):
        if here[0] <= before[0]:
            raise FileError(
                f"{row.place}: station_m = {here[0]:g}: must be more than that of the point "
                "before (a step in the ground: two stations 0.01 m apart)"
            )
    crossings: dict[str, list[list[float]]] = {}
    for row in rows["crossings"]:
        point = [row.number(column) for column in _COLUMNS["crossings"][1:]]
        crossings.setdefault(row.text("crossing"), []).append(point)
    for crossing, points in crossings.items():
        if len(points) < 2:
            text = f"crossing {crossing!r}: has one point; give two or more"
            raise FileError(f"{crossings_file}: {text}")
    for row in rows["towers"]:
        if row.text("kind") not in KINDS:
            raise FileError(f"{row.place}: kind: expected one of {', '.join(KINDS)}")
    absent = {column: None if column in _NEEDED["towers"] else 0.0 for column in _TOWERS.values()}
    return LineSection(
        conductor(name),
        kinds=[row.text("kind") for row in rows["towers"]],
        names=[row.text("tower") for row in rows["towers"]],
        profile=profile or None,
        crossings=crossings,
        **{f: [row.number(c, absent[c]) for row in rows["towers"]] for f, c in _TOWERS.items()},
    )


def _state_of_row(row, count):
    """Return the `LineState` of a row of the table of states; ValueError if it has none."""
    broken = None
    if row.text("broken_span"):
        broken = row.number("broken_span")
        if broken not in range(1, count + 1):
            text = f"expected a whole number from 1 to {count}, the number of spans"
            raise ValueError(f"broken_span = {broken:g}: {text}")
        broken -= 1
    try:
        ice = [1e-3 * float(word) for word in row.text("ice_mm").split()] or [0.0]
    except ValueError:
        raise ValueError("ice_mm: expected numbers, one or one a span") from None
    if len(ice) not in (1, count):
        raise ValueError(f"ice_mm: {len(ice)} numbers, for {count} spans")
    numbers = {f: row.number(c, float(getattr(LineState(), f))) for f, c in _STATES.items()}
    condition = row.text("condition") or "initial"
    ice = ice[0] if len(ice) == 1 else ice
    return LineState(ice=ice, condition=condition, broken=broken, **numbers)


def _states_of_rows(rows, count):
    """Return the states of a table by name, the names of those that stretch, and that of creep.

    `count` is the number of spans.
    """
    found, loads, creep = {}, [], None
    for row in rows:
        name, role = row.text("state"), row.text("role")
        try:
            if name in found:
                raise ValueError(f"state {name!r} occurs twice; give it another name")
            if not set(role.split()) <= set(_ROLES):
                raise ValueError(f"role {role!r}: expected {', '.join(_ROLES)}, both or none")
            if "creeps" in role and creep is not None:
                raise ValueError(f"role: state {creep!r} creeps already; only one state may")
            found[name] = _state_of_row(row, count)
        except ValueError as error:  # one of reading has the place
            text = str(error).removeprefix(f"{row.place}: ")
            raise FileError(f"{row.place}: {text}") from None
        loads += [name] if "stretches" in role else []
        creep = name if "creeps" in role else creep
    return found, tuple(loads), creep


def _stringing_of(head, path):
    """Return the arguments of `string` in the head of a file."""
    stated = {str(k).lower(): v for k, v in dict(head.get("stringing", {})).items()}
    for name in stated:
        if name not in _STRINGING:
            text = "expected parameter_m, tension_N, sag_m, span, temperature_C"
            raise FileError(f"{path}: stringing: {name!r}: {text}")
    given = {_STRINGING[name]: float(value) for name, value in stated.items()}
    if len(given.keys() - {"span", "temperature"}) != 1:
        raise FileError(f"{path}: stringing: give one of parameter_m, tension_N, sag_m")
    if "span" in given:
        given["span"] = int(given["span"]) - 1
    return {"temperature": 15.0} | given


def _require_of_catalogue(own):
    """ValueError for a `Conductor` that its name alone does not give back."""
    text = f"line.section.conductor: {own.name!r} is not that of the catalogue"
    why = "a file has only the name of a conductor"
    try:
        known = conductor(own.name)
    except ValueError:
        raise ValueError(f"{text}; {why}") from None
    one, other = jax.tree.flatten(own), jax.tree.flatten(known)
    same = one[1] == other[1] and all(map(np.array_equal, one[0], other[0]))
    if not same:
        raise ValueError(f"{text}: its numbers are changed; {why}")


def save_line(path: str | PathLike[str], line: Line) -> Path:
    """Write a line to a JSON file that `load_line` reads; its conductor by its name.

    Only a conductor of the catalogue can be written, as it is there.

    Args:
        path: path of the file, ending with .json.
        line: `Line`.

    Returns:
        The path.

    Raises:
        OSError: the file cannot be written.
        ValueError: the conductor is none of the catalogue, or is changed.

    Example:
        >>> import pathlib, tempfile
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> line = jc.lines.Line(section, {"parameter": 1500.0}, {"hot": jc.lines.LineState(75.0)})
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "line.json"
        >>> print(jc.lines.load_line(jc.lines.save_line(path, line)).states["hot"].temperature)
        75.0
    """
    section, path = line.section, Path(path)
    _require_of_catalogue(section.conductor)
    states = []
    for name, state in line.states.items():
        has_role = zip(_ROLES, (name in line.loads, name == line.creep), strict=True)
        role = " ".join(one for one, is_its in has_role if is_its)
        ice = " ".join(repr(1e3 * float(x)) for x in np.atleast_1d(np.asarray(state.ice)))
        numbers = (float(getattr(state, field)) for field in _STATES)
        broken = None if state.broken is None else state.broken + 1
        states.append((name, state.condition, role, ice, *numbers, broken))
    columns = (np.asarray(getattr(section, field), float).tolist() for field in _TOWERS)
    tables = {
        "towers": [*zip(section.names, section.kinds, *columns, strict=True)],
        "states": states,
        "ground": [] if section.profile is None else np.asarray(section.profile).tolist(),
        "crossings": [
            (name, *point)
            for name, points in (section.crossings or {}).items()
            for point in np.asarray(points).tolist()
        ],
    }
    given = {"temperature": 15.0} | line.stringing
    stated = {k: float(given[name]) for k, name in _STRINGING.items() if name in given}
    if "span" in stated:
        stated["span"] = given["span"] + 1
    content: dict[str, Any] = {"conductor": section.conductor.name}
    content["stringing"] = {_SPELLING.get(k, k): x for k, x in stated.items()}
    content["temperatures_C"] = list(line.temperatures)
    for key, rows in tables.items():
        objects = [zip(_COLUMNS[key], row, strict=True) for row in rows]
        content[key] = [{_SPELLING.get(k, k): x for k, x in o if x is not None} for o in objects]
    content = {key: value for key, value in content.items() if value or key not in _COLUMNS}
    with atomic_write(path) as stream:
        stream.write(json.dumps(content, indent=1) + "\n")
    return path
