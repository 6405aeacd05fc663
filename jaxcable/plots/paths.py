"""Pictures of load against displacement: `path`."""

from __future__ import annotations

import os

import numpy as np
from matplotlib.figure import Figure

from ..analysis.phase_results import Path
from ..paths.events import (
    BIFURCATION,
    LIMIT_POINT,
    MATERIAL_FAILURE,
    NAMES,
    SLACKENING,
    SLIP,
    TIGHTENING,
)
from ..paths.result import TracedPath
from .style import GRID, SERIES, finish_figure, legend_below, new_figure

_MARKS = {
    LIMIT_POINT: ("o", SERIES[1]),
    BIFURCATION: ("D", SERIES[4]),
    SLACKENING: ("v", SERIES[2]),
    TIGHTENING: ("^", SERIES[3]),
    MATERIAL_FAILURE: ("X", "black"),
    SLIP: ("s", SERIES[5]),
}


def path(
    traced: TracedPath | Path,
    node: int,
    axis: str = "z",
    path: str | os.PathLike[str] | None = None,
    *,
    scale: float = 1.0,
    unit: str | None = None,
    factor: float = 1e3,
    length: str = "mm",
) -> Figure:
    """Draw load against displacement of a node, unstable parts dashed, events marked.

    Args:
        traced: `TracedPath`, or the `path` of a phase of a solution.
        node: number of the node whose displacement is drawn.
        axis: "x", "y" or "z", with a minus sign before it for the opposite direction.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        scale, unit: load at load factor 1 and its unit; default: the load factor is drawn.
        factor, length: factor on displacements in m, and the name of the resulting unit.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: unknown node or axis, or a path without a point.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> solution = jc.solve(*jc.scenes.flat_net())
    >>> figure = jc.plots.path(solution.phases[1].path, 3, axis="-z", scale=150.0, unit="N")
    >>> figure.axes[0].get_xlabel()
    'displacement of node 3 along -z (mm)'
    """
    name = axis.removeprefix("-")
    if name not in ("x", "y", "z"):
        raise ValueError(f'axis = {axis!r}: expected "x", "y" or "z", with "-" for the opposite')
    sign = -factor if axis.startswith("-") else factor
    n_node = traced.displacement.shape[1]
    if not 0 <= node < n_node:
        raise ValueError(f"node = {node}: the structure has nodes 0 to {n_node - 1}")
    moved = sign * np.asarray(traced.displacement)[:, node, "xyz".index(name)]
    load = scale * np.asarray(traced.load_factor)
    if not np.isfinite(moved).any():
        raise ValueError("traced: has no point to draw; look at its status")
    figure = new_figure(4.8, 3.8)
    axes = figure.add_subplot()
    negative = getattr(traced, "n_negative", None)
    unstable = np.zeros(len(load), bool) if negative is None else np.asarray(negative) > 0
    # a piece of the line is stable or unstable as the point at its end
    for kind, style, label in ((False, "-", "stable"), (True, "--", "unstable")):
        shown = unstable == kind
        shown[:-1] |= shown[1:]
        if (unstable == kind).any():
            known = None if negative is None else label
            line = (np.where(shown, values, np.nan) for values in (moved, load))
            axes.plot(*line, style, color=SERIES[0], linewidth=1.6, label=known)
    events = getattr(traced, "events", None)
    for number in () if events is None else np.unique(np.asarray(events.kind)):
        mark, color = _MARKS[int(number)]
        alike = np.asarray(events.kind) == number
        at = sign * np.asarray(events.displacement)[alike, node, "xyz".index(name)]
        heights = scale * np.asarray(events.load_factor)[alike]
        axes.plot(at, heights, mark, color=color, markersize=6, label=NAMES[int(number)])
    axes.axhline(0.0, color="0.6", linewidth=0.7)
    axes.grid(color=GRID)
    axes.set(
        xlabel=f"displacement of node {node} along {axis} ({length})",
        ylabel="load factor" if unit is None else f"load ({unit})",
    )
    if negative is not None:
        legend_below(axes, columns=3)
    return finish_figure(figure, path)
