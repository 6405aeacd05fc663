"""Write VTK files (legacy, ASCII) for ParaView and other programs."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import jax
import numpy as np

from ..analysis.solution import Solution
from ..common.units import SI, UnitsLike, as_units
from ..common.writing import atomic_write, atomic_write_together
from ..model.result_parts import (
    ResultColumn,
    element_faces,
    named_groups_of,
    result_columns,
    straight_pieces,
    values_per_group,
)
from ..model.structure import Structure
from .end_of_analysis import concatenate_groups, end_state, require_suffix

_TYPES = {2: 3, 3: 5, 4: 9}  # cell types of VTK by number of points: line, triangle, quadrilateral


def save_vtk(
    path: str | PathLike[str],
    structure: Structure,
    solution: Solution,
    increments: bool = False,
    *,
    units: UnitsLike | None = None,
) -> list[Path]:
    """Write a result as lines, and as faces where elements have some, for ParaView.

    Points have their ``displacement`` (over all phases), ``reaction`` and ``load``. Elements have
    ``tension``, ``peak_tension``, other results of elements with an array for every place and
    component (``skin_stress_top_xx``), ``rest_length``, and the indices of their ``element`` and
    ``group``. A cable over several nodes is written as several lines.

    Args:
        path: path of the file, ending with .vtk.
        structure: `Structure` that was analysed.
        solution: its `Solution`; if it has failed, the last converged state is written.
        increments: True to write a file for every converged increment, ``name-0001.vtk`` and so on,
            which ParaView opens as a series.

    Options:
        units: units of all numbers, such as "kN, m" (see `Units`); names of arrays then end with
            their unit, as in ``tension_(kN)``. Default: SI units.

    Returns:
        Paths of the files written, a list.

    Raises:
        ValueError: another suffix, a batch, another structure than that of the solution, or
            unknown units.
        OSError: the file cannot be written.

    Example:
        >>> import tempfile, pathlib
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "net.vtk"
        >>> _ = jc.files.save_vtk(path, structure, jc.solve(structure, phases))
        >>> path.read_text().splitlines()[4]
        'POINTS 12 double'
    """
    path, last = require_suffix(path, ".vtk"), end_state(structure, solution)
    shown = None if units is None else as_units(units)
    if not increments:
        names = {"displacement": "displacement", "reaction": "reactions", "load": "load"}
        vectors = [
            ResultColumn(name, "m" if name == "displacement" else "N", [getattr(last, field)])
            for name, field in names.items()
        ]
        scalars = result_columns(structure.groups, last.element_results)
        lengths = values_per_group(structure, last.rest_length)
        scalars.append(ResultColumn("rest_length", "m", lengths))
        with atomic_write(path) as stream:
            _write_unstructured_grid(
                stream, structure, np.asarray(last.positions), vectors, scalars, shown
            )
        return [path]
    with atomic_write_together() as begin:
        return _write_increments(path, structure, solution, begin, shown)


def _write_increments(path, structure, solution, open_file, units):
    """Write one VTK file for each converged increment of all phases; return their paths.

    `path` names the series, `open_file` is the function that `atomic_write_together` yields, and
    numbers are in `units`, None for SI.
    """
    done, nodes = [], np.asarray(solution.last.positions - solution.last.displacement)
    for phase in solution.phases:
        good = np.flatnonzero(np.asarray(phase.path.status) == 0)
        if not len(good):
            break
        for k in good:
            moved = np.asarray(phase.path.displacement[k])
            done.append(path.with_name(f"{path.stem}-{len(done) + 1:04d}.vtk"))
            told = {  # keeps the order of the results: tree.map would sort the names
                name: jax.tree.map(lambda x, k=k: x[k], result)
                for name, result in phase.path.element_results.items()
            }
            scalars = result_columns(structure.groups, told)
            moves = [ResultColumn("displacement", "m", [moved])]
            stream = open_file(done[-1])
            _write_unstructured_grid(stream, structure, nodes + moved, moves, scalars, units)
    return done


def _write_unstructured_grid(stream, structure, points, vectors, scalars, units):
    """Write nodes and elements to a stream as an unstructured grid of VTK.

    `points` are the positions of the nodes, [n_node, 3], m. `vectors` of nodes, each with one array
    [n_node, 3], and `scalars` of elements are lists of `ResultColumn`. Numbers are written in
    `units`, None for SI.
    """
    shown = units or SI
    points = shown.from_si(points, "m")
    cells, element, group = _collect_cells(structure.groups)
    names = ", ".join(
        f"{k} {name}".strip() for k, (name, _) in enumerate(named_groups_of(structure))
    )
    lines = [
        "# vtk DataFile Version 3.0",
        _ascii_title(f"jaxcable, {units or 'SI units'}; groups: {names}"),
    ]
    lines += ["ASCII", "DATASET UNSTRUCTURED_GRID", f"POINTS {len(points)} double"]
    lines += _format_vectors(points)
    lines += [f"CELLS {len(cells)} {len(cells) + sum(map(len, cells))}"]
    lines += [" ".join(map(str, (len(cell), *cell))) for cell in cells]
    lines += [f"CELL_TYPES {len(cells)}", *(str(_TYPES[len(cell)]) for cell in cells)]
    lines += [f"CELL_DATA {len(cells)}"]
    for name, number in (("element", element), ("group", group)):
        lines += [f"SCALARS {name} int 1", "LOOKUP_TABLE default", *map(str, number.tolist())]
    for column in scalars:
        name = _array_name(column, units)
        of_piece = concatenate_groups(structure.groups, column.values)[element]
        of_piece = shown.from_si(of_piece, column.unit)
        lines += [f"SCALARS {name} double 1", "LOOKUP_TABLE default", *map(repr, of_piece.tolist())]
    lines += [f"POINT_DATA {len(points)}"]
    for column in vectors:
        values = shown.from_si(np.asarray(column.values[0]), column.unit)
        lines += [f"VECTORS {_array_name(column, units)} double", *_format_vectors(values)]
    stream.write("\n".join(lines) + "\n")


def _array_name(column, units):
    """Return the name of the array of a `ResultColumn`, with its unit unless `units` is None."""
    unit = "" if units is None or column.unit in ("", "-") else f"_({units.shown(column.unit)})"
    return (column.label + unit).replace(" ", "_")


def _collect_cells(groups):
    """Return the VTK cells of all elements: lines first, then faces.

    Returns:
        Node numbers of each cell, a list of lists; the index of its element, counted through all
        groups, and the index of its group, [n_cell] each.
    """
    ends, element, owner = straight_pieces(groups)
    corners, of_face, group = element_faces(groups)
    lines = ~np.isin(element, of_face)  # elements with faces are these
    rings = [list(dict.fromkeys(ring)) for ring in corners.tolist()]  # no node of a triangle twice
    numbers = np.concatenate([element[lines], of_face]), np.concatenate([owner[lines], group])
    return ends[lines].tolist() + rings, *numbers


def _ascii_title(text):
    """Return a title as the format allows it: one line of at most 255 ASCII characters."""
    return text.encode("ascii", "replace").decode().replace("\n", " ")[:255]


def _format_vectors(vectors):
    """Return the text of each vector, three numbers with spaces between: a list of lines."""
    return [" ".join(map(repr, row)) for row in vectors.tolist()]
