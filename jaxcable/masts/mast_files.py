"""Masts in JSON and CSV files: sections, guys, ancillaries, states, directions, in SI units."""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from ..catalogue.tables import read_rows
from ..common.writing import atomic_write
from ..files import codec
from ..files.reading import FileError, read_json
from .guyed_mast import GuyedMast
from .mast_analysis import wind_directions
from .mast_components import Ancillary, GuyLevel, MastSection
from .mast_parts import guy_level, lattice_section, tube_section
from .mast_states import MastState, eurocode_state, tia_state

_STANDARDS = {"EN 1993-3-1": eurocode_state, "TIA-222": tia_state}
_LISTS = "sections", "guys", "ancillaries"
_TABLES = *_LISTS, "states"
_FUNCTIONS = (
    *(tube_section, lattice_section, MastSection, guy_level, GuyLevel, Ancillary),
    *(eurocode_state, tia_state, MastState),
)
"""Functions whose arguments are the columns of tables."""
_TEXTS = {
    *("name", "state", "standard", "profile", "cable"),
    *("terrain", "exposure", "pattern", "members"),
}
"""Columns whose fields are texts; those of others are numbers."""
_NAMES = "comment", "standard", "state"  # in objects, beside arguments
_OPTIONS = "base", "element_length"


class MastJob(NamedTuple):
    """A mast as in its file, with what acts on it.

    Attributes:
        mast: `GuyedMast`.
        states: `MastState` by name.
        directions: number of wind directions, or the angles, degrees.

    Example:
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> job = jc.masts.MastJob(jc.masts.GuyedMast([part], guys), {})
        >>> print(job.directions)
        12
    """

    mast: GuyedMast
    states: Mapping[str, MastState]
    directions: int | Sequence[float] = 12


def load_mast(
    path: str | PathLike[str],
    *,
    guys: str | PathLike[str] | None = None,
    ancillaries: str | PathLike[str] | None = None,
    states: str | PathLike[str] | None = None,
) -> MastJob:
    """Load a mast from JSON, or from CSV tables of sections, guys, ancillaries and states.

    A JSON file has lists of objects with the arguments of functions, in SI units:

    - ``sections``, from below: the arguments of `tube_section` (``"profile": "CHS 219.1x6.3"``), of
      `lattice_section` (``"sides": 3``), or of `MastSection`;
    - ``guys``, from below: those of `guy_level` (``"cable": "Galfan spiral strand 16"``) or of
      `GuyLevel`;
    - ``ancillaries``: those of `Ancillary`;
    - ``states``, an object by name: ``"standard": "EN 1993-3-1"`` with the arguments of
      `eurocode_state`, ``"TIA-222"`` with those of `tia_state`, or without a standard those of
      `MastState`, with profiles as in scenes, ``{"type": "WindTable", "pressures": 500.0}``.

    Beside them ``base``, ``element_length`` and ``directions``, a number of them or a list of
    degrees. Objects may have a ``comment``. A table has these arguments as columns, and that of
    states ``state`` and ``standard``; an empty field leaves its argument out, and several numbers
    are a list, ``0 120 240``. A list of a JSON file may be the name of a table beside it.

    Args:
        path: JSON file, or CSV table of sections.

    Options:
        guys, ancillaries, states: CSV tables, in place of the lists of the file.

    Returns:
        `MastJob`.

    Raises:
        OSError: there is no such file.
        FileError: wrong contents; names file and object.

    Example:
        >>> import pathlib, tempfile
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "mast.json"
        >>> _ = path.write_text('''{"sections": [{"top": 20, "profile": "CHS 168.3x6.3"}],
        ...   "guys": [{"height": 19, "radius": 12, "azimuths": [0, 120, 240],
        ...             "cable": "Galfan spiral strand 12", "share": 0.1}],
        ...   "states": {"wind": {"standard": "EN 1993-3-1", "velocity": 25}}}''')
        >>> job = jc.masts.load_mast(path)
        >>> print(job.mast.guys[0].tension, list(job.states))
        [15000. 15000. 15000.] ['wind']
    """
    path, tables = Path(path), {"guys": guys, "ancillaries": ancillaries, "states": states}
    head: dict[str, Any] = read_json(path) if path.suffix.lower() == ".json" else {"sections": path}
    names = {key: path.parent / head[key] for key in _TABLES if isinstance(head.get(key), str)}
    head |= names | {key: Path(table) for key, table in tables.items() if table is not None}
    for name in head.keys() - {*_LISTS, *_OPTIONS, "states", "directions", "comment"}:
        raise FileError(f"{path}: {name!r}: has no meaning here; expected {', '.join(_LISTS)}, ...")
    parts: dict[str, Any] = {}
    for key in _LISTS:
        rows = head.get(key, [])
        if isinstance(rows, list):
            rows = [(f"{path}: {key}[{k}]", row) for k, row in enumerate(rows)]
        elif isinstance(rows, Path):
            rows = _read_objects(rows)
        else:
            raise FileError(f"{path}: {key}: expected a list of objects, or the name of a table")
        parts[key] = [_make(place, key, row) for place, row in rows]
    options = {name: head[name] for name in _OPTIONS if name in head}
    mast = _call_or_file_error(str(path), GuyedMast, parts | options)
    found: dict[str, MastState] = {}
    if isinstance(rows := head.get("states", {}), Path):
        named = [(row.get("state"), place, row) for place, row in _read_objects(rows)]
    else:
        named = [(name, f"{path}: states.{name}", row) for name, row in dict(rows).items()]
    for name, place, row in named:
        if name is None or name in found:
            raise FileError(f"{place}: state: expected a name of its own, got {name!r}")
        found[name] = _make(place, "states", row)
    directions = head.get("directions", 12)
    _call_or_file_error(str(path), wind_directions, {"directions": directions})
    return MastJob(mast, found, directions)


def _read_objects(path):
    """Return the rows of a table as pairs: place in words, arguments by name; no empty fields."""
    every = [name for function in _FUNCTIONS for name in inspect.signature(function).parameters]
    names = {name.lower(): name for name in ("state", "standard", *every)}
    found = []
    for row in read_rows(path, tuple(names), ()):
        words = {column: word for column, word in row.fields.items() if word}
        given = {names[k]: x if k in _TEXTS else _numbers(row, k) for k, x in words.items()}
        found.append((row.place, given))
    return found


def _numbers(row, column):
    """Return the number in a field of a `TableRow`, or a list of several ones."""
    words = row.text(column).split()
    found = [row._replace(fields={column: word}).number(column) for word in words]
    return found if len(found) > 1 else found[0]


def _make(place, key, row):
    """Return what an object of a file stands for; FileError with its place for wrong arguments."""
    if not isinstance(row, dict):
        raise FileError(f"{place}: expected an object such as {{...}}")
    given = {name: value for name, value in row.items() if name not in _NAMES}
    if key == "sections":
        kind = tube_section if "profile" in given else MastSection
        return _call_or_file_error(place, lattice_section if "sides" in given else kind, given)
    if key == "guys":
        return _call_or_file_error(place, guy_level if "cable" in given else GuyLevel, given)
    if key == "ancillaries":
        return _call_or_file_error(place, Ancillary, given)
    standard = row.get("standard")
    if standard is not None and standard not in _STANDARDS:
        known = ", ".join(_STANDARDS)
        raise FileError(f"{place}: standard = {standard!r}: expected one of {known}")
    for name in given:
        if isinstance(given[name], dict):
            given[name] = codec.decode(given[name], f"{place}.{name}")
    return _call_or_file_error(place, _STANDARDS.get(standard, MastState), given)


def _call_or_file_error(place, function, given):
    """Return ``function(**given)``; FileError, with the place, for arguments that it refuses."""
    try:
        inspect.signature(function).bind(**given)
        return function(**given)
    except (TypeError, ValueError) as error:
        raise FileError(f"{place}: {error}") from None


def save_mast(path: str | PathLike[str], job: MastJob) -> Path:
    """Write a mast to a JSON file that `load_mast` reads, with sections and guys by their numbers.

    Args:
        path: of the file, ending with .json.
        job: `MastJob`.

    Returns:
        The path.

    Raises:
        OSError: the file cannot be written.
        ValueError: numbers that are traced or not finite.

    Example:
        >>> import pathlib, tempfile
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> job = jc.masts.MastJob(jc.masts.GuyedMast([part], guys), {}, 8)
        >>> path = jc.masts.save_mast(pathlib.Path(tempfile.mkdtemp()) / "mast.json", job)
        >>> print(jc.masts.load_mast(path).mast.guys[0].strength)
        150000.0
    """
    directions = job.directions if isinstance(job.directions, int) else list(job.directions)
    content: dict[str, Any] = {name: getattr(job.mast, name) for name in _OPTIONS}
    content["directions"] = directions
    for key in _LISTS:
        content[key] = [_fields(x, f"{key}[{k}]") for k, x in enumerate(getattr(job.mast, key))]
    content["states"] = {name: _fields(x, f"states.{name}") for name, x in job.states.items()}
    path = Path(path)
    with atomic_write(path) as stream:
        stream.write(json.dumps(content, indent=1) + "\n")
    return path


def _fields(record, place):
    """Return the fields of a record that are not None as data for JSON, by name."""
    every = {name: getattr(record, name) for name in record._all_fields}
    return {k: codec.encode(x, f"{place}.{k}") for k, x in every.items() if x is not None}
