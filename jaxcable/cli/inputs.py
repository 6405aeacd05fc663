"""Input of commands: scenes, nets, and numbers written on the command line."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..common.checks import warn_user
from ..common.types import ArrayLike, Float, PyTree
from ..common.units import SI, Units, as_units
from ..files import load_scene, read_csv, read_dxf, read_network, read_obj
from ..files.net_doubts import pluralize
from ..files.net_units import LARGEST_EXTENT
from ..files.nets import Net
from ..files.reading import FileError, parse_integer, parse_number, read_json
from ..files.scene import FORMAT
from ..model.plausibility import lengths_over_nodes
from ..model.result_parts import active_nodes, named_groups_of
from ..model.structure import Structure
from ..scenes import Scene
from .guard import BadInput, refuse_value_errors

_MOST_BYTES = 8e9
"""Memory of the results of all increments above which a scene is refused, bytes.

Half of the memory of a common computer; a typing error in `increments` would fill it otherwise.
"""


def read_scene(options: Namespace) -> Scene:
    """Read the scene file of a command; warn if it is so large that nodes may be in millimeters.

    Raises:
        BadInput: the results of all increments would need too much memory.
    """
    found = load_scene(options.scene, int(options.largest * 1e6))
    bytes_needed = sum(phase.increments for phase in found.phases) * (
        24.0 * found.structure.n_node + 8.0 * sum(len(g.links) for g in found.structure.groups)
    )
    if bytes_needed > _MOST_BYTES:
        raise BadInput(
            f"{options.scene}: results of all increments would need {bytes_needed / 1e9:.0f} GB; "
            "give fewer increments"
        )
    extent = float(np.ptp(np.asarray(found.structure.nodes, float), axis=0).max())
    if extent > LARGEST_EXTENT:
        stated = "nodes are in m" if found.units is None else f"units are {found.units}"
        warn_user(
            f"{options.scene}: the structure extends over {extent / 1e3:.4g} km; {stated}: "
            'are these mm? A scene states its units at its top, such as "units": "N, mm"'
        )
    return found


def shown_units(options: Namespace, scene: Scene) -> Units | None:
    """Return the `Units` in which a command shows a scene; None for SI units.

    They are those of ``--show-units``, or else those of the scene.
    """
    given = getattr(options, "show_units", None)
    return scene.units if given is None else parse_units(given, "--show-units")


def parse_units(words: str | None, option: str = "--units") -> Units | None:
    """Return the `Units` that a text on the command line means; None for no text."""
    if words is None:
        return None
    with refuse_value_errors(option):
        return as_units(words)


def is_scene_file(options: Namespace) -> bool:
    """Return whether `options.files` is a single scene file."""
    name, largest = options.files[0], int(options.largest * 1e6)
    if len(options.files) != 1 or not name.lower().endswith((".json", ".fofin")):
        return False
    return read_json(name, largest).get("format") == FORMAT


def read_net(options: Namespace) -> Net:
    """Read the net in `options.files`; with `options.split` split links where they cross."""
    found = _read_net_files(options)
    if options.split is None:
        return found
    # chords are that far from ends which lie on their arc
    tolerance = max(_length_in_m(options, "tol") or 1e-6, _length_in_m(options, "sagitta") or 0.0)
    with refuse_value_errors("--split"):
        made = found.split(options.split or None, tolerance=tolerance)
    print(
        f"split: {pluralize(len(made.nodes) - len(found.nodes), 'node')} added, "
        f"{len(made.links)} links instead of {len(found.links)}"
    )
    return made


_FORMATS_OF_OPTIONS = {
    "scale": (".obj", ".dxf"),
    "tol": (".obj", ".dxf"),
    "supports": (".dxf",),
    "sagitta": (".dxf",),
    "hidden": (".dxf",),
    "columns": (".csv",),
    "units": (".obj", ".dxf", ".csv", ".json", ".fofin"),
}
"""Suffixes of the files for which each option of reading is meant."""


STATED = (
    'is for files that state no unit; a scene states its own at its top, such as "units": "kN, m"'
)
"""Why there is no ``--units`` for scenes."""


def refuse_options_without_effect(options: Namespace, names: Sequence[str], why: str) -> None:
    """Raise `BadInput` if one of the named options is given, because it would have no effect.

    `why` ends the message.
    """
    for name in names:
        if getattr(options, name, None) not in (None, False, []):
            raise BadInput(f"--{name.replace('_', '-')}: {why}")


def refuse_options_of_other_formats(options: Namespace) -> None:
    """Raise `BadInput` for options that belong to other file formats, such as --scale with CSV."""
    suffix = Path(options.files[0]).suffix.lower()
    for name, suffixes in _FORMATS_OF_OPTIONS.items():
        takes_split = name == "tol" and options.split is not None
        if suffix not in suffixes and not takes_split:
            refuse_options_without_effect(
                options, [name], f"is for files {', '.join(suffixes)} only"
            )


def _length_in_m(options, name):
    """Return the length that an option gives, converted from ``--units`` to m; None without it."""
    value, units = getattr(options, name), parse_units(options.units)
    return value if value is None or units is None else units.to_si(value, "m")


def _parse_column_names(words):
    """Return names of columns in a file, words like ``x=X_COORD``, as a dict; None stays.

    Raise BadInput for a word without both names.
    """
    if words is None:
        return None
    pairs = [part.partition("=") for word in words for part in word.split(",") if part]
    for name, equals, own in pairs:
        if not (name and equals and own):
            raise BadInput(f"--columns: expected column=name in the file: {' '.join(words)}")
    return {name: own for name, _, own in pairs}


def _read_net_files(options):
    """Read the `Net` in `options.files`: OBJ, DXF, JSON of compas or jax_fdm, or two CSV tables."""
    paths, largest = [Path(path) for path in options.files], int(options.largest * 1e6)
    suffixes = [path.suffix.lower() for path in paths]
    refuse_options_of_other_formats(options)
    units = parse_units(options.units)
    tolerance = 1e-6 if options.tol is None else _length_in_m(options, "tol")
    if suffixes == [".csv", ".csv"]:
        try:
            columns = _parse_column_names(options.columns)
            return read_csv(paths[0], paths[1], largest=largest, columns=columns, units=units)
        except FileError:
            raise
        except ValueError as error:
            raise BadInput(f"--{error}") from None
    if len(paths) != 1:
        raise BadInput("files: expected one file, or two CSV tables: nodes and links")
    drawn = {"scale": options.scale, "units": units if options.scale is None else None}
    if suffixes == [".obj"]:
        return read_obj(paths[0], tolerance=tolerance, largest=largest, **drawn)
    if suffixes == [".dxf"]:
        with refuse_value_errors(paths[0]):  # ezdxf is not installed
            return read_dxf(
                paths[0],
                tolerance=tolerance,
                supports=options.supports,
                sagitta=_length_in_m(options, "sagitta"),
                hidden=options.hidden,
                largest=largest,
                **drawn,
            )
    if suffixes in ([".json"], [".fofin"]):
        if read_json(paths[0], largest).get("format") == FORMAT:
            raise BadInput(f"{paths[0]}: is a scene of jaxcable already")
        return read_network(paths[0], largest, units=units)
    raise BadInput(
        f"{paths[0]}: expected .obj, .dxf, .json, .fofin, or two .csv tables (nodes, links)"
    )


def number_parser(units: Units | None, unit: str) -> Callable[[str], float]:
    """Return a function that parses a number in `units` (None: SI) and returns it in SI.

    `unit` is the SI unit of the number. The function raises ValueError for any other text.
    """
    return parse_number if units is None else lambda word: units.to_si(parse_number(word), unit)


def parse_numbers(
    words: Sequence[str], name: str, read: Callable[[str], Any] = parse_number
) -> float | dict[str, float]:
    """Parse numbers of an option: one for all groups, or ``group=number`` for some of them.

    Args:
        words: the words after the option.
        name: name of the option, for messages.
        read: function that parses the text of a number.

    Returns:
        A number, or a dict from group to number.
    """
    try:
        if len(words) == 1 and "=" not in words[0]:
            return read(words[0])
        pairs = dict(word.rsplit("=", 1) for word in words)
        return {key: read(word) for key, word in pairs.items()}
    except ValueError:
        raise BadInput(f"{name}: expected a number, or group=number: {' '.join(words)}") from None


def parse_group_values(
    words: Sequence[str],
    structure: Structure,
    name: str,
    drawn: Sequence[Any] | None = None,
    read: Callable[[str], float] = parse_number,
) -> float | PyTree[Any]:
    """Parse numbers of an option: one for all elements, or ``group=number`` for groups.

    Args:
        words: the words after the option.
        structure: `Structure` that has the groups.
        name: name of the option, for messages.
        drawn: for each group the value that ``group=drawn`` means; one number for all groups is
            then refused.
        read: function that parses the text of a number.

    Returns:
        A float, or a prefix pytree of the structure's elements.
    """
    found = parse_numbers(
        words, name, lambda word: None if drawn and word == "drawn" else read(word)
    )
    if not isinstance(found, dict):
        if drawn is not None:
            raise BadInput(f"{name}: expected group=drawn, or group=number, m")
        return found
    names = [label for label, _ in named_groups_of(structure)]
    for key, value in found.items():
        if key not in names:
            raise BadInput(f"{name}: no group {key!r}; there are {', '.join(names)}")
        found[key] = drawn[names.index(key)] if value is None else value
    return structure.arrange([found.get(label) for label in names])


def element_lengths(structure: Structure) -> list[Float[np.ndarray, " n_elem"]]:
    """Return the initial lengths of the elements of each group, a list of [n_elem], m."""
    nodes = np.asarray(structure.nodes)
    return [lengths_over_nodes(group, nodes) for group in structure.groups]


def parse_anchors(words: Sequence[str] | None) -> list[int | str] | None:
    """Return the supported nodes of an option such as ``0 3 5-8 ends``: indices and "ends".

    None without any words. Raises BadInput for other words.
    """
    if not words:
        return None
    found: list[int | str] = []
    for word in words:
        first, _, last = word.partition("-")
        try:
            found += (
                [word]
                if word == "ends"
                else range(parse_integer(first), parse_integer(last or first) + 1)
            )
        except ValueError:
            raise BadInput(
                f'anchors: {word!r} is no node number or range such as 5-8, nor "ends"'
            ) from None
    return found


def number_text(value: float, unit: str, units: Units | None = None) -> str:
    """Return a number, given in the SI unit `unit`, as text with six digits and its unit."""
    return (units or SI).text(value, unit)


def largest_displacement(
    structure: Structure, moved: Float[ArrayLike, "n_node 3"], present: Any, units: Units | None
) -> tuple[float, str]:
    """Return the largest displacement, m, and a text such as "0.03 m at node 5" in `units`.

    `moved` are displacements, [n_node, 3], m. Nodes of which all elements are inactive do not
    count; `present` is `Solution.present`.
    """
    sizes = np.linalg.norm(moved, axis=1) * active_nodes(structure, present)
    node = int(sizes.argmax())
    return float(sizes[node]), f"{number_text(float(sizes[node]), 'm', units)} at node {node}"
