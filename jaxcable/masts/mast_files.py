"""Masts in JSON files: sections, guys, ancillaries, states and directions."""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..catalogue.tables import read_rows
from ..common.writing import atomic_write
from ..files.reading import FileError, read_json
from ..loads import EurocodeWind, WindPowerLaw
from .guyed_mast import Ancillary, GuyedMast, GuyLevel, MastSection
from .mast_parts import guy_level, lattice_section, tube_section
from .mast_states import PEAK_FACTOR, MastState, eurocode_state, tia_state

_SECTIONS = {
    **{"top": ("top_m", 1.0), "EA": ("ea_mn", 1e6), "EI": ("ei_mnm2", 1e6)},
    **{"GJ": ("gj_mnm2", 1e6), "GA": ("ga_mn", 1e6), "weight": ("weight_n_per_m", 1.0)},
    **{"drag_area": ("drag_area_m2_per_m", 1.0), "ice_width": ("ice_width_m_per_m", 1.0)},
    **{"ice_length": ("ice_length_m_per_m", 1.0), "ice_diameter": ("ice_diameter_mm", 1e-3)},
    **{"sides": ("sides", 1), "width": ("width_m", 1.0), "panel": ("panel_m", 1.0)},
    **{k: (f"{k}_mm", 1e-3) for k in ("leg", "diagonal", "strut")},
    **{f"{k}_area": (f"{k}_area_cm2", 1e-4) for k in ("leg", "diagonal", "strut")},
    **{"drag": ("drag", 1.0), "modulus": ("modulus_gpa", 1e9)},
    **{"more_weight": ("more_weight_n_per_m", 1.0)},
    **{"more_drag_area": ("more_drag_area_m2_per_m", 1.0)},
}
"""Columns of tables of sections by arguments, with factors to SI units."""
_GUYS = {
    **{"height": ("height_m", 1.0), "EA": ("ea_mn", 1e6), "weight": ("weight_n_per_m", 1.0)},
    **{"diameter": ("diameter_mm", 1e-3), "strength": ("strength_kn", 1e3), "arm": ("arm_m", 1.0)},
    **{"drag": ("drag", 1.0), "share": ("share", 1.0)},
}
_GUY_LISTS = {
    **{"radius": ("radius_m", 1.0), "azimuths": ("azimuths_deg", 1.0)},
    **{"tension": ("tension_kn", 1e3), "anchor_height": ("anchor_height_m", 1.0)},
    **{"arm_azimuths": ("arm_azimuths_deg", 1.0)},
}
_ANCILLARIES = {
    **{"height": ("height_m", 1.0), "drag_area": ("drag_area_m2", 1.0), "weight": ("weight_n", 1.0)},
    **{"iced_drag_area": ("iced_drag_area_m2", 1.0), "iced_weight": ("iced_weight_n", 1.0)},
    **{"offset": ("offset_m", 1.0), "azimuth": ("azimuth_deg", 1.0)},
}
_STATES = {
    **{"velocity": ("velocity_m_per_s", 1.0), "ice": ("ice_mm", 1e-3)},
    **{"temperature": ("temperature_k", 1.0), "ice_density": ("ice_density_kg_per_m3", 1.0)},
    **{name: (name, 1.0) for name in ("wind_factor", "weight_factor", "scaling", "patch_factor")},
    **{name: (name, 1.0) for name in ("gust_factor", "directionality", "importance")},
    **{name: (name, 1.0) for name in ("topography", "ice_factor", "ice_exponent", "most_ice")},
}
_POWER_LAW = {
    **{"velocity": ("velocity_m_per_s", 1.0), "exponent": ("exponent", 1.0)},
    **{f"{k}_height": (f"{k}_height_m", 1.0) for k in ("reference", "lowest", "highest")},
    **{"density": ("density_kg_per_m3", 1.0)},
}
_WORDS = {
    "sections": ("profile", "pattern", "members", "standard"),
    "guys": ("cable",),
    "ancillaries": ("ancillary",),
    "states": ("state", "standard", "terrain", "exposure"),
}
"""Columns of texts by table."""
_NEEDED = {
    "sections": ("top_m",),
    "guys": ("height_m", "radius_m", "azimuths_deg"),
    "ancillaries": ("height_m",),
    "states": ("state", "standard", "velocity_m_per_s"),
}


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
    """Load a mast from a JSON file with the lists sections, guys, ancillaries, states.

    Each is a list of objects, whose keys end with their units:

    - ``sections``, from below: ``top_m`` with ``profile`` (`tube_section`); or with ``sides,
      width_m, panel_m, leg_mm, diagonal_mm, strut_mm, pattern, members`` (`lattice_section`); or
      with ``EA_MN, EI_MNm2, GJ_MNm2, GA_MN, weight_N_per_m, drag_area_m2_per_m`` (`MastSection`);
    - ``guys``, from below: ``height_m, radius_m, azimuths_deg`` (a list), ``cable`` and ``share``;
      or ``EA_MN, weight_N_per_m, diameter_mm, strength_kN, tension_kN``; also ``arm_m``;
    - ``ancillaries``: ``ancillary`` (its name), ``height_m, drag_area_m2, weight_N, offset_m``;
    - ``states``: ``state`` (its name), ``standard`` ("EN 1993-3-1" with ``terrain``, "TIA-222" with
      ``exposure``, or "power law"), ``velocity_m_per_s, ice_mm, wind_factor, weight_factor``.

    Other arguments of these functions have keys of the same kind. Beside the lists there are
    ``base``, ``element_length_m`` and ``directions``, a number of them or a list of degrees.

    Args:
        path: of the file.

    Returns:
        `MastJob`.

    Raises:
        OSError: there is no such file.
        FileError: wrong contents; names file and row.
        ValueError: a mast that cannot be.

    Example:
        >>> import pathlib, tempfile
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "mast.json"
        >>> _ = path.write_text('''{"sections": [{"top_m": 20, "profile": "CHS 168.3x6.3"}],
        ...   "guys": [{"height_m": 19, "radius_m": 12, "azimuths_deg": [0, 120, 240],
        ...             "cable": "Galfan spiral strand 12", "share": 0.1}],
        ...   "states": [{"state": "wind", "standard": "EN 1993-3-1", "velocity_m_per_s": 25}]}''')
        >>> job = jc.masts.load_mast(path)
        >>> print(job.mast.guys[0].tension, list(job.states))
        [15000. 15000. 15000.] ['wind']
    """
    head = read_json(path)
    for name in ("sections", "guys"):
        if not head.get(name):
            raise FileError(f"{path}: {name}: missing; a list of objects, one for each row")
    parts = [_section_of_row(row) for row in _rows(path, head, "sections", _SECTIONS)]
    levels = [_level_of_row(row) for row in _rows(path, head, "guys", _GUYS | _GUY_LISTS)]
    others = [
        _made(row, Ancillary, _numbers(row, _ANCILLARIES) | _words(row, {"name": "ancillary"}))
        for row in _rows(path, head, "ancillaries", _ANCILLARIES)
    ]
    states: dict[str, MastState] = {}
    for row in _rows(path, head, "states", _STATES | _POWER_LAW):
        if row.text("state") in states:
            raise FileError(f"{row.place}: state {row.text('state')!r} occurs twice")
        states[row.text("state")] = _state_of_row(row)
    options = {"base": head["base"]} if "base" in head else {}
    if "element_length_m" in head:
        options["element_length"] = float(head["element_length_m"])
    return MastJob(GuyedMast(parts, levels, others, **options), states, head.get("directions", 12))


def _rows(path, head, key, columns):
    """Return the rows of a list of the file; none if the file has no such list."""
    if not head.get(key):
        return []
    known = *_WORDS[key], *(column for column, _ in columns.values())
    try:
        return read_rows(path, known, _NEEDED[key], key)
    except FileError as error:
        text = str(error)
        raise FileError(text if text.startswith(f"{path}: ") else f"{path}: {text}") from None


def _numbers(row, columns):
    """Return the arguments whose columns a row fills, as numbers in SI units, by name."""
    return {
        name: row.number(column) * factor
        for name, (column, factor) in columns.items()
        if row.text(column)
    }


def _words(row, columns):
    """Return the arguments whose columns a row fills, as texts, by name."""
    return {name: row.text(column) for name, column in columns.items() if row.text(column)}


def _made(row, function, arguments):
    """Return what a function makes of arguments; FileError with the row for those it refuses."""
    known = inspect.signature(function).parameters
    takes_all = any(p.kind is p.VAR_KEYWORD for p in known.values())
    for name in arguments:
        if not takes_all and name not in known:
            raise FileError(f"{row.place}: {name}: has no meaning beside the other columns")
    missing = [
        p.name
        for p in known.values()
        if p.default is p.empty and p.kind is not p.VAR_KEYWORD and p.name not in arguments
    ]
    if missing:
        raise FileError(f"{row.place}: lacks the column of {missing[0]}")
    try:
        return function(**arguments)
    except (ValueError, TypeError) as error:
        raise FileError(f"{row.place}: {error}") from None


def _section_of_row(row):
    """Return the `MastSection` of a row: of a tube, of a lattice, or by stiffnesses."""
    names = ("profile", "pattern", "members", "standard")
    given = _numbers(row, _SECTIONS) | _words(row, {name: name for name in names})
    if "sides" in given:
        given["sides"] = int(given["sides"])
    kind = lattice_section if "sides" in given else MastSection
    return _made(row, tube_section if "profile" in given else kind, given)


def _level_of_row(row):
    """Return the `GuyLevel` of a row: of a cable of the catalogue, or by numbers."""
    given = _numbers(row, _GUYS) | _words(row, {"cable": "cable"})
    for name, (column, factor) in _GUY_LISTS.items():
        words = row.text(column).strip("[]").replace(",", " ").split()
        try:
            values = [factor * float(word) for word in words]
        except ValueError:
            raise FileError(f"{row.place}: {column}: expected numbers, one or one a guy") from None
        if values:
            given[name] = values if name == "azimuths" or len(values) > 1 else values[0]
    return _made(row, guy_level if "cable" in given else GuyLevel, given)


def _state_of_row(row):
    """Return the `MastState` of a row, after its standard."""
    given, standard = _numbers(row, _STATES), row.text("standard")
    words = _words(row, {"terrain": "terrain", "exposure": "exposure"})
    if standard == "EN 1993-3-1":
        return _made(row, eurocode_state, given | words)
    if standard == "TIA-222":
        return _made(row, tia_state, given | words)
    if standard == "power law":
        wind = _made(row, WindPowerLaw, _numbers(row, _POWER_LAW))
        return _made(row, MastState, {k: x for k, x in given.items() if k != "velocity"} | {"wind": wind})
    text = "expected EN 1993-3-1, TIA-222 or power law"
    raise FileError(f"{row.place}: standard = {standard!r}: {text}")


def save_mast(path: str | PathLike[str], job: MastJob) -> Path:
    """Write a mast to a JSON file that `load_mast` reads, with sections and guys by their numbers.

    Args:
        path: of the file, ending with .json.
        job: `MastJob`; its winds are after EN 1991-1-4 or power laws.

    Returns:
        The path.

    Raises:
        OSError: the file cannot be written.
        ValueError: a wind profile of another kind.

    Example:
        >>> import pathlib, tempfile
        >>> part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
        >>> guys = [jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")]
        >>> job = jc.masts.MastJob(jc.masts.GuyedMast([part], guys), {}, 8)
        >>> path = jc.masts.save_mast(pathlib.Path(tempfile.mkdtemp()) / "mast.json", job)
        >>> print(jc.masts.load_mast(path).mast.guys[0].strength)
        150000.0
    """
    mast = job.mast
    directions = job.directions if isinstance(job.directions, int) else list(job.directions)
    content: dict[str, Any] = {
        "base": mast.base,
        "element_length_m": float(mast.element_length),
        "directions": directions,
        "sections": [_row_of(part, _SECTIONS) for part in mast.sections],
        "guys": [_row_of(level, _GUYS | _GUY_LISTS) for level in mast.guys],
    }
    if mast.ancillaries:
        content["ancillaries"] = [
            {"ancillary": one.name, **_row_of(one, _ANCILLARIES)} for one in mast.ancillaries
        ]
    if job.states:
        content["states"] = [_row_of_state(name, state) for name, state in job.states.items()]
    path = Path(path)
    with atomic_write(path) as stream:
        stream.write(json.dumps(content, indent=1) + "\n")
    return path


def _row_of(record, columns):
    """Return the numbers of a record by column, without those that are None or that it lacks."""
    found = {}
    for name, (column, factor) in columns.items():
        value = getattr(record, name, None)
        if value is not None:
            found[column] = (np.asarray(value, float) / factor).tolist()
    return found


def _row_of_state(name, state):
    """Return the row of a state; ValueError for a wind that a file does not have."""
    columns = {k: v for k, v in _STATES.items() if k not in ("velocity", "scaling")}
    row, wind, gust = {"state": name, **_row_of(state, columns)}, state.wind, state.gust
    kinds = isinstance(wind, EurocodeWind), isinstance(gust, EurocodeWind)
    if all(kinds) and wind.terrain is not None and float(wind.velocity) == float(gust.velocity):
        row["scaling"] = row.pop("patch_factor") * PEAK_FACTOR
        own = {"terrain": wind.terrain, "velocity_m_per_s": float(wind.velocity)}
        return row | {"standard": "EN 1993-3-1", **own}
    if isinstance(wind, WindPowerLaw) and gust is None:
        return row | {"standard": "power law", **_row_of(wind, _POWER_LAW)}
    raise ValueError(
        f"states[{name!r}]: files have winds of eurocode_state, or power laws without gusts"
    )
