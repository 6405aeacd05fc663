"""Profiles of lines: station and elevation of ground, towers and conductors, as DXF and picture."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..elements import Bars, SlidingCables
from ..files import save_dxf
from ..model.structure import Structure
from ..model.supports import pinned
from .line_analysis import LineResults
from .line_section import LineSection

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def profile_lines(section: LineSection, results: LineResults) -> dict[str, list[np.ndarray]]:
    """Return the profile of a line as polylines of station and elevation, [n, 2], m, by layer.

    Layers are "ground", "towers", "strings" and the names of the states.

    Args:
        section: `LineSection`.
        results: its `LineResults`.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> found = jc.lines.analyse(section, strung, {"hot": jc.lines.LineState(75.0)})
        >>> print(list(jc.lines.profile_lines(section, found)))
        ['ground', 'towers', 'hot']
    """
    own, station = section.layout, np.asarray(section.station)
    base = np.asarray(section.ground, float)
    top = base + np.asarray(section.height, float)
    profile = section.profile if section.profile is not None else np.stack([station, base], axis=1)
    found = {
        "ground": [np.asarray(profile)],
        "towers": [np.array([[s, a], [s, b]]) for s, a, b in zip(station, base, top, strict=True)],
    }
    place, along = np.asarray(section.in_plan(station)), np.asarray(section.directions())
    bisectors = np.asarray(section.bisectors())

    def unfolded(points, tower, axis):
        """Return points in space along an axis from a tower as station and elevation, [n, 2]."""
        moved = station[tower] + (points[:, :2] - place[tower]) @ axis
        return np.stack([moved, points[:, 2]], axis=1)

    for ends in own.strings:
        tower, points = own.towers[ends[0]], np.asarray(results.positions)[0, ends]
        found.setdefault("strings", []).append(unfolded(points, tower, bisectors[tower]))
    for name, curves in zip(results.names, np.asarray(results.curves), strict=True):
        lines = [unfolded(points, k, along[k]) for k, points in enumerate(curves)]
        found[name] = [line for line in lines if np.isfinite(line).all()]
    return found


def save_profile(
    path: str | PathLike[str],
    section: LineSection,
    results: LineResults,
    *,
    heights: float = 1.0,
) -> Path:
    """Write the profile of a line with its sags as a drawing: station and elevation, m, in DXF.

    Layers are those of `profile_lines`: ground, towers, strings (of the first state), the states,
    with a polyline for the ground and for each span.

    Args:
        path: path of the file, ending with .dxf.
        section: `LineSection`.
        results: its `LineResults`.

    Options:
        heights: factor on elevations.

    Returns:
        The path.

    Raises:
        ValueError: another suffix; ezdxf is not installed. OSError: the file cannot be written.

    Example:
        >>> import pathlib, tempfile
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> found = jc.lines.analyse(section, strung, {"hot": jc.lines.LineState(75.0)})
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "profile.dxf"
        >>> print(jc.lines.save_profile(path, section, found, heights=5.0).name)
        profile.dxf
    """
    numbers: dict[tuple[float, float], int] = {}  # of nodes by place: lines share their ends
    elements: dict[str, Any] = {}
    for name, lines in profile_lines(section, results).items():
        places = [[(round(float(s), 6), round(heights * float(z), 6)) for s, z in x] for x in lines]
        own = [[numbers.setdefault(place, len(numbers)) for place in line] for line in places]
        if own:
            kind = Bars if name == "towers" else SlidingCables  # which are drawn as polylines
            elements[name] = kind(own, axial_stiffness=1.0)
    nodes = [[s, z, 0.0] for s, z in numbers]
    drawing = Structure(nodes, elements, pinned(range(len(nodes))))
    return save_dxf(path, drawing, node_points=False)[0]


def plot_profile(
    section: LineSection, results: LineResults, path: str | PathLike[str] | None = None
) -> Figure:
    """Draw the profile of a line: ground, towers and the conductor in every state.

    Args:
        section: `LineSection`.
        results: its `LineResults`.
        path: where to save the picture, in the format of the suffix, or None.

    Returns:
        The matplotlib figure.

    Example:
        >>> drake = jc.catalogue.conductor("Drake")
        >>> section = jc.lines.LineSection(drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post")
        >>> strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        >>> found = jc.lines.analyse(section, strung, {"hot": jc.lines.LineState(75.0)})
        >>> figure = jc.lines.plot_profile(section, found)
        >>> print(figure.axes[0].get_xlabel())
        station, m
    """
    from ..plots import style  # slow to import: matplotlib

    figure = style.new_figure(9.0, 4.4)
    axes, count, lines = figure.add_subplot(), 0, profile_lines(section, results)
    for layer, own in lines.items():
        gray = {"ground": "0.55", "towers": "0.25", "strings": "0.25"}.get(layer)
        look: dict[str, Any] = {"color": gray or style.SERIES[count % len(style.SERIES)]}
        look["linewidth"] = 2.0 if layer == "towers" else 1.2
        count += gray is None
        for k, points in enumerate(own):
            axes.plot(*points.T, label=layer if k == 0 and gray is None else None, **look)
    above: dict[str, Any] = {"xytext": (0, 3), "textcoords": "offset points", "ha": "center"}
    for name, (_, top) in zip(section.names, lines["towers"], strict=True):
        axes.annotate(name, top, **above)
    axes.margins(y=0.12)
    axes.set_xlabel("station, m")
    axes.set_ylabel("elevation, m (magnified)")
    figure.legend(loc="outside lower center", ncols=4, **style.LEGEND)
    return style.finish_figure(figure, path)
