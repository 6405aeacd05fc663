"""Input of commands: scenes, nets, and numbers written on the command line."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..common.types import ArrayLike, Float, PyTree
from ..files import load_scene, read_csv, read_dxf, read_network, read_obj
from ..files.nets import Net
from ..files.reading import FileError, number, read_json, whole
from ..files.scene import FORMAT
from ..model.parts import groups_by_name
from ..model.structure import Structure
from ..scenes import Scene
from .guard import Refused, refusing

_MOST_BYTES = 8e9  # limit on the memory of the results at all increments


def scene(options: Namespace) -> Scene:
    """The scene of a command; refused if the results of its increments need too much memory."""
    found = load_scene(options.scene, int(options.largest * 1e6))
    bytes_needed = sum(phase.increments for phase in found.phases) * (
        24.0 * found.structure.n_node + 8.0 * sum(len(g.links) for g in found.structure.groups)
    )
    if bytes_needed > _MOST_BYTES:
        raise Refused(
            f"{options.scene}: its increments would need {bytes_needed / 1e9:.0f} GB; ask for fewer"
        )
    return found


def is_scene(options: Namespace) -> bool:
    """Whether the files of a command are one scene."""
    name, largest = options.files[0], int(options.largest * 1e6)
    if len(options.files) != 1 or not name.lower().endswith(".json"):
        return False
    return read_json(name, largest).get("format") == FORMAT


def net(options: Namespace) -> Net:
    """The `Net` in the files of a command, split where its links cross if that is asked for."""
    found = _read(options)
    if options.split is None:
        return found
    # chords are that far from ends which lie on their arc
    tolerance = max(options.tol or 1e-6, options.sagitta or 0.0)
    with refusing("--split"):
        made = found.split(options.split or None, tolerance=tolerance)
    print(
        f"split: {counted(len(made.nodes) - len(found.nodes), 'node')} made, "
        f"{len(made.links)} links of {len(found.links)}"
    )
    return made


_FOR = {
    "scale": (".obj", ".dxf"),
    "tol": (".obj", ".dxf"),
    "supports": (".dxf",),
    "sagitta": (".dxf",),
    "hidden": (".dxf",),
    "columns": (".csv",),
}
"""Suffixes of the files that options of reading are for."""


def refuse_options(options: Namespace, names: Sequence[str], why: str) -> None:
    """Raise `Refused` if one of some options is given that would do nothing."""
    for name in names:
        if getattr(options, name, None) not in (None, False, ()):
            raise Refused(f"--{name.replace('_', '-')}: {why}")


def refuse_unread(options: Namespace) -> None:
    """Raise `Refused` for options that files of this kind do not take, such as --scale of CSV."""
    suffix = Path(options.files[0]).suffix.lower()
    for name, suffixes in _FOR.items():
        takes_split = name == "tol" and options.split is not None
        if suffix not in suffixes and not takes_split:
            refuse_options(options, [name], f"is for files {', '.join(suffixes)} only")


def _columns(words):
    """Names of columns, from ``x=X_COORD y=...``; None if none are given."""
    if words is None:
        return None
    pairs = [part.partition("=") for word in words for part in word.split(",") if part]
    for name, equals, own in pairs:
        if not (name and equals and own):
            raise Refused(f"--columns: expected column=name in the file: {' '.join(words)}")
    return {name: own for name, _, own in pairs}


def _read(options):
    """The `Net` in the files of a command: OBJ, DXF, JSON of compas or jax_fdm, two CSV tables."""
    paths, largest = [Path(path) for path in options.files], int(options.largest * 1e6)
    suffixes = [path.suffix.lower() for path in paths]
    refuse_unread(options)
    tolerance = 1e-6 if options.tol is None else options.tol
    if suffixes == [".csv", ".csv"]:
        try:
            columns = _columns(options.columns)
            return read_csv(paths[0], paths[1], largest=largest, columns=columns)
        except FileError:
            raise
        except ValueError as error:
            raise Refused(f"--{error}") from None
    if len(paths) != 1:
        raise Refused("files: expected one file, or two CSV tables: nodes and links")
    if suffixes == [".obj"]:
        return read_obj(paths[0], options.scale or 1.0, tolerance=tolerance, largest=largest)
    if suffixes == [".dxf"]:
        with refusing(paths[0]):  # ezdxf is not installed
            return read_dxf(
                paths[0],
                options.scale,
                tol=tolerance,
                supports=options.supports,
                sagitta=options.sagitta,
                hidden=options.hidden,
                largest=largest,
            )
    if suffixes == [".json"]:
        if read_json(paths[0], largest).get("format") == FORMAT:
            raise Refused(f"{paths[0]}: is a scene of jaxcable already")
        return read_network(paths[0], largest)
    raise Refused(f"{paths[0]}: expected .obj, .dxf, .json, or two .csv tables (nodes, links)")


def numbers(
    words: Sequence[str], name: str, read: Callable[[str], Any] = number
) -> float | dict[str, float]:
    """Numbers on a command line: one for all groups, or ``group=number`` for some of them.

    Args:
        words: on the command line.
        name: of the option.
        read: what is made of the text of a number.
    """
    try:
        if len(words) == 1 and "=" not in words[0]:
            return read(words[0])
        pairs = dict(word.rsplit("=", 1) for word in words)
        return {key: read(word) for key, word in pairs.items()}
    except ValueError:
        raise Refused(f"{name}: expected a number, or group=number: {' '.join(words)}") from None


def values(
    words: Sequence[str], structure: Structure, name: str, drawn: Mapping[str, Any] | None = None
) -> float | PyTree[Any]:
    """Numbers on a command line: one for all elements, or ``group=number`` for groups.

    Args:
        words: on the command line.
        structure: whose groups are meant.
        name: of the option.
        drawn: what ``group=drawn`` means, by group; then one number for all is refused.

    Returns:
        A float, or a prefix pytree of the structure's elements.
    """
    found = numbers(words, name, lambda word: None if drawn and word == "drawn" else number(word))
    if not isinstance(found, dict):
        if drawn is not None:
            raise Refused(f"{name}: expected group=drawn, or group=number, m")
        return found
    names = [label for label, _ in groups_by_name(structure)]
    for key, value in found.items():
        if key not in names:
            raise Refused(f"{name}: no group {key!r}; there are {', '.join(names)}")
        found[key] = drawn[key] if value is None else value
    return structure.arrange([found.get(label) for label in names])


def anchors(words: Sequence[str] | None) -> list[int | str] | None:
    """Anchors on a command line: "ends", node numbers, and ranges such as 0 3 5-8."""
    if not words:
        return None
    found: list[int | str] = []
    for word in words:
        first, _, last = word.partition("-")
        try:
            found += [word] if word == "ends" else range(whole(first), whole(last or first) + 1)
        except ValueError:
            raise Refused(
                f'anchors: {word!r} is no node number or range such as 5-8, nor "ends"'
            ) from None
    return found


def short(value: float) -> str:
    """A number as text, with six digits."""
    return f"{value:.6g}"


def spread(arrays: PyTree[Float[ArrayLike, " ..."]]) -> str:
    """The range of the numbers in arrays as text; a single number if all are equal."""
    if not jax.tree.leaves(arrays):
        return "none"
    flat = np.concatenate([np.ravel(np.asarray(a, float)) for a in jax.tree.leaves(arrays)])
    low, high = short(float(flat.min())), short(float(flat.max()))
    return low if low == high else f"{low} to {high}"


def farthest(displacement: Float[ArrayLike, "n_node 3"]) -> tuple[float, str]:
    """The largest displacement, m, and the same with its node as text."""
    moved = np.linalg.norm(np.asarray(displacement), axis=1)
    node = int(moved.argmax())
    return float(moved[node]), f"{short(float(moved[node]))} m at node {node}"


def counted(number: int, word: str) -> str:
    """A number with its noun as text: 1 increment, 2 increments."""
    return f"{number} {word}" + ("" if number == 1 else "s")
