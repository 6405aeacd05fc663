"""What all pictures share: figures, sizes of text, colors, units of force."""

from __future__ import annotations

import io
import os
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import ScaledTranslation

from ..common.units import Units
from ..common.writing import MADE_BY, atomic_write

SIZE = 9.5
"""Size of all text, in points: 6 or more when a picture is printed 10 cm wide."""

_CHARACTERS = 12.0
"""Characters of text on an inch, with some wide ones."""
_MARK = 0.8  # inches: mark of a legend entry, with the space around it

SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKS = ("o", "s", "^", "D", "v", "P", "X")
STYLES = ("-", "--", "-.", ":")
"""Line styles; several series differ in color (Okabe and Ito), mark and line style."""

SLACK = "#D55E00"
GHOST = "0.72"
INK = "0.1"
LOAD = "#000000"
REACTION = "#CC79A7"
OVER = "#E8002A"
"""Color of values above a scale: bright, and in no part of the color map."""
AXES = ("#E69F00", "#56B4E9", "#0072B2")
"""Colors of the axes x, y and z of sections."""
GRID = "0.9"
FAILED = {"linestyle": "", "marker": "X", "color": "#D55E00", "markersize": 7, "zorder": 5}
"""Marks of failed increments, steps and trials."""
LEGEND = {"frameon": False, "columnspacing": 1.4, "handletextpad": 0.6}


class Picture(Figure):
    """A matplotlib `Figure` that notebooks show and that is not registered with pyplot.

    It needs no display, does not count among pyplot's open figures and is deleted with its last
    reference.
    """

    def _repr_png_(self):
        """Return the picture as PNG, for notebooks."""
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


def new_figure(
    width: float, height: float, layout: Literal["constrained"] | None = "constrained"
) -> Picture:
    """Return an empty `Picture` of this width and height, inches."""
    figure = Picture(figsize=(width, height), dpi=150, layout=layout)
    FigureCanvasAgg(figure)  # measures text
    if layout is not None:
        figure.get_layout_engine().set(w_pad=0.08, h_pad=0.08)  # type: ignore[call-arg]  # ours is constrained
    return figure


def set_text_size(figure: Figure) -> None:
    """Set all text of a figure to the size `SIZE` of this module, in points."""
    for axes in figure.axes:
        axes.tick_params(labelsize=SIZE)
    for text in figure.findobj(Text):
        text.set_fontsize(SIZE)


def finish_figure(figure: Figure, path: str | os.PathLike[str] | None = None) -> Figure:
    """Set the size of all text, save the figure to `path` unless it is None, and return it."""
    set_text_size(figure)
    if path is not None:
        save_figure(figure, path, dpi=200)
    return figure


def save_figure(figure: Figure, path: str | os.PathLike[str], dpi: float) -> None:
    """Save a figure in the format of its suffix, PNG without one; completely or not at all.

    Raises:
        ValueError: matplotlib has no format of that name. OSError: the file cannot be written.
    """
    if hasattr(path, "write"):  # a stream
        figure.savefig(path, dpi=dpi)
        return
    path = Path(path)
    if not path.suffix:
        path = path.with_name(f"{path.name}.png")
    kind, known = path.suffix[1:].lower(), sorted(figure.canvas.get_supported_filetypes())
    if kind not in known:
        raise ValueError(f"path = {str(path)!r}: expected a name that ends with one of {known}")
    names = {"png": "Software", "pdf": "Creator", "svg": "Creator"}
    metadata = {names[kind]: MADE_BY} if kind in names else None
    with atomic_write(path, "wb") as stream:
        figure.savefig(stream, format=kind, dpi=dpi, metadata=metadata)


def color_map() -> Colormap:
    """Return the color map Viridis without its brightest end, which is invisible on white.

    Values above the scale have the color `OVER`; missing values are grey.
    """
    colors = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.92, 256))
    return ListedColormap(colors).with_extremes(bad="0.6", over=OVER)


def display_unit(largest: float, unit: str, units: Units | None = None) -> tuple[float, str]:
    """Return the factor from an SI unit to the unit in which pictures show it, and its name.

    With `units` it is theirs; stresses are in MPa, kip/in2, lbf/in2 or kgf/cm2 then. Without them,
    quantities whose unit begins with N (forces, moments) are in N, kN or MN, as suits the largest
    value, and others in SI.
    """
    if units is None and unit.startswith("N"):
        factor, force = force_unit(largest)
        return factor, force + unit[1:]
    if units is None:
        return 1.0, unit
    if unit == "Pa":
        name, to_stress = units.stress
        return float(to_stress) * units.from_si(1.0, unit), name
    return units.from_si(1.0, unit), units.shown(unit)


def force_unit(largest: float) -> tuple[float, str]:
    """Return the factor from N to N, kN or MN, as suits the largest force, N, and its name."""
    for size, name in ((1e6, "MN"), (1e3, "kN")):
        if largest >= 10 * size:
            return 1.0 / size, name
    return 1.0, "N"


def format_force(force: float, units: Units | None = None) -> str:
    """Return a force, given in N, as text in `units`, or with a suitable unit."""
    factor, name = display_unit(10 * force, "N", units)
    return f"{force * factor:.3g} {name}"


def format_value(value: float) -> str:
    """Return a number as text, with four digits or, if it is large, without decimals."""
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"


def fold_text(text: str, width: float) -> str:
    """Return a text of a picture in at most two lines of a width in inches, then "..."."""
    count = max(int(_CHARACTERS * width), 8)
    return "\n".join(textwrap.wrap(text, count, max_lines=2, placeholder=" ..."))


def fold_labels(handles: Sequence[Any], width: float) -> None:
    """Fold the labels of legend entries, such as long names of groups, to a width in inches."""
    for handle in handles:
        handle.set_label(fold_text(handle.get_label(), width - _MARK))


def legend_below(
    axes: Axes, columns: int, handles: Sequence[Any] | None = None, drop: float = 0.5
) -> None:
    """Put a legend `drop` inches below axes, in at most this number of columns, and as many as fit.

    `handles` are its entries, None for those of the axes; without entries there is no legend.
    """
    handles = axes.get_legend_handles_labels()[0] if handles is None else handles
    if handles:
        width = axes.figure.get_size_inches()[0]
        fold_labels(handles, width)
        lines = [handle.get_label().splitlines() for handle in handles]
        widths = [_MARK + max(map(len, own), default=0) / _CHARACTERS for own in lines]
        columns = min(columns, len(handles))
        while columns > 1 and sum(map(max, np.array_split(widths, columns))) > width:
            columns -= 1
        down = ScaledTranslation(0.0, -drop, axes.figure.dpi_scale_trans)
        axes.legend(
            handles=handles,
            loc="upper center",
            bbox_to_anchor=(0.5, 0.0),
            bbox_transform=axes.transAxes + down,
            ncols=columns,
            borderaxespad=0.0,
            **LEGEND,
        )


def series_style(k: int) -> dict[str, Any]:
    """Return color, mark and line style of series number `k`, as arguments for matplotlib."""
    return {
        "color": SERIES[k % len(SERIES)],
        "marker": MARKS[k % len(MARKS)],
        "linestyle": STYLES[k % len(STYLES)],
        "markersize": 5,
        "linewidth": 1.4,
    }
