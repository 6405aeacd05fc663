"""Pictures of the fibres of a cross-section: `section`."""

from __future__ import annotations

import os
from typing import Any

import matplotlib
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..common.types import ArrayLike, Float
from ..common.units import UnitsLike, as_units
from ..sections import LinearSection, Section
from .style import display_unit, finish_figure, legend_below, new_figure


def section(
    section: Section,
    stress: Float[ArrayLike, " n_fibre"] | None = None,
    path: str | os.PathLike[str] | None = None,
    *,
    scale: float = 1e-6,
    unit: str = "N/mm2",
    units: UnitsLike | None = None,
) -> Figure:
    """Draw the fibres of a cross-section, colored by stress, or by law if no stress is given.

    Args:
        section: `Section` with a mesh.
        stress: stress of every fibre, [n_fibre], Pa, for example from `fibre_stress`.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        scale, unit: factor on the stress, and the name of the resulting unit.
        units: units of the picture instead, such as "kip, ft" (see `files.Units`): coordinates are
            then in mm or in, and stresses in MPa, kip/in2, lbf/in2 or kgf/cm2.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: no mesh or no fibres, or a stress of the wrong shape; unknown units.

    >>> import jaxcable as jc
    >>> disc = jc.Section.disc(0.05, jc.Elastic(210e9), (4, 8))
    >>> figure = jc.plots.section(disc, disc.fibre_stress(1e-4, 2e-3, 0.0))
    >>> figure.axes[1].get_ylabel()
    'stress (N/mm2), tension positive'
    """
    if isinstance(section, LinearSection):
        raise ValueError("section: is given by its stiffnesses; it has no fibres to draw")
    if section.points is None:
        raise ValueError("section: has no mesh to draw; it was made from fibres alone")
    size, length = 1e3, "mm"
    if units is not None:
        shown = as_units(units)
        scale, unit = display_unit(0.0, "Pa", shown)
        length, to_small = shown.small_length
        size = shown.from_si(float(to_small), "m")
    corners: Any = np.asarray(section.points)[section.cells.array] * size
    figure = new_figure(4.8, 4.2)
    axes = figure.add_subplot()
    edges: dict[str, Any] = {"edgecolors": "white", "linewidths": 0.4}
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
        colors = matplotlib.colormaps["viridis"](
            np.linspace(0.15, 0.85, max(len(section.counts), 2))
        )
        axes.add_collection(PolyCollection(corners, facecolors=colors[number], **edges))
        names = [f"{k + 1}: {type(law).__name__}" for k, law in enumerate(section.laws)]
        handles = [Patch(color=c, label=n) for c, n in zip(colors, names, strict=False)]
        legend_below(axes, columns=3, handles=handles)
    axes.axhline(0.0, color="0.3", linewidth=0.7, linestyle=":")
    axes.axvline(0.0, color="0.3", linewidth=0.7, linestyle=":")
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.08)
    axes.set(xlabel=f"y ({length})", ylabel=f"z ({length})")
    return finish_figure(figure, path)
