"""Pictures of the steps of an optimization: `history`."""

from __future__ import annotations

import os

import numpy as np
from matplotlib.figure import Figure

from ..design.fit import Fit
from ..design.minimize import Design
from .style import FAILED, GRID, SERIES, finish_figure, legend_below, new_figure

_LOG = 30.0  # largest over smallest value from which small ones would lie on a linear axis


def history(
    design: Design | Fit, path: str | os.PathLike[str] | None = None, *, tol: float | None = None
) -> Figure:
    """Draw the steps of `minimize`, or the trial points of `fit`, with failed trials marked.

    Args:
        design: `Design`, of which loss and gradient norm of the accepted steps are drawn, and steps
            marked in which the analysis has failed; or `Fit`, of which misfit and damping of all
            trial points are drawn, accepted or not, and points where the analysis failed are marked
            at the upper edge.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        tol: tolerance of `minimize`, drawn as a line below the gradient norm; None for no line.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: no history (results of `minimize_subject_to` have none), a batch, or no finite
            value.

    >>> import jax.numpy as jnp
    >>> import jaxcable as jc
    >>> found = jc.minimize(lambda x: jnp.sum((x - 3.0) ** 2), jnp.zeros(2))
    >>> figure = jc.plots.history(found)
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['loss', 'gradient norm (-)']
    """
    record = getattr(design, "history", None)
    if record is None:
        raise ValueError(
            f"design: a {type(design).__name__} has no history; expected a Design or a Fit"
        )
    if np.ndim(design.status) != 0:
        raise ValueError("design: is a batch; draw one, jax.tree.map(lambda a: a[k], design)")
    figure = new_figure(4.8, 4.6)
    upper, lower = figure.subplots(2, 1, sharex=True)
    (_draw_fit_trials if hasattr(record, "misfit") else _draw_minimize_steps)(
        record, int(design.steps), upper, lower
    )
    if tol is not None:
        lower.axhline(tol, color="black", linestyle="--", linewidth=1.0, label=f"tol = {tol:.1g}")
    for axes in (upper, lower):
        axes.grid(color=GRID)
    lower.xaxis.get_major_locator().set_params(integer=True)
    handles = upper.get_legend_handles_labels()[0] + lower.get_legend_handles_labels()[0]
    legend_below(lower, columns=3, handles=handles, drop=0.55)
    figure.align_ylabels()
    return finish_figure(figure, path)


def _draw_minimize_steps(record, n, upper, lower):
    """Draw the history of a `Design`: loss above, gradient norm below, failed trials marked.

    `record` is the history of `n` steps; `upper` and `lower` are axes. Raise ValueError without a
    finite loss.
    """
    loss, norm, failures = (
        np.asarray(values, float)[: n + 1]
        for values in (record.loss, record.gradient_norm, record.failures)
    )
    if not np.isfinite(loss).any():
        raise ValueError("design: not one finite loss in its history; look at history.status")
    number = np.arange(n + 1)
    _draw_line_with_dots(upper, number, loss, "accepted step")
    _draw_line_with_dots(lower, number, norm, None)
    marked = (failures > 0) & np.isfinite(loss)
    if marked.any():
        label = f"failed trials ({int(failures[failures > 0].sum())})"
        upper.plot(number[marked], loss[marked], label=label, **FAILED)
    upper.set_ylabel("loss")
    lower.set(ylabel="gradient norm (-)", xlabel="step (-)")


def _draw_fit_trials(record, n, upper, lower):
    """Draw the history of a `Fit`: misfit of trial points above, damping below.

    Trials that are not accepted or have failed are marked. `record` is the history of `n` trials.
    """
    misfit, damping = (np.asarray(v, float)[: n + 1] for v in (record.misfit, record.damping))
    accepted = np.asarray(record.accepted)[: n + 1] > 0
    finite = np.isfinite(misfit)
    if not finite.any():
        raise ValueError("design: not one finite misfit in its history; look at history.status")
    accepted[0] |= finite[0]  # the start
    number = np.arange(n + 1)
    _draw_line_with_dots(upper, number, np.where(accepted, misfit, np.nan), "accepted trial")
    refused = ~accepted & finite
    if refused.any():
        open_dots = {"linestyle": "", "marker": "o", "markerfacecolor": "white", "markersize": 5}
        upper.plot(number[refused], misfit[refused], color="0.4", label="not accepted", **open_dots)
    if (~finite).any():
        edge = {"transform": upper.get_xaxis_transform(), "clip_on": False}
        upper.plot(
            number[~finite], np.ones((~finite).sum()), label="failed trial", **FAILED, **edge
        )
    _draw_line_with_dots(lower, number, damping, None)
    upper.set_ylabel("misfit")
    lower.set(ylabel="damping", xlabel="trial (-)")


def _draw_line_with_dots(axes, number, values, label):
    """Draw a line with dots through finite values; on a logarithmic axis if their range is wide.

    `number` are the abscissas, and `label` is the text for the legend, None for none.
    """
    real = np.isfinite(values)
    values, number = values[real], number[real]
    look = {"color": SERIES[0], "marker": "o", "linewidth": 1.3}
    look["markersize"] = float(np.clip(120.0 / max(len(values), 1), 1.5, 3.5))
    axes.plot(number, values, label=label, **look)
    if len(values) and values.min() > 0 and values.max() > _LOG * values.min():
        axes.set_yscale("log")
