"""Masts in JSON files: sections, guys, ancillaries, states and directions, in SI units."""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

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


def load_mast(path: str | PathLike[str]) -> MastJob:
    """Load a mast from a JSON file: lists of objects with the arguments of functions, in SI units.

    - ``sections``, from below: the arguments of `tube_section` (``"profile": "CHS 219.1x6.3"``), of
      `lattice_section` (``"sides": 3``), or of `MastSection`;
    - ``guys``, from below: those of `guy_level` (``"cable": "Galfan spiral strand 16"``) or of
      `GuyLevel`;
    - ``ancillaries``: those of `Ancillary`;
    - ``states``, an object by name: ``"standard": "EN 1993-3-1"`` with the arguments of
      `eurocode_state`, ``"TIA-222"`` with those of `tia_state`, or without a standard those of
      `MastState`, with profiles as in scenes, ``{"type": "WindTable", "pressures": 500.0}``.

    Beside them ``base``, ``element_length`` and ``directions``, a number of them or a list of
    degrees. Objects may have a ``comment``.

    Args:
        path: of the file.

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
    head = read_json(path)
    for name in head.keys() - {*_LISTS, *_OPTIONS, "states", "directions", "comment"}:
        raise FileError(f"{path}: {name!r}: has no meaning here; expected {', '.join(_LISTS)}, ...")
    parts: dict[str, Any] = {}
    for key in _LISTS:
        rows = head.get(key, [])
        if not isinstance(rows, list):
            raise FileError(f"{path}: {key}: expected a list of objects")
        parts[key] = [_make(f"{path}: {key}[{k}]", key, row) for k, row in enumerate(rows)]
    options = {name: head[name] for name in _OPTIONS if name in head}
    mast = _call(str(path), GuyedMast, parts | options)
    states = dict(head.get("states", {}))
    found = {name: _make(f"{path}: states.{name}", "states", row) for name, row in states.items()}
    directions = head.get("directions", 12)
    _call(str(path), wind_directions, {"directions": directions})
    return MastJob(mast, found, directions)


def _make(place, key, row):
    """Return what an object of a file stands for; FileError with its place for wrong arguments."""
    if not isinstance(row, dict):
        raise FileError(f"{place}: expected an object such as {{...}}")
    given = {name: value for name, value in row.items() if name not in ("comment", "standard")}
    if key == "sections":
        kind = tube_section if "profile" in given else MastSection
        return _call(place, lattice_section if "sides" in given else kind, given)
    if key == "guys":
        return _call(place, guy_level if "cable" in given else GuyLevel, given)
    if key == "ancillaries":
        return _call(place, Ancillary, given)
    standard = row.get("standard")
    if standard is not None and standard not in _STANDARDS:
        known = ", ".join(_STANDARDS)
        raise FileError(f"{place}: standard = {standard!r}: expected one of {known}")
    for name in given:
        if isinstance(given[name], dict):
            given[name] = codec.decode(given[name], f"{place}.{name}")
    return _call(place, _STANDARDS.get(standard, MastState), given)


def _call(place, function, given):
    """Return a function of arguments by name; FileError with the place for those it refuses."""
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
