"""Pictures of a motion in time: `motion`."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ..common import checks
from ..dynamics.response import Transient
from .style import GRID, display_unit, finish_figure, new_figure, series_style

_ENERGIES = ("kinetic", "stored", "work", "dissipated", "error")


def motion(
    moved: Transient,
    path: str | os.PathLike[str] | None = None,
    *,
    nodes: Sequence[int] | None = None,
    direction: str = "z",
    elements: Sequence[int] | None = None,
    group: str | int | None = None,
) -> Figure:
    """Draw a motion in time: displacements of nodes, forces of elements, and the energy.

    Displacements are from the start of the motion, and so is the change of the stored energy, which
    would hide the others beside that of a prestress.

    Args:
        moved: `dynamics.Transient`.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        nodes: nodes that are drawn, of those whose histories are kept; default: the first of these.
        direction: of the displacement, "x", "y" or "z".
        elements: elements whose axial force is drawn, indices; None: of none.
        group: their group, by its key or number; None if there is one group.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: an unknown direction, node, element or group; a history that the motion does not
            have; a batch.

    >>> import numpy as np
    >>> import jaxcable as jc
    >>> bar = jc.Bars([[0, 1]], axial_stiffness=8e3)
    >>> guide = jc.pinned([0]) + jc.restrained([1], "yz")
    >>> structure = jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], bar, supports=guide)
    >>> load = jc.NodalLoads([1], (16.0, 0, 0))
    >>> moved = jc.dynamics.transient(structure, load, dt=2e-3, steps=100, masses=2.0)
    >>> figure = jc.plots.motion(moved, nodes=[1], direction="x", elements=[0])
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['displacement x (m)', 'axial force (N)', 'energy (J)']
    """
    if direction not in ("x", "y", "z"):
        raise ValueError(f'direction = {direction!r}: expected "x", "y" or "z"')
    if np.ndim(moved.status) != 0:
        raise ValueError("moved: is a batch; draw one, jax.tree.map(lambda a: a[k], moved)")
    time = np.asarray(moved.time)
    elements = () if elements is None else elements
    rows = 1 + bool(len(elements)) + 1
    figure = new_figure(4.8, 1.0 + 1.7 * rows)
    panels = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    values = np.asarray(moved.displacement)
    nodes, columns = _chosen_nodes(moved, nodes, values.shape[1])
    values = values[:, columns, "xyz".index(direction)]
    since = "\nsince the start" if values[0].any() else ""
    values = values - values[:1]
    _draw_lines(panels[0], time, values, [f"node {k}" for k in nodes])
    panels[0].set_ylabel(f"displacement {direction}{since} (m)")
    if len(elements):
        force = _forces_of_group(moved, group)
        numbers = checks.as_indices(elements, "elements", things="element")
        if (numbers >= force.shape[1]).any():
            raise ValueError(
                f"elements: {max(numbers)} is unknown; there are 0 to {force.shape[1] - 1}"
            )
        force = force[:, numbers]
        factor, unit = display_unit(float(np.nanmax(np.abs(force), initial=0.0)), "N")
        _draw_lines(panels[1], time, factor * force, [f"element {k}" for k in elements])
        panels[1].set_ylabel(f"axial force ({unit})")
    energies = np.stack([np.asarray(getattr(moved.energy, name)) for name in _ENERGIES], axis=1)
    energies[:, _ENERGIES.index("stored")] -= energies[0, _ENERGIES.index("stored")]
    shown = [k for k, own in enumerate(energies.T) if np.nanmax(np.abs(own), initial=0.0) > 0]
    labels = ["change of stored" if one == "stored" else one for one in _ENERGIES]
    _draw_lines(panels[-1], time, energies[:, shown], [labels[k] for k in shown])
    panels[-1].set(ylabel="energy (J)", xlabel="time (s)")
    figure.align_ylabels()
    return finish_figure(figure, path)


def _chosen_nodes(moved, nodes, count):
    """Return numbers of nodes, and their places in the histories; ValueError for unknown ones."""
    kept = np.arange(count) if moved.nodes is None else moved.nodes.array
    numbers = kept[:1] if nodes is None else checks.as_indices(nodes, "nodes")
    places = []
    for k, node in enumerate(numbers):
        found = np.flatnonzero(kept == node)
        if not len(found):
            shown = f"0 to {count - 1}" if moved.nodes is None else ", ".join(map(str, kept))
            raise ValueError(f"nodes[{k}] = {node}: the motion has the histories of nodes {shown}")
        places.append(int(found[0]))
    return numbers, places


def _forces_of_group(moved, group):
    """Return the axial forces of one group in time, [n_time, n_elem], N."""
    force = moved.tension
    if isinstance(force, dict | list | tuple):
        keys = [*force] if isinstance(force, dict) else [*range(len(force))]
        if group is None or group not in keys:
            names = ", ".join(map(repr, keys))
            raise ValueError(
                f"group = {group!r}: elements are numbered within their group; give one of {names}"
            )
        force = force[group]
    elif group is not None:
        raise ValueError(f"group = {group!r}: the structure has one group without a key")
    if force is None:
        raise ValueError(f"group = {group!r}: its elements have no axial force")
    return np.asarray(force)


def _draw_lines(axes, time, values, labels):
    """Draw lines over time, values [n_time, n], with a legend beside the axes."""
    for k, (line, label) in enumerate(zip(values.T, labels, strict=True)):
        look = series_style(k) | {"marker": "", "linewidth": 1.2}
        axes.plot(time, line, label=label, **look)
    axes.grid(color=GRID)
    axes.margins(x=0)
    if len(labels) > 1:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
