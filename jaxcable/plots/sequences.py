"""Pictures of all phases beside each other, as of stages of a construction: `sequence`."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..analysis.solution import Solution
from ..model.parts import pieces
from ..model.structure import Structure
from .diagrams import Along, sign_keys, unit_of
from .diagrams import check as check_force
from .glyphs import draw_supports, support_keys
from .layout import grid, settle
from .members import Members, Scale, ghost, keys
from .shapes import Shapes
from .stages import Stage, forces_of, named, shown, start_of
from .style import SIZE, finish, force_unit
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
    colour = shown(solution, structure, colour)
    stages = _stages(solution, structure, colour, magnify, names)
    everything = np.concatenate([place for stage in stages for place in stage.places()])
    seen = choose(everything, view)
    links = pieces(solution.last.topology.parts)[:2]
    if diagram is None:
        content: _Members | _Diagrams = _Members(stages, links)
    else:
        content = _Diagrams(solution, stages, links, (diagram, high), seen)
        everything = np.concatenate([everything, content.points()])
    ratio = seen.ratio(everything)
    if columns is None:
        columns = 2 if ratio < _WIDE else 3
    if isinstance(columns, bool) or not isinstance(columns, int) or columns < 1:
        raise ValueError(f"columns = {columns!r}: must be a positive integer")
    columns = min(columns, len(stages))
    figure, slots = grid(ratio, len(stages), columns)
    for number, stage in enumerate(stages):
        axes = seen.add_axes(figure, everything, stage.title)
        if seen.flat and number % columns:  # numbers at the left and below only
            axes.set(ylabel="", yticklabels=[])
        if seen.flat and number + columns < len(stages):
            axes.set(xlabel="", xticklabels=[])
        content.draw(axes, seen, number)
        if supports:
            draw_supports(axes, seen, stage.positions, stage.held(structure, seen))
    handles = content.keys()
    if supports:
        handles += support_keys(np.any([s.held(structure, seen) for s in stages], axis=0))
    if magnify != 1.0:
        handles.append(Line2D([], [], linestyle="", label=f"deflection x {magnify:g}"))
    bar, label = content.bar()
    settle(figure, slots, bar, label, handles, columns if seen.flat else None)
    content.shrink(figure)
    return finish(figure, path)


class _Members:
    """The pictures of a sequence, with elements in colours."""

    def __init__(self, stages, links):
        self.stages, self.links = stages, links
        self.scale = Scale([stage.forces for stage in stages])

    def draw(self, axes, view, number):
        """Draw one of the pictures."""
        stage = self.stages[number]
        present = stage.before & stage.forces.present
        ghost(axes, view, stage.ghost, self.links, present, stage.ghost_curves)
        self.lines = Members(axes, view, self.links, self.scale)
        self.lines.show(stage.positions, stage.forces, stage.curves)

    def keys(self):
        """Legend entries."""
        stages = self.stages
        return keys([stage.forces for stage in stages], any(s.moved() for s in stages), False)

    def bar(self):
        """What the colour bar explains, and its label."""
        return self.lines.taut, self.scale.label

    def shrink(self, figure):
        """Nothing is written."""


class _Diagrams:
    """The pictures of a sequence, with a section force on the beams."""

    def __init__(self, solution, stages, links, asked, view):
        check_force(*asked)
        of, high = asked
        phases = solution.phases
        self.links, self.view, self.of = links, view, of
        self.along = [Along(solution, s, phases[k], of) for k, s in enumerate(stages)]
        self.largest = max(each.largest for each in self.along)
        extent = max(each.extent for each in self.along)
        scale = high * extent / max(self.largest, 1e-300)
        self.tips = [each.tips(view, scale) for each in self.along]

    def points(self):
        """Where all diagrams end, [n, 3], m."""
        return np.concatenate([tips.reshape(-1, 3) for tips in self.tips])

    def draw(self, axes, view, number):
        """Draw one of the pictures."""
        along, tips = self.along[number], self.tips[number]
        along.draw(axes, view, self.links, tips)
        factor = force_unit(self.largest)[0]
        along.write(axes, view, tips, factor, _LABELS, _APART, _LEAST * self.largest)

    def keys(self):
        """Legend entries, with the unit of the numbers."""
        unit = unit_of(self.of, force_unit(self.largest)[1])
        numbers = Line2D([], [], linestyle="", label=f"{self.of} ({unit})")
        return [numbers, *sign_keys(self.of, self.along)]

    def bar(self):
        """No colour bar."""
        return None, ""

    def shrink(self, figure):
        """Make the numbers smaller than labels."""
        for axes in figure.axes:
            for text in axes.texts:
                text.set_fontsize(0.7 * SIZE)


def _stages(solution, structure, colour, magnify, names):
    """A `Stage` for every phase that has converged."""
    named(solution, names)
    begin = start_of(solution, solution.last)
    shapes, start = Shapes(solution, structure), None
    before, found, was, ghost_curves = begin, [], None, None
    for k, phase in enumerate(solution.phases):
        if int(phase.status) != 0:
            break
        end = begin + magnify * (np.asarray(phase.positions) - begin)
        title = f"phase {k + 1}" if names is None else str(names[k])
        forces = forces_of(phase, solution, structure, colour)
        fixed = solution.last.fixed[k + 1].array[: len(end)]
        curves = shapes.after(k)
        if k == 0:
            start = ghost_curves = shapes.start(curves)
        curves = curves if curves is None else curves.magnified(start, magnify)
        present = forces.present if was is None else was
        found.append(Stage(title, end, before, forces, fixed, present, curves, ghost_curves))
        before, was, ghost_curves = end, forces.present, curves
    if not found:
        raise ValueError("solution: no phase has converged; see raise_if_failed")
    return found
