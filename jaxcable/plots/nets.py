"""Pictures of a structure before and after loading: `net`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ..analysis.solution import Solution, State
from ..common.types import ArrayLike, Float
from ..common.units import SI, UnitsLike, as_units
from ..model.structure import Structure
from .element_lines import ColorScale, ElementLines, draw_earlier_geometry, line_legend
from .layout import arrange_pictures, finish_layout
from .snapshots import Snapshot, Snapshots
from .style import finish_figure
from .symbols import (
    ForceArrows,
    draw_section_axes,
    draw_supports,
    section_axis_legend,
    support_legend,
)
from .views import choose_view, round_factor


def net(
    solution: Solution,
    path: str | os.PathLike[str] | None = None,
    magnify: float | None = 1.0,
    *,
    color: str = "tension",
    one_scale: bool = False,
    structure: Structure | None = None,
    state: State | None = None,
    phase: int | None = None,
    view: str | None = None,
    names: Sequence[str] | None = None,
    supports: bool = True,
    loads: bool = True,
    reactions: bool = False,
    axes: bool = False,
    ground: Float[ArrayLike, "n 3"] | None = None,
    heights: float | None = 1.0,
    units: UnitsLike | None = None,
) -> Figure:
    """Draw a structure in plan before and in space after loading, colored by tension.

    A structure that lies in a vertical plane, or is higher than half its width, is drawn in an
    elevation instead of plan; a plane structure also after loading. Slack cables are dashed,
    elements in compression have a black casing. With a `structure`, catenaries hang and beams are
    bent: each is the cubic with the positions and rotations of its ends. Without it, both are
    chords. Elements with faces are drawn as these, translucent.

    Titles say "Before loading" and "After loading" of two phases, "After phase 3 of 7" of more.

    Args:
        solution: `Solution`; of a failed one give `state`, such as its `last`. "Before" is the end
            of its first phase (with a single phase both pictures are of its end).
        path: where to save the picture, in the format of the suffix, or None.
        magnify: factor on the displacement after the first phase, in the second picture; None for a
            round factor that makes the largest displacement a tenth of the structure. Deflections
            of beams and catenaries from their chords are magnified by the same factor. Before a
            single phase beams are straight; the shape of catenaries is not known there, and they
            are drawn with the sag of its end, not magnified. A single phase after another analysis
            (`solve` with `start`) counts from the end of that one; with beams from the nodes of the
            input, as rotations are known from there only.

    Options:
        color: values that color the elements:

            - "tension" (of catenaries the mean of both ends; if no element has a tension, the first
              result of elements);
            - "utilization", the largest force along an element over its breaking force, from 0 to
              100 % and red above; needs `structure`;
            - another name in ``solution.element_results``, followed by a place and a component if
              the result has several: ``skin_stress top xx``.
        one_scale: whether colors are forces in one scale for all groups. Otherwise they are shares
            of the largest force of each group where many forces are small beside those of others.
        structure: the `Structure` that was analysed. It says which elements are cables, which
            nodes rotate, and where elements are curved: without it every element with zero tension
            is drawn as slack, and no support as clamped.
        state: `State` to draw instead of the end, such as ``solution.last`` of a failed analysis.
        phase: number of a phase, from 0, whose end is drawn instead.
        view: "plan", "elevation" or "space" for the first picture; default: as described above.
        names: titles, one for each phase, such as the names of load cases.
        supports: whether to mark supports.
        loads, reactions: whether to draw them in the second picture, as arrows. Loads end at their
            node, reactions begin there. An arrow that would cover an element is drawn on the other
            side of its node, or under the elements if there is one, too. Loads and reactions have
            their own scales; the legend has the largest force. If there are more than 250, only the
            largest in each cell of a grid is drawn, and the legend counts them. Moments are not
            drawn.
        axes: whether to draw the axes x, y and z of the sections of beams at their middles, a dot
            for an axis that is seen end on; needs `structure`.
        ground: points of the ground along a line, [n, 3], m, as of `results.clearance_over_ground`,
            drawn in elevations and in space.
        heights: factor on heights in elevations, such as 5.0 for the spans of a line; default 1.0,
            heights to scale. None for a round factor from 1 to 100, 1 of a structure that is not
            low.
        units: units of coordinates and values, such as "kip, ft" (see `files.Units`); default: SI,
            with forces in N, kN or MN.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: the solution has failed and no state is given; it is a batch; the structure is
            missing or another one; no group has a breaking force; another number of names than of
            phases; an unknown option; unknown units.

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
    stated = None if units is None else as_units(units)
    snapshots = Snapshots(solution, structure, color, names)
    shown = snapshots.state_to_draw(state, phase)
    stages = _stages_before_and_after(snapshots, shown, magnify)
    profile = np.zeros((0, 3)) if ground is None else np.asarray(ground, float).reshape(-1, 3)
    views = _choose_views(stages, view, stated or SI, profile, heights)
    if views[0] is views[1] and stages[0].title == stages[1].title:
        views, stages = views[1:], stages[1:]  # the first picture would be the same

    kinds = [("load", loads), ("reaction", reactions)]
    asked = [name for name, wanted in kinds if wanted]
    arrows = _force_arrows(snapshots, stages[-1].now, shown, views[-1], asked, stated)
    points = [np.concatenate([stage.points(), profile]) for stage in stages]
    points[-1] = np.concatenate([points[-1], *(kind.ends for kind in arrows)])
    sections = [stage.now.section_axes() for stage in stages] if axes else []
    for number, (_, tips) in enumerate(sections):
        points[number] = np.concatenate([points[number], tips.reshape(-1, 3)])
    forces = [stage.now.forces for stage in stages]
    scale = ColorScale(forces, stated, one_scale)
    titles = [stage.title for stage in stages]
    titles[0] += f": {views[0].kind}" if views[0].flat else ""
    figure, slots = arrange_pictures(views, points, titles)
    held = [stage.now.support_kinds(seen.normal) for seen, stage in zip(views, stages, strict=True)]
    for number, (seen, stage, space) in enumerate(zip(views, stages, figure.axes, strict=True)):
        draw_earlier_geometry(space, seen, snapshots.links, stage.before)
        if len(profile) and seen.kind != "plan":
            seen.add_ground(space, profile)
        lines = ElementLines(space, seen, snapshots, scale)
        lines.show(stage.now)
        if supports:
            draw_supports(space, seen, stage.now.positions, held[number])
        if axes:
            draw_section_axes(space, seen, *sections[number])
    for kind in arrows:
        kind.draw(space, views[-1])

    handles = line_legend(forces, any(stage.now.has_moved_from(stage.before) for stage in stages))
    handles = scale.legend_entries() + handles
    if supports:
        handles += support_legend(np.any(held, axis=0))
    handles += [key for kind in arrows for key in kind.legend_entries()]
    if any(len(middles) for middles, _ in sections):
        handles += section_axis_legend()
    finish_layout(figure, slots, handles, (lines.taut, scale.label))
    return finish_figure(figure, path)


class StagePicture(NamedTuple):
    """A picture of a structure: its title, and the two instants that it shows.

    Attributes:
        title: title of the picture.
        now: `Snapshot` that it shows.
        before: `Snapshot` of an earlier instant, which is drawn dashed behind.
    """

    title: str
    now: Snapshot
    before: Snapshot

    def points(self) -> Float[np.ndarray, "n 3"]:
        """Return all points that are drawn, of both instants, [n, 3], m."""
        return np.concatenate([self.before.points(), self.now.points()])


def _stages_before_and_after(snapshots, state, magnify):
    """Return the `StagePicture`s before and after loading, the latter with magnified displacements.

    Args:
        snapshots: `Snapshots` of the solution.
        state: `State` after loading.
        magnify: factor on displacements, or None for a round one.
    """
    end, title = snapshots.at_state(state), snapshots.title(int(state.phase), state)
    if end.phase < 1:  # a single phase: both pictures are of its end
        before, origin = (
            StagePicture(title, end, end.in_initial_geometry()),
            end.in_initial_geometry(),
        )
    else:
        origin = snapshots.after_phase(0)
        before = StagePicture(snapshots.title(0), origin, origin)
    factor = magnify
    if factor is None:
        factor = round_magnification(
            end.displacement_from(origin), np.concatenate([end.positions, end.initial_positions])
        )
    title += "" if factor == 1 else f", displacements x {factor:g}"
    return [before, StagePicture(title, end.magnified(origin, factor), origin)]


def round_magnification(
    moved: Float[np.ndarray, "n_node 3"], places: Float[np.ndarray, "n 3"]
) -> float:
    """Return a round factor that makes the largest displacement about a tenth of the structure.

    `moved` are displacements, [n_node, 3], m, and `places` points of the structure, [n, 3], m.
    """
    largest = np.linalg.norm(moved, axis=1).max()
    wanted = 0.1 * np.ptp(places, axis=0).max() / max(largest, 1e-300)
    return round_factor(wanted) if largest else 1.0


def _choose_views(stages, view, units, profile, heights):
    """Return the `View`s of the pictures before and after loading, in `units`.

    `view` is the kind of the first one, "plan", "elevation" or "space", or None to choose it;
    `profile` is the ground, [n, 3], m, and `heights` the factor on heights, or None.
    """
    everything = np.concatenate([*(stage.points() for stage in stages), profile])
    first = choose_view(stages[0].points(), view, units=units)
    second = choose_view(everything, space=True, units=units, heights=heights)
    if first.kind == "elevation":  # of one scale of heights in both
        first = choose_view(everything, "elevation", units=units, heights=heights)
    return [second if second.plane and view in (None, second.kind) else first, second]


def _force_arrows(snapshots, snapshot, shown, view, asked, units):
    """Return the `ForceArrows` of loads and reactions of a state, a list.

    Args:
        snapshots: `Snapshots` of the solution.
        snapshot: `Snapshot` of the picture.
        shown: `State` with the forces.
        view: `View` of the picture.
        asked: what is drawn: some of "load" and "reaction".
        units: `Units` of legends, or None.
    """
    links, element = snapshots.links
    pairs = links[snapshot.forces.present[element]]
    kinds = ("load", shown.load, True), ("reaction", shown.reactions, False)
    at = snapshot.positions, view, snapshot.points(), pairs
    negligible = snapshots.negligible_force()
    return [
        ForceArrows(name, forces, *at, push, units, negligible)
        for name, forces, push in kinds
        if name in asked
    ]
