"""Section forces along beams, drawn on the structure: `diagram`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from ..analysis.solution import Solution, State
from ..common.types import Float, Int
from ..elements.element import SECTION_FORCES
from ..model.parts import first_and_last, per_group
from ..model.structure import Structure
from ..results import section_forces
from .glyphs import draw_supports, support_keys
from .layout import arrange, settle
from .shapes import chosen, lines, projected
from .stages import drawn, stages_of
from .style import GHOST, INK, SERIES, SIZE, finish, force_unit
from .views import View, choose

PLACES = 25  # along a beam, ends included
_HIGH = 0.12  # length of the largest value over the extent of the structure
_LABELS = 9  # values that are written
_APART = 0.12  # distance of written values over the extent
_NOTHING = 1e-9  # value over the largest force, or moment, up to which it is rounding
_LEAST = 0.05  # of the largest value: less is not written
_COLOURS = {"positive": SERIES[0], "negative": SERIES[1]}


def diagram(
    solution: Solution,
    of: str = "My",
    path: str | os.PathLike[str] | None = None,
    *,
    structure: Structure | None = None,
    state: State | None = None,
    view: str | None = None,
    names: Sequence[str] | None = None,
    high: float = _HIGH,
    supports: bool = True,
) -> Figure:
    """Draw a section force of all beams on the structure, with values at ends and extremes.

    Positive values are drawn to the side of the section's axis z (of "Vy" and "Mz" to that of y; of
    -y for "Mz"), so that moments lie on the side that is in tension (`section_forces` has the
    signs). In a plane picture the side is that of the axis, drawn at right angles to the beam. With
    a `structure` beams are bent and catenaries hang, as in `net`.

    Args:
        solution: `Solution` of a structure with beams.
        of: "N", "Vy", "Vz", "T", "My" or "Mz".
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        structure: the `Structure` that was analysed. Without it, values are those of
            `Solution.section_forces` at its few places, axes are those of beams without a stated
            `up`, beams and catenaries are chords, and it is not known which nodes rotate.
        state: `State` to draw instead of the end, such as ``solution.last`` of a failed analysis.
        view: "plan", "elevation" or "space"; default that of `net`.
        names: names of the phases for the title, as of `net`.
        high: length of the largest value over the extent of the structure.
        supports: whether to mark supports.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: an unknown force, no beams, a size that is not positive, or those of `net`.

    A cantilever of 4 m under 500 N at its end:

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
    >>> beam = jc.Beams([[0, 1]], section=section)
    >>> structure = jc.Structure([[0, 0, 0], [4.0, 0, 0]], beam, supports=jc.clamped([0]))
    >>> load = jc.NodalLoads([1], (0.0, 0.0, -500.0))
    >>> figure = jc.plots.diagram(jc.solve(structure, jc.Phase(loads=load)), structure=structure)
    >>> figure.axes[0].get_title(), figure.axes[0].texts[0].get_text()
    ('My (N m), at the end', '2000')
    """
    components = SECTION_FORCES.components
    if of not in components:
        raise ValueError(f"of = {of!r}: expected one of {', '.join(components)}")
    if not high > 0:
        raise ValueError(f"high = {high!r}: must be positive")
    links, stages, shown = stages_of(solution, structure, state, names=names)
    stage = stages[-1]
    there, positions, curves = stage.forces.present, stage.positions, stage.curves
    forces, ends, number = _forces(solution, shown, structure)
    kept = there[number]
    forces, ends, number = forces[kept], ends[kept], number[kept]
    alike = slice(3, 6) if of in ("T", "My", "Mz") else slice(0, 3)
    least = _NOTHING * float(np.abs(forces[..., alike]).max(initial=0.0))
    values = forces[..., components.index(of)]
    values = np.where(np.abs(values) > least, values, 0.0)
    points = np.concatenate(drawn(*stage.now()))
    extent = float(np.ptp(points, axis=0).max())
    largest = float(np.abs(values).max(initial=0.0))
    axis = positions[ends]
    if curves is None or not np.isin(number, curves.number[: len(curves.axes)]).all():
        parts = np.linspace(0, 1, values.shape[1])[:, None]
        base = axis[:, :1] + parts * (axis[:, 1:] - axis[:, :1])
        sides = _sides(_supposed_axes(axis), axis, of)
    else:
        rows = curves.rows(number)
        base = curves.points(positions, values.shape[1])[rows]
        sides = _sides(curves.axes[rows], axis, of)
    seen = choose(points, view)
    if view is None and not seen.plane:
        seen = View("space")
    sides = _in_picture(sides, axis[:, 1] - axis[:, 0], seen)
    scale = high * extent / max(largest, 1e-300)
    tips = base + scale * values[..., None] * sides[:, None]
    factor, unit = force_unit(largest)
    unit = unit + (" m" if of in ("T", "My", "Mz") else "")
    everything = np.concatenate([points, tips.reshape(-1, 3)])
    figure, slots = arrange([seen.ratio(everything)], [seen.flat])
    name = stage.title if names is not None else stage.title[0].lower() + stage.title[1:]
    title = f"{of} ({unit}), {name}" + ("" if largest > 0.0 else ": zero")
    axes = seen.add_axes(figure, everything, title)
    _draw(axes, seen, stage, links, base, tips, values, least)
    occur = values.max(initial=0.0) > least, values.min(initial=0.0) < -least
    handles: list[Any] = [
        Patch(color=_COLOURS[sign], alpha=0.6, label=f"{of} {sign}")
        for sign, occurs in zip(_COLOURS, occur, strict=True)
        if occurs
    ]
    if supports:
        held = stage.held(structure, seen)
        draw_supports(axes, seen, positions, held)
        handles += support_keys(held)
    halo = [Stroke(linewidth=2.5, foreground="white"), Normal()]
    for place, value in _written(tips, values, extent):
        look = {"ha": "center", "va": "center", "color": INK, "zorder": 9, "path_effects": halo}
        axes.text(*seen.project(place), f"{factor * value:.4g}", **look)
    settle(figure, slots, None, "", handles)
    for text in axes.texts:
        text.set_fontsize(0.85 * SIZE)
    return finish(figure, path)


def _forces(solution, state, structure):
    """Forces of all beams [n_beam, n_place, 6], their ends [n_beam, 2] and numbers [n_beam]."""
    found, ends, numbers, count = [], [], [], 0
    parts = solution.last.topology.parts
    if structure is None:
        forces = _leaves(state.section_forces, len(parts))
    else:
        forces = per_group(structure, section_forces(structure, state, PLACES))
    for part, values in zip(parts, forces, strict=True):
        if values is not None:
            found.append(np.asarray(values))
            ends.append(first_and_last(part))
            numbers.append(count + np.arange(len(part.links.array)))
        count += len(part.links.array)
    if not found:
        raise ValueError("solution: has no beams, and so no section forces")
    return np.concatenate(found), np.concatenate(ends), np.concatenate(numbers)


def _leaves(tree: Any, count: int) -> list[Any]:
    """Leaves of a pytree in the shape of the elements, None for groups without values."""
    return [None] * count if tree is None else jax.tree.leaves(tree, is_leaf=lambda x: x is None)


def _sides(axes, ends, of):
    """Unit vectors to which positive values are drawn, [n_beam, 3], at right angles to chords."""
    chord = ends[:, 1] - ends[:, 0]
    chord = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    side = {"Vy": axes[:, 1], "Mz": -axes[:, 1]}.get(of, axes[:, 2])
    side = side - (side * chord).sum(axis=1, keepdims=True) * chord
    return side / np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)


def _supposed_axes(ends):
    """Axes of sections of beams without a stated `up`, in rows, [n_beam, 3, 3]."""
    chord = ends[:, 1] - ends[:, 0]
    chord = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    steep = np.abs(chord[:, 2:]) > 0.999
    axes_z = np.where(steep, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    return np.stack([chord, np.cross(axes_z, chord), axes_z], axis=1)


def _in_picture(sides, chord, view):
    """Sides turned into the plane of a flat picture, at right angles to the chords in it."""
    if not view.flat:
        return sides
    basis = view.project(np.eye(3)).T  # directions of the picture, [2, 3]
    across = view.project(chord) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    across = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    along = (across * view.project(sides)).sum(axis=1, keepdims=True)
    return np.where(along < -1e-9, -across, across) @ basis


def _draw(axes, view, stage, links, base, tips, values, least):
    """Lines of all elements, and the areas between beams and their values."""
    collection, areas = (LineCollection, PolyCollection) if view.flat else (
        Line3DCollection,
        Poly3DCollection,
    )  # fmt: skip
    plain = chosen(
        projected(view, lines(stage.positions, links, stage.curves)),
        stage.forces.present[links[1]],
    )
    axes.add_collection(collection(plain, colors=GHOST, linewidths=1.0, zorder=1), autolim=False)
    base, top = view.project(base), view.project(tips)
    axes.add_collection(collection(base, colors=INK, linewidths=1.4, zorder=4), autolim=False)
    axes.add_collection(collection(top, colors=INK, linewidths=0.7, zorder=3), autolim=False)
    quads = np.stack([base[:, :-1], base[:, 1:], top[:, 1:], top[:, :-1]], axis=2)
    mean = 0.5 * (values[:, :-1] + values[:, 1:])
    for sign, alike in (("positive", mean > least), ("negative", mean < -least)):
        if alike.any():
            look = {"facecolors": _COLOURS[sign], "edgecolors": "none", "alpha": 0.6, "zorder": 2}
            axes.add_collection(areas(quads[alike], **look), autolim=False)


def _written(
    tips: Float[np.ndarray, "n_beam n_place 3"],
    values: Float[np.ndarray, "n_beam n_place"],
    extent: float,
) -> list[tuple[Float[np.ndarray, " 3"], float]]:
    """Places and values that are written: of ends and extremes the largest, apart from others."""
    beam: Int[np.ndarray, " n_beam"] = np.arange(len(values))
    at = np.stack(
        [0 * beam, 0 * beam + values.shape[1] - 1, values.argmax(axis=1), values.argmin(axis=1)]
    )
    places, found = tips[beam, at].reshape(-1, 3), values[beam, at].ravel()
    kept: list[int] = []
    for k in np.argsort(-np.abs(found)):
        if len(kept) == _LABELS or np.abs(found[k]) <= _LEAST * np.abs(found).max():
            break
        if all(np.linalg.norm(places[k] - places[j]) > _APART * extent for j in kept):
            kept.append(int(k))
    return [(places[k], float(found[k])) for k in kept]
