"""Envelopes over load cases, drawn on the structure: `envelope_diagram`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..analysis.solution import Solution, State
from ..common import checks
from ..common.negligible import zero_negligible
from ..common.units import SI, UnitsLike, as_units
from ..design.result_envelopes import ResultEnvelope
from ..elements import Beams
from ..elements.abilities import Bending
from ..elements.element import SECTION_FORCES
from ..model.result_parts import end_nodes, named_groups_of
from ..model.structure import Structure
from .diagrams import MOMENTS
from .element_curves import curves_from_reference, points_on_chords
from .element_forces import ColoredValues, concatenate_values, values_by_group
from .element_lines import ColorScale, line_width
from .layout import arrange_pictures, finish_layout
from .nets import round_magnification
from .ordinates import (
    default_section_axes,
    keep_texts_inside,
    positive_side_directions,
    side_directions_in_picture,
    side_legend,
    write_largest_values,
)
from .style import GHOST, INK, SERIES, display_unit, finish_figure, format_value
from .symbols import draw_supports, support_legend
from .undeformed import UndeformedStructure

_HIGH = 0.12  # length of the largest value over the extent of the structure, as of `diagram`
_LABELS, _APART = 9, 0.12  # values that are written, and their distance over the extent
KINDS = ("N", "Vy", "Vz"), MOMENTS
"""Section forces of a kind."""
_UNITS = {"tension": "N", "sag": "m"}
"""Units of results that elements have one of each."""
_SIDES = {"high": ("largest", SERIES[0]), "low": ("smallest", SERIES[1])}


def envelope_diagram(
    structure: Structure,
    envelope: ResultEnvelope,
    of: str = "My",
    path: str | os.PathLike[str] | None = None,
    *,
    view: str | None = None,
    high: float = _HIGH,
    supports: bool = True,
    heights: float | None = 1.0,
    solutions: Solution | None = None,
    since: Solution | State | None = None,
    units: UnitsLike | None = None,
) -> Figure:
    """Draw the envelope of a result over load cases on the structure, in its initial geometry.

    The legend names the cases that govern. Elements that are inactive in all cases are left out.

    - Section forces of beams, "N" to "Mz": the largest and the smallest value along each beam, to
      the sides of `diagram`; between the places of the envelope straight lines.
    - "displacement": the structure in the case that moves a node most, magnified, and thin in all
      other cases; elements are straight between their nodes, but for `solutions`.
    - "tension", "sag" or another result with a number for each element: the smallest and the
      largest value as colors, in one scale.

    Args:
        structure: `Structure` that was analysed.
        envelope: `design.ResultEnvelope`, from ``design.envelope(structure, solutions, names)``.
        of: name of the result.
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        view: "plan", "elevation" or "space"; default elevation of a structure that lies in a
            vertical plane, else space; of section forces and displacements of masts and towers the
            elevation that shows them in their true length.
        high: length of the largest section force over the extent of the structure.
        supports: whether to mark supports.
        heights: factor on heights in elevations, as of `net`; 1 of section forces.
        solutions: the batch of which this is the envelope, with which displaced beams are bent and
            catenaries hang, as in `net`.
        since: `Solution` or `State` from which displacements count, and whose geometry is drawn,
            such as the prestressed state; default: the initial geometry.
        units: units of coordinates and values, as of `net`.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: another envelope, an unknown result, or one that cannot be drawn like this; no
            converged case; another number of solutions than of cases; a size that is not positive;
            a `since` that has failed, or for another result than "displacement"; unknown units.

    A beam of 4 m under either of two loads in the middle:

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
    >>> held = jc.restrained([0], "xyz", "x") + jc.restrained([2], "yz")
    >>> nodes = [[0.0, 0, 0], [2.0, 0, 0], [4.0, 0, 0]]
    >>> structure = jc.Structure(nodes, jc.Beams([[0, 1], [1, 2]], section=section), supports=held)
    >>> cases = [jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, p))) for p in (-500.0, 200.0)]
    >>> start = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, 0.0)))
    >>> solutions = jc.design.solve_cases(structure, start, cases)
    >>> envelope = jc.design.envelope(structure, solutions, names=["snow", "wind"])
    >>> figure = jc.plots.envelope_diagram(structure, envelope, "My")
    >>> [text.get_text() for text in figure.legends[0].get_texts()[:2]]
    ['largest My: 200 N m, wind', 'smallest My: -500 N m, snow']
    """
    stated = None if units is None else as_units(units)
    if not isinstance(envelope, ResultEnvelope):
        kind = checks.describe_type(envelope, "design.envelope(structure, solutions, names)")
        raise ValueError(f"envelope: expected a ResultEnvelope, got {kind}")
    if of not in envelope.values:
        raise ValueError(f"of = {of!r}: is no result{checks.suggest_names(of, envelope.values)}")
    if not high > 0:
        raise ValueError(f"high = {high!r}: must be positive")
    if len(envelope.failed) == len(envelope.names):
        raise ValueError("envelope: no case has converged")
    if solutions is not None and np.shape(solutions.status) != (len(envelope.names),):
        raise ValueError(f"solutions: must be the batch of the {len(envelope.names)} cases")
    of_beams = of in SECTION_FORCES.components
    active = _is_element_active(structure, envelope).any(axis=0)
    moved = _reference_displacement(since, of)
    heights = 1.0 if of_beams else heights
    stage = UndeformedStructure(structure, view, stated, heights, active, moved)
    if of_beams:
        figure, handles, slots, bar = _draw_section_force(stage, envelope, of, high)
    elif of == "displacement":
        figure, handles, slots, bar = _draw_displacements(stage, envelope, solutions, since)
    else:
        figure, handles, slots, bar = _draw_element_values(stage, envelope, of)
    if supports:
        for axes in figure.axes:
            draw_supports(axes, stage.view, stage.nodes, stage.held)
        handles += support_legend(stage.held)
    finish_layout(figure, slots, handles, bar)
    for axes in figure.axes[: len(slots)]:
        keep_texts_inside(axes)
    return finish_figure(figure, path)


def _reference_displacement(since, of):
    """Return the displacement of the reference state `since`, [n_node, 3], m; 0 if it is None.

    Raise ValueError if the state has failed, or if `of` is no displacement.
    """
    if since is None:
        return 0.0
    if of != "displacement":
        raise ValueError(f'since: is for of = "displacement", not for {of!r}')
    if not isinstance(since, Solution | State) or not np.isfinite(since.displacement).all():
        raise ValueError("since: expected a Solution, or a State, that has converged")
    return np.asarray(since.displacement, float)


class _GoverningValue(NamedTuple):
    """The largest or smallest value of a result, and the name of the case in which it occurs."""

    value: float
    case: str


def _governing_values(envelope, of):
    """Return the extreme values of a result over all places: {"high": ..., "low": ...}.

    They are `_GoverningValue`s. Raise ValueError if the result has no value in any case.
    """
    found = {}
    largest = largest_magnitude(envelope, _compared_results(of))
    for side, pick in (("high", np.nanargmax), ("low", np.nanargmin)):
        values = [np.ravel(np.asarray(x, float)) for x in _arrays(getattr(envelope, side)[of])]
        cases = [np.ravel(np.asarray(x)) for x in _arrays(getattr(envelope, f"{side}_case")[of])]
        value, case = np.concatenate(values), np.concatenate(cases)
        if np.isfinite(value).any():
            k = pick(value)
            found[side] = _GoverningValue(
                float(zero_negligible(value[k], largest)), envelope.names[int(case[k])]
            )
    if not found:
        raise ValueError(f"of = {of!r}: has no value in any case")
    return found


def largest_magnitude(envelope: ResultEnvelope, names: Sequence[str]) -> float:
    """Return the largest magnitude of results with these names in an envelope; 0 without any."""
    every = [x for s in _SIDES for name in names for x in _arrays(getattr(envelope, s).get(name))]
    return max((float(np.nanmax(np.abs(x), initial=0.0)) for x in every), default=0.0)


def _compared_results(of):
    """Return the results that rounding errors of one are compared with: all forces, or moments.

    A result that is no section force stands alone.
    """
    return next((kind for kind in KINDS if of in kind), (of,))


def _arrays(tree):
    """Return the arrays in a pytree, without None, as a list."""
    return [x for x in values_by_group(tree, 0) if x is not None]


def _is_element_active(structure, envelope):
    """Return which elements are active in each case, [n_case, n_elem] bool.

    An envelope has NaN for the tension of inactive elements; elements without tensions count as
    active.
    """
    tensions = values_by_group(envelope.values["tension"], len(structure.groups))
    shapes = [(len(envelope.names), len(group.links)) for group in structure.groups]
    pairs = zip(tensions, shapes, strict=True)
    known = [np.zeros(shape) if x is None else np.asarray(x) for x, shape in pairs]
    return ~np.isnan(np.concatenate(known, axis=1))


def _draw_section_force(stage, envelope, of, high):
    """Draw the largest and the smallest value of the section force `of` along all beams.

    `high` is the length of the largest ordinate over the extent of the structure.

    Returns:
        The figure, legend entries, slots of `arrange_pictures`, and the color bar of
        `finish_layout`.
    """
    structure = stage.structure
    kind = largest_magnitude(envelope, _compared_results(of))
    values = {
        side: zero_negligible(np.concatenate(_arrays(getattr(envelope, side)[of])), kind)
        for side in _SIDES
    }
    extremes = _governing_values(envelope, of)
    largest = max(abs(extreme.value) for extreme in extremes.values())
    factor, unit = display_unit(largest, "N m" if of in MOMENTS else "N", stage.units)
    active = _is_element_active(structure, envelope).any(axis=0)
    bends = [np.full(len(one.links), isinstance(one, Bending)) for one in structure.groups]
    beams = active[np.concatenate(bends)]
    values = {side: own[beams] for side, own in values.items()}
    ends, axes_of_beams = (x[beams] for x in _beam_ends_and_axes(structure, stage.nodes))
    chord = stage.nodes[ends]
    base = points_on_chords(chord, values["high"].shape[1])
    sides = positive_side_directions(axes_of_beams, chord, of)
    stage.turn_view(chord, sides)
    sides = side_directions_in_picture(sides, chord[:, 1] - chord[:, 0], stage.view)
    scale = high * stage.extent / max(largest, 1e-300)
    tips = {
        side: base + scale * np.nan_to_num(own)[..., None] * sides[:, None]
        for side, own in values.items()
    }
    points = np.concatenate([stage.nodes, *(own.reshape(-1, 3) for own in tips.values())])
    figure, slots = arrange_pictures([stage.view], [points], [f"envelope of {of} ({unit})"])
    (axes,) = figure.axes
    stage.add_lines(axes, stage.nodes, active, colors=GHOST, linewidths=1.0, zorder=1)
    seen = stage.view.project(base)
    stage.view.add_lines(axes, seen, colors=INK, linewidths=1.4, zorder=4)
    handles: list[Any] = []
    for side, (word, color) in _SIDES.items():
        top = stage.view.project(tips[side])
        quads = np.concatenate([seen, top[:, ::-1]], axis=1)
        look: Any = {"facecolors": color, "edgecolors": "none", "alpha": 0.35}
        stage.view.add_faces(axes, quads, zorder=2, **look)
        stage.view.add_lines(axes, top, colors=color, linewidths=1.0, zorder=3)
        extreme = extremes[side]
        text = f"{word} {of}: {format_value(factor * extreme.value)} {unit}, {extreme.case}"
        handles.append(Patch(color=color, alpha=0.6, label=text))
    handles += side_legend(of)
    every = [np.concatenate([own[side] for side in _SIDES]) for own in (tips, values)]
    ordinates, limits = (np.tile(base, (2, 1, 1)), every[0]), (_APART * stage.extent, _LABELS, 0.0)
    write_largest_values(axes, stage.view, ordinates, np.nan_to_num(every[1]), factor, limits)
    return figure, handles, slots, None


def _beam_ends_and_axes(structure, nodes):
    """Return the end nodes of all beams, [n_beam, 2], and their section axes, [n_beam, 3, 3].

    Axes x, y and z are in rows; `nodes` are positions, [n_node, 3], m.
    """
    ends, axes = [np.zeros((0, 2), int)], [np.zeros((0, 3, 3))]
    for bending in structure.groups:
        if not isinstance(bending, Bending):
            continue
        own = end_nodes(bending)
        ends.append(own)
        if isinstance(bending, Beams):  # elements of other classes state no axes
            axes.append(np.asarray(bending.element_axes(nodes)))
        else:
            axes.append(default_section_axes(nodes[own]))
    return np.concatenate(ends), np.concatenate(axes)


def _draw_displacements(stage, envelope, solutions, since):
    """Draw the structure in the case that moves a node most, and thin in all others.

    With the batch `solutions`, not None, beams and catenaries are curves. `since` is the `Solution`
    or `State` from which displacements count, or None.

    Returns:
        The figure, legend entries, slots of `arrange_pictures`, and the color bar of
        `finish_layout`.
    """
    moved = np.asarray(envelope.values["displacement"], float)
    moved = moved - _reference_displacement(since, "displacement")
    sizes = np.linalg.norm(moved, axis=2)
    case, node = np.unravel_index(np.nanargmax(sizes), sizes.shape)
    stage.turn_view(stage.nodes[_beam_ends_and_axes(stage.structure, stage.nodes)[0]], moved[case])
    factor = round_magnification(moved[case], stage.nodes)
    good = np.flatnonzero(np.isfinite(sizes).all(axis=1))
    every = stage.nodes + factor * moved[good]
    drawn = [curves_from_reference(stage.structure, solutions, k, factor, since) for k in good]
    curves, origins = zip(*drawn, strict=True)
    bends = [own.points(at) for own, at in zip(curves, every, strict=True) if own is not None]
    points = np.concatenate([x.reshape(-1, 3) for x in (stage.nodes, every, *bends)])
    title = "displacements of all cases" + (f" x {factor:g}" if factor != 1 else "")
    figure, slots = arrange_pictures([stage.view], [points], [title])
    (axes,) = figure.axes
    active = _is_element_active(stage.structure, envelope)
    dashed: Any = {"colors": GHOST, "linewidths": 1.0, "linestyles": "--", "zorder": 1}
    stage.add_lines(axes, stage.nodes, active.any(axis=0), origins[0], **dashed)
    thin: Any = {"colors": SERIES[5], "linewidths": 0.5, "alpha": 0.6, "zorder": 2}
    for number, positions, bent in zip(good, every, curves, strict=True):
        stage.add_lines(axes, positions, active[number], bent, **thin)
    width = line_width(len(stage.links))
    positions = stage.nodes + factor * moved[case]
    bold: Any = {"colors": SERIES[0], "linewidths": width, "zorder": 3}
    stage.add_lines(axes, positions, active[case], curves[list(good).index(case)], **bold)
    units = stage.units or SI
    small, to_small = units.small_length
    size = float(to_small) * units.from_si(float(sizes[case, node]), "m")
    origin = "initial geometry" if since is None else "reference state"
    text = f"largest displacement from the {origin}: {size:.4g} {small}, node {node}, "
    text += envelope.names[case]
    handles = [
        Line2D([], [], color=SERIES[0], linewidth=width, label=text),
        Line2D([], [], color=SERIES[5], linewidth=0.8, label=f"all {len(good)} cases"),
        Line2D([], [], color=GHOST, linewidth=1.0, linestyle="--", label=origin),
    ]
    return figure, handles, slots, None


def _draw_element_values(stage, envelope, of):
    """Draw the smallest and the largest value of the result `of` in each element as colors.

    Raise ValueError for a result that has not one number for each element.

    Returns:
        The figure, legend entries, slots of `arrange_pictures`, and the color bar of
        `finish_layout`.
    """
    structure, groups = stage.structure, stage.structure.groups
    for leaf, group in zip(
        values_by_group(envelope.high[of], len(groups)), [*groups, *groups], strict=False
    ):
        if leaf is not None and np.shape(leaf) != (len(group.links),):
            raise ValueError(
                f"of = {of!r}: has no number for each element; drawn are section forces, "
                '"displacement", and results such as "tension"'
            )
    group = np.repeat(np.arange(len(groups)), [len(one.links) for one in groups])
    labels = [label for label, _ in named_groups_of(structure)]
    every = {side: concatenate_values(getattr(envelope, side)[of], groups) for side in _SIDES}
    look = of, _UNITS.get(of, ""), group, labels
    values = {side: ColoredValues(own, *look) for side, own in every.items()}
    extremes = _governing_values(envelope, of)
    scale = ColorScale(list(values.values()), stage.units)
    titles = [f"{word} {scale.name}" for word, _ in _SIDES.values()]
    view = stage.view
    figure, slots = arrange_pictures([view, view], [stage.nodes, stage.nodes], titles)
    width = line_width(len(stage.links))
    handles: list[Any] = scale.legend_entries()
    active = _is_element_active(structure, envelope).any(axis=0)
    for axes, (side, (word, _)) in zip(figure.axes, _SIDES.items(), strict=True):
        lines = stage.add_lines(axes, stage.nodes, active, linewidths=width, zorder=3, **scale.look)
        lines.set_array(scale.numbers(values[side])[stage.element[active[stage.element]]])
        extreme = extremes[side]
        number = f"{format_value(scale.factor * extreme.value)} {scale.unit}".rstrip()
        text = f"{word} {scale.name}: {number}, {extreme.case}"
        handles.append(Line2D([], [], linestyle="", label=text))
    return figure, handles, slots, (lines, scale.label)
