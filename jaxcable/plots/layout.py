"""Layout of pictures of a structure: axes, color bar and legend, measured so that they fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import proj3d

from ..common.types import Float
from .style import LEGEND, SIZE, fold_labels, fold_text, new_figure, set_text_size
from .views import View

Slots: TypeAlias = "Sequence[tuple[float, float, float, float]]"

_GAP = 0.1  # inches, around everything
_BAR = 0.74  # inches, height of the color bar with its numbers and label
_TITLE = 0.25  # inches, height of a title
_NUMBER = 4.5  # width of a number on the color bar with the space beside it, over its size
_APART = 1.1  # least distance of numbers on an upright axis, over their size
_ROUNDS = 3
"""Rounds of measuring and placing: labels keep their size when axes change theirs."""


def arrange_pictures(
    views: Sequence[View],
    points: Sequence[Float[np.ndarray, "n 3"]],
    titles: Sequence[str],
    columns: int | None = None,
    stacked: bool = False,
) -> tuple[Figure, Slots]:
    """Make a figure with axes for pictures of a structure; `finish_layout` moves them into place.

    Args:
        views: `View` of every picture.
        points: what the axes of every picture have to include, arrays [n, 3], m.
        titles: title of every picture.
        columns: number of pictures in a row; None for one or two pictures, which are side by side
            if they are high.
        stacked: whether two pictures are below each other in any case.

    Returns:
        The figure, which has no space for a legend yet, and the slot of each picture: left, top,
        width, height of its place, in inches from the upper left corner.
    """
    ratios = [view.height_over_width(within) for view, within in zip(views, points, strict=True)]
    if columns is None:
        slots = _slots_of_one_or_two(ratios, [view.flat for view in views], stacked)
    else:
        wide = max(6.4 / columns, 2.1)
        high = min(0.35 + wide * max(ratios), 4.0)
        rows = (divmod(k, columns) for k in range(len(views)))
        slots = [(column * wide, row * high, wide, high) for row, column in rows]
    lefts, tops, widths, heights = np.transpose(slots)
    figure = new_figure(max(lefts + widths), max(tops + heights) + _BAR, None)
    for view, within, title, slot in zip(views, points, titles, slots, strict=True):
        view.add_axes(figure, within, fold_text(title, slot[2]))
    return figure, slots


def _slots_of_one_or_two(ratios, flat, stacked):
    """Return the slots (left, top, width, height) of one or two pictures, inches.

    `ratios` are height over width of each, and `flat` says which are plane, not in space; `stacked`
    as for `arrange_pictures`.
    """
    are_high = all(r >= 0.6 or not f for r, f in zip(ratios, flat, strict=True))
    if len(ratios) == 2 and are_high and not stacked:
        widths = [3.2, 3.2] if flat[0] == flat[1] else [2.8 if f else 3.6 for f in flat]
    else:
        widths = [4.8 for _ in ratios]
    heights = [
        min(0.85 + (wide - 0.85) * ratio, 6.5) for wide, ratio in zip(widths, ratios, strict=True)
    ]
    if widths[0] < 4.8:
        first, second = widths
        return [(0.0, 0.0, first, max(heights)), (first, 0.0, second, max(heights))]
    tops = np.cumsum([0.0, *heights[:-1]])
    return [(0.0, top, 4.8, high) for top, high in zip(tops, heights, strict=True)]


def finish_layout(
    figure: Figure,
    slots: Slots,
    handles: Sequence[Any],
    color_bar: tuple[ScalarMappable, str] | None = None,
    columns: int | None = None,
) -> None:
    """Move the axes of a figure into their slots, and put color bar and legend below them.

    Args:
        figure, slots: results of `arrange_pictures`; the figure has one axes per slot.
        handles: legend entries.
        color_bar: drawn lines whose colors it explains, and its label; None for no color bar.
        columns: number of axes in a row, for plane pictures that all get one size; None to let
            each picture fill its slot.
    """
    width, height = figure.get_size_inches()
    views = list(figure.axes)
    room = _place_legend(figure, handles, width)
    bar = 0.0 if color_bar is None else _BAR
    height += bar - _BAR
    total = height + room
    figure.set_size_inches(width, total)
    if color_bar is not None:
        mappable, label = color_bar
        below = figure.add_axes((0.2, (room + 0.48) / total, 0.6, 0.12 / total))
        marks = MaxNLocator(nbins=max(int(0.6 * width * 72 / (_NUMBER * SIZE)), 2))
        figure.colorbar(mappable, cax=below, orientation="horizontal", label=label, ticks=marks)
    set_text_size(figure)
    for axes, (left, top, wide, high) in zip(views, slots, strict=True):
        axes.set_position((left / width, 1 - (top + high) / total, wide / width, high / total))
    for _ in range(_ROUNDS):
        figure.draw_without_rendering()
        for axes, (left, top, wide, high) in zip(views, slots, strict=True):
            _fit_into_slot(axes, (left + _GAP, total - top - high, wide - 2 * _GAP, high - _GAP))
    if columns is not None:
        for _ in range(_ROUNDS):
            _tile_axes(views, columns, (_GAP, room + bar, width - 2 * _GAP, height - bar))
            figure.draw_without_rendering()
    figure.draw_without_rendering()
    for axes in views:
        if axes.name == "3d":
            _thin_out_heights(axes)
            top, place = visible_extent(axes)[3] * figure.dpi, axes.get_window_extent()
            axes.title.set_y((top + 0.06 * figure.dpi - place.y0) / place.height)


def _place_legend(figure, handles, width):
    """Put the legend at the lower edge, in as many columns as fit; return its height, inches.

    `handles` are its entries, without which the height is 0, and `width` is that of the figure,
    inches.
    """
    if not handles:
        return 0.0
    fold_labels(handles, width - 2 * _GAP)
    for columns in range(min(4, len(handles)), 0, -1):
        look: Any = {"loc": "lower center", "fontsize": SIZE, "borderaxespad": 0.4, **LEGEND}
        legend = figure.legend(handles=handles, ncols=columns, **look)
        size = legend.get_window_extent()
        if columns == 1 or size.width / figure.dpi <= width - 2 * _GAP:
            return size.height / figure.dpi + 0.12
        legend.remove()


def _fit_into_slot(axes, slot):
    """Move and scale axes that have been drawn, so that they fill a slot with their labels.

    Args:
        axes: axes in two or three dimensions.
        slot: left, bottom, width, height, inches.
    """
    figure = axes.figure
    size = figure.get_size_inches()
    drawn = visible_extent(axes)
    now = axes.get_position().extents * np.tile(size, 2)
    corner, room = np.array(slot[:2]), np.array(slot[2:])
    if axes.name == "3d":
        room = room - np.array([0.0, _TITLE * (1 + axes.get_title().count("\n"))])
        factor = (room / (drawn[2:] - drawn[:2])).min()
        middle, at = 0.5 * (drawn[:2] + drawn[2:]), 0.5 * (now[:2] + now[2:])
        half = 0.5 * factor * (now[2:] - now[:2])
        centre = corner + 0.5 * room + factor * (at - middle)
        new = np.concatenate([centre - half, centre + half])
    else:
        new = np.concatenate([corner, corner + room]) + (now - drawn)
    left, bottom, right, top = new / np.tile(size, 2)
    axes.set_position([left, bottom, right - left, top - bottom])


def _thin_out_heights(axes):
    """Put fewer numbers on the upright axis of axes in space that have their place, if they touch.

    Its length in the picture is that of a vertical edge of the box.
    """
    (x, _), (y, _), (low, high) = axes.get_xlim(), axes.get_ylim(), axes.get_zlim()
    ends = proj3d.proj_transform([x, x], [y, y], [low, high], axes.get_proj())[:2]
    length = abs(np.ptp(axes.transData.transform(np.transpose(ends))[:, 1])) * 72 / axes.figure.dpi
    marks = [mark for mark in axes.get_zticks() if low <= mark <= high]
    while len(marks) > 1 and length * (marks[1] - marks[0]) < _APART * SIZE * (high - low):
        marks = marks[::2] if len(marks) > 2 else [min(marks, key=abs)]
        axes.set_zticks(marks)


def _tile_axes(views, columns, room):
    """Put axes of equal limits into a grid, all of one size, as close as their labels allow.

    Args:
        views: axes that have been drawn, row by row.
        columns: number of axes in a row.
        room: left, bottom, width, height of the grid, inches.
    """
    figure = views[0].figure
    size = figure.get_size_inches()
    rows = -(-len(views) // columns)
    before, after = np.zeros((rows, columns, 2)), np.zeros((rows, columns, 2))
    for k, axes in enumerate(views):
        drawn, now = visible_extent(axes), axes.get_position().extents * np.tile(size, 2)
        before[divmod(k, columns)] = now[:2] - drawn[:2]  # labels at the left and below
        after[divmod(k, columns)] = drawn[2:] - now[2:]
    sides = before[..., 0].max(axis=0), after[..., 0].max(axis=0) + _GAP  # of columns
    ends = before[..., 1].max(axis=1), after[..., 1].max(axis=1) + _GAP  # of rows
    wide = (room[2] - sum(sides[0]) - sum(sides[1])) / columns
    high = (room[3] - sum(ends[0]) - sum(ends[1])) / rows
    top = room[1] + room[3]
    for k, axes in enumerate(views):
        r, c = divmod(k, columns)
        left = room[0] + c * wide + sides[0][: c + 1].sum() + sides[1][:c].sum()
        bottom = top - (r + 1) * high - ends[1][: r + 1].sum() - ends[0][:r].sum()
        axes.set_position(np.array([left, bottom, wide, high]) / np.tile(size, 2))


def visible_extent(axes):
    """Return left, bottom, right and top of drawn axes with their labels and ticks, inches."""
    renderer = axes.figure.canvas.get_renderer()
    if axes.name != "3d":
        return axes.get_tightbbox(renderer).extents / axes.figure.dpi
    # axes in 3d reach far beyond the box that is drawn; the title is placed later
    limits = [getattr(axes, f"get_{name}lim")() for name in "xyz"]
    corners = np.array(np.meshgrid(*limits)).reshape(3, -1)
    corners = axes.transData.transform(
        np.transpose(proj3d.proj_transform(*corners, axes.get_proj()))[:, :2]
    )
    boxes = [getattr(axes, f"{name}axis").get_tightbbox(renderer).extents for name in "xyz"]
    low = np.min([corners.min(axis=0), *(box[:2] for box in boxes)], axis=0)
    high = np.max([corners.max(axis=0), *(box[2:] for box in boxes)], axis=0)
    return np.concatenate([low, high]) / axes.figure.dpi
