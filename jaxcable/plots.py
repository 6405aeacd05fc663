"""Pictures of results (matplotlib)."""

import jax
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from .paths.events import (
    BIFURCATION,
    LIMIT_POINT,
    MATERIAL_FAILURE,
    NAMES,
    SLACKENING,
    TIGHTENING,
)


def net(solution, path=None, magnify=1.0):
    """Draw a cable net in plan before and in space after loading, coloured by tension.

    Args:
        solution: `Solution` with status OK; "before" is the end of its first phase. Catenaries are
            drawn as their chords (`forms.catenary_curves` has their places).
        path: where to save a PNG, or None.
        magnify: factor on the displacement after the first phase, in the right picture.

    Returns:
        The matplotlib `Figure`.

    Raises:
        ValueError: the solution has failed (there is nothing to draw; see `solution.last`).
    """
    if int(solution.status) != 0:
        raise ValueError("solution: has failed; draw solution.last or call raise_if_failed")
    first, before = solution.phases[0], np.asarray(solution.phases[0].positions)
    moved = np.asarray(solution.positions) - before
    links, element = _pieces(solution.links)
    tensions = [
        np.concatenate(jax.tree.leaves(part.tension))[element] for part in (first, solution)
    ]
    low, high = min(t.min() for t in tensions), max(t.max() for t in tensions)
    if high - low <= 1e-9 * max(abs(high), 1.0):
        low, high = low - 1.0, high + 1.0
    colours = {"cmap": "viridis", "norm": plt.Normalize(low, high)}
    fixed = solution.last.fixed[-1].array[: len(before), :3].all(axis=1)

    figure = plt.figure(figsize=(12.0, 5.6), layout="constrained")
    plan, space = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="3d")
    start = np.asarray(solution.positions - solution.displacement)
    plan.add_collection(
        LineCollection(start[links][:, :, :2], colors="0.75", linewidths=1.0, linestyles="dashed")
    )
    plan.add_collection(
        LineCollection(before[links][:, :, :2], array=tensions[0], linewidths=2.5, **colours)
    )
    plan.plot(*before[~fixed, :2].T, "o", color="black", markersize=3)
    plan.plot(*before[fixed, :2].T, "s", color="black", markersize=6)
    plan.plot([], [], "--", color="0.75", label="start")
    plan.plot([], [], "s", color="black", markersize=6, label="anchor")
    plan.set_aspect("equal")
    plan.margins(0.05)
    plan.set(title="Before loading: plan after prestress", xlabel="x (m)", ylabel="y (m)")
    figure.legend(loc="outside lower left", ncols=2, frameon=False)

    after = before + magnify * moved
    grey = Line3DCollection(before[links], colors="0.75", linewidths=1.0, linestyles="dashed")
    space.add_collection3d(grey)
    lines = Line3DCollection(after[links], array=tensions[1], linewidths=2.5, **colours)
    space.add_collection3d(lines)
    space.scatter(*after[fixed].T, marker="s", color="black", s=16)
    both = np.concatenate([before, after])
    low_corner, extent = both.min(0), np.maximum(np.ptp(both, axis=0), 1e-3)
    space.set(
        xlim=(low_corner[0], low_corner[0] + extent[0]),
        ylim=(low_corner[1], low_corner[1] + extent[1]),
        zlim=(low_corner[2], low_corner[2] + extent[2]),
        xlabel="x (m)",
        ylabel="y (m)",
        zlabel="z (m)",
        title="After loading" + (f", deflection x {magnify:g}" if magnify != 1 else ""),
    )
    # equal axes, but a nearly flat net keeps a readable height
    space.set_box_aspect(np.maximum(extent, 0.15 * extent.max()), zoom=1.05)
    for axis, bins, pad in (("x", 4, 8), ("y", 4, 8), ("z", 2, 10)):
        space.locator_params(axis=axis, nbins=bins)
        getattr(space, f"{axis}axis").labelpad = pad
    figure.colorbar(lines, ax=space, label="tension (N)", shrink=0.75, pad=0.15)
    if path is not None:
        figure.savefig(path, dpi=130)
        plt.close(figure)
    return figure


_MARKS = {
    LIMIT_POINT: ("o", "C3"),
    BIFURCATION: ("D", "C1"),
    SLACKENING: ("v", "C2"),
    TIGHTENING: ("^", "C0"),
    MATERIAL_FAILURE: ("X", "black"),
}


def path(traced, node, axis="z", path=None, scale=1.0, unit=None, factor=1e3, length="mm"):
    """Draw load against displacement of a node, unstable parts dashed, events marked.

    Args:
        traced: `TracedPath`, or the `path` of a phase of a solution.
        node: whose displacement is drawn.
        axis: "x", "y" or "z"; with a minus sign before it for the opposite direction.
        path: where to save a PNG, or None.
        scale, unit: load at load factor 1 and its unit; default the load factor.
        factor, length: factor on displacements in m, and the name of that unit.

    Returns:
        The matplotlib `Figure`.

    Raises:
        ValueError: unknown node or axis, or a path without a point.
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
    figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    negative = getattr(traced, "n_negative", None)
    unstable = np.zeros(len(load), bool) if negative is None else np.asarray(negative) > 0
    # a stretch belongs to the kind of the point that it leads to
    for kind, style, label in ((False, "-", "stable"), (True, "--", "unstable")):
        shown = unstable == kind
        shown[:-1] |= shown[1:]
        if (unstable == kind).any():
            label = None if negative is None else label
            axes.plot(*_broken(moved, load, shown), style, color="C0", linewidth=1.6, label=label)
    events = getattr(traced, "events", None)
    for number in () if events is None else np.unique(np.asarray(events.kind)):
        mark, colour = _MARKS[int(number)]
        own = np.asarray(events.kind) == number
        at = sign * np.asarray(events.displacement)[own, node, "xyz".index(name)]
        heights = scale * np.asarray(events.load_factor)[own]
        axes.plot(at, heights, mark, color=colour, markersize=6, label=NAMES[int(number)])
    axes.axhline(0.0, color="0.6", linewidth=0.7)
    axes.grid(color="0.92")
    axes.set(
        xlabel=f"displacement of node {node} along {axis} ({length})",
        ylabel="load factor" if unit is None else f"load ({unit})",
    )
    if negative is not None:
        axes.legend(frameon=False)
    if path is not None:
        figure.savefig(path, dpi=130)
        plt.close(figure)
    return figure


def _broken(x, y, shown):
    """Points of a line, interrupted where they are not to be shown."""
    return np.where(shown, x, np.nan), np.where(shown, y, np.nan)


def _pieces(groups):
    """Straight pieces of all elements, node numbers [n, 2], and the number of their element [n]."""
    links, element, count = [], [], 0
    for group in groups:
        chain = group.array
        pairs = np.stack([chain[:, :-1], chain[:, 1:]], axis=2)
        own = np.arange(count, count + len(chain))[:, None] + np.zeros_like(pairs[..., 0])
        real = pairs[..., 0] != pairs[..., 1]
        links.append(pairs[real])
        element.append(own[real])
        count += len(chain)
    return np.concatenate(links), np.concatenate(element)


def section(section, stress=None, path=None, scale=1e-6, unit="N/mm2"):
    """Draw the fibres of a cross-section, coloured by stress, or else by law.

    Args:
        section: `Section` with a mesh.
        stress: of every fibre, [n_fibre], Pa, for example a row of `fibre_stress`.
        path: where to save a PNG, or None.
        scale, unit: factor on the stress and its label.

    Returns:
        The matplotlib `Figure`.

    Raises:
        ValueError: no mesh, or a stress of the wrong shape.
    """
    if section.points is None:
        raise ValueError("section: has no mesh to draw; it was made from fibres alone")
    corners = np.asarray(section.points)[section.cells.array] * 1e3
    figure, axes = plt.subplots(figsize=(5.6, 4.8), layout="constrained")
    edges = {"edgecolors": "white", "linewidths": 0.4}
    if stress is not None:
        stress = np.asarray(stress) * scale
        if stress.shape != (section.n_fibre,):
            raise ValueError(f"stress: expected shape ({section.n_fibre},), got {stress.shape}")
        largest = max(float(np.nanmax(np.abs(stress))), 1e-30)
        cells = PolyCollection(corners, array=stress, cmap="RdBu_r", **edges)
        cells.set_clim(-largest, largest)
        axes.add_collection(cells)
        figure.colorbar(cells, ax=axes, label=f"stress ({unit}), tension positive")
    else:
        number = np.repeat(np.arange(len(section.counts)), section.counts)
        colours = plt.get_cmap("viridis")(np.linspace(0.15, 0.85, max(len(section.counts), 2)))
        axes.add_collection(PolyCollection(corners, facecolors=colours[number], **edges))
        names = [f"{k + 1}: {type(law).__name__}" for k, law in enumerate(section.laws)]
        handles = [Patch(color=c, label=n) for c, n in zip(colours, names, strict=False)]
        below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.14), "ncols": 3}
        axes.legend(handles=handles, frameon=False, **below)
    axes.axhline(0.0, color="0.3", linewidth=0.7, linestyle=":")
    axes.axvline(0.0, color="0.3", linewidth=0.7, linestyle=":")
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.08)
    axes.set(xlabel="y (mm)", ylabel="z (mm)")
    if path is not None:
        figure.savefig(path, dpi=130)
        plt.close(figure)
    return figure
