"""Pictures of all phases beside each other, as of stages of a construction: `sequence`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..analysis.solution import Solution
from ..model.structure import Structure
from .diagrams import Diagrams
from .glyphs import draw_supports, support_keys
from .layout import arrange, settle
from .members import Members, Scale, ghost, keys
from .nets import Stage
from .snapshots import Snapshots
from .style import SIZE, finish
from .views import choose

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
    colour: str = "tension",
    diagram: str | None = None,
    high: float = _HIGH,
    structure: Structure | None = None,
    view: str | None = None,
    names: Sequence[str] | None = None,
    columns: int | None = None,
    supports: bool = True,
) -> Figure:
    """Draw the end of every phase: one small picture each, in the same scales and colours.

    Only elements that are there are drawn. Behind them, thin and dashed, is the end of the phase
    before, with the elements that are in both. With a `structure`, catenaries hang and beams are
    bent, as in `net`; catenaries are not drawn as they were before the first phase, because this is
    not known.

    Args:
        solution: `Solution`; of a failed analysis the phases that have converged are drawn.
        path: where to save the picture, in the format of the suffix, or None.
        magnify: factor on the displacement from the initial geometry, in which beams are straight:
            they bend by this factor, too. Catenaries, whose shape is not known there, differ from
            their chords by as much as they do, not magnified.

    Options:
        colour, structure: as of `net`.
        diagram: "N", "Vy", "Vz", "T", "My" or "Mz": draw this section force on the beams instead of
            colours, as `diagram` does, in one scale for all phases.
        high: length of the largest value of a `diagram` over the extent of the structure.
        view: "plan", "elevation" or "space"; default elevation of a structure that lies in a
            vertical plane or is higher than half its width, else plan.
        names: titles, one for each phase; default "phase 1", "phase 2" and so on.
        columns: number of pictures in a row; default two, or three of high structures.
        supports: whether to mark supports.

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
    found = Snapshots(solution, structure, colour, names)
    stages = _stages(found, magnify)
    everything = np.concatenate([stage.points() for stage in stages])
    seen = choose(everything, view)
    content: Any = _Members(stages, found, seen)
    if diagram is not None:
        instants = [stage.now for stage in stages]
        content = Diagrams(found, instants, diagram, high, seen, _LABELS, _APART, _LEAST)
        everything = np.concatenate([everything, content.points()])
    if columns is None:
        columns = 2 if seen.ratio(everything) < _WIDE else 3
    if isinstance(columns, bool) or not isinstance(columns, int) or columns < 1:
        raise ValueError(f"columns = {columns!r}: must be a positive integer")
    count = len(stages)
    columns = min(columns, count)
    titles = [stage.title for stage in stages]
    figure, slots = arrange([seen] * count, [everything] * count, titles, columns)
    held = [stage.now.held(seen.normal) for stage in stages]
    for number, (stage, axes) in enumerate(zip(stages, figure.axes, strict=True)):
        if seen.flat and number % columns:  # numbers at the left and below only
            axes.set(ylabel="", yticklabels=[])
        if seen.flat and number + columns < count:
            axes.set(xlabel="", xticklabels=[])
        content.draw(axes, number)
        if supports:
            draw_supports(axes, seen, stage.now.positions, held[number])
    handles = content.keys()
    if diagram is not None:  # what the numbers are
        handles.insert(0, Line2D([], [], linestyle="", label=f"{diagram} ({content.unit})"))
    if supports:
        handles += support_keys(np.any(held, axis=0))
    if magnify != 1.0:
        handles.append(Line2D([], [], linestyle="", label=f"deflection x {magnify:g}"))
    bar, label = content.bar()
    settle(figure, slots, bar, label, handles, columns if seen.flat else None)
    for text in (text for axes in figure.axes for text in axes.texts):  # the numbers of diagrams
        text.set_fontsize(0.7 * SIZE)
    return finish(figure, path)


def _stages(found, magnify):
    """A `Stage` for every phase that has converged."""
    stages: list[Stage] = []
    for k, phase in enumerate(found.solution.phases):
        if int(phase.status) != 0:
            break
        end = found.after(k)
        now = end.magnified(end.before(), magnify)
        title = f"phase {k + 1}" if found.names is None else str(found.names[k])
        stages.append(Stage(title, now, stages[-1].now if stages else now.before()))
    if not stages:
        raise ValueError("solution: no phase has converged; see raise_if_failed")
    return stages


class _Members:
    """The pictures of a sequence with elements in colours, as `Diagrams` are those of a force."""

    def __init__(self, stages, found, view):
        self.stages, self.found, self.view = stages, found, view
        self.scale = Scale([stage.now.forces for stage in stages])

    def draw(self, axes, number):
        """Draw one of the pictures."""
        _, now, before = self.stages[number]
        ghost(axes, self.view, self.found.links, before, now.forces.present)
        self.lines = Members(axes, self.view, self.found, self.scale)
        self.lines.show(now)

    def keys(self):
        """Legend entries."""
        moved = any(now.has_moved(before) for _, now, before in self.stages)
        return keys([stage.now.forces for stage in self.stages], moved, False)

    def bar(self):
        """What the colour bar explains, and its label."""
        return self.lines.taut, self.scale.label
