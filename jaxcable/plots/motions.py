"""Pictures of a motion in time: `motion`."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ..dynamics.response import Transient
from .style import GRID, display_unit, finish_figure, new_figure, series_style

_ENERGIES = ("kinetic", "stored", "work", "dissipated", "error")


def motion(
    moved: Transient,
    path: str | os.PathLike[str] | None = None,
    *,
    nodes: Sequence[int] = (0,),
    direction: str = "z",
    elements: Sequence[int] = (),
    group: str | int | None = None,
) -> Figure:
    """Draw a motion in time: displacements of nodes, forces of elements, and the energy.

    Args:
        moved: `dynamics.Transient`.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        nodes: which of the nodes of the histories are drawn, indices.
        direction: of the displacement, "x", "y" or "z".
        elements: elements whose axial force is drawn, indices.
        group: their group, by its key or number; None if there is one group.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: an unknown direction, a history that the motion does not have, a batch.

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
    rows = 1 + bool(len(elements)) + 1
    figure = new_figure(4.8, 1.0 + 1.7 * rows)
    panels = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    values = np.asarray(moved.displacement)[:, list(nodes), "xyz".index(direction)]
    _draw_lines(panels[0], time, values, [f"node {k}" for k in nodes])
    panels[0].set_ylabel(f"displacement {direction} (m)")
    if len(elements):
        force = moved.tension if group is None else moved.tension[group]
        force = np.asarray(force)[:, list(elements)]
        factor, unit = display_unit(float(np.nanmax(np.abs(force), initial=0.0)), "N")
        _draw_lines(panels[1], time, factor * force, [f"element {k}" for k in elements])
        panels[1].set_ylabel(f"axial force ({unit})")
    energies = np.stack([np.asarray(getattr(moved.energy, name)) for name in _ENERGIES], axis=1)
    shown = [k for k, own in enumerate(energies.T) if np.nanmax(np.abs(own), initial=0.0) > 0]
    _draw_lines(panels[-1], time, energies[:, shown], [_ENERGIES[k] for k in shown])
    panels[-1].set(ylabel="energy (J)", xlabel="time (s)")
    figure.align_ylabels()
    return finish_figure(figure, path)


def _draw_lines(axes, time, values, labels):
    """Draw lines over time, values [n_time, n], with a legend beside the axes."""
    for k, (line, label) in enumerate(zip(values.T, labels, strict=True)):
        look = series_style(k) | {"marker": "", "linewidth": 1.2}
        axes.plot(time, line, label=label, **look)
    axes.grid(color=GRID)
    axes.margins(x=0)
    if len(labels) > 1:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
