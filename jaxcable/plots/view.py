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
from ..model.parts import groups_by_name, pieces
from ..model.structure import Structure
from .curved import beams_of, sagging_of
from .glyphs import supports
from .moments import Moments, leaves
from .page import Arrays, Page, write
from .stages import named, shown
from .style import LOAD, REACTION, SLACK, colour_map


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
    ``y``, ``z``, space to play). Slack cables are dashed, elements in compression have a casing,
    absent elements are not drawn. Browsers need WebGL 2.

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
    if isinstance(frames, bool) or not isinstance(frames, int) or frames < 1:
        raise ValueError(f"frames = {frames!r}: must be a positive integer")
    _require_solution(solution)
    colour = shown(solution, structure, colour)
    named(solution, names)
    moments = Moments(solution, structure, frames)
    arrays = Arrays()
    told: dict[str, Any] = {"title": title, "note": _note(solution)}
    count = len(solution.phases)
    told["phases"] = [f"Phase {k}" for k in range(1, count + 1)] if names is None else [*names]
    _put_geometry(told, arrays, moments)
    _put_results(told, arrays, moments, colour)
    _put_nodes(told, arrays, moments)
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
        return "The equilibrium at the end is unstable."
    return ""


def _put_geometry(told, arrays, moments):
    """Groups, pieces, positions, and elements that are not straight."""
    parts = moments.parts
    ends, element, _ = pieces(parts)
    names = [part.name for part in parts]
    if moments.structure is not None:
        names = [name for name, _ in groups_by_name(moments.structure)]
    told["groups"] = [
        {"name": name.strip("[]'\""), "kind": part.kind, "count": count}
        for name, part, count in zip(names, parts, moments.counts, strict=True)
    ]
    told["origin"] = moments.start.mean(axis=0).tolist()
    told["shots"] = [
        {"phase": s.phase + 1, "number": s.number + 1, "factor": s.factor, "end": s.end is not None}
        for s in moments.shots
    ]
    arrays.put("pieces", "u", ends)
    arrays.put("element", "u", element)
    arrays.put("first", "u", np.concatenate([part.links.array[:, 0] for part in parts]))
    arrays.put("last", "u", np.concatenate([part.links.array[:, -1] for part in parts]))
    arrays.put("start", "f", moments.start - moments.start.mean(axis=0))
    arrays.put("moved", "f", [shot.moved for shot in moments.shots])
    beams, sagging = beams_of(moments), sagging_of(moments)
    if beams is not None:
        arrays.put("beam", "u", beams.number)
        arrays.put("bend", "f", beams.bend)
        arrays.put("axes", "f", beams.axes)
        arrays.put("diagrams", "f", beams.diagrams)
    if sagging is not None:
        arrays.put("sagging", "u", sagging[0])
        arrays.put("sag", "f", sagging[1])


def _put_results(told, arrays, moments, colour):
    """Results of elements at all moments, and how the elements look."""
    found = moments.columns()
    told["columns"] = [
        {"label": label, "unit": unit, "array": f"column {k}"}
        for k, (label, (unit, _)) in enumerate(found.items())
    ]
    told["colour"] = colour if colour in found else next(iter(found), "")
    for k, (_, values) in enumerate(found.values()):
        arrays.put(f"column {k}", "f", values)
    slack, pressed, absent = moments.looks()
    arrays.put("looks", "b", 1 * slack + 2 * pressed + 4 * absent)
    ends = [shot.end for shot in moments.shots if shot.end is not None]
    lengths = [moments.joined(leaves(end.rest_length)) for end in ends]
    arrays.put("rest_length", "f", lengths)


def _put_nodes(told, arrays, moments):
    """Supports, reactions and loads."""
    last = moments.solution.last
    n_node = len(moments.start)
    ends = [shot for shot in moments.shots if shot.end is not None]
    rotates = None if moments.structure is None else moments.structure.rotating()
    kinds = [
        supports(last.fixed[shot.phase + 1].array[:n_node], rotates, _normal(moments.start))
        for shot in ends
    ]
    arrays.put("supports", "b", [kind.T @ [1, 2, 3] for kind in kinds])
    # nodes without a load, or without a support, have none in any phase: only others are written
    load = np.stack([np.asarray(shot.end.load) for shot in ends])
    loaded = np.flatnonzero((load != 0).any(axis=(0, 2)))
    arrays.put("loaded", "u", loaded)
    arrays.put("load", "f", load[:, loaded])
    reactions = np.stack([np.asarray(shot.end.reactions) for shot in ends])
    held = np.flatnonzero((reactions != 0).any(axis=(0, 2)))
    arrays.put("held", "u", held)
    arrays.put("reactions", "f", reactions[:, held])
    if last.reaction_moments is not None:
        turns = np.stack([np.asarray(shot.end.reaction_moments) for shot in ends])
        arrays.put("reaction_moments", "f", turns[:, held])


def _normal(points):
    """The axis normal to a plane structure, a unit vector [3], or None."""
    size = np.ptp(points, axis=0)
    flat = size <= 1e-6 * max(size.max(), 1e-300)
    return np.eye(3)[int(flat.argmax())] if flat.sum() == 1 and not flat[2] else None


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
