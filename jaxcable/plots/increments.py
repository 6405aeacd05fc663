"""Pictures of the convergence of an analysis, increment by increment: `increments`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from ..analysis.solution import Solution
from ..equilibrium.convergence import default_tolerance
from .snapshots import require_one_solution, titles_of_phases
from .style import FAILED, GRID, SERIES, finish_figure, legend_below, new_figure

_ROWS = 4  # of names of phases
_GAP = 0.01  # beside names of phases, over the width of the axes


def increments(
    solution: Solution,
    path: str | os.PathLike[str] | None = None,
    *,
    tol: float | None = None,
    names: Sequence[str] | None = None,
) -> Figure:
    """Draw residual, Newton iterations and slack cables of every increment of all phases.

    Args:
        solution: `Solution`, failed or not; of a failed analysis the increment that failed is
            marked, and later increments are not drawn.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        tol: tolerance of the method, drawn as a line; default: that of `Newton()`. (`Incremental`
            has another measure: its residuals may be above the line.)
        names: names of the phases; default "phase 1", "phase 2" and so on. Where there is no room
            for a name, none is drawn.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: a batch, a tol that is not positive, or another number of names than of phases.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> figure = jc.plots.increments(jc.solve(*jc.scenes.flat_net()))
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['relative residual (-)', 'iterations (-)', 'slack cables (-)']
    """
    require_one_solution(solution)
    titles = titles_of_phases(solution, names)
    paths = [phase.path for phase in solution.phases]
    status = np.concatenate([np.asarray(p.status) for p in paths])
    residual, iterations, slack = (
        np.concatenate([np.asarray(getattr(p, name), float) for p in paths])
        for name in ("relative_residual", "iterations", "n_slack")
    )
    tol = default_tolerance(paths[0].residual.dtype) if tol is None else tol
    if not tol > 0:
        raise ValueError(f"tol = {tol}: must be positive")
    reached = status == 0
    n = int(reached.argmin()) if not reached.all() else len(status)
    number = np.arange(1, n + 1)

    figure = new_figure(4.8, 4.8)
    above, middle, lowest = figure.subplots(3, 1, sharex=True, height_ratios=[1.6, 1, 1])
    size = float(np.clip(100.0 / max(n, 1), 1.0, 4.0))
    dots = {"linestyle": "", "marker": "o", "color": SERIES[0], "markersize": size}
    floor = 0.1 * np.finfo(np.asarray(paths[0].residual).dtype).eps  # least residual drawn
    above.plot(number, np.maximum(residual[:n], floor), label="increment", **dots)
    above.axhline(tol, color=SERIES[-1], linestyle="--", linewidth=1.0, label=f"tol = {tol:.1g}")
    highest = max(tol, residual[: n + 1].max(initial=tol))
    above.set(yscale="log", ylabel="relative residual (-)", ylim=(0.5 * floor, 30 * highest))
    middle.plot(number, iterations[:n], **dots)
    lowest.plot(number, slack[:n], **dots)
    if n < len(status):
        above.plot([n + 1], [max(residual[n], floor)], label="failed", **FAILED)
        middle.plot([n + 1], [iterations[n]], **FAILED)
    for axes, values, name in ((middle, iterations, "iterations"), (lowest, slack, "slack cables")):
        axes.set(ylabel=f"{name} (-)", ylim=(-0.08, 1.15 * max(values[: n + 1].max(), 1.0)))
        axes.yaxis.get_major_locator().set_params(integer=True, nbins=4)
    ends = np.cumsum([len(p.status) for p in paths])
    for axes in (above, middle, lowest):
        axes.grid(color=GRID, axis="y")
        for end in ends[:-1]:
            axes.axvline(end + 0.5, color="0.5", linewidth=0.8, linestyle=":")
    lowest.set(xlim=(0.5, ends[-1] + 0.5), xlabel="increment, all phases (-)")
    lowest.xaxis.get_major_locator().set_params(integer=True)
    legend_below(lowest, columns=3, handles=above.get_legend_handles_labels()[0], drop=0.55)
    figure.align_ylabels()
    _write_titles(above, titles, np.array([0.0, *ends]) + 0.5)
    return finish_figure(figure, path)


def _write_titles(axes: Axes, titles: Sequence[str], ends: np.ndarray) -> None:
    """Write the name of each phase at a line that rises where the phase begins.

    No line crosses a name: those of earlier phases are higher. `ends` are the places at which
    phases begin and end. A phase without room has no name.
    """
    to_shares, named = axes.transAxes.inverted(), []  # (place, row) of the phases that have names
    begins = (ends[:-1] - ends[0]) / (ends[-1] - ends[0])
    for title, begin in zip(titles[::-1], begins[::-1], strict=True):
        text = axes.text(begin + _GAP, 1.0, title, transform=axes.transAxes)
        end = Bbox(to_shares.transform(text.get_window_extent())).x1 + _GAP
        row = max((row + 1 for place, row in named if place < end), default=0)
        if row == _ROWS:
            text.remove()
            continue
        named.append((begin, row))
        height = 1.03 + 0.12 * row
        text.set_y(height)
        look: Any = {"color": "0.5", "linewidth": 0.8, "linestyle": ":", "clip_on": False}
        axes.plot([begin, begin], [1.0, height + 0.07], transform=axes.transAxes, **look)
