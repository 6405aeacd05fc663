"""Pictures of errors against size and against time: `convergence`, `work_precision`."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ..common.types import ArrayLike, Float
from .style import GRID, finish_figure, legend_below, new_figure, series_style

_LIMIT_RATIO = 2.0  # of the limits of axes to the extreme values: room for marks at the edges
_DECADES = 60.0  # range of values below which powers of ten alone are too few ticks
_OPEN = {"markerfacecolor": "white"}
_EDGE = 0.03  # distance of marks at the edge from it, over the size of the axes


def convergence(
    sizes: Float[ArrayLike, " n"] | dict[str, Float[ArrayLike, " n"]],
    errors: Float[ArrayLike, " n"] | dict[str, Float[ArrayLike, " n"]],
    path: str | os.PathLike[str] | None = None,
    *,
    counts: bool = False,
    floor: float = 0.0,
    xlabel: str | None = None,
    ylabel: str = "error (-)",
) -> Figure:
    """Draw errors against element size or number of elements, with the fitted orders.

    Args:
        sizes: step sizes or element sizes, [n], or for several series a dict of such arrays.
        errors: errors [n], or a dict from labels to such arrays; errors that are not finite are
            marked as failed at the upper edge, zeros at the lower one.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        counts: whether sizes are numbers of elements, with which errors fall.
        floor: errors up to `floor` are rounding: drawn with open marks, and not fitted.
        xlabel, ylabel: labels of the axes, with units.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`. Orders are slopes
        by least squares in logarithms.

    Raises:
        ValueError: shapes or labels that do not match, sizes that are not positive, negative
            errors.

    >>> import jaxcable as jc
    >>> figure = jc.plots.convergence([0.1, 0.05, 0.025], {"secant": [0.4, 0.2, 0.1]})
    >>> figure.axes[0].get_legend().get_texts()[0].get_text()
    'secant: order 1.00'
    """
    series = _validated_series(sizes, errors, "sizes", "errors")
    if xlabel is None:
        xlabel = "number of elements (-)" if counts else "step (-)"
    figure, axes = _add_log_axes(series, xlabel, ylabel)
    for k, (label, (size, error)) in enumerate(series.items()):
        if not (np.isfinite(size) & (size > 0)).all():
            raise ValueError(f"sizes{_format_label(label)}: must be positive and finite")
        style = series_style(k)
        real = np.isfinite(error) & (error > 0)
        fitted = real & (error > floor)
        name = [] if label is None else [label]
        if len(np.unique(size[fitted])) > 1:
            slope = np.polyfit(np.log(size[fitted]), np.log(error[fitted]), 1)[0]
            name.append(f"order {-slope if counts else slope:.2f}")
        order = np.flatnonzero(real)[np.argsort(size[real], kind="stable")]
        marked = np.flatnonzero(fitted[order]).tolist()
        axes.plot(size[order], error[order], label=": ".join(name), markevery=marked, **style)
        rounding = real & ~fitted
        axes.plot(size[rounding], error[rounding], **style | {"linestyle": ""} | _OPEN)
    marks = _mark_failures_and_zeros(axes, series)
    if any((e[np.isfinite(e)] <= floor).any() for _, e in series.values()) and floor > 0:
        look: dict[str, Any] = {"marker": "o", "color": "0.3", "markersize": 5, **_OPEN}
        marks.append(Line2D([], [], linestyle="", label="rounding", **look))
    legend_below(axes, columns=2, handles=[*axes.get_legend_handles_labels()[0], *marks])
    return finish_figure(figure, path)


def work_precision(
    times: Float[ArrayLike, " n"] | dict[str, Float[ArrayLike, " n"]],
    errors: Float[ArrayLike, " n"] | dict[str, Float[ArrayLike, " n"]],
    path: str | os.PathLike[str] | None = None,
    *,
    xlabel: str = "time (s)",
    ylabel: str = "relative error (-)",
) -> Figure:
    """Draw errors against computing time, with failed runs at the edge.

    Args:
        times: times [n], or for several series a dict of such arrays.
        errors: errors [n], or a dict from labels to such arrays. A run whose error is not finite
            has failed: its mark is at the upper edge (also at the right one if the time is not
            finite). The mark of an error of zero is at the lower edge.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        xlabel, ylabel: labels of the axes, with units.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: shapes or labels that do not match, times that are not positive, negative
            errors.

    >>> import jaxcable as jc
    >>> errors = {"Newton": [1e-9, 1e-12], "secant": [1e-3, float("nan")]}
    >>> figure = jc.plots.work_precision([0.002, 0.003], errors)
    >>> [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    ['Newton', 'secant', 'failed']
    """
    series = _validated_series(times, errors, "times", "errors")
    figure, axes = _add_log_axes(series, xlabel, ylabel)
    for k, (label, (time, error)) in enumerate(series.items()):
        if (time <= 0).any():
            raise ValueError(f"times{_format_label(label)}: must be positive")
        real = np.isfinite(time) & np.isfinite(error) & (error > 0)
        order = np.argsort(time[real], kind="stable")
        axes.plot(time[real][order], error[real][order], label=label, **series_style(k))
    marks = _mark_failures_and_zeros(axes, series)
    named = [h for h in axes.get_legend_handles_labels()[0] if h.get_label() != "None"]
    legend_below(axes, columns=3, handles=[*named, *marks])
    return finish_figure(figure, path)


def _validated_series(places, values, first, second):
    """Return series of points for plots as a dict from label to two arrays [n]: abscissas, values.

    A single series has the label None. Raise ValueError for shapes or labels that do not match, and
    for negative values; `first` and `second` name the arguments.
    """
    values = values if isinstance(values, dict) else {None: values}
    if not values:
        raise ValueError(f"{second}: expected at least one series")
    if isinstance(places, dict) and set(places) != set(values):
        raise ValueError(f"{first}: expected the labels {list(values)}, got {list(places)}")
    series = {}
    for label, value in values.items():
        place = places[label] if isinstance(places, dict) else places
        place, value = np.asarray(place, float), np.asarray(value, float)
        if place.ndim != 1 or len(place) == 0:
            raise ValueError(
                f"{first}{_format_label(label)}: expected shape [n], got {place.shape}"
            )
        if value.shape != place.shape:
            raise ValueError(
                f"{second}{_format_label(label)}: expected shape {place.shape}, got {value.shape}"
            )
        if (value < 0).any():
            raise ValueError(f"{second}{_format_label(label)}: must not be negative")
        series[label] = place, value
    return series


def _format_label(label):
    """Return the label of a series as "['label']", for messages; empty for a single series."""
    return "" if label is None else f"[{label!r}]"


def _add_log_axes(series, xlabel, ylabel):
    """Return a new figure and its logarithmic axes, whose limits include all positive values.

    `series` is from `_validated_series`.
    """
    figure = new_figure(4.8, 4.0)
    axes = figure.add_subplot()
    axes.set(xscale="log", yscale="log", xlabel=xlabel, ylabel=ylabel)
    for k, name in enumerate("xy"):
        seen = np.concatenate([pair[k] for pair in series.values()])
        seen = seen[np.isfinite(seen) & (seen > 0)]
        if len(seen):
            axes.set(**{f"{name}lim": (seen.min() / _LIMIT_RATIO, seen.max() * _LIMIT_RATIO)})
            axis = getattr(axes, f"{name}axis")
            axis.set_minor_formatter(NullFormatter())
            if seen.max() < _DECADES * seen.min():
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.grid(color=GRID)
    return figure, axes


def _mark_failures_and_zeros(axes, series):
    """Mark failed runs at the upper edge of the axes, and zero errors at the lower one.

    `series` is from `_validated_series`. Return legend entries for these marks, a list.
    """
    grey = {"linestyle": "", "color": "0.3", "markersize": 7, "markeredgewidth": 1.6}
    cross = {"marker": "x", "color": "black"}
    keys = {}
    for k, (place, value) in enumerate(series.values()):
        exact = (value == 0) & np.isfinite(place)
        failed = ~np.isfinite(value) | ~np.isfinite(place)
        x, y = _fraction_of_axis(axes.get_xlim(), place), _fraction_of_axis(axes.get_ylim(), value)
        y = np.where(exact, _EDGE, y)
        look = {**series_style(k), "linestyle": "", "markersize": 7, "zorder": 5}
        look |= {"transform": axes.transAxes, "markeredgewidth": 1.6}
        marked = failed | exact
        axes.plot(x[marked], y[marked], **look, **_OPEN)
        dot = cross | {"linestyle": "", "markersize": 4, "zorder": 6, "transform": axes.transAxes}
        axes.plot(x[failed], y[failed], **dot)
        if failed.any():
            keys["failed"] = grey | cross
        if exact.any():
            keys["zero error"] = {"marker": "o"} | grey | _OPEN
    return [Line2D([], [], label=name, **keys[name]) for name in sorted(keys)]


def _fraction_of_axis(limits, values):
    """Return where values lie on a logarithmic axis with these limits, from 0 to 1.

    Numbers that are not finite, and zeros, are put at the upper edge.
    """
    low, high = np.log(limits)
    known = np.isfinite(values) & (values > 0)
    return np.where(known, (np.log(np.where(known, values, 1.0)) - low) / (high - low), 1 - _EDGE)
