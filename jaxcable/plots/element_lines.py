"""Elements as colored lines and faces; slack lines are dashed, compressed ones have a casing."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke

from ..common.negligible import NEGLIGIBLE
from ..common.types import Bool, Float
from ..common.units import Units
from .element_curves import Links, picture_lines, select_lines
from .element_forces import ColoredValues, ElementForces
from .snapshots import Snapshot, Snapshots
from .style import GHOST, INK, SLACK, color_map, display_unit, format_value
from .views import View

DASHES = (0, (3, 1.5))
_SWAMPED = (
    0.01,
    0.25,
)  # largest force of a group over that of all, with which groups have own colors
_DIGITS = 1e-3  # of the largest force of a group: less is zero in the legend
_MANY = 1 / 3  # share of the elements that are in such groups
_REACHED = 1e-6  # utilization above 1 that is rounding: the breaking force is just reached


class ColorScale:
    """The color scale of elements that several pictures share.

    Where the forces of many elements are small beside those of other groups, colors are shares of
    the largest force of each group, and the legend has the forces.

    Args:
        forces: `ElementForces` of the pictures, or `ColoredValues`.
        units: `Units` of the numbers; None for SI, of which forces are in N, kN or MN.
        one_scale: whether colors are forces in any case.

    Attributes:
        factor: factor from the values to the numbers of texts and, but for shares, the color bar.
        name, unit: name of the values, and the unit of these numbers.
        label: label of the color bar, with unit.
        look: color map and norm, as arguments of matplotlib's collections.
    """

    def __init__(
        self,
        forces: Sequence[ElementForces | ColoredValues],
        units: Units | None = None,
        one_scale: bool = False,
    ):
        color = forces[0].color
        segments = [f.segments for f in forces if isinstance(f, ElementForces)]
        forces = [*forces, *(own for own in segments if own is not None)]
        values = np.concatenate([f.value for f in forces])
        values = values[np.isfinite(values)] if np.isfinite(values).any() else np.zeros(1)
        low, high = float(values.min(initial=np.inf)), float(values.max(initial=-np.inf))
        cmap: Any = color_map()
        self.name, self.unit = color.replace("_", " "), "%"
        self._ranges = None
        if color == "utilization":
            # the bar is from 0 to 100 % whatever occurs; what is more has another color, named
            # with a margin for rounding: a force that has been brought to the strength is not over
            self.factor, self.label = 100.0, "force / breaking force (%)"
            if high > 1.0 + _REACHED:
                cmap.colorbar_extend = "max"
                self.label += f", largest {100 * high:.{4 if high > 1.01 else 6}g} %"
            low, high = 0.0, 100.0 * (1.0 + _REACHED)
        else:
            most = max(abs(low), abs(high))
            self.factor, self.unit = display_unit(most, forces[0].unit, units)
            signed = ""
            if color == "tension" and low < -NEGLIGIBLE * most:
                self.name, signed = "axial force", ", tension positive"
            self.label = f"{self.name} ({self.unit})".removesuffix(" ()") + signed
            low, high = self.factor * low, self.factor * high
            by_group = color == "tension" and not one_scale
            self._ranges = _force_ranges_by_group(forces) if by_group else None
            if self._ranges is not None:
                self._labels = forces[0].labels
                self.label, low, high = f"{self.name}, % of the largest of its group", 0.0, 100.0
            if high - low <= 1e-9 * max(abs(high), 1.0):
                width = max(0.05 * abs(high), 1e-3)
                low, high = low - width, high + width
        self.look = {"cmap": cmap, "norm": Normalize(low, high)}

    def numbers(self, forces: ElementForces | ColoredValues) -> Float[np.ndarray, " n_elem"]:
        """Return the numbers on the color bar of all elements in one of the pictures, [n_elem].

        Of `ElementForces.segments` they are those of all pieces, [n_piece].
        """
        if self._ranges is None:
            return self.factor * forces.value
        sizes = np.maximum(np.abs(self._ranges).max(axis=1), 1e-300)
        # divided first: no share is above 100, which is where the color of excess begins
        return 100.0 * (np.abs(forces.value) / sizes[forces.group])

    def legend_entries(self) -> list[Line2D]:
        """Return legend entries with the range of forces of each group, if colors are shares.

        Otherwise the list is empty.
        """
        if self._ranges is None:
            return []
        texts = [
            f"{label}: {' to '.join(dict.fromkeys(map(format_value, ends)))} {self.unit}"
            for label, ends in zip(self._labels, self.factor * self._ranges, strict=True)
            if np.isfinite(ends[0])
        ]
        return [Line2D([], [], linestyle="", label=text) for text in texts]


def _force_ranges_by_group(forces):
    """Return the smallest and largest value of each group in all pictures, [n_group, 2], or None.

    None, for one common scale, unless more than a third of the elements are in groups whose forces
    are small beside those of another group. Groups without values have NaN.
    """
    values, group = (np.concatenate([getattr(f, x) for f in forces]) for x in ("value", "group"))
    own = [values[group == k] for k in range(len(forces[0].labels))]
    known = [x[np.isfinite(x)] for x in own]
    ranges = np.array([[x.min(), x.max()] if len(x) else [np.nan, np.nan] for x in known])
    sizes = np.abs(ranges).max(axis=1)
    most = np.nanmax(sizes, initial=0.0)
    small = (sizes > _SWAMPED[0] * most) & (sizes < _SWAMPED[1] * most)
    if small[forces[0].group].mean() <= _MANY:
        return None
    return np.where(np.abs(ranges) < _DIGITS * sizes[:, None], 0.0, ranges)


class ElementLines:
    """The lines and faces of all elements in axes; `show` changes them from frame to frame.

    Args:
        axes: matplotlib axes to draw in.
        view: `View` of these axes.
        snapshots: `Snapshots`, which know the pieces and the faces of elements.
        scale: `ColorScale` of the colors.
    """

    def __init__(self, axes: Axes, view: View, snapshots: Snapshots, scale: ColorScale):
        self.view, self.faces, self.scale = view, snapshots.faces, scale
        self.all_links = snapshots.links
        # faces are drawn with their edges
        self.lines = lines = ~np.isin(snapshots.links[1], self.faces[1])
        self.links = snapshots.links[0][lines], snapshots.links[1][lines]
        width = line_width(len(self.links[0]))
        add = functools.partial(view.add_lines, axes, np.zeros((0, 2, 2 if view.flat else 3)))
        self.casing = add(colors="black", linewidths=2.2 * width, zorder=2)
        self.taut = add(linewidths=width, zorder=3, **scale.look)
        thin = max(0.75 * width, 0.8)
        self.slack = add(colors=SLACK, linewidths=thin, linestyles=DASHES, zorder=4)
        if len(self.faces[0]):  # what is behind remains visible
            edges = {"edgecolors": INK, "linewidths": 0.25 * width}
            self.surface = view.add_faces(axes, [], alpha=0.6, zorder=1.5, **edges, **scale.look)

    def show(self, snapshot: Snapshot) -> None:
        """Draw the elements as they are in a `Snapshot`, in place of what was drawn before."""
        forces, element = snapshot.forces, self.links[1]
        drawn = picture_lines(self.view, snapshot.positions, self.all_links, snapshot.curves)
        drawn = select_lines(drawn, self.lines)
        slack, compressed = forces.slack[element], forces.compressed[element]
        numbers = self.scale.numbers(forces)[element]
        if forces.segments is not None:
            own, of_segments = (
                values[self.lines]
                for values in (forces.segments.value, self.scale.numbers(forces.segments))
            )
            slack, numbers = slack | (own <= 0), np.where(np.isnan(own), numbers, of_segments)
        taut = forces.present[element] & ~slack
        self.casing.set_segments(select_lines(drawn, compressed))
        self.taut.set_segments(select_lines(drawn, taut))
        self.taut.set_array(numbers[taut])
        self.slack.set_segments(select_lines(drawn, slack))
        corners, element = self.faces
        if len(corners):
            there = forces.present[element]
            self.surface.set_verts(self.view.project(snapshot.positions)[corners[there]])
            self.surface.set_array(self.scale.numbers(forces)[element][there])


def draw_earlier_geometry(
    axes: Axes,
    view: View,
    links: Links,
    snapshot: Snapshot,
    which: Bool[np.ndarray, " n_elem"] | bool = True,
) -> None:
    """Draw the elements at an earlier instant, in thin dashed lines behind the picture.

    Elements whose shape is not known then are left out, as are those for which `which` is False.
    """
    found = picture_lines(view, snapshot.positions, links, snapshot.curves)
    segments = select_lines(found, (snapshot.has_known_shape() & which)[links[1]])
    width = min(1.0, line_width(len(links[0])))
    view.add_lines(axes, segments, colors=GHOST, linewidths=width, linestyles="dashed", zorder=1)


def line_width(n: int) -> float:
    """Return the line width, in points, for a picture of `n` lines: thinner if there are many."""
    return float(np.clip(2.4 * np.sqrt(80.0 / max(n, 1)), 0.6, 2.4))


def line_legend(
    forces: Sequence[ElementForces],
    before: bool = False,
    counted: bool = True,
    earlier: str = "before",
) -> list[Line2D]:
    """Return legend entries for the ways in which elements are drawn in some pictures.

    These are an earlier geometry, slack and compressed elements, and elements without a value.

    Args:
        forces: `ElementForces` of the pictures; slack elements are counted in the last one.
        before: whether an earlier geometry is drawn.
        counted: whether to add the number of slack elements.
        earlier: what the earlier geometry is called.
    """
    found = []
    if before:
        found.append(Line2D([], [], color=GHOST, linewidth=1.0, linestyle="--", label=earlier))
    if any(f.slack.any() for f in forces):
        last = forces[-1]
        label = (
            f"slack ({int(last.slack.sum())} of {int(last.present.sum())})" if counted else "slack"
        )
        found.append(Line2D([], [], color=SLACK, linewidth=1.6, linestyle=DASHES, label=label))
    if any(f.compressed.any() for f in forces):
        cased = [Stroke(linewidth=4.4, foreground="black"), Normal()]
        look: Any = {"color": "white", "linewidth": 2.0}  # inside is the color of the force
        found.append(Line2D([], [], path_effects=cased, label="compression", **look))
    if any((np.isnan(f.value) & np.isfinite(f.tension) & f.present).any() for f in forces):
        what = (
            "no breaking force given" if forces[0].color == "utilization" else "without this result"
        )
        found.append(Line2D([], [], color="0.6", linewidth=2.0, label=what))
    return found
