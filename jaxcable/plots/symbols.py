"""Symbols on a structure: marks for supports, arrows for forces, axes of sections."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ..common.negligible import NEGLIGIBLE
from ..common.types import ArrayLike, Bool, Float, Int
from ..common.units import Units
from ..elements.element import Element
from ..model.topology import GroupTopology, nodes_with_elements
from .style import AXES, INK, LOAD, REACTION, format_force
from .views import View

# sizes in a picture 10 cm wide: larger symbols hide elements, smaller ones are lost in print
_ARROW = 0.14  # length of the longest arrow over the extent of the structure, for few arrows
_SHARE = 0.3  # what it takes of the structure's size in each direction of the picture, at most
_LEAST = {True: 0.15, False: 0.4}  # least of these sizes over the extent, in flat views and space
_MOST = 250  # arrows of a kind; more would touch: the largest in each cell of a grid are drawn
_ON = 0.9  # cosine between arrow and element above which one hides the other: some 25 degrees
_AXIS = 0.05  # length of the axes of a section over the extent of the structure, at most
_AXIS_SHARE = 0.4  # and over the length of the beam
SUPPORT_MARKS = (
    ("s", INK, "clamped"),
    ("^", INK, "pinned"),
    ("^", "white", "partially supported"),
    ("D", "white", "on a spring or bearing"),
)
"""Mark, filling and name of the kinds of supports."""


def support_kinds(
    fixed: Bool[np.ndarray, "n_node n_freedom"],
    on_ground: Bool[np.ndarray, " n_node"],
    rotates: Bool[np.ndarray, " n_node"] | None = None,
    normal: Float[np.ndarray, " 3"] | None = None,
) -> Bool[np.ndarray, "4 n_node"]:
    """Return which nodes are clamped, pinned, partially held or on springs, [4, n_node] bool.

    Args:
        fixed: which degrees of freedom supports hold, [n_node, 3 or 6].
        on_ground: which nodes have springs to the ground or bearings, [n_node].
        rotates: which nodes have rotations, [n_node] bool; None if unknown: no node is clamped.
        normal: unit normal vector of a plane structure, [3]; a support along it alone, as nodes of
            plane structures have, does not count.
    """
    all_three = fixed[:, :3].all(axis=1)
    clamped = np.zeros_like(all_three)
    if rotates is not None and fixed.shape[1] == 6:
        clamped = all_three & rotates & fixed[:, 3:].all(axis=1)
    in_part = fixed[:, :3].any(axis=1) & ~all_three
    if normal is not None:
        in_part &= (fixed[:, :3] & (np.abs(normal) < 0.5)).any(axis=1)
    supported = all_three | in_part
    return np.stack([clamped, all_three & ~clamped, in_part, on_ground & ~supported])


def supported_nodes(
    parts: Sequence[Element | GroupTopology],
    present: Bool[np.ndarray, " n_elem"],
    fixed: Bool[np.ndarray, "n_node n_freedom"],
) -> tuple[Bool[np.ndarray, "n_node n_freedom"], Bool[np.ndarray, " n_node"]]:
    """Return supported degrees of freedom of nodes with active elements, and nodes on springs.

    Args:
        parts: element groups, or the parts of a `Topology`.
        present: which elements of all groups are active.
        fixed: degrees of freedom that supports fix, [n_node, 3 or 6] bool.

    Returns:
        What is fixed, [n_node, n_freedom] bool; which nodes have active springs to the ground or
        bearings, [n_node] bool.
    """
    ends = np.cumsum([len(part.links) for part in parts])[:-1]
    split, on_ground = np.split(present, ends), np.zeros(len(fixed), bool)
    for part, there in zip(parts, split, strict=True):
        if part.links.shape[1] == 1:
            on_ground[part.links.array[there]] = True
    active = nodes_with_elements(parts, len(fixed), None, split)
    return fixed & (active | ~nodes_with_elements(parts, len(fixed)))[:, None], on_ground


def draw_supports(
    axes: Axes,
    view: View,
    positions: Float[np.ndarray, "n_node 3"],
    kinds: Bool[np.ndarray, "4 n_node"],
) -> list[Line2D]:
    """Draw marks at the supports, and return these marks.

    `kinds` are those of `Snapshot.support_kinds`, [4, n_node] bool.
    """
    marks = []
    seen, size = view.project(positions), mark_size(len(positions))
    for (mark, filling, _), nodes in zip(SUPPORT_MARKS, kinds, strict=True):
        if nodes.any():
            look: dict[str, Any] = {
                "markerfacecolor": filling,
                "markeredgecolor": INK,
                "markersize": size,
            }
            marks += axes.plot(*seen[nodes].T, mark, markeredgewidth=0.8, zorder=5, **look)
    return marks


def support_legend(kinds: Bool[np.ndarray, "4 n_node"]) -> list[Line2D]:
    """Return legend entries of the kinds of supports that occur.

    `kinds` are those of `Snapshot.support_kinds`, [4, n_node] bool.
    """
    return [
        Line2D([], [], linestyle="", marker=mark, markerfacecolor=filling, markeredgecolor=INK,
               markersize=6, label=name)
        for (mark, filling, name), nodes in zip(SUPPORT_MARKS, kinds, strict=True)
        if nodes.any()
    ]  # fmt: skip


class ForceArrows:
    """Forces on nodes as arrows in a common scale.

    The longest arrow is a fixed fraction of the extent of the structure, shorter if there are many
    arrows, and takes at most 30 % of the size of the structure in each direction of the picture.

    Args:
        name: what a force is, for the legend: "load" or "reaction".
        forces: forces on all nodes, [n_node, 3], N.
        positions: positions of all nodes, [n_node, 3], m.
        view: `View` of the picture.
        points: all points of the structure that are drawn, [n, 3], m.
        links: node numbers of the pieces that are drawn, [n_piece, 2].
        push: whether the arrows end at their nodes (loads) or begin there (reactions). An arrow
            that would lie on an element lies on the other side of its node; if it would lie on one
            there, too, it is drawn under the elements.
        units: `Units` of the largest force in the legend; None for N, kN or MN.
        negligible: size up to which a force is not drawn, N; nor is what is `NEGLIGIBLE` beside
            the largest force.

    Attributes:
        tails, vectors: start points and vectors of the arrows, [n_arrow, 3], m.
        under: which arrows are drawn under the elements, [n_arrow] bool.
        ends: start points and tips, [2 n_arrow, 3], m.
        largest: size of the largest force, N.
        count: number of forces.
    """

    def __init__(
        self,
        name: str,
        forces: Float[ArrayLike, "n_node 3"],
        positions: Float[np.ndarray, "n_node 3"],
        view: View,
        points: Float[np.ndarray, "n 3"],
        links: Int[np.ndarray, "n_piece 2"],
        push: bool,
        units: Units | None = None,
        negligible: float = 0.0,
    ):
        self.units = units
        forces = np.asarray(forces)
        size = np.linalg.norm(forces, axis=1)
        self.name, self.color = name, LOAD if push else REACTION
        self.largest = float(size.max(initial=0.0))
        node = np.flatnonzero(size > max(NEGLIGIBLE * self.largest, negligible))
        self.count = len(node)
        extent = np.ptp(points, axis=0).max()
        if len(node) > _MOST:
            node = _largest_forces_in_cells(positions, size, node)
        self.vectors = forces[node] * _arrow_scale(forces[node], view, points, extent)
        seen = view.project(forces[node]), node, view.project(positions), links
        outward, self.under = _choose_arrow_sides(*seen, push)
        self.tails = positions[node] - np.where(outward[:, None], 0.0, self.vectors)
        self.ends = np.concatenate([self.tails, self.tails + self.vectors])

    def draw(self, axes: Axes, view: View) -> None:
        """Draw the arrows in axes that have this `View`."""
        if not len(self.tails):
            return
        tails, vectors = view.project(self.tails), view.project(self.vectors)
        width = float(np.clip(1.4 * np.sqrt(40.0 / len(tails)), 0.5, 1.4))
        look: dict[str, Any] = {"arrow_length_ratio": 0.3, "linewidth": width}
        if view.flat:
            look = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "units": "dots"}
            look |= {"width": width * axes.figure.dpi / 72, "headwidth": 4.0}
        for which, order in ((self.under, 1.5), (~self.under, 6)):
            if which.any():
                parts = *tails[which].T, *vectors[which].T
                axes.quiver(*parts, color=self.color, zorder=order, **look)

    def legend_entries(self) -> list[Line2D]:
        """Return the legend entry with the size of the largest force; [] without arrows."""
        if not len(self.tails):
            return []
        label = f"largest {self.name} {format_force(self.largest, self.units)}"
        if len(self.tails) < self.count:
            label += f", {len(self.tails)} of {self.count} drawn"
        look: dict[str, Any] = {"color": self.color, "marker": "$\\rightarrow$", "markersize": 14}
        return [Line2D([], [], linestyle="", label=label, **look)]


def _arrow_scale(forces, view, points, extent):
    """Return the length of arrows over the force, m/N, such that the longest has a suitable size.

    `forces` are those that get an arrow, [n, 3], N; `points` all points of the structure that are
    drawn, [n, 3], m; `extent` is the largest side of their bounding box, m.
    """
    longest = extent * min(_ARROW, 0.8 / np.sqrt(max(len(forces), 1)))
    seen = np.ptp(view.project(points), axis=0)
    room = _SHARE * np.maximum(seen, _LEAST[view.flat] * extent * view.scale)
    parts = np.abs(view.project(forces)).max(axis=0, initial=0.0)
    largest = np.linalg.norm(forces, axis=1).max(initial=0.0)
    return min(longest / max(largest, 1e-300), *(room / np.maximum(parts, 1e-300)))


def _largest_forces_in_cells(positions, size, node):
    """Return the nodes with the largest force in each cell of a grid, at most 250, sorted.

    Args:
        positions: of all nodes, [n_node, 3], m.
        size: magnitude of the force on each node, [n_node], N.
        node: indices of nodes with a force.
    """
    place = positions[node] - positions.min(axis=0)
    node, place = (x[np.argsort(-size[node], kind="stable")] for x in (node, place))
    width, first = place.max() / np.sqrt(_MOST), np.arange(len(node))
    while len(first) > _MOST:
        cells = np.floor(place / width).astype(int)
        first = np.unique(cells, axis=0, return_index=True)[1]
        width *= 1.3
    return np.sort(node[first])


def _choose_arrow_sides(forces, node, positions, links, push):
    """Choose for each arrow a side of its node on which it covers no element, if there is one.

    Args:
        forces: forces in coordinates of the picture, [n_arrow, 2 or 3], N.
        node: their nodes, [n_arrow].
        positions: positions of all nodes in the picture, [n_node, 2 or 3], m.
        links: node numbers of the pieces that are drawn, [n_piece, 2].
        push: whether arrows usually end at their nodes (loads), or begin there (reactions).

    Returns:
        Whether each arrow begins at its node, and whether it covers an element, [n_arrow] bool.
    """
    row = np.full(len(positions), -1)
    row[node] = np.arange(len(node))
    unit = _unit_vectors(forces)
    on = np.full((2, len(node)), -1.0)  # largest cosine of an element with an arrow on either side
    for ends in (links, links[:, ::-1]):
        ends = ends[row[ends[:, 0]] >= 0]
        along = _unit_vectors(positions[ends[:, 1]] - positions[ends[:, 0]])
        cosine = (along * unit[row[ends[:, 0]]]).sum(axis=1)
        for side, sign in enumerate((-1.0, 1.0)):
            np.maximum.at(on[side], row[ends[:, 0]], sign * cosine)
    usual, other = (on if push else on[::-1]) > _ON
    turned = usual & ~other
    return (turned if push else ~turned), usual & other


def _unit_vectors(vectors):
    """Return vectors, [n, 2 or 3], scaled to length 1; zero vectors stay zero."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)


def section_axis_tips(
    middles: Float[np.ndarray, "n_beam 3"],
    directions: Float[np.ndarray, "n_beam 3 3"],
    chords: Float[np.ndarray, " n_beam"],
    extent: float,
) -> Float[np.ndarray, "n_beam 3 3"]:
    """Return the ends of the section axes x, y and z that are drawn at the middles of beams, m.

    Args:
        middles: middles of the beams, [n_beam, 3], m.
        directions: unit vectors of the axes, in rows, [n_beam, 3, 3].
        chords: lengths of the beams, [n_beam], m.
        extent: size of the structure, m.
    """
    length = np.minimum(_AXIS * extent, _AXIS_SHARE * chords)
    return middles[:, None] + length[:, None, None] * directions


def draw_section_axes(
    axes: Axes,
    view: View,
    middles: Float[np.ndarray, "n_beam 3"],
    tips: Float[np.ndarray, "n_beam 3 3"],
) -> None:
    """Draw the section axes of beams from their middles to `tips`; those seen end on as dots."""
    feet = view.project(middles)
    for k, color in enumerate(AXES):
        lines = np.stack([feet, view.project(tips[:, k])], axis=1)
        seen = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1)
        on_end = seen < 0.1 * view.scale * np.linalg.norm(tips[:, k] - middles, axis=1)
        view.add_lines(axes, lines[~on_end], colors=color, linewidths=1.2, zorder=7)
        if on_end.any():
            axes.plot(*feet[on_end].T, ".", color=color, markersize=3, zorder=8)


def section_axis_legend() -> list[Line2D]:
    """Return legend entries of the section axes x, y and z."""
    return [
        Line2D([], [], color=color, linewidth=1.6, label=f"section axis {name}")
        for name, color in zip("xyz", AXES, strict=True)
    ]


def mark_size(n: int) -> float:
    """Return the size of marks, in points, for a picture of `n` nodes: smaller if they are many."""
    return float(np.clip(6.0 * np.sqrt(40.0 / max(n, 1)), 1.5, 6.0))
