"""Pictures of a structure before and after loading: `net`."""

from __future__ import annotations

import os

import numpy as np
from matplotlib.figure import Figure

from ..analysis.solution import Solution, State
from ..model.structure import Structure
from .glyphs import Arrows, draw_supports, support_keys
from .layout import arrange, settle
from .members import Members, Scale, ghost, keys
from .stages import stages_of
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
    view: str | None = None,
    supports: bool = True,
    loads: bool = True,
    reactions: bool = False,
) -> Figure:
    """Draw a structure in plan before and in space after loading, coloured by tension.

    A structure that lies in a vertical plane, or is higher than it is wide, is drawn in elevation
    instead of plan; a plane structure also after loading. Slack cables are dashed, elements in
    compression have a black casing.

    Args:
        solution: `Solution` with status OK; "before" is the end of its first phase (with a single
            phase both pictures are of its end). Catenaries are drawn as their chords
            (`forms.catenary_curves` has their positions).
        path: where to save the picture, in the format of the suffix, or None.
        magnify: factor on the displacement after the first phase, in the second picture; None for a
            round factor that makes the largest displacement a tenth of the structure.

    Options:
        colour: values that colour elements: "tension" (of catenaries the mean of both ends; the
            first result of elements if none has a tension); "utilisation", the largest force along
            an element over its breaking strength, which needs `structure`; or another name in
            ``solution.told``, followed by the name of a component if the result has components.
        structure: the `Structure` that was analysed. It says which elements are cables and which
            nodes rotate: without it every element with zero tension is drawn as slack, and no
            support as clamped.
        state: `State` to draw instead of the end, such as ``solution.last`` of a failed analysis.
        view: "plan", "elevation" or "space" for the first picture; default: as described above.
        supports: whether to mark supports.
        loads, reactions: whether to draw them in the second picture, as arrows: loads end at their
            node, reactions begin there, and the longest arrows of both are equally long. Moments
            are not drawn.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: the solution has failed and no state is given, it is a batch, the structure is
            another one, no group has a strength, or an unknown option.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> structure, phases = jc.scenes.flat_net()
    >>> solution = jc.solve(structure, phases)
    >>> figure = jc.plots.net(solution, structure=structure, reactions=True)
    >>> [axes.get_title() for axes in figure.axes[:2]]
    ['Before loading: plan', 'After loading']
    """
    links, stages, shown = stages_of(solution, structure, state, magnify, colour)
    everything = np.concatenate([place for stage in stages for place in stage.places()])
    views = [choose(np.concatenate(stages[0].places()), view), choose(everything)]
    if not views[1].plane:
        views[1] = View("space")
    elif view is None:
        views[0] = views[1]

    if views[0] is views[1] and stages[0].title == stages[1].title:
        views, stages = views[1:], stages[1:]  # the first picture would be the same

    extent = np.ptp(everything, axis=0).max()
    arrows = []
    if loads:
        arrows.append(Arrows("loads", shown.load, stages[-1].positions, extent, push=True))
    if reactions:
        arrows.append(
            Arrows("reactions", shown.reactions, stages[-1].positions, extent, push=False)
        )
    points = [np.concatenate(stage.places()) for stage in stages]
    points[-1] = np.concatenate([points[-1], *(kind.ends for kind in arrows)])

    scale = Scale([stage.forces for stage in stages])
    ratios = [seen.ratio(drawn) for seen, drawn in zip(views, points, strict=True)]
    figure, slots = arrange(ratios, [seen.flat for seen in views])
    for number, (seen, stage) in enumerate(zip(views, stages, strict=True)):
        title = stage.title + (f": {seen.kind}" if number == 0 and seen.flat else "")
        axes = seen.add_axes(figure, points[number], title)
        ghost(axes, seen, stage.ghost, links, stage.before)
        lines = Members(axes, seen, links, scale)
        lines.show(stage.positions, stage.forces)
        if supports:
            draw_supports(axes, seen, stage.positions, stage.held(structure, seen))
    for kind in arrows:
        kind.draw(axes, views[-1])

    handles = keys([stage.forces for stage in stages], any(stage.moved() for stage in stages))
    if supports:
        kinds = [stage.held(structure, seen) for seen, stage in zip(views, stages, strict=True)]
        handles += support_keys(np.any(kinds, axis=0))
    handles += [key for kind in arrows for key in kind.keys()]
    settle(figure, slots, lines.taut, scale.label, handles)
    return finish(figure, path)
