"""Symbols at nodes: marks for supports, arrows for loads and reactions."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ..common.types import ArrayLike, Bool, Float
from .style import INK, LOAD, REACTION, force_text
from .views import View

_ARROW = 0.14  # length of the longest arrow over the extent of the structure, for few arrows
_SMALL = 1e-9  # force over the largest one up to which it is not drawn
HELD = (("s", INK, "clamped"), ("^", INK, "pinned"), ("^", "white", "held in part"))
"""Mark, filling and name of the kinds of supports."""


def supports(
    fixed: Bool[np.ndarray, "n_node n_freedom"],
    rotates: Bool[np.ndarray, " n_node"] | None = None,
    normal: Float[np.ndarray, " 3"] | None = None,
) -> Bool[np.ndarray, "3 n_node"]:
    """Which nodes are clamped, which pinned, which held in part, [3, n_node] bool.

    Args:
        fixed: held freedoms, [n_node, 3 or 6].
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
    return np.stack([clamped, all_three & ~clamped, in_part])


def draw_supports(
    axes: Axes,
    view: View,
    positions: Float[np.ndarray, "n_node 3"],
    kinds: Bool[np.ndarray, "3 n_node"],
) -> list[Line2D]:
    """Draw marks at the supports, of the kinds that `supports` returns; a list of these marks."""
    marks = []
    seen, size = view.project(positions), mark_size(len(positions))
    for (mark, filling, _), nodes in zip(HELD, kinds, strict=True):
        if nodes.any():
            look: dict[str, Any] = {
                "markerfacecolor": filling,
                "markeredgecolor": INK,
                "markersize": size,
            }
            marks += axes.plot(*seen[nodes].T, mark, markeredgewidth=0.8, zorder=5, **look)
    return marks


def support_keys(kinds: Bool[np.ndarray, "3 n_node"]) -> list[Line2D]:
    """Legend entries of the kinds of supports that occur."""
    return [
        Line2D([], [], linestyle="", marker=mark, markerfacecolor=filling, markeredgecolor=INK,
               markersize=6, label=name)
        for (mark, filling, name), nodes in zip(HELD, kinds, strict=True)
        if nodes.any()
    ]  # fmt: skip


class Arrows:
    """Forces on nodes as arrows, drawn to a common scale.

    Args:
        name: name in the legend.
        forces: forces on all nodes, [n_node, 3], N.
        positions: positions of all nodes, [n_node, 3], m.
        extent: size of the structure, m.
        push: whether the arrows end at their nodes (loads) or begin there (reactions).
    """

    def __init__(
        self,
        name: str,
        forces: Float[ArrayLike, "n_node 3"],
        positions: Float[np.ndarray, "n_node 3"],
        extent: float,
        push: bool,
    ):
        forces = np.asarray(forces)
        size = np.linalg.norm(forces, axis=1)
        self.largest = float(size.max(initial=0.0))
        shown = size > _SMALL * self.largest
        self.name, self.colour = name, LOAD if push else REACTION
        length = extent * min(_ARROW, 0.8 / np.sqrt(max(shown.sum(), 1)))
        self.vectors = forces[shown] * (length / max(self.largest, 1e-300))
        self.tails = positions[shown] - (self.vectors if push else 0.0)
        self.ends = np.concatenate([self.tails, self.tails + self.vectors])

    def draw(self, axes: Axes, view: View) -> None:
        """Draw the arrows in the axes of a view."""
        if not len(self.tails):
            return
        tails, vectors = view.project(self.tails), view.project(self.vectors)
        width = float(np.clip(1.4 * np.sqrt(40.0 / len(tails)), 0.3, 1.4))
        look: dict[str, Any]
        if view.flat:
            look = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "units": "dots"}
            dots = width * axes.figure.dpi / 72
            axes.quiver(*tails.T, *vectors.T, color=self.colour, width=dots, zorder=6, **look)
        else:
            look = {"arrow_length_ratio": 0.3, "linewidth": width, "zorder": 6}
            axes.quiver(*tails.T, *vectors.T, color=self.colour, **look)

    def keys(self) -> list[Line2D]:
        """The legend entry, with the force of the longest arrow; an empty list without arrows."""
        if not len(self.tails):
            return []
        label = f"{self.name}, longest {force_text(self.largest)}"
        look: dict[str, Any] = {"color": self.colour, "marker": "$\\rightarrow$", "markersize": 14}
        return [Line2D([], [], linestyle="", label=label, **look)]


def mark_size(n: int) -> float:
    """Size of marks in a picture of `n` nodes, points."""
    return float(np.clip(6.0 * np.sqrt(40.0 / max(n, 1)), 1.5, 6.0))
