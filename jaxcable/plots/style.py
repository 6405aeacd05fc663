"""What all pictures have in common: their figure, sizes of text, colours, units of force."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.text import Text

SIZE = 9.5
"""Of all text, points: 6 or more when a picture is printed 10 cm wide."""

SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKS = ("o", "s", "^", "D", "v", "P", "X")
STYLES = ("-", "--", "-.", ":")
"""Of several series (colours of Okabe and Ito): never told apart by colour alone."""

SLACK = "#D55E00"
GHOST = "0.72"
INK = "0.1"
LOAD = "#000000"
REACTION = "#CC79A7"
GRID = "0.9"


class Picture(Figure):
    """A matplotlib `Figure` that notebooks show by themselves and pyplot does not know.

    It needs no display, is not counted among pyplot's open figures and is gone with its last name.
    """

    def _repr_png_(self):
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


def start(
    width: float, height: float, layout: Literal["constrained"] | None = "constrained"
) -> Picture:
    """An empty `Picture` of a size in inches."""
    figure = Picture(figsize=(width, height), dpi=150, layout=layout)
    FigureCanvasAgg(figure)  # measures text
    if layout is not None:
        figure.get_layout_engine().set(w_pad=0.08, h_pad=0.08)  # type: ignore[call-arg]
    return figure


def resize(figure: Figure) -> None:
    """Give all text of a figure its size, whatever the settings of matplotlib are."""
    for axes in figure.axes:
        axes.tick_params(labelsize=SIZE)
    for text in figure.findobj(Text):
        text.set_fontsize(SIZE)


def finish(figure: Figure, path: str | os.PathLike[str] | None = None, dpi: float = 200) -> Figure:
    """Give all text its size, save to `path` unless it is None, return the figure."""
    resize(figure)
    if path is not None:
        figure.savefig(path, dpi=dpi)
    return figure


def colour_map() -> Colormap:
    """Viridis without its brightest end, which is lost on white; grey where there is no value."""
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.92, 256))
    return ListedColormap(colours).with_extremes(bad="0.6")


def force_unit(largest: float) -> tuple[float, str]:
    """Factor from N, and name, of the unit in which a force is best written."""
    for size, name in ((1e6, "MN"), (1e3, "kN")):
        if largest >= 10 * size:
            return 1.0 / size, name
    return 1.0, "N"


def force_text(force: float) -> str:
    """A force, N, with its unit."""
    factor, name = force_unit(10 * force)
    return f"{force * factor:.3g} {name}"


def below(
    axes: Axes, columns: int, handles: Sequence[Any] | None = None, drop: float = 0.62
) -> None:
    """A legend below axes, `drop` inches under them; nothing if there is nothing to name."""
    handles = axes.get_legend_handles_labels()[0] if handles is None else handles
    if handles:
        lower = -drop / (axes.get_position().height * axes.figure.get_size_inches()[1])
        axes.legend(
            handles=handles,
            loc="upper center",
            bbox_to_anchor=(0.5, lower),
            ncols=min(columns, len(handles)),
            frameon=False,
            borderaxespad=0.0,
            columnspacing=1.4,
            handletextpad=0.6,
        )


def series_style(k: int) -> dict[str, Any]:
    """Colour, mark and line style of series number `k`."""
    return {
        "color": SERIES[k % len(SERIES)],
        "marker": MARKS[k % len(MARKS)],
        "linestyle": STYLES[k % len(STYLES)],
        "markersize": 5,
        "linewidth": 1.4,
    }
