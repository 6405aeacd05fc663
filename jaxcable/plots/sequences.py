"""Pictures of all phases beside each other, as of stages of a construction: `sequence`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..analysis.solution import Solution
from ..common import checks
from ..common.units import SI, Units, UnitsLike, as_units
from ..model.structure import Structure
from .diagrams import ForceDiagrams
from .element_lines import ColorScale, ElementLines, draw_earlier_geometry, line_legend
from .layout import arrange_pictures, finish_layout
from .nets import StagePicture
from .ordinates import keep_texts_inside
from .snapshots import Snapshots
from .style import SERIES, finish_figure
from .symbols import draw_supports, support_legend
from .views import choose_view

# pictures are small here: longer diagrams than alone, with fewer numbers, farther apart
_HIGH = 0.15  # length of the largest value of a diagram over the extent of the structure
_LABELS = 3  # values that are written in a picture
_APART = 0.4  # their distance over the extent of the structure
_LEAST = 0.1  # of the largest value of all: less is not written
_WIDE = 0.7  # height over width up to which pictures stand in two columns; in three if higher


def sequence(
    solution: Solution,
    path: str | os.PathLike[str] | None = None,
    magnify: float = 1.0,
    *,
    color: str = "tension",
    one_scale: bool = False,
    diagram: str | None = None,
    high: float = _HIGH,
    structure: Structure | None = None,
    view: str | None = None,
    names: Sequence[str] | None = None,
    columns: int | None = None,
    supports: bool = True,
    units: UnitsLike | None = None,
) -> Figure:
    """Draw the end of each phase: one small picture each, in the same scales and colors.

    Only active elements are drawn. Behind them, thin and dashed, is the end of the phase
    before, with the elements that are in both. With a `structure`, catenaries hang and beams are
    bent, as in `net`; catenaries are not drawn as they were before the first phase, because this is
    not known.

    Args:
        solution: `Solution`; of a failed analysis the phases that have converged are drawn.
        path: where to save the picture, in the format of the suffix, or None.
        magnify: factor on the displacement from the initial geometry, and on the bending of beams.
            The sag of catenaries is not magnified, because their initial shape is not known.
            After another analysis (`solve` with `start`) the initial geometry is that at its end;
            with beams it is always that of the input, as rotations are known from there only.

    Options:
        color, one_scale, structure: as of `net`.
        diagram: "N", "Vy", "Vz", "T", "My" or "Mz": draw this section force on the beams instead of
            colors, as `diagram` does, in one scale for all phases.
        high: length of the largest value of a `diagram` over the extent of the structure.
        view: "plan", "elevation" or "space"; default elevation of a structure that lies in a
            vertical plane or is higher than half its width, else plan.
        names: titles, one for each phase; default "phase 1", "phase 2" and so on.
        columns: number of pictures in a row; default two, or three of high structures.
        supports: whether to mark supports.
        units: units of coordinates and values, as of `net`.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: no phase has converged, another number of names than of phases, no positive
            number of columns, or those of `net`.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> structure, phases = jc.scenes.flat_net()
    >>> figure = jc.plots.sequence(jc.solve(structure, phases), names=["prestress", "loads"])
    >>> [axes.get_title() for axes in figure.axes[:2]]
    ['prestress', 'loads']
    """
    stated = None if units is None else as_units(units)
    snapshots = Snapshots(solution, structure, color, names)
    stages = _stages_of_phases(snapshots, magnify)
    notes = [f"displacements x {magnify:g}"] if magnify != 1.0 else []
    options = diagram, one_scale, view, columns, supports, notes, stated
    figure = draw_stages(stages, snapshots, *options, high=high)
    return finish_figure(figure, path)


def draw_stages(
    stages: Sequence[StagePicture],
    snapshots: Snapshots,
    diagram: str | None,
    one_scale: bool,
    view: str | None,
    columns: int | None,
    supports: bool,
    notes: Sequence[str],
    units: Units | None,
    earlier: str = "before",
    high: float = _HIGH,
    colored: bool = True,
) -> Figure:
    """Draw small pictures beside each other, in the same scales and colors; return the figure.

    Args:
        stages: `StagePicture` of each.
        snapshots: `Snapshots` of the solution.
        diagram, high: as of `sequence`.
        one_scale, view, columns, supports: as of `sequence`.
        notes: lines of text for the legend.
        units: of coordinates and values, or None.
        earlier: what the geometry behind them is called.
        colored: whether elements have the colors of their forces, rather than one color.
    """
    everything = np.concatenate([stage.points() for stage in stages])
    seen = choose_view(everything, view, units=units or SI)
    how = _ColoredElementPictures if colored else _PlainElementPictures
    content: Any = how(stages, snapshots, seen, units, one_scale, earlier)
    if diagram is not None:
        instants = [stage.now for stage in stages]
        content = ForceDiagrams(
            snapshots, instants, diagram, high, seen, _LABELS, _APART, _LEAST, units
        )
        everything = np.concatenate([everything, content.points()])
    if columns is None:
        columns = 2 if seen.height_over_width(everything) < _WIDE else 3
    checks.require_whole_number(columns, "columns")
    count = len(stages)
    columns = min(columns, count)
    titles = [stage.title for stage in stages]
    figure, slots = arrange_pictures([seen] * count, [everything] * count, titles, columns)
    held = [stage.now.support_kinds(seen.normal) for stage in stages]
    for number, (stage, axes) in enumerate(zip(stages, figure.axes, strict=True)):
        if seen.flat and number % columns:  # numbers at the left and below only
            axes.set(ylabel="", yticklabels=[])
        if seen.flat and number + columns < count:
            axes.set(xlabel="", xticklabels=[])
        content.draw(axes, number)
        if supports:
            draw_supports(axes, seen, stage.now.positions, held[number])
    handles = content.legend_entries()
    if supports:
        handles += support_legend(np.any(held, axis=0))
    handles += [Line2D([], [], linestyle="", label=note) for note in notes]
    bar = content.color_bar() if diagram is None else None
    finish_layout(figure, slots, handles, bar, columns if seen.flat else None)
    for axes in figure.axes[:count]:
        keep_texts_inside(axes)
    return figure


def _stages_of_phases(snapshots, magnify):
    """Return a `StagePicture` of the end of each phase that has converged, a list.

    `magnify` is the factor on displacements from the initial geometry.
    """
    stages: list[StagePicture] = []
    for k, phase in enumerate(snapshots.solution.phases):
        if int(phase.status) != 0:
            break
        end = snapshots.after_phase(k)
        now = end.magnified(end.in_initial_geometry(), magnify)
        before = stages[-1].now if stages else now.in_initial_geometry()
        stages.append(StagePicture(snapshots.titles[k], now, before))
    if not stages:
        raise ValueError("solution: no phase has converged; see raise_if_failed")
    return stages


class _ColoredElementPictures:
    """The pictures of a sequence with colored elements; drawn as `ForceDiagrams` are.

    Args:
        stages: `StagePicture` of each picture.
        snapshots: `Snapshots` of the solution.
        view: `View` of all pictures.
        units: `Units` of the numbers, or None.
        one_scale: whether colors have one scale for all groups.
        earlier: what the geometry behind them is called.
    """

    def __init__(self, stages, snapshots, view, units, one_scale, earlier):
        self.stages, self.snapshots, self.view, self.earlier = stages, snapshots, view, earlier
        self.scale = ColorScale([stage.now.forces for stage in stages], units, one_scale)

    def draw(self, axes, number):
        """Draw picture `number`: the elements, and dashed behind them those of the phase before."""
        _, now, before = self.stages[number]
        draw_earlier_geometry(axes, self.view, self.snapshots.links, before, now.forces.present)
        self.lines = ElementLines(axes, self.view, self.snapshots, self.scale)
        self.lines.show(now)

    def legend_entries(self):
        """Return legend entries for colors of groups and line styles: slack, compressed, before."""
        moved = any(now.has_moved_from(before) for _, now, before in self.stages)
        return self.scale.legend_entries() + line_legend(
            [stage.now.forces for stage in self.stages], moved, False, self.earlier
        )

    def color_bar(self):
        """Return lines of the last picture, whose colors a color bar explains, and its label."""
        return self.lines.taut, self.scale.label


class _PlainElementPictures(_ColoredElementPictures):
    """The pictures of a sequence with elements of one color, whatever their forces."""

    def draw(self, axes, number):
        """Draw picture `number`, as `_ColoredElementPictures` does, without colors and casings."""
        super().draw(axes, number)
        self.lines.casing.set_segments([])
        drawn = [self.lines.taut, getattr(self.lines, "surface", None)]
        for own in drawn:
            if own is not None:
                own.set_array(None)
                own.set_color(SERIES[0])

    def legend_entries(self):
        """Return the legend entry for the state before, if elements have moved."""
        moved = any(now.has_moved_from(before) for _, now, before in self.stages)
        return line_legend([], moved, False, self.earlier)

    def color_bar(self):
        """Return None: there is no color bar."""
