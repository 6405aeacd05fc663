"""Pictures of a structure before and after loading: `net`."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ..analysis.solution import Solution, State
from ..model.structure import Structure
from .glyphs import Arrows, draw_section_axes, draw_supports, section_axis_keys, support_keys
from .layout import arrange, settle
from .members import Members, Scale, ghost, keys
from .stages import drawn, stages_of
from .style import finish
from .views import View, choose


def net(
    solution: Solution,
    path: str | os.PathLike[str] | None = None,
    magnify: float | None = 1.0,
    *,
    colour: str = "tension",
    structure: Structure | None = None,
    state: State | None = None,
    phase: int | None = None,
    view: str | None = None,
    names: Sequence[str] | None = None,
    supports: bool = True,
    loads: bool = True,
    reactions: bool = False,
    axes: bool = False,
) -> Figure:
    """Draw a structure in plan before and in space after loading, coloured by tension.

    A structure that lies in a vertical plane, or is higher than half its width, is drawn in an
    elevation instead of plan; a plane structure also after loading. Slack cables are dashed,
    elements in compression have a black casing. With a `structure`, catenaries hang and beams are
    bent: each is the cubic with the positions and rotations of its ends. Without it, both are
    chords.

    Titles say "Before loading" and "After loading" of two phases, "After phase 3 of 7" of more.

    Args:
        solution: `Solution` with status OK; "before" is the end of its first phase (with a single
            phase both pictures are of its end).
        path: where to save the picture, in the format of the suffix, or None.
        magnify: factor on the displacement after the first phase, in the second picture; None for a
            round factor that makes the largest displacement a tenth of the structure. What curves
            differ by from their chords changes by the same factor, and they end in the nodes.
            Before a single phase beams are straight; catenaries, whose shape is not known there,
            differ from their chords by as much as at its end, not magnified.

    Options:
        colour: values that colour elements: "tension" (of catenaries the mean of both ends; the
            first result of elements if none has a tension); "utilisation", the largest force along
            an element over its breaking strength, which needs `structure`, from 0 to 100 % and red
            above; or another name in ``solution.told``, followed by the name of a component if the
            result has components.
        structure: the `Structure` that was analysed. It says which elements are cables, which
            nodes rotate, and where elements are curved: without it every element with zero tension
            is drawn as slack, and no support as clamped.
        state: `State` to draw instead of the end, such as ``solution.last`` of a failed analysis.
        phase: number of a phase, from 0, whose end is drawn instead.
        view: "plan", "elevation" or "space" for the first picture; default: as described above.
        names: titles, one for each phase, such as the names of load cases.
        supports: whether to mark supports.
        loads, reactions: whether to draw them in the second picture, as arrows: loads end at their
            node, reactions begin there. An arrow that would lie on an element lies on the other
            side of its node, or under the elements if there is one, too. Both have a scale of their
            own, so that the longest arrow, whose force the legend says, takes at most 0.3 of the
            structure's size in each direction of the picture, and is shorter if there are many. Of
            more than 250 the largest in each cell of a grid are drawn, and the legend counts them.
            Moments are not drawn.
        axes: whether to draw the axes x, y and z of the sections of beams at their middles, a dot
            for an axis that is seen end on; needs `structure`.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: the solution has failed and no state is given, it is a batch, the structure is
            another one, or is needed, no group has a strength, another number of names than of
            phases, or an unknown option.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> structure, phases = jc.scenes.flat_net()
    >>> solution = jc.solve(structure, phases)
    >>> figure = jc.plots.net(solution, structure=structure, reactions=True)
    >>> [axes.get_title() for axes in figure.axes[:2]]
    ['Before loading: plan', 'After loading']
    """
    if axes and structure is None:
        raise ValueError("structure: needed for axes; the beams are in it")
    links, stages, shown = stages_of(solution, structure, state, magnify, colour, names, phase)
    views = _views(stages, view)
    if views[0] is views[1] and stages[0].title == stages[1].title:
        views, stages = views[1:], stages[1:]  # the first picture would be the same

    arrows = _arrows(stages[-1], shown, views[-1], links, loads, reactions)
    points = [np.concatenate(stage.places()) for stage in stages]
    points[-1] = np.concatenate([points[-1], *(kind.ends for kind in arrows)])
    sections = [stage.section_axes() for stage in stages] if axes else []
    for number, (_, tips) in enumerate(sections):
        points[number] = np.concatenate([points[number], tips.reshape(-1, 3)])
    scale = Scale([stage.forces for stage in stages])
    ratios = [seen.ratio(within) for seen, within in zip(views, points, strict=True)]
    figure, slots = arrange(ratios, [seen.flat for seen in views])
    for number, (seen, stage) in enumerate(zip(views, stages, strict=True)):
        title = stage.title + (f": {seen.kind}" if number == 0 and seen.flat else "")
        space = seen.add_axes(figure, points[number], title)
        ghost(space, seen, stage.ghost, links, stage.before, stage.ghost_curves)
        lines = Members(space, seen, links, scale)
        lines.show(stage.positions, stage.forces, stage.curves)
        if supports:
            draw_supports(space, seen, stage.positions, stage.held(structure, seen))
        if axes:
            draw_section_axes(space, seen, *sections[number])
    for kind in arrows:
        kind.draw(space, views[-1])

    handles = keys([stage.forces for stage in stages], any(stage.moved() for stage in stages))
    if supports:
        kinds = [stage.held(structure, seen) for seen, stage in zip(views, stages, strict=True)]
        handles += support_keys(np.any(kinds, axis=0))
    handles += [key for kind in arrows for key in kind.keys()]
    if any(len(middles) for middles, _ in sections):
        handles += section_axis_keys()
    settle(figure, slots, lines.taut, scale.label, handles)
    return finish(figure, path)


def _views(stages, view):
    """The views of the pictures before and after loading."""
    everything = np.concatenate([place for stage in stages for place in stage.places()])
    views = [choose(np.concatenate(stages[0].places()), view), choose(everything)]
    if not views[1].plane:
        views[1] = View("space")
    elif view is None:
        views[0] = views[1]
    return views


def _arrows(stage, shown, view, links, loads, reactions):
    """`Arrows` of the kinds that are asked for."""
    points = np.concatenate(drawn(*stage.now()))
    pairs = links[0][stage.forces.present[links[1]]]
    asked = ("loads", shown.load, loads, True), ("reactions", shown.reactions, reactions, False)
    return [
        Arrows(name, forces, stage.positions, view, points, pairs, push)
        for name, forces, wanted, push in asked
        if wanted
    ]
