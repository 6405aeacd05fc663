"""A picture of a structure before any analysis: groups, supports, numbers of nodes and elements."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke
from mpl_toolkits.mplot3d import proj3d

from ..common.types import Bool, Float
from ..common.units import UnitsLike, as_units
from ..elements import Beams
from ..model.result_parts import named_groups_of
from ..model.structure import Structure
from .element_lines import line_width
from .layout import arrange_pictures, finish_layout
from .style import INK, SERIES, SIZE, STYLES, finish_figure
from .symbols import draw_supports, support_legend
from .undeformed import UndeformedStructure
from .views import choose_view

_WIDE, _HIGH = 0.65, 1.0  # width of a digit and height of a number, over the size of text
_SHIFT = 0.7  # distance of the number of a node from the node, to the right and up, likewise
_THIN = 0.6  # width of lines over that of other pictures, so that numbers can be read on them
_SAME, _ABOVE = 1e-3, 0.1  # distance of nodes in plan over the extent; share of such nodes
_HALO = [Stroke(linewidth=2.0, foreground="white"), Normal()]


def model(
    structure: Structure,
    path: str | os.PathLike[str] | None = None,
    *,
    numbers: bool = True,
    view: str | None = None,
    supports: bool = True,
    heights: float | None = 1.0,
    units: UnitsLike | None = None,
) -> Figure:
    """Draw a structure as it is in the input: its groups, supports, and numbers.

    Numbers of nodes are black, beside their nodes; those of elements have the color of their group,
    in which they count from 0, and are at its middle. A number that would cover another one is left
    out, and the title says how many are.

    Args:
        structure: `Structure`.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        numbers: whether to write the numbers.
        view: "plan", "elevation" or "space"; default elevation of a structure that lies in a
            vertical plane, plan of one that is low, else space. Where many nodes lie above others,
            there is a picture in space, without numbers, below the plan.
        supports: whether to mark supports.
        heights: factor on heights in elevations, as of `net`.
        units: units of the coordinates, as of `net`.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: an unknown view; unknown units.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> structure = jc.scenes.flat_net().structure
    >>> figure = jc.plots.model(structure)
    >>> len([text for text in figure.axes[0].texts if text.get_text() == "5"])  # node and element
    2
    """
    nodes = np.asarray(structure.nodes, float)
    kinds = [view]
    if view is None and choose_view(nodes).kind == "plan":
        kinds = ["plan", "space"] if _are_nodes_above_others(nodes) else ["plan"]
    stated = None if units is None else as_units(units)
    stages = [UndeformedStructure(structure, kind, stated, heights) for kind in kinds]
    stage, views = stages[0], [stage.view for stage in stages]
    titles = [f"structure: {own.kind}" for own in views]
    figure, slots = arrange_pictures(views, [stage.nodes] * len(views), titles, stacked=True)
    axes = figure.axes[0]
    width = _THIN * line_width(len(stage.links))
    handles: list[Any] = []
    for number, (label, group) in enumerate(named_groups_of(structure)):
        look = _group_line_style(number)
        own = stage.links[stage.group == number]
        wide = (1.6 if isinstance(group, Beams) else 1.0) * width
        for seen, space in zip(views, figure.axes, strict=True):
            ends = seen.project(stage.nodes)[own]
            seen.add_lines(space, ends, linewidths=wide, zorder=3, **look)
        count = len(group.links)
        text = f"{label}: {count} {type(group).__name__}".removeprefix(": ")
        handles.append(Line2D([], [], linewidth=wide, label=text, **look))
    if supports:
        for own, space in zip(stages, figure.axes, strict=True):
            draw_supports(space, own.view, own.nodes, own.held)
        handles += support_legend(stage.held)
    finish_layout(figure, slots, handles)
    left_out = _write_numbers(axes, stage) if numbers else 0
    if left_out:
        text = f"{axes.get_title()}; numbers left out: {left_out}"  # they would cover others
        axes.title.set_text(text)  # where the layout has put it
    return finish_figure(figure, path)


def _are_nodes_above_others(nodes):
    """Return whether many nodes lie at the same place in plan as others, within rounding."""
    size = max(float(np.ptp(nodes, axis=0).max()), 1e-300)
    places = np.unique(np.round(nodes[:, :2] / (_SAME * size)), axis=0)
    return len(nodes) - len(places) > _ABOVE * len(nodes)


def _group_line_style(number):
    """Return color and line style of the group with index `number`, as arguments for matplotlib."""
    colors = SERIES[:-1]  # black is for numbers of nodes
    style = STYLES[number // len(colors) % len(STYLES)]
    return {"color": colors[number % len(colors)], "linestyle": style}


def _write_numbers(axes, stage):
    """Write numbers of nodes and elements; return how many are left out.

    Left out is a number that would cover one written before. `stage` is the `UndeformedStructure`.
    """
    texts, places, colors, shifts = [], [], [], []
    for k, position in enumerate(stage.nodes):
        texts.append(str(k))
        places.append(position)
        colors.append(INK)
        shifts.append((_SHIFT, _SHIFT))
    for number, group in enumerate(stage.structure.groups):
        for k, chain in enumerate(group.links.array):
            texts.append(str(k))
            places.append(stage.nodes[np.unique(chain)].mean(axis=0))
            colors.append(_group_line_style(number)["color"])
            shifts.append((0.0, 0.0) if len(chain) > 1 else (_SHIFT, -_SHIFT))
    at = _positions_in_picture(axes, stage.view, np.array(places))
    kept = _has_free_place(axes, at, texts, SIZE * np.array(shifts))
    look: Any = {"ha": "center", "va": "center", "zorder": 9, "path_effects": _HALO}
    look |= {"textcoords": "offset points", "annotation_clip": False}
    for k in np.flatnonzero(kept):
        axes.annotate(texts[k], at[k], SIZE * np.array(shifts[k]), color=colors[k], **look)
    return int((~kept).sum())


def _positions_in_picture(
    axes: Any, view: Any, positions: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 2"]:
    """Return positions, given in m, in the plane of a picture, in data units of its axes."""
    seen = view.project(positions)
    if view.flat:
        return seen
    return np.transpose(proj3d.proj_transform(*seen.T, axes.get_proj())[:2])


def _has_free_place(axes, at, texts, shifts) -> Bool[np.ndarray, " n"]:
    """Return which texts can be written without covering an earlier one of these, [n] bool.

    Args:
        axes: axes of the picture.
        at: points that the texts belong to, [n, 2], in the data units of the axes.
        texts: list of texts.
        shifts: distances of the texts from there, [n, 2], in points.
    """
    points = axes.transData.transform(at) * 72 / axes.figure.dpi + shifts
    half = 0.5 * SIZE * np.array([[_WIDE * len(text), _HIGH] for text in texts])
    kept: list[int] = []
    for k in range(len(texts)):
        others = np.array(kept, int)
        near = np.abs(points[others] - points[k]) < half[others] + half[k]
        if not near.all(axis=1).any():
            kept.append(k)
    found = np.zeros(len(texts), bool)
    found[kept] = True
    return found
