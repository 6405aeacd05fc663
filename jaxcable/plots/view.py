"""An interactive 3-D view of a structure, its phases and its results, as a page: `view`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.colors import to_hex

from ..analysis.solution import Solution
from ..common import status
from ..common.units import UnitsLike, as_units
from ..dynamics.modes import NaturalModes
from ..model.result_parts import named_groups_of
from ..model.structure import Structure
from .diagrams import forces_along_beams
from .element_forces import all_result_columns, concatenate_values
from .mode_shapes import mode_titles, moving_modes
from .page import Page, PageArrays, write_page
from .snapshots import Snapshots
from .style import LOAD, REACTION, SLACK, color_map, display_unit
from .views import choose_view

_PLACES = 17  # along hanging cables, ends included; fewer than in pictures, for small pages
_DIAGRAM = 13  # places along beams for their section forces


def view(
    solution: Solution,
    path: str | os.PathLike[str] | None = "net.html",
    *,
    structure: Structure | None = None,
    color: str = "tension",
    title: str = "jaxcable",
    names: Sequence[str] | None = None,
    frames: int = 40,
    modes: NaturalModes | None = None,
    units: UnitsLike | None = None,
) -> Page:
    """Write a page with an interactive 3-D view of a structure, its phases and its results.

    The page needs no other file and no network. It has a slider through the increments of all
    phases and a factor on displacements; a click on an element or a node shows its values. Mouse,
    fingers and keys turn, move and enlarge (arrows, with shift to move, ``+``, ``-``, ``0``, ``x``,
    ``y``, ``z``, space to play). Elements with faces are filled. Slack cables are
    dashed, elements in compression have a casing, inactive elements are not drawn. Browsers need
    WebGL 2.

    With `structure` beams are bent (cubics with the rotations of their ends, in all increments) and
    have their axes and diagrams of section forces. Catenaries hang: exactly at the ends of phases,
    interpolated between them. Loads, reactions, moments and diagrams of beams are only available at
    the end of a phase.

    Args:
        solution: `Solution` of one case. Of a failed analysis the page shows the converged
            increments, up to ``solution.last``, and says so.
        path: where to write the page, with the suffix ".html", or None.

    Options:
        structure: the `Structure` that was analysed. Without it every element is straight, there
            is no utilization, and elements with zero tension are drawn as slack.
        color: values that color elements when the page opens, as for `net`; it offers the others.
            They have one scale for all groups and phases, or for all groups in the phase shown.
        title: title of the page.
        names: names of the phases, one for each, as of `net`.
        frames: largest number of increments in the page, taken evenly from all of them; the ends
            of phases are kept whatever it is. Every one needs ``16 n_node + 7 n_elem`` bytes or
            more, and all positions and results are numbers of 32 bits.
        modes: result of `dynamics.modes` about the last state: the page shows these in place of the
            increments, each as a moving shape with its frequency; elements are straight then.
        units: units of the numbers that the page shows, as of `net`.

    Returns:
        A `Page` with `path` and `html`, which notebooks show.

    Raises:
        ValueError: another suffix, no converged increment, a batch, a `State` or a path (which
            `path` draws), another structure than that of the solution, another number of names than
            of phases, or an unknown option.

    >>> import pathlib, tempfile
    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> structure, phases = jc.scenes.flat_net()
    >>> solution = jc.solve(structure, phases)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     page = jc.plots.view(solution, pathlib.Path(folder) / "n.html", structure=structure)
    >>> page.path.name, "https://" in page.html
    ('n.html', False)
    """
    if path is not None and Path(path).suffix.lower() not in (".html", ".htm"):
        raise ValueError(f'path = {str(path)!r}: expected the suffix ".html"')
    stated = None if units is None else as_units(units)
    snapshots = Snapshots(solution, structure, color, names, _PLACES)
    arrays = PageArrays()
    description: dict[str, Any] = {"title": title, "note": _failure_note(solution)}
    count = len(solution.phases)
    phases = [f"Phase {k}" for k in range(1, count + 1)] if names is None else [*names]
    if modes is None:
        shots = snapshots.increments(frames, ends=True)
    else:
        shots, phases = moving_modes(modes, snapshots), mode_titles(modes)
    description |= {"phases": phases, "repeats": modes is not None}
    _add_geometry(description, arrays, snapshots, shots)
    _add_curves(arrays, snapshots, shots)
    _add_results(description, arrays, snapshots, shots)
    _add_supports_and_nodal_forces(arrays, snapshots, shots)
    description["colors"] = _page_colors()
    if stated is not None:
        columns = {column["unit"] for column in description["columns"]}
        description["units"] = {
            unit: display_unit(0.0, unit, stated) for unit in sorted({"N", "m", "N m", *columns})
        }
    return write_page(title, description, arrays, path)


def _failure_note(solution):
    """Return the note that the page shows if the solution has failed or is unstable; else ""."""
    if int(solution.status) != status.OK:
        last = solution.last
        where = f"phase {int(last.phase) + 1}, load factor {float(last.load_factor):.3g}"
        return (
            f"The analysis did not finish: {status.describe(solution.status)}. Shown up to {where}."
        )
    if solution.stable is not None and not bool(solution.stable):
        # of an unsymmetric tangent the symmetric part is judged, which proves nothing
        return "The equilibrium at the end is unstable, or not known to be stable."
    return ""


def _add_geometry(description, arrays, snapshots, shots):
    """Add groups, straight pieces, faces and positions to the description and arrays of the page.

    `shots` are the `Snapshot`s of the page, and `snapshots` the `Snapshots` of the solution.
    """
    parts, structure = snapshots.parts, snapshots.structure
    names = [part.name for part in parts]
    if structure is not None:
        names = [name for name, _ in named_groups_of(structure)]
    description["groups"] = [
        {"name": name.strip("[]'\""), "kind": part.kind, "count": len(part.links.array)}
        for name, part in zip(names, parts, strict=True)
    ]
    start = shots[0].initial_positions
    description["origin"] = start.mean(axis=0).tolist()
    description["shots"] = [
        {
            "phase": s.phase + 1,
            "number": s.increment + 1,
            "factor": s.load_factor,
            "end": s.end is not None,
        }
        for s in shots
    ]
    ends, element = snapshots.links
    arrays.add("pieces", "u", ends)
    arrays.add("element", "u", element)
    corners, element = snapshots.faces
    if len(corners):
        thirds = corners[:, [[0, 1, 2], [0, 2, 3]]]  # of a triangle the second has no area
        real = thirds[..., 1] != thirds[..., 2]
        arrays.add("triangles", "u", thirds[real])
        arrays.add("face", "u", np.stack([element, element], axis=1)[real])
    arrays.add("first", "u", np.concatenate([part.links.array[:, 0] for part in parts]))
    arrays.add("last", "u", np.concatenate([part.links.array[:, -1] for part in parts]))
    arrays.add("start", "f", start - start.mean(axis=0))
    arrays.add("moved", "f", [shot.displacement for shot in shots])


def _add_curves(arrays, snapshots, shots):
    """Add the shapes of beams and hanging cables, and section forces, to the arrays of the page.

    Shapes of beams are those in each `Snapshot` of `shots`; all else only at ends of phases.
    """
    if shots[0].curves is None:
        return
    curves, ends = [shot.curves for shot in shots], [shot for shot in shots if shot.end is not None]
    count = len(curves[0].bend)
    beam, sagging = curves[0].element[:count], curves[0].piece[count:]  # of chains each segment
    if len(beam):
        places = np.linspace(0.0, 1.0, _DIAGRAM)
        diagrams = [forces_along_beams(snapshots.parts, shot.end, places)[0] for shot in ends]
        if any(len(values) != len(beam) for values in diagrams):  # a group tells none
            diagrams = np.zeros((len(ends), len(beam), 0, 6))
        arrays.add("beam", "u", beam)
        arrays.add("bend", "f", [each.bend for each in curves])
        arrays.add("axes", "f", [each.axes[:, 1:] for each in curves])
        arrays.add("diagrams", "f", diagrams)
    if len(sagging):
        arrays.add("sagging", "u", sagging)
        # NaN where no sag is known, as of a cable that is not there: the page draws its chord
        arrays.add("sag", "f", [np.nan_to_num(shot.curves.sag) for shot in ends])


def _add_results(description, arrays, snapshots, shots):
    """Add to the page the results of elements in each `Snapshot` of `shots`, NaN where unknown.

    The array "looks" is the sum of 1 for slack, 2 for compressed and 4 for inactive elements;
    "segment_tension" has the tensions of pieces of cables with friction, NaN of other pieces.
    """
    parts, columns = snapshots.parts, {}
    for at, shot in enumerate(shots):
        for column in all_result_columns(shot.element_results, parts, snapshots.structure):
            nothing = np.full((len(shots), len(shot.forces.present)), np.nan, np.float32)
            values = columns.setdefault(column.label, (column.unit, nothing))[1]
            values[at] = concatenate_values(column.values, parts)
    tension, peak = (columns.get(name, (None, None))[1] for name in ("tension", "peak_tension"))
    if peak is not None and np.array_equal(peak, tension, equal_nan=True):
        del columns["peak_tension"]
    columns = {name: pair for name, pair in columns.items() if np.isfinite(pair[1]).any()}
    description["columns"] = [
        {"label": label, "unit": unit, "array": f"column {k}"}
        for k, (label, (unit, _)) in enumerate(columns.items())
    ]
    description["color"] = (
        snapshots.color if snapshots.color in columns else next(iter(columns), "")
    )
    for k, (_, values) in enumerate(columns.values()):
        arrays.add(f"column {k}", "f", values)
    looks = [1 * f.slack + 2 * f.compressed + 4 * ~f.present for f in (s.forces for s in shots)]
    arrays.add("looks", "b", looks)
    if shots[0].forces.segment_tension is not None:
        arrays.add("segment_tension", "f", [shot.forces.segment_tension for shot in shots])
    ends = [shot.end for shot in shots if shot.end is not None]
    arrays.add("rest_length", "f", [concatenate_values(end.rest_length, parts) for end in ends])


def _add_supports_and_nodal_forces(arrays, snapshots, shots):
    """Add supports, loads and reactions at the ends of phases to the arrays of the page.

    `shots` are all `Snapshot`s of the page; those within phases are skipped. Loads and reactions
    are written for the nodes in "loaded" and "held" only: others have none in any phase. Forces
    that are negligible in all `snapshots` are zero.
    """
    shots = [shot for shot in shots if shot.end is not None]
    normal = choose_view(shots[0].initial_positions).normal
    arrays.add("supports", "b", [shot.support_kinds(normal).T @ [1, 2, 3, 3] for shot in shots])
    load, reactions, moments = (
        np.stack([np.asarray(getattr(shot.end, name)) for shot in shots])
        if getattr(shots[-1].end, name) is not None
        else np.zeros((len(shots), 0, 3))
        for name in ("load", "reactions", "reaction_moments")
    )
    for forces in (load, reactions):
        forces[np.linalg.norm(forces, axis=2) <= snapshots.negligible_force()] = 0.0
    loaded = np.flatnonzero(load.any(axis=(0, 2)))
    held = np.union1d(*(np.flatnonzero(x.any(axis=(0, 2))) for x in (reactions, moments)))
    arrays.add("loaded", "u", loaded)
    arrays.add("load", "f", load[:, loaded])
    arrays.add("held", "u", held)
    arrays.add("reactions", "f", reactions[:, held])
    if moments.size:
        arrays.add("reaction_moments", "f", moments[:, held])


def _page_colors():
    """Return the colors of the page by name, for the scripts; scales are lists of hex colors.

    There is a second scale for a dark background.
    """
    bright = matplotlib.colormaps["viridis"](np.linspace(0.25, 1.0, 17))
    return {
        "scale": [to_hex(c) for c in color_map()(np.linspace(0.0, 1.0, 17))],
        "darkScale": [to_hex(c) for c in bright],
        "slack": SLACK,
        "load": LOAD,
        "reaction": REACTION,
    }
