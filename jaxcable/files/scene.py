"""Scenes in JSON files: a structure and its phases, exact to the last digit.

The format, version 1::

    {
     "format": "jaxcable scene", "version": 1,
     "structure": {
      "nodes": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
      "elements": {"type": "Cables", "links": [[0, 1]], "axial_stiffness": 1e5},
      "supports": {"nodes": [0, 1]}},
     "phases": [
      {"name": "prestress", "pretension": 200.0, "increments": 10},
      {"loads": {"type": "NodalLoads", "nodes": [1], "forces": [0.0, 0.0, -10.0]}}]}

A phase may have a "name", for reports. "actions" beside the phases are those that the rules of a
standard combine (`design.Action`)::

     "actions": [
      {"name": "snow", "kind": "snow",
       "loads": {"type": "NodalLoads", "nodes": [1], "forces": [0.0, 0.0, -5.0]}}]

"combinations" beside them is the standard by whose rules ``jaxcable solve`` combines them, and
"checks" are those of the results: names of standards for cables, and objects of `design.Check`::

     "combinations": "EN 1990",
     "checks": ["EN 1993-1-11", {"type": "DisplacementLimit", "upper": 0.05}]

In place of the name of a standard, "combinations" may be rules of your own, an object as
`design.combination_rules` returns it.

Fields are the arguments of the classes of this package, in SI units, or in those that the file
states by ``"units": "kN, m"`` at its top; node numbers start at 0. An
object with a "type" is of a class in `codec.TYPES`; without it, it is a dict, as of element groups.

A "comment", a text or a list of lines, may stand at the top and in every object of a class: in
what names one as its "type", and in structure, supports, section, phases and actions. (Where the
keys are names of groups, it would be such a name.) Reading skips it whatever it is, and writing
writes none: a scene that has been read and is written again has lost its comments.

`scene_schema` describes the format to editors: with ``"$schema": "scene.schema.json"`` in a scene,
and the file that ``jaxcable schema --save scene.schema.json`` writes beside it, they explain and
check every field while it is typed. Reading ignores the field, but for a word on the schema of
something else.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

from ..analysis.phase_checks import prefix_errors
from ..analysis.phases import Phase, as_phases
from ..analysis.preparation import prepare
from ..common.checks import without_warnings
from ..common.units import UnitsLike, as_units
from ..common.writing import atomic_write
from ..design.actions import Action, check_actions
from ..design.check import Check
from ..design.checks import require_checks
from ..design.combination_rules import combination_rules, names_of_standards
from ..model.structure import Structure
from ..scenes import Scene
from .codec import COMMENT, decode, encode
from .json_format import format_json
from .omissions import Omissions
from .reading import LARGEST, FileError, read_json
from .scene_units import SceneConverter, UnitError

_SCHEMA = "scene.schema.json"  # as it is usually called
FORMAT = "jaxcable scene"
VERSION = 1
_COUNT = re.compile(r"\b(?:increments|nodes|links|faces)\S* = -?\d+")
_QUANTITY = re.compile(r"\d\.\d|\de[-+]\d| = -?\d|\d (?:N|m|K|kg|Pa|rad)\b")
"""A number that may have a unit: a decimal one, the value of a field but for `_COUNT`, or "5 N"."""
MOST_INCREMENTS = 1_000_000
"""Of a phase: limits the memory that a small file can claim."""


def save_scene(
    path: str | PathLike[str],
    scene: Scene | tuple[Structure, Phase | Sequence[Phase] | Mapping[str, Phase]],
    *,
    units: UnitsLike | None = None,
    actions: Sequence[Action] | None = None,
    combinations: str | Mapping[str, Any] | None = None,
    checks: Sequence[str | Check] | None = None,
) -> None:
    """Write a structure and its phases to a JSON file, which `load_scene` reads back exactly.

    Every number keeps all its digits (also in float32), so that the loaded scene has an identical
    solution. In other units than SI, numbers read back differ from those written by rounding (2
    units in the last place). The file is written completely or not at all.

    Args:
        path: path of the file.
        scene: `Scene`, or a pair (structure, phases), in SI units; a dict of phases names them.

    Options:
        units: units of the numbers in the file, such as "kN, m" or "kip, ft, F", which the file
            states (see `Units`); default: those of ``scene.units`` if it has some, otherwise SI.
            Masses, also the density of air, are in kg, or lb with feet and inches, if not stated.
        actions: list of `design.Action` to write beside the phases; default: those of
            ``scene.actions`` if it has some, otherwise none.
        combinations: name of the standard by whose rules ``jaxcable solve`` combines them, such as
            "EN 1990", or rules as `design.combination_rules` returns them; default:
            ``scene.combination_rules``.
        checks: list of `design.Check` and of names of standards, as `design.checks` takes it;
            default: ``scene.checks``.

    Raises:
        ValueError: a file cannot hold the scene: NaN, a traced number, names of groups that are no
            texts; phases, actions or checks that the structure does not take; unknown units; a unit
            of temperatures that is needed, or a class of your own whose docstring does not state
            the units of its fields.
        OSError: the file cannot be written.

    Example:
        >>> import tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.json"
        >>> jc.save_scene(path, jc.scenes.flat_net(load=15.0))
        >>> scene = jc.load_scene(path)
        >>> scene.structure.n_node, len(scene.phases)
        (12, 2)

        In kilonewtons, and read back into newtons:

        >>> jc.save_scene(path, scene, units="kN, m")
        >>> print([line for line in path.read_text().splitlines() if "pretension" in line][0])
           "pretension": 0.2
        >>> again = jc.load_scene(path)
        >>> print(again.units, float(again.phases[0].pretension))
        kN, m, K 200.0
    """
    stated = getattr(scene, "units", None) if units is None else as_units(units)
    try:
        structure, phases = scene
    except (TypeError, ValueError):
        raise ValueError("scene: expected a Scene or a pair (structure, phases)") from None
    names = list(phases) if isinstance(phases, Mapping) else getattr(scene, "phase_names", None)
    phases = list(phases.values()) if isinstance(phases, Mapping) else phases
    phases = as_phases(structure, phases)
    if names is not None:
        _require_phase_names(names, len(phases))
    actions = list(getattr(scene, "actions", ()) if actions is None else actions)
    actions = check_actions(actions) if actions else []
    checks = getattr(scene, "checks", None) if checks is None else checks
    standard = combinations or getattr(scene, "combination_rules", None)
    data = {
        "structure": encode(structure, "structure", Structure),
        "phases": [encode(phase, f"phases[{k}]", Phase) for k, phase in enumerate(phases)],
    }
    if actions:
        data["actions"] = [encode(x, f"actions[{k}]", Action) for k, x in enumerate(actions)]
    if standard is not None:
        data["combinations"] = _check_combinations(standard, actions)
    if checks:
        require_checks(checks, structure, "checks")
        data["checks"] = [encode(x, f"checks[{k}]") for k, x in enumerate(checks)]
    # after `encode`, which says what a file cannot hold: what is written can be read
    _require_analysable(structure, phases)
    for k, action in enumerate(actions):
        _require_analysable_after(action, f"actions[{k}]", structure, phases)
    if stated is not None:
        convert = SceneConverter(stated, to_si=False)
        data["structure"] = convert(data["structure"], "structure", Structure)
        for part, cls in (("phases", Phase), ("actions", Action)):
            for k, own in enumerate(data.get(part, ())):
                data[part][k] = convert(own, f"{part}[{k}]", cls, structure)
        if checks:
            data["checks"] = [convert(x, "checks") for x in data["checks"]]
        data = {"units": convert.units.as_dict(), **data}
    if names is not None:
        named = zip(names, data["phases"], strict=True)
        data["phases"] = [{"name": name, **phase} for name, phase in named]
    text = format_json({"format": FORMAT, "version": VERSION, **data})
    with atomic_write(path) as stream:
        stream.write(text + "\n")


def load_scene(path: str | PathLike[str], largest: int = LARGEST) -> Scene:
    """Read a scene that `save_scene`, or a person, has written; nothing in it is executed.

    A file is in SI units unless it states others, as in ``"units": "kN, m"`` or
    ``"units": {"force": "kip", "length": "ft", "temperature": "F"}`` at its top (see `Units`). The
    scene is in SI units in any case, and has those of the file as ``scene.units``. Actions in the
    file are ``scene.actions``, a list of `design.Action`.

    Args:
        path: path of the file.
        largest: largest size that is read, bytes.

    Returns:
        `Scene`; analyse it by ``jc.solve(*scene)``.

    Raises:
        FileError: a `ValueError` that names the file and the line (if it is not JSON) or the field
            (the class does not accept its value, or the structure lacks a node or element); unknown
            units.
        OSError: there is no such file, or it cannot be read.

    Example:
        >>> import tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.json"
        >>> jc.save_scene(path, jc.scenes.flat_net(load=15.0))
        >>> jc.describe(jc.solve(*jc.load_scene(path)).status)
        'converged'
    """
    data = read_json(path, largest)
    with Omissions(path) as table:
        scene = _decode_scene(data)
        schema = data.get("$schema", "")
        if ":" in schema and "jaxcable" not in schema and not schema.endswith(_SCHEMA):
            why = "is not the schema of scene files, and was ignored; `jaxcable schema` writes it"
            table.add(f"schema {schema:.80}", "$schema", why)
    return scene


def _decode_scene(data):
    """Return the `Scene` of the data in a file; raise FileError if it cannot be analysed."""
    if data.get("format") != FORMAT:
        raise FileError(_describe_unexpected(data, "format", f'"{FORMAT}"'))
    version = data.get("version")
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise FileError(_describe_unexpected(data, "version", f"a whole number such as {VERSION}"))
    if version > VERSION:
        newest = f"{VERSION}, the newest that this jaxcable reads; update jaxcable"
        raise FileError(f"version: {version} is newer than {newest}")
    if not isinstance(data.get("$schema", ""), str):  # of editors: where the schema is
        raise FileError(f"$schema: expected a text, got {_abbreviate(data['$schema'])}")
    unknown = data.keys() - {"format", "version", *_KNOWN}
    if unknown:
        raise FileError(f"unknown field {min(unknown)!r}; known are {', '.join(_KNOWN[:-1])}")
    for name, kind, words in _PARTS:
        if not isinstance(data.get(name), kind):
            raise FileError(_describe_unexpected(data, name, words))
    units = _stated_units(data)
    try:
        if units is None:
            return _decode_parts(data, lambda part, *_: part)
        return _decode_parts(data, SceneConverter(units, to_si=True)).with_units(units)
    except UnitError:
        raise
    except ValueError as error:
        hint = ""
        if units is not None and not units.is_si and _QUANTITY.search(_COUNT.sub("", str(error))):
            hint = f" (numbers in this message are in SI units, not in {units})"
        raise FileError(f"{error}{hint}") from None


def _stated_units(data):
    """Return the `Units` that a file states, or None."""
    if data.get("units") is None:
        return None
    try:
        return as_units(data["units"])
    except ValueError as error:
        raise FileError(str(error)) from None


def _decode_parts(data, convert):
    """Return the `Scene` of the JSON data of a file, with numbers converted to SI by `convert`.

    `convert` is a `SceneConverter`, or a function of the same arguments that returns the data
    unchanged. Raise ValueError for a scene that cannot be analysed.
    """
    part = convert(data["structure"], "structure", Structure)
    structure = decode(part, "structure", Structure)
    phases = []
    for k, phase in enumerate(data["phases"]):
        if not isinstance(phase, dict):
            raise FileError(f"phases[{k}]: expected an object, got {_abbreviate(phase)}")
        part = {key: value for key, value in phase.items() if key != "name"}
        part = convert(part, f"phases[{k}]", Phase, structure)
        phases.append(decode(part, f"phases[{k}]", Phase))
        if phases[-1].increments > MOST_INCREMENTS:
            count = phases[-1].increments
            raise FileError(f"phases[{k}].increments = {count}: at most {MOST_INCREMENTS} are read")
    _require_analysable(structure, phases)
    scene = Scene(structure, phases)
    if any("name" in phase for phase in data["phases"]):
        names = [phase.get("name", f"phase {k}") for k, phase in enumerate(data["phases"], 1)]
        _require_phase_names(names, len(phases))
        scene = scene.with_phase_names(names)
    actions = _decode_actions(data.get("actions"), structure, phases, convert)
    scene = scene.with_actions(actions) if actions else scene
    if data.get("combinations") is not None:
        scene = scene.with_combination_rules(_check_combinations(data["combinations"], actions))
    if data.get("checks") not in (None, []):
        scene = scene.with_checks(_decode_checks(data["checks"], structure, convert))
    return scene


def _check_combinations(rules, actions):
    """Return the name of a standard of combinations, or a user's rules as a dict, after checks.

    Raise ValueError for unknown names or wrong rules, and if there are no `actions` to combine.
    """
    if isinstance(rules, Mapping):
        with prefix_errors("combinations: "):
            rules = combination_rules(rules)
    elif rules not in names_of_standards():
        known = ", ".join(names_of_standards())
        raise ValueError(f"combinations = {rules!r:.60}: expected one of {known}")
    if not actions:
        raise ValueError(f"combinations = {rules!r:.60}: there are no actions to combine")
    return rules


def _decode_checks(data, structure, convert):
    """Return the checks in the data of a file, a list of `Check` and of names of standards.

    `convert` is as of `_decode_parts`. Raise ValueError for checks that do not fit the structure.
    """
    checks = []
    for k, own in enumerate(data if isinstance(data, list) else [data]):
        checks.append(decode(convert(own, f"checks[{k}]"), f"checks[{k}]"))
    require_checks(checks, structure, "checks")
    return checks


def _decode_actions(data, structure, phases, convert):
    """Return the actions in the data of a file, a list of `Action`; [] for None.

    `convert` is as of `_decode_parts`. Raise ValueError for an action that cannot follow the
    phases.
    """
    if data is None:
        return []
    if not isinstance(data, list):
        raise FileError(f"actions: expected a list, got {_abbreviate(data)}")
    actions = []
    for k, own in enumerate(data):
        where = f"actions[{k}]"
        if not isinstance(own, dict):
            raise FileError(f"{where}: expected an object, got {_abbreviate(own)}")
        action = decode(convert(own, where, Action, structure), where, Action)
        actions.append(action)
        _require_analysable_after(action, where, structure, phases)
    return check_actions(actions) if actions else []


def _require_phase_names(names, count):
    """Raise ValueError unless `names` are `count` different texts that are not empty."""
    for k, name in enumerate(names):
        if not isinstance(name, str) or not name.strip() or name in names[:k]:
            raise ValueError(
                f"phases[{k}]: name = {_abbreviate(name)}: expected a text that no other phase has"
            )
    if len(names) != count:
        raise ValueError(f"phase_names: {len(names)} names for {count} phases")


def _require_analysable(structure, phases):
    """Raise ValueError, which names the phase, if `prepare` refuses a structure with phases."""
    try:
        with without_warnings():  # the analysis gives warnings, files do not
            prepare(structure, phases, None, None)
    except ValueError as error:
        named = str(error).startswith("phases[")
        raise ValueError(f"{'' if named else 'phases: '}{error}") from None


def _require_analysable_after(action, where, structure, phases):
    """Raise ValueError, which begins with `where`, for an action that cannot follow the phases.

    It is analysed as one more phase after them.
    """
    names = ("loads", "temperature", "shortening", "removes")
    after = [*phases, Phase(**{name: getattr(action, name) for name in names})]
    try:
        _require_analysable(structure, after)
    except ValueError as error:
        text = str(error).removeprefix("phases: ").removeprefix(f"phases[{len(phases)}]")
        raise ValueError(f"{where}: {text.lstrip(': .')}") from None


_KNOWN = ("structure", "phases", "units", "actions", "combinations", "checks", COMMENT, "$schema")
"""Fields of a scene beside its format and version."""
_PARTS = (
    ("structure", dict, "an object with nodes, elements and supports"),
    ("phases", list, 'a list such as [{"pretension": 200.0}]'),
)
"""Parts of a scene, with their JSON types and what is expected there."""


def _describe_unexpected(data, name, expected):
    """Return the message on the field `name` of `data` that is missing, null or of a wrong kind."""
    if name not in data:
        return f"{name}: missing; expected {expected}"
    if data[name] is None:
        return f"{name}: is null; expected {expected}"
    return f"{name}: expected {expected}, got {_abbreviate(data[name])}"


def _abbreviate(value):
    """Return a value as a text of at most 60 characters, for messages."""
    text = repr(value)
    return text if len(text) < 60 else text[:57] + "..."
