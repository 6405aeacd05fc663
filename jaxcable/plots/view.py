"""A picture that turns: a page with a structure in space, its phases and its results: `view`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.colors import to_hex

from ..analysis.phase_results import Path as Increments
from ..analysis.solution import Solution, State
from ..common import status
from ..model.parts import groups_by_name
from ..model.structure import Structure
from .diagrams import along_beams
from .forces import joined, results
from .page import Arrays, Page, write
from .snapshots import Snapshots
from .style import LOAD, REACTION, SLACK, colour_map
from .views import choose

_PLACES = 17  # along hanging cables, ends included
_DIAGRAM = 13  # along beams, of their section forces


def view(
    solution: Solution,
    path: str | os.PathLike[str] | None = "net.html",
    *,
    structure: Structure | None = None,
    colour: str = "tension",
    title: str = "jaxcable",
    names: Sequence[str] | None = None,
    frames: int = 40,
) -> Page:
    """Write a page in which a structure turns, with its phases and its results.

    The page needs no other file and no network. It has a slider through the increments of all
    phases and a factor on displacements; a click on an element or a node reads its values. Mouse,
    fingers and keys turn, move and enlarge (arrows, with shift to move, ``+``, ``-``, ``0``, ``x``,
    ``y``, ``z``, space to play). Elements with faces are filled. Slack cables are
    dashed, elements in compression have a casing, absent elements are not drawn. Browsers need
    WebGL 2.

    With `structure` beams are bent (cubics through the rotations of their ends, in all increments)
    and have their axes and diagrams of section forces; catenaries hang, exactly at the ends of
    phases and interpolated between these. Loads, reactions, moments and diagrams of beams are known
    at the ends of phases, and drawn there.

    Args:
        solution: `Solution` of one case. Of a failed analysis the slider goes through what has
            converged, up to ``solution.last``, and the page says so.
        path: where to write the page, with the suffix ".html", or None.

    Options:
        structure: the `Structure` that was analysed. Without it every element is straight, there
            is no utilisation, and elements with zero tension are drawn as slack.
        colour: values that colour elements at first, as for `net`; the page offers the others.
        title: title of the page.
        names: names of the phases, one for each, as of `net`.
        frames: largest number of increments in the page, taken evenly from all of them; the ends
            of phases are kept whatever it is. Every one needs ``16 n_node + 7 n_elem`` bytes or
            more, and all positions and results are numbers of 32 bits.

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
    _require_solution(solution)
    found = Snapshots(solution, structure, colour, names, _PLACES)
    shots = found.increments(frames, ends=True)
    arrays = Arrays()
    told: dict[str, Any] = {"title": title, "note": _note(solution)}
    count = len(solution.phases)
    told["phases"] = [f"Phase {k}" for k in range(1, count + 1)] if names is None else [*names]
    _put_geometry(told, arrays, found, shots)
    _put_curves(arrays, found, shots)
    _put_results(told, arrays, found, shots)
    _put_nodes(arrays, shots)
    told["colours"] = _colours()
    return write(title, told, arrays, path)


def _require_solution(solution):
    """Raise ValueError, saying what to pass, for what is no `Solution`."""
    if isinstance(solution, Solution):
        return
    more = ""
    if isinstance(solution, State):
        more = "; pass the solution whose state it is, its slider ends at solution.last"
    elif isinstance(solution, Increments):
        more = (
            "; of a traced path pass solve(structure, phases) up to a load factor on it, failed or"
            " not, and draw the path itself by plots.path"
        )
    raise ValueError(f"solution: expected a Solution, got {type(solution).__name__}{more}")


def _note(solution):
    """What has to be known of a solution that did not end well; empty otherwise."""
    if int(solution.status) != status.OK:
        last = solution.last
        where = f"phase {int(last.phase) + 1}, load factor {float(last.load_factor):.3g}"
        return f"Not to the end: {status.describe(solution.status)}. Shown up to {where}."
    if solution.stable is not None and not bool(solution.stable):
        # of an unsymmetric tangent the symmetric part is judged, which proves nothing
        return "The equilibrium at the end is unstable, or not known to be stable."
    return ""


def _put_geometry(told, arrays, found, shots):
    """Groups, pieces, and positions."""
    parts, structure = found.parts, found.structure
    names = [part.name for part in parts]
    if structure is not None:
        names = [name for name, _ in groups_by_name(structure)]
    told["groups"] = [
        {"name": name.strip("[]'\""), "kind": part.kind, "count": len(part.links.array)}
        for name, part in zip(names, parts, strict=True)
    ]
    start = shots[0].start
    told["origin"] = start.mean(axis=0).tolist()
    told["shots"] = [
        {"phase": s.phase + 1, "number": s.number + 1, "factor": s.factor, "end": s.end is not None}
        for s in shots
    ]
    ends, element = found.links
    arrays.put("pieces", "u", ends)
    arrays.put("element", "u", element)
    corners, element = found.faces
    if len(corners):
        thirds = corners[:, [[0, 1, 2], [0, 2, 3]]]  # of a triangle the second has no area
        real = thirds[..., 1] != thirds[..., 2]
        arrays.put("triangles", "u", thirds[real])
        arrays.put("face", "u", np.stack([element, element], axis=1)[real])
    arrays.put("first", "u", np.concatenate([part.links.array[:, 0] for part in parts]))
    arrays.put("last", "u", np.concatenate([part.links.array[:, -1] for part in parts]))
    arrays.put("start", "f", start - start.mean(axis=0))
    arrays.put("moved", "f", [shot.moved for shot in shots])


def _put_curves(arrays, found, shots):
    """Elements that are not straight, and section forces along beams."""
    if shots[0].curves is None:
        return
    curves, ends = [shot.curves for shot in shots], [shot for shot in shots if shot.end is not None]
    beam, sagging = np.split(curves[0].number, [len(curves[0].bend)])
    if len(beam):
        diagrams = [along_beams(found.parts, shot.end, _DIAGRAM)[0] for shot in ends]
        if any(len(values) != len(beam) for values in diagrams):  # a group tells none
            diagrams = np.zeros((len(ends), len(beam), 0, 6))
        arrays.put("beam", "u", beam)
        arrays.put("bend", "f", [each.bend for each in curves])
        arrays.put("axes", "f", [each.axes[:, 1:] for each in curves])
        arrays.put("diagrams", "f", diagrams)
    if len(sagging):
        arrays.put("sagging", "u", sagging)
        # NaN where no sag is known, as of a cable that is not there: the page draws its chord
        arrays.put("sag", "f", [np.nan_to_num(shot.curves.sag) for shot in ends])


def _put_results(told, arrays, found, shots):
    """Results of elements at all instants, NaN where not known, and how the elements look."""
    parts, columns = found.parts, {}
    for at, shot in enumerate(shots):
        for column in results(shot.told, parts, found.structure):
            nothing = np.full((len(shots), len(shot.forces.present)), np.nan, np.float32)
            values = columns.setdefault(column.label, (column.unit, nothing))[1]
            values[at] = joined(column.values, parts)
    tension, peak = (columns.get(name, (None, None))[1] for name in ("tension", "peak_tension"))
    if peak is not None and np.array_equal(peak, tension, equal_nan=True):
        del columns["peak_tension"]
    columns = {name: pair for name, pair in columns.items() if np.isfinite(pair[1]).any()}
    told["columns"] = [
        {"label": label, "unit": unit, "array": f"column {k}"}
        for k, (label, (unit, _)) in enumerate(columns.items())
    ]
    told["colour"] = found.colour if found.colour in columns else next(iter(columns), "")
    for k, (_, values) in enumerate(columns.values()):
        arrays.put(f"column {k}", "f", values)
    looks = [1 * f.slack + 2 * f.compressed + 4 * ~f.present for f in (s.forces for s in shots)]
    arrays.put("looks", "b", looks)
    ends = [shot.end for shot in shots if shot.end is not None]
    arrays.put("rest_length", "f", [joined(end.rest_length, parts) for end in ends])


def _put_nodes(arrays, shots):
    """Supports, reactions and loads at the ends of phases."""
    shots = [shot for shot in shots if shot.end is not None]
    normal = choose(shots[0].start).normal
    arrays.put("supports", "b", [shot.held(normal).T @ [1, 2, 3] for shot in shots])
    # nodes without a load, or without a support, have none in any phase: only others are written
    load, reactions = (
        np.stack([np.asarray(getattr(shot.end, name)) for shot in shots])
        for name in ("load", "reactions")
    )
    loaded, held = (np.flatnonzero((x != 0).any(axis=(0, 2))) for x in (load, reactions))
    arrays.put("loaded", "u", loaded)
    arrays.put("load", "f", load[:, loaded])
    arrays.put("held", "u", held)
    arrays.put("reactions", "f", reactions[:, held])
    moments = [shot.end.reaction_moments for shot in shots]
    if moments[-1] is not None:
        arrays.put("reaction_moments", "f", np.stack(moments)[:, held])


def _colours():
    """Colours of the page, those of all pictures; brighter ones on a dark ground."""
    bright = matplotlib.colormaps["viridis"](np.linspace(0.25, 1.0, 17))
    return {
        "scale": [to_hex(c) for c in colour_map()(np.linspace(0.0, 1.0, 17))],
        "darkScale": [to_hex(c) for c in bright],
        "slack": SLACK,
        "load": LOAD,
        "reaction": REACTION,
    }
