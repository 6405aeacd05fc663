"""Section forces along beams, drawn on the structure: `diagram`."""

from __future__ import annotations

import os
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
from ..elements import Beams
from ..elements.element import SECTION_FORCES
from ..model.parts import first_and_last, per_group, pieces
from ..model.structure import Structure
from ..results import section_forces
from .glyphs import draw_supports, support_keys
from .layout import arrange, settle
from .stages import forces_of, stages_of
from .style import GHOST, INK, SERIES, SIZE, finish, force_unit
from .views import View, choose

PLACES = 25  # along a beam, ends included
_HIGH = 0.12  # length of the largest value over the extent of the structure
_LABELS = 9  # values that are written
_APART = 0.12  # distance of written values over the extent
_NOTHING = 1e-9  # value over the largest one up to which it is rounding
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
    high: float = _HIGH,
    supports: bool = True,
) -> Figure:
    """Draw a section force of all beams on the structure, with values at ends and extremes.

    Positive values are drawn to the side of the section's axis z (of "Vy" and "Mz" to that of y; of
    -y for "Mz"), so that moments lie on the side that is in tension (`section_forces` has the
    signs). In a plane picture the side is that of the axis, drawn at right angles to the beam.

    Args:
        solution: `Solution` of a structure with beams.
        of: "N", "Vy", "Vz", "T", "My" or "Mz".
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        structure: the `Structure` that was analysed. Without it, values are those of
            `Solution.section_forces` at its few places, axes are those of beams without a stated
            `up`, and it is not known which nodes rotate.
        state: `State` to draw instead of the end, such as ``solution.last`` of a failed analysis.
        view: "plan", "elevation" or "space"; default that of `net`.
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
    names = SECTION_FORCES.components
    if of not in names:
        raise ValueError(f"of = {of!r}: expected one of {', '.join(names)}")
    if not high > 0:
        raise ValueError(f"high = {high!r}: must be positive")
    _, stages, shown = stages_of(solution, structure, state)
    values, ends, number = _values(solution, shown, structure, names.index(of))
    there = forces_of(shown, solution, structure, "tension").present
    kept = there[number]
    values, ends, number = values[kept], ends[kept], number[kept]
    positions = np.asarray(shown.positions)
    extent = float(np.ptp(positions, axis=0).max())
    largest = float(np.abs(values).max(initial=0.0))
    sides = _sides(structure, positions, ends, number, of)
    axis = positions[ends]
    drawn = axis[:, :1] + np.linspace(0, 1, values.shape[1])[:, None] * (axis[:, 1:] - axis[:, :1])
    seen = choose(positions, view)
    if view is None and not seen.plane:
        seen = View("space")
    sides = _in_picture(sides, axis[:, 1] - axis[:, 0], seen)
    scale, least = high * extent / max(largest, 1e-300), _NOTHING * largest
    tips = drawn + scale * values[..., None] * sides[:, None]
    factor, unit = force_unit(largest)
    unit = unit + (" m" if of in ("T", "My", "Mz") else "")
    everything = np.concatenate([positions, tips.reshape(-1, 3)])
    figure, slots = arrange([seen.ratio(everything)], [seen.flat])
    name = f"after phase {int(shown.phase) + 1}" if len(solution.phases) > 1 else "at the end"
    axes = seen.add_axes(figure, everything, f"{of} ({unit}), {name}")
    _draw(axes, seen, positions, solution, there, drawn, tips, values, least)
    occur = values.max(initial=0.0) > least, values.min(initial=0.0) < -least
    handles: list[Any] = [
        Patch(color=_COLOURS[sign], alpha=0.6, label=f"{of} {sign}")
        for sign, occurs in zip(_COLOURS, occur, strict=True)
        if occurs
    ]
    if supports:
        held = stages[-1].held(structure, seen)
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


def _values(solution, state, structure, k):
    """Values of all beams [n_beam, n_place], their ends [n_beam, 2] and numbers [n_beam]."""
    found, ends, numbers, count = [], [], [], 0
    parts = solution.last.topology.parts
    if structure is None:
        forces = _leaves(state.section_forces, len(parts))
    else:
        forces = per_group(structure, section_forces(structure, state, PLACES))
    for part, values in zip(parts, forces, strict=True):
        if values is not None:
            found.append(np.asarray(values)[..., k])
            ends.append(first_and_last(part))
            numbers.append(count + np.arange(len(part.links.array)))
        count += len(part.links.array)
    if not found:
        raise ValueError("solution: has no beams, and so no section forces")
    return np.concatenate(found), np.concatenate(ends), np.concatenate(numbers)


def _leaves(tree: Any, count: int) -> list[Any]:
    """Leaves of a pytree in the shape of the elements, None for groups without values."""
    return [None] * count if tree is None else jax.tree.leaves(tree, is_leaf=lambda x: x is None)


def _sides(structure, positions, ends, number, of):
    """Unit vectors to which positive values are drawn, [n_beam, 3], at right angles to chords."""
    chord = positions[ends[:, 1]] - positions[ends[:, 0]]
    chord = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    steep = np.abs(chord[:, 2:]) > 0.999
    axes_z = np.where(steep, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    axes_y, begin = np.cross(axes_z, chord), 0
    for part in () if structure is None else structure.groups:
        count = len(part.links.array)
        own = (number >= begin) & (number < begin + count)
        if isinstance(part, Beams):
            known = np.asarray(part.axes_of(structure.nodes))[number[own] - begin]
            axes_y[own], axes_z[own] = known[:, 1], known[:, 2]
        begin += count
    side = {"Vy": axes_y, "Mz": -axes_y}.get(of, axes_z)
    side = side - (side * chord).sum(axis=1, keepdims=True) * chord
    return side / np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)


def _in_picture(sides, chord, view):
    """Sides turned into the plane of a flat picture, at right angles to the chords in it."""
    if not view.flat:
        return sides
    basis = view.project(np.eye(3)).T  # directions of the picture, [2, 3]
    across = view.project(chord) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    across = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    along = (across * view.project(sides)).sum(axis=1, keepdims=True)
    return np.where(along < -1e-9, -across, across) @ basis


def _draw(axes, view, positions, solution, there, drawn, tips, values, least):
    """Lines of all elements, and the areas between beams and their values."""
    links, element = pieces(solution.last.topology.parts)[:2]
    lines, areas = (LineCollection, PolyCollection) if view.flat else (
        Line3DCollection,
        Poly3DCollection,
    )  # fmt: skip
    segments = view.project(positions)[links]
    axes.add_collection(
        lines(segments[there[element]], colors=GHOST, linewidths=1.0, zorder=1), autolim=False
    )
    base, top = view.project(drawn), view.project(tips)
    axes.add_collection(
        lines(base[:, [0, -1]], colors=INK, linewidths=1.4, zorder=4), autolim=False
    )
    axes.add_collection(lines(top, colors=INK, linewidths=0.7, zorder=3), autolim=False)
    quads = np.stack([base[:, :-1], base[:, 1:], top[:, 1:], top[:, :-1]], axis=2)
    mean = 0.5 * (values[:, :-1] + values[:, 1:])
    for sign, chosen in (("positive", mean > least), ("negative", mean < -least)):
        if chosen.any():
            look = {"facecolors": _COLOURS[sign], "edgecolors": "none", "alpha": 0.6, "zorder": 2}
            axes.add_collection(areas(quads[chosen], **look), autolim=False)


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
        if len(kept) == _LABELS or np.abs(found[k]) < _LEAST * np.abs(found).max():
            break
        if all(np.linalg.norm(places[k] - places[j]) > _APART * extent for j in kept):
            kept.append(int(k))
    return [(places[k], float(found[k])) for k in kept]
