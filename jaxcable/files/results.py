"""Write and read results: NPZ and JSON with every number, CSV tables for a spreadsheet."""

from __future__ import annotations

import csv
import io
import json
import math
import zipfile
from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..analysis.solution import Solution
from ..common import status
from ..common.units import SI, Units, UnitsLike, as_units
from ..common.writing import atomic_write, atomic_write_together, write_npz
from ..model.result_parts import (
    ResultColumn,
    end_nodes,
    named_groups_of,
    result_columns,
    values_per_group,
)
from ..model.structure import Structure
from .end_of_analysis import end_state
from .reading import LARGEST, FileError, read_json

FORMAT = "jaxcable result"
_FORMULA_BEGINS = ("=", "+", "-", "@", "\t", "\r")  # of cells, in spreadsheets
_PER_NODE = ("positions", "displacement", "reactions", "load", "rotation", "reaction_moments")
_PER_INCREMENT = (
    *("load_factor", "status", "iterations", "factorizations", "residual", "relative_residual"),
    *("rounding", "n_slack", "n_loose", "displacement"),
)


def save_result(
    path: str | PathLike[str],
    structure: Structure,
    solution: Solution,
    *,
    units: UnitsLike | None = None,
) -> list[Path]:
    """Write a result to files, in the format that the suffix names.

    - ``.npz``: all arrays of the result by name, binary (NumPy), in SI units.
    - ``.json``: the same arrays as text; numbers that are not finite become null, and floats are
      read back in double precision.
    - ``.csv``: three tables, ``name-nodes.csv``, ``name-elements.csv`` and
      ``name-increments.csv``, with units in their first line.

    Args:
        path: path of the file.
        structure: `Structure` that was analysed.
        solution: its `Solution`; may be a failed one. The last converged state has the names
            ``last.``.

    Options:
        units: units of the CSV tables, such as "kN, m" (see `Units`); default: SI units, in which
            files of the other formats always are.

    Returns:
        Paths of the files written, a list.

    Raises:
        ValueError: another suffix, or a batch for a table; unknown units, or units for another
            format than CSV.
        OSError: the file cannot be written.

    Example:
        >>> import tempfile, pathlib
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.npz"
        >>> _ = jc.files.save_result(path, structure, jc.solve(structure, phases))
        >>> jc.files.load_result(path)["tension"].shape
        (12,)
    """
    path = Path(path)
    suffix = path.suffix.lower()
    shown = SI if units is None else as_units(units)
    if units is not None and suffix in (".npz", ".json"):
        raise ValueError(f"units: results in {suffix} files are in SI units; .csv has others")
    if suffix == ".npz":
        with atomic_write(path, "wb") as stream:
            write_npz(stream, flatten_result(structure, solution), compressed=True)
        return [path]
    if suffix == ".json":
        numbers = {
            name: _as_json_lists(value)
            for name, value in flatten_result(structure, solution).items()
        }
        data = {"format": FORMAT, "version": 1, **_status_description(solution), **numbers}
        with atomic_write(path) as stream:
            json.dump(data, stream, allow_nan=False)
            stream.write("\n")
        return [path]
    if suffix == ".csv":
        texts = {
            name: format_csv(rows)
            for name, rows in result_tables(structure, solution, shown).items()
        }
        done = [path.with_name(f"{path.stem}-{name}.csv") for name in texts]
        with atomic_write_together() as begin:
            for name, text in zip(done, texts.values(), strict=True):
                begin(name).write(text)
        return done
    raise ValueError(f"path = {str(path)!r}: expected a name that ends with .npz, .json or .csv")


def load_result(path: str | PathLike[str], largest: int = 8 * LARGEST) -> dict[str, np.ndarray]:
    """Read the arrays of a result that `save_result` has written to ``.npz`` or ``.json``.

    Args:
        path: path of the file.
        largest: largest size that is read, bytes.

    Returns:
        Dict from name to NumPy array.

    Raises:
        FileError: the file holds no such result, or is too large. Arrays of Python objects are
            refused, since loading them could execute code.
        OSError: the file cannot be read.

    Example:
        >>> import tempfile, pathlib
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.json"
        >>> _ = jc.files.save_result(path, structure, jc.solve(structure, phases))
        >>> read = jc.files.load_result(path)
        >>> sorted(name for name in read if "." not in name)[:4]
        ['displacement', 'links', 'load', 'peak_tension']
    """
    path = Path(path)
    if path.suffix.lower() == ".json":
        data = read_json(path, largest)
        if data.get("format") != FORMAT:
            raise FileError(f'{path}: format: expected "{FORMAT}", got {data.get("format")!r:.40}')
        words = ("format", "version", "description")
        try:
            return {
                k: np.array(v, _result_array_type(k)) for k, v in data.items() if k not in words
            }
        except (ValueError, TypeError, OverflowError) as error:
            raise FileError(f"{path}: {error}") from None
    with path.open("rb") as stream:
        return _read_npz(path, stream, largest)


def _read_npz(path, stream, largest):
    """Return the arrays of an NPZ file by name; refuse one that unpacks to more than `largest`."""
    try:
        with zipfile.ZipFile(stream) as archive:
            size = sum(item.file_size for item in archive.infolist())
            size = max(size, sum(_declared_bytes(archive, name) for name in archive.namelist()))
        if size > largest:
            raise FileError(
                f"{path}: unpacks to {size / 1e6:.3g} MB, and the limit is {largest / 1e6:.3g} MB; "
                f"to read it all the same, give largest={size}"
            )
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except FileError:
        raise
    except Exception as error:  # zlib, zipfile and NumPy raise many types for broken archives
        raise FileError(f"{path}: not an NPZ file of a result: {error}") from None


def _declared_bytes(archive, name):
    """Return the size in bytes that the header of an array in an open zip archive declares."""
    with archive.open(name) as stream:
        version = np.lib.format.read_magic(stream)
        headers = {(1, 0): np.lib.format.read_array_header_1_0}
        read = headers.get(version, np.lib.format.read_array_header_2_0)
        shape, _, dtype = read(stream)
    return math.prod(shape) * dtype.itemsize


def flatten_result(structure: Structure, solution: Solution) -> dict[str, np.ndarray]:
    """Collect all arrays of a result by name: ``tension``, ``tension.net``, ``phase1.residual``.

    A name ends with that of the group, where groups have names.

    Returns:
        Dict from name to NumPy array. ``links`` has the first and last node of every element.
        Arrays of a batch keep their leading axis.
    """
    names = [name for name, _ in named_groups_of(structure)]
    if len(set(names)) < len(names):
        raise ValueError(f"elements: two groups would have the same name in a file: {names}")
    found = {name: np.asarray(getattr(solution, name)) for name in ("status", "stable")}
    for prefix, part in (("", solution), ("last.", solution.last)):
        for name in _PER_NODE:
            if getattr(part, name) is not None:
                found[prefix + name] = np.asarray(getattr(part, name))
        for name, value in (part.element_results | {"rest_length": part.rest_length}).items():
            _add_group_values(found, prefix + name, structure, value)
    for name in ("phase", "load_factor"):
        found["last." + name] = np.asarray(getattr(solution.last, name))
    for name, group in named_groups_of(structure):
        found[f"links.{name}".rstrip(".")] = end_nodes(group)
    for number, phase in enumerate(solution.phases, 1):
        found[f"phase{number}.stable"] = np.asarray(phase.stable)
        for name in _PER_INCREMENT:
            found[f"phase{number}.{name}"] = np.asarray(getattr(phase.path, name))
        for name, value in phase.path.element_results.items():
            _add_group_values(found, f"phase{number}.{name}", structure, value)
    return found


def _add_group_values(found, name, structure, values):
    """Add element values to the dict `found`: under `name`, or ``name.group`` for named groups.

    `values` has an array, or None, for each group of the structure, in the shape of its elements.
    """
    groups = [group for group, _ in named_groups_of(structure)]
    for group, value in zip(groups, values_per_group(structure, values), strict=True):
        if value is not None:
            found[f"{name}.{group}".rstrip(".")] = value


def _status_description(solution):
    """Return {"description": status of the solution in words}; an empty dict for a batch."""
    if np.ndim(solution.status) != 0:
        return {}
    return {"description": status.describe(solution.status)}


def _as_json_lists(array):
    """Turn an array into nested lists, with None for numbers that are not finite."""
    if np.issubdtype(array.dtype, np.floating):
        array = array.astype(object)
        array = np.where(np.isfinite(array.astype(float)), array, None)
    return array.tolist()


def _result_array_type(name):
    """Return bool, int or float: the type of the array that a result file has under this name."""
    words = name.split(".")
    last = words[1] if len(words) > 1 and words[0].startswith(("phase", "last")) else words[0]
    counts = ("status", "iterations", "factorizations", "n_slack", "n_loose", "links", "phase")
    return bool if last == "stable" else int if last in counts else float


def result_tables(
    structure: Structure, solution: Solution, units: Units = SI
) -> dict[str, list[list[Any]]]:
    """Return the tables "nodes", "elements" and "increments" by name: lists of rows, header first.

    Numbers are in `units`, which the headers name.

    Raises:
        ValueError: the solution is a batch, or belongs to another structure.
    """
    last = end_state(structure, solution)
    fixed = last.fixed[int(last.phase) + 1].array[: structure.n_node, :3]
    vectors = [
        np.asarray(getattr(solution, name))
        for name in ("positions", "displacement", "load", "reactions")
    ]
    header = ["node", "support"]
    words = ("", "m"), ("displacement ", "m"), ("load ", "N"), ("reaction ", "N")
    for word, unit in words:
        header += [f"{word}{axis} ({units.name(unit)})" for axis in "xyz"]
    vectors = [units.from_si(x, unit) for x, (_, unit) in zip(vectors, words, strict=True)]
    nodes: list[list[Any]] = [header]
    for k in range(structure.n_node):
        held = "".join(axis for axis, is_held in zip("xyz", fixed[k], strict=True) if is_held)
        nodes.append([k, held, *(float(v) for column in vectors for v in column[k])])
    lengths = ResultColumn(
        "unstressed length at present temperature",
        "m",
        values_per_group(structure, solution.rest_length),
    )
    told = result_columns(structure.groups, solution.element_results)
    told.insert(1 if told and told[0].label == "tension" else len(told), lengths)
    heads = [f"{column.label.replace('_', ' ')} ({units.shown(column.unit)})" for column in told]
    elements: list[list[Any]] = [["group", "element", "first", "last", *heads]]
    values = zip(*(column.values for column in told), strict=True)
    for (name, group), of_group in zip(named_groups_of(structure), values, strict=True):
        for k, ends in enumerate(end_nodes(group).tolist()):
            numbers = (
                None if result is None else units.from_si(float(result[k]), column.unit)
                for result, column in zip(of_group, told, strict=True)
            )
            elements.append([name, k, *ends, *numbers])
    names = [n for n in _PER_INCREMENT if n != "displacement"]
    heads = [f"{n} ({units.name('N')})" if n in ("residual", "rounding") else n for n in names]
    increments: list[list[Any]] = [["phase", "increment", *heads]]
    for number, phase in enumerate(solution.phases, 1):
        arrays = [
            units.from_si(array, "N" if head != name else "").tolist()
            for name, head in zip(names, heads, strict=True)
            for array in (np.asarray(getattr(phase.path, name)),)
        ]
        increments += [[number, k, *line] for k, line in enumerate(zip(*arrays, strict=True), 1)]
    return {"nodes": nodes, "elements": elements, "increments": increments}


def format_csv(rows: Iterable[Iterable[Any]]) -> str:
    """Return rows as the text of a CSV table, with all digits of floats and without formulas.

    A text that a spreadsheet would take for a formula, because it begins with ``=``, ``+``, ``-``,
    ``@`` or a tab, gets an apostrophe before it, unless it is a number or this character alone.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([_escape_formula(cell) for cell in row] for row in rows)
    return text.getvalue()


def _escape_formula(cell):
    """Return a cell of a table; a text that begins like a formula gets an apostrophe before it."""
    if not isinstance(cell, str) or len(cell) < 2 or not cell.startswith(_FORMULA_BEGINS):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell
