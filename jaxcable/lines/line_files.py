"""Lines in files: tables of towers, states, ground and crossings, CSV and JSON."""

from __future__ import annotations

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
from .line_section import KINDS, LineSection
from .line_states import CONDITIONS, LineState

_TOWERS = {
    "station": "station_m",
    "ground": "ground_m",
    "height": "height_m",
    "offset": "offset_m",
    "angle": "angle_deg",
    "string_length": "string_length_m",
    "string_weight": "string_weight_n",
    "string_area": "string_area_m2",
}
"""Columns of tables of towers by fields of `LineSection`; from `offset` on they may be left out."""
_STATES = {
    "temperature": "temperature_c",
    "wind": "wind_pa",
    "wind_direction": "wind_direction_deg",
    "drag": "drag",
    "extra": "extra_n_per_m",
    "ice_density": "ice_density_kg_per_m3",
}
"""Columns of tables of states by fields of `LineState`, beside ice, condition and broken span."""
_ROLES = "stretches", "creeps"
_STRINGING = {"parameter_m": "parameter", "tension_n": "horizontal_tension", "sag_m": "sag"}
_KINDS_OF_FILES = "towers", "states", "ground", "crossings"
_NEEDED_TOWERS = ("tower", "kind", "station_m", "ground_m", "height_m")


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
    temperatures: tuple[float, ...] = (0.0, 15.0, 30.0)


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
    path, whole = Path(path), path
    others = {"states": states, "ground": ground, "crossings": crossings}
    head: dict[str, Any] = {}
    if path.suffix.lower() == ".json":
        head = read_json(path)
        others = {name: whole if name in head else None for name in others}
    name = conductor_name or head.get("conductor")
    if not isinstance(name, str):
        raise FileError(f"{path}: conductor: name one of the catalogue, such as Drake")
    ground_rows = _rows(others["ground"], "ground", ("station_m", "elevation_m"))
    columns = ("crossing", "station_m", "offset_m", "elevation_m")
    crossed: dict[str, list[list[float]]] = {}
    for row in _rows(others["crossings"], "crossings", columns):
        crossed.setdefault(row.text("crossing"), []).append([row.number(c) for c in columns[1:]])
    for crossing, points in crossed.items():
        if len(points) < 2:
            text = f"crossing {crossing!r}: has one point; give two or more"
            raise FileError(f"{others['crossings']}: {text}")
    profile = [[row.number("station_m"), row.number("elevation_m")] for row in ground_rows]
    for k in range(1, len(profile)):
        if profile[k][0] <= profile[k - 1][0]:
            raise FileError(
                f"{ground_rows[k].place}: station_m = {profile[k][0]:g}: must be more than that of "
                "the point before (a step in the ground: two stations 0.01 m apart)"
            )
    section = _section_of_rows(path, name, profile or None, crossed)
    state_rows = _rows(others["states"], "states", ("state",))
    found = _states_of_rows(state_rows, len(section.layout.spans))
    strung = _known_stringing(stringing) if stringing is not None else _stringing_of(head, path)
    line = Line(section, strung, *found)
    if "temperatures_C" in head:
        line = line._replace(temperatures=tuple(map(float, head["temperatures_C"])))
    return line


def _rows(path, key, needed):
    """Return the rows of a table of a kind, of a CSV or JSON file; none without a path."""
    if path is None:
        return []
    columns = {
        "towers": (*_NEEDED_TOWERS[:2], *_TOWERS.values()),
        "states": ("state", "ice_mm", "condition", "broken_span", "role", *_STATES.values()),
        "ground": needed,
        "crossings": needed,
    }[key]
    try:
        return read_rows(path, columns, needed, key)
    except FileError as error:  # may have the path twice: from the line, and from the whole file
        text = str(error).removeprefix(f"{path}: ")
        raise FileError(text if text.startswith(f"{path}: ") else f"{path}: {text}") from None


def _section_of_rows(path, name, profile, crossings):
    """Return the `LineSection` of a table of towers."""
    rows = _rows(path, "towers", _NEEDED_TOWERS)
    for row in rows:
        if row.text("kind") not in KINDS:
            raise FileError(f"{row.place}: kind: expected one of {', '.join(KINDS)}")
    table = {
        field: [row.number(column, None if column in _NEEDED_TOWERS else 0.0) for row in rows]
        for field, column in _TOWERS.items()
    }
    return LineSection(
        conductor(name),
        kinds=[row.text("kind") for row in rows],
        names=[row.text("tower") for row in rows],
        profile=profile,
        crossings=crossings,
        **table,
    )


def _broken_span(row, count):
    """Return the index, from 0, of the broken span in a row of the table of states, or None."""
    if not row.text("broken_span"):
        return None
    number = row.number("broken_span")
    if number % 1 != 0 or not 1 <= number <= count:
        text = f"expected a whole number from 1 to {count}, the number of spans"
        raise FileError(f"{row.place}: broken_span = {number:g}: {text}")
    return int(number) - 1


def _states_of_rows(rows, count):
    """Return the states of a table by name, the names of those that stretch, and that of creep."""
    usual, found, roles = LineState(), {}, {role: [] for role in _ROLES}
    for row in rows:
        name, role = row.text("state"), row.text("role")
        if name in found:
            raise FileError(f"{row.place}: state {name!r} occurs twice; give it another name")
        if not set(role.split()) <= set(_ROLES):
            raise FileError(
                f"{row.place}: role {role!r}: expected {', '.join(_ROLES)}, both or none"
            )
        if "creeps" in role.split() and roles["creeps"]:
            first = roles["creeps"][0]
            raise FileError(
                f"{row.place}: role: state {first!r} creeps already; only one state may"
            )
        if (condition := row.text("condition") or "initial") not in CONDITIONS:
            raise FileError(f"{row.place}: condition: expected one of {', '.join(CONDITIONS)}")
        try:
            ice = [1e-3 * float(word) for word in row.text("ice_mm").split()] or [0.0]
        except ValueError:
            raise FileError(f"{row.place}: ice_mm: expected numbers, one or one a span") from None
        if len(ice) not in (1, count):
            raise FileError(f"{row.place}: ice_mm: {len(ice)} numbers, for {count} spans")
        numbers = {
            field: row.number(column, float(getattr(usual, field)))
            for field, column in _STATES.items()
        }
        broken = _broken_span(row, count)
        try:
            found[name] = LineState(
                ice=ice[0] if len(ice) == 1 else ice, condition=condition, broken=broken, **numbers
            )
        except ValueError as error:
            raise FileError(f"{row.place}: {error}") from None
        for one in set(role.split()):
            roles[one].append(name)
    creep = roles["creeps"][0] if roles["creeps"] else None
    return found, tuple(roles["stretches"]), creep


def _known_stringing(stringing):
    """Return the arguments of `string` as a dict; ValueError for names that it does not have."""
    names = *_STRINGING.values(), "span", "temperature"
    for name in stringing:
        checks.require_one_of(name, "stringing", names)
    return dict(stringing)


def _stringing_of(head, path):
    """Return the arguments of `string` in the head of a file."""
    stated = {str(k).lower(): v for k, v in dict(head.get("stringing", {})).items()}
    for name in stated:
        if name not in (*_STRINGING, "span", "temperature_c"):
            text = "expected parameter_m, tension_N, sag_m, span, temperature_C"
            raise FileError(f"{path}: stringing: {name!r}: {text}")
    given = {_STRINGING[k]: float(v) for k, v in stated.items() if k in _STRINGING}
    if len(given) != 1:
        raise FileError(f"{path}: stringing: give one of parameter_m, tension_N, sag_m")
    if "span" in stated:
        given["span"] = int(stated["span"]) - 1
    return {**given, "temperature": float(stated.get("temperature_c", 15.0))}


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
    towers = [
        {
            "tower": name,
            "kind": kind,
            **{c: float(np.asarray(getattr(section, f))[k]) for f, c in _TOWERS.items()},
        }
        for k, (name, kind) in enumerate(zip(section.names, section.kinds, strict=True))
    ]
    states = []
    for name, state in line.states.items():
        is_one = dict(zip(_ROLES, (name in line.loads, name == line.creep), strict=True))
        role = " ".join(one for one in _ROLES if is_one[one])
        ice = " ".join(repr(1e3 * float(x)) for x in np.atleast_1d(np.asarray(state.ice)))
        numbers = {column: float(getattr(state, field)) for field, column in _STATES.items()}
        broken = {} if state.broken is None else {"broken_span": state.broken + 1}
        own = {"state": name, "condition": state.condition, "role": role, "ice_mm": ice}
        states.append(own | numbers | broken)
    stated = {c: float(line.stringing[f]) for c, f in _STRINGING.items() if f in line.stringing}
    stated["temperature_c"] = float(line.stringing.get("temperature", 15.0))
    if "span" in line.stringing:
        stated["span"] = line.stringing["span"] + 1
    content: dict[str, Any] = {
        "conductor": section.conductor.name,
        "stringing": stated,
        "temperatures_C": list(line.temperatures),
        "towers": towers,
        "states": states,
    }
    if section.profile is not None:
        rows = np.asarray(section.profile).tolist()
        content["ground"] = [{"station_m": s, "elevation_m": z} for s, z in rows]
    content["crossings"] = [
        {"crossing": name, "station_m": s, "offset_m": y, "elevation_m": z}
        for name, points in (section.crossings or {}).items()
        for s, y, z in np.asarray(points).tolist()
    ]
    if not content["crossings"]:
        del content["crossings"]
    with atomic_write(path) as stream:
        stream.write(json.dumps(content, indent=1) + "\n")
    return path
