"""Section forces along beams, drawn on the structure: `diagram`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..analysis.phase_results import PhaseResult
from ..analysis.solution import Solution, State
from ..common.negligible import NEGLIGIBLE
from ..common.types import Float, Int
from ..common.units import SI, Units, UnitsLike, as_units
from ..elements.abilities import POINT_LOADS
from ..elements.element import SECTION_FORCES
from ..model.result_parts import end_nodes
from ..model.structure import Structure
from ..model.topology import GroupTopology
from ..results.interpolation import interpolate_recorded_forces
from .element_curves import PLACES, Links, hermite_cubic, picture_lines, select_lines
from .element_forces import values_by_group
from .layout import arrange_pictures, finish_layout
from .ordinates import (
    default_section_axes,
    keep_texts_inside,
    positive_side_directions,
    side_directions_in_picture,
    side_legend,
    view_of_ordinates,
    write_largest_values,
)
from .snapshots import Snapshot, Snapshots
from .style import GHOST, INK, SERIES, display_unit, finish_figure
from .symbols import draw_supports, support_legend
from .views import View, choose_view

# sizes in a picture 10 cm wide: longer diagrams and more numbers run into each other
_HIGH = 0.12  # length of the largest value over the extent of the structure
_MOST_JUMPS = 200  # places of loads in a group, from which on jumps are drawn as slopes
_LABELS = 9  # values that are written
_APART = 0.12  # distance of written values over the extent
MOMENTS = "T", "My", "Mz"
_COLORS = {"positive": SERIES[0], "negative": SERIES[1]}


def diagram(
    solution: Solution,
    of: str = "My",
    path: str | os.PathLike[str] | None = None,
    *,
    structure: Structure | None = None,
    state: State | None = None,
    phase: int | None = None,
    view: str | None = None,
    names: Sequence[str] | None = None,
    high: float = _HIGH,
    supports: bool = True,
    units: UnitsLike | None = None,
) -> Figure:
    """Draw a section force of all beams on the structure, with values at ends and extremes.

    Positive values are drawn to the side of the section axis z; those of "Vy" to that of y, those
    of "Mz" to that of -y. So moments lie on the side in tension. In a plane picture they are drawn
    at right angles to the beam, on that side. `section_forces` explains the signs, and how exact
    the values at the end of a phase are. With a `structure` beams are bent and catenaries hang, as
    in `net`.

    Args:
        solution: `Solution` of a structure with beams.
        of: "N", "Vy", "Vz", "T", "My" or "Mz".
        path: where to save the picture, in the format of the suffix, or None.

    Options:
        structure: the `Structure` that was analysed. Without it, axes are those of beams without a
            stated `up`, beams and catenaries are chords, and it is not known which nodes rotate.
        state: `State` to draw instead of the end, such as ``solution.last`` of a failed analysis.
        phase: number of a phase, from 0, whose end is drawn instead; `sequence` draws all of them.
        view: "plan", "elevation" or "space"; default an elevation of masts and towers, in which
            the ordinates have their true length, else that of `net`.
        names: names of the phases for the title, as of `net`.
        high: length of the largest value over the extent of the structure.
        supports: whether to mark supports.
        units: units of coordinates and values, as of `net`.

    Returns:
        The matplotlib `Figure`, not registered with pyplot; see `jaxcable.plots`.

    Raises:
        ValueError: an unknown force, no beams, a size that is not positive, or those of `net`.

    A cantilever of 4 m under 500 N at its end:

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import jaxcable as jc
    >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
    >>> beam = jc.Beams([[0, 1]], section=section)
    >>> structure = jc.Structure([[0, 0, 0], [4.0, 0, 0]], beam, supports=jc.clamped([0]))
    >>> load = jc.NodalLoads([1], (0.0, 0.0, -500.0))
    >>> figure = jc.plots.diagram(jc.solve(structure, jc.Phase(loads=load)), structure=structure)
    >>> figure.axes[0].get_title(), figure.axes[0].texts[0].get_text()
    ('My (N m), at the end', '2000')
    """
    stated = None if units is None else as_units(units)
    snapshots = Snapshots(solution, structure, names=names)
    shown = snapshots.state_to_draw(state, phase)
    snapshot, title = snapshots.at_state(shown), snapshots.title(int(shown.phase), shown)
    seen = choose_view(snapshot.points(), view, space=True, units=stated or SI)
    found = ForceDiagrams(snapshots, [snapshot], of, high, seen, units=stated, turns=view is None)
    seen = found.view
    points = np.concatenate([snapshot.points(), found.points()])
    name = title if names is not None else title[0].lower() + title[1:]
    title = f"{of} ({found.unit}), {name}" + ("" if found.largest > 0.0 else ": zero")
    figure, slots = arrange_pictures([seen], [points], [title])
    (axes,) = figure.axes
    found.draw(axes, 0)
    handles = found.legend_entries()
    if supports:
        held = snapshot.support_kinds(seen.normal)
        draw_supports(axes, seen, snapshot.positions, held)
        handles += support_legend(held)
    finish_layout(figure, slots, handles)
    keep_texts_inside(axes)
    return finish_figure(figure, path)


class ForceDiagrams:
    """Diagrams of a section force on all beams: a picture for each instant, in one scale.

    Args:
        found: `Snapshots` of the solution.
        snapshots: `Snapshot` of every picture, at the end of a phase, or of a `State`.
        of: name of the section force, such as "My".
        high: length of the largest value over the extent of the structure.
        view: `View` of the pictures.
        most: largest number of values that are written in a picture.
        apart: least distance of written values over the extent.
        least: least size of written values, over the largest value of all pictures.
        units: `Units` of written values; None for N, kN or MN.
        turns: whether the view becomes that of `view_of_ordinates`.

    Attributes:
        view: `View` of the pictures.
        largest: size of the largest value in all pictures, N or N m.
        unit: unit of the values that are written, such as "kN m".

    Raises:
        ValueError: an unknown force, a size that is not positive, or a structure without beams.
    """

    def __init__(
        self,
        found: Snapshots,
        snapshots: Sequence[Snapshot],
        of: str,
        high: float,
        view: View,
        most: int = _LABELS,
        apart: float = _APART,
        least: float = 0.0,
        units: Units | None = None,
        turns: bool = False,
    ):
        if of not in SECTION_FORCES.components:
            raise ValueError(f"of = {of!r}: expected one of {', '.join(SECTION_FORCES.components)}")
        if not high > 0:
            raise ValueError(f"high = {high!r}: must be positive")
        self.component, self.links = of, found.links
        self._along = [_BeamForces(found.parts, snapshot, of) for snapshot in snapshots]
        self.largest = max(each.largest for each in self._along)
        if turns:
            view = self._along[-1].view_of_ordinates(view)
        self.view = view
        unit = "N m" if of in MOMENTS else "N"
        self._factor, self.unit = display_unit(self.largest, unit, units)
        scale = high * max(each.extent for each in self._along) / max(self.largest, 1e-300)
        self._tips = [each.value_tips(view, scale) for each in self._along]
        self._labels = apart, most, least * self.largest

    def points(self) -> Float[np.ndarray, "n 3"]:
        """Return the ends of the ordinates of all values in all pictures, [n, 3], m."""
        return np.concatenate([tips.reshape(-1, 3) for tips in self._tips])

    def draw(self, axes: Any, number: int) -> None:
        """Draw picture `number`: elements, areas between beams and values, the largest numbers."""
        along, tips, view = self._along[number], self._tips[number], self.view
        along.draw(axes, view, self.links, tips)
        apart, *others = self._labels
        limits: Any = apart * along.extent, *others
        write_largest_values(axes, view, (along.base, tips), along.values, self._factor, limits)

    def legend_entries(self) -> list[Any]:
        """Return legend entries for the colors of positive and of negative values that occur."""
        signed = (("positive", 1.0), ("negative", -1.0))
        found: list[Any] = [
            Patch(color=_COLORS[name], alpha=0.6, label=f"{self.component} {name} ({self.unit})")
            for name, sign in signed
            if any((sign * each.values > each.least).any() for each in self._along)
        ]
        return found + (side_legend(self.component) if found else [])


class _BeamForces:
    """A section force along all active beams at one instant, as ordinates across the beams.

    Args:
        parts: `GroupTopology` of every group of elements.
        snapshot: `Snapshot` at the end of a phase, or of a `State`.
        of: name of the section force, such as "My".

    Attributes:
        values: at places along the beams, [n_beam, n_place], N or N m; zero where it is rounding.
        base: these places, on the axes of the beams, [n_beam, n_place, 3], m.
        largest: size of the largest value.
        extent: largest side of the bounding box of the structure, m.

    Raises:
        ValueError: the structure has no beams.
    """

    def __init__(self, parts: Sequence[GroupTopology], snapshot: Snapshot, of: str):
        self.snapshot, positions, curves = snapshot, snapshot.positions, snapshot.curves
        end: Any = snapshot.end  # not of an increment
        places = _places_with_jumps(end, len(parts))
        forces, ends, number = forces_along_beams(parts, end, places)
        if not len(number):
            raise ValueError("solution: has no beams, and so no section forces")
        kept = snapshot.forces.present[number]
        forces, ends, number = forces[kept], ends[kept], number[kept]
        alike = slice(3, 6) if of in MOMENTS else slice(0, 3)
        self.least = NEGLIGIBLE * float(np.abs(forces[..., alike]).max(initial=0.0))
        values = forces[..., SECTION_FORCES.components.index(of)]
        self.values = np.where(np.abs(values) > self.least, values, 0.0)
        self.largest = float(np.abs(self.values).max(initial=0.0))
        self.extent = float(np.ptp(snapshot.points(), axis=0).max())
        self._chord = positions[ends]
        part = places[:, None]
        self.base = (1 - part) * self._chord[:, :1] + part * self._chord[:, 1:]
        axes = default_section_axes(self._chord)
        if curves is not None and np.isin(number, curves.element[: len(curves.axes)]).all():
            rows = curves.indices_of_elements(number)
            self.base = self.base + hermite_cubic(curves.bend[rows], places)
            axes = curves.axes[rows]
        self._sides = positive_side_directions(axes, self._chord, of)

    def view_of_ordinates(self, view: View) -> View:
        """Return the elevation that shows the ordinates of upright beams, or else `view`."""
        return view_of_ordinates(view, self._chord, self._sides)

    def value_tips(self, view: View, scale: float) -> Float[np.ndarray, "n_beam n_place 3"]:
        """Return the ends of the ordinates of all values in a view, m.

        `scale` is the length of an ordinate over its value, m/N or 1/N.
        """
        sides = side_directions_in_picture(self._sides, self._chord[:, 1] - self._chord[:, 0], view)
        return self.base + scale * self.values[..., None] * sides[:, None]

    def draw(
        self, axes: Any, view: View, links: Links, tips: Float[np.ndarray, "n_beam n_place 3"]
    ) -> None:
        """Draw the lines of all elements, and areas between the beams and the ends of ordinates."""
        shown = self.snapshot
        every = picture_lines(view, shown.positions, links, shown.curves)
        plain = select_lines(every, shown.forces.present[links[1]])
        view.add_lines(axes, plain, colors=GHOST, linewidths=1.0, zorder=1)
        base, top = view.project(self.base), view.project(tips)
        view.add_lines(axes, base, colors=INK, linewidths=1.4, zorder=4)
        view.add_lines(axes, top, colors=INK, linewidths=0.7, zorder=3)
        quads = np.stack([base[:, :-1], base[:, 1:], top[:, 1:], top[:, :-1]], axis=2)
        mean = 0.5 * (self.values[:, :-1] + self.values[:, 1:])
        for sign, alike in (("positive", mean > self.least), ("negative", mean < -self.least)):
            if alike.any():
                look: Any = {"facecolors": _COLORS[sign], "edgecolors": "none", "alpha": 0.6}
                view.add_faces(axes, quads[alike], zorder=2, **look)


def _places_with_jumps(end, count):
    """Return evenly spaced places along beams, from 0 to 1, and both sides of concentrated loads.

    `end` is the `State` or `PhaseResult` that has the loads, and `count` the number of groups.
    """
    places = np.linspace(0.0, 1.0, PLACES)
    loads = (end.results or {}).get(POINT_LOADS.name)
    for own in values_by_group(loads, count):
        if own is None:
            continue
        own = np.asarray(own)
        acts = np.abs(own[..., 1:]).max(axis=-1) > 0
        at = np.unique(own[..., 0][acts])
        at = at[(at > 0) & (at < 1)]
        if len(at) <= _MOST_JUMPS:
            places = np.concatenate([places, at, np.minimum(at + 1e-9, 1.0)])
    return np.unique(places)


def forces_along_beams(
    parts: Sequence[GroupTopology], end: State | PhaseResult, places: Float[np.ndarray, " n_place"]
) -> tuple[
    Float[np.ndarray, "n_beam n_place 6"], Int[np.ndarray, "n_beam 2"], Int[np.ndarray, " n_beam"]
]:
    """Return section forces at places along all beams.

    Args:
        parts: `GroupTopology` of every group of elements.
        end: `State` or `PhaseResult` that has the section forces.
        places: along each beam, from 0 to 1.

    Returns:
        forces: N, Vy, Vz, T, My, Mz at the places, [n_beam, n_place, 6], N and N m.
        ends: node numbers of the beams, [n_beam, 2].
        numbers: index of each beam, counted through the elements of all groups, [n_beam].
    """
    found, ends = [np.zeros((0, len(places), 6))], [np.zeros((0, 2), int)]
    numbers, count = [np.zeros(0, int)], 0
    own = values_by_group(end.section_forces, len(parts))
    loads = values_by_group((end.results or {}).get(POINT_LOADS.name), len(parts))
    along = interpolate_recorded_forces(parts, own, end.positions, places, loads)
    for part, values in zip(parts, along, strict=True):
        size = len(part.links.array)
        if values is not None:
            found.append(np.asarray(values))
            ends.append(end_nodes(part))
            numbers.append(count + np.arange(size))
        count += size
    return np.concatenate(found), np.concatenate(ends), np.concatenate(numbers)
