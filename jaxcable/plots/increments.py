"""Pictures of the convergence of an analysis, increment by increment: `increments`."""

from __future__ import annotations

import os

import numpy as np
from matplotlib.figure import Figure

from ..analysis.solution import Solution
from ..equilibrium.convergence import default_tolerance
from .snapshots import require_one_solution
from .style import FAILED, GRID, SERIES, finish_figure, legend_below, new_figure

_NAME = 0.17  # width of the name of a phase over that of the axes


def increments(
    solution: Solution, path: str | os.PathLike[str] | None = None, *, tol: float | None = None
) -> Figure:
    """Draw residual, Newton iterations and slack cables of every increment of all phases.

    Args:
        solution: `Solution`, failed or not; of a failed analysis the increment that failed is
            marked, and later increments are not drawn.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        tol: tolerance of the method, drawn as a line; default: that of `Newton()`. (`Incremental`
            has another measure: its residuals may be above the line.)

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: a batch, or a tol that is not positive.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> figure = jc.plots.increments(jc.solve(*jc.scenes.flat_net()))
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['relative residual (-)', 'iterations (-)', 'slack cables (-)']
    """
    require_one_solution(solution)
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
    # names of phases in two lines: where the last name of each line is
    lines = [-1.0, -1.0]
    for k, (begin, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        share = 0.5 * (begin + end) / ends[-1]
        # the first line with room; a phase without room has no name
        line = next((r for r in range(2) if share - lines[r] > _NAME), None)
        if line is not None:
            lines[line] = share
            look = {"transform": above.transAxes, "ha": "center"}
            above.text(share, 1.03 + 0.12 * line, f"phase {k + 1}", **look)
    lowest.set(xlim=(0.5, ends[-1] + 0.5), xlabel="increment, all phases (-)")
    lowest.xaxis.get_major_locator().set_params(integer=True)
    legend_below(lowest, columns=3, handles=above.get_legend_handles_labels()[0], drop=0.55)
    figure.align_ylabels()
    return finish_figure(figure, path)
