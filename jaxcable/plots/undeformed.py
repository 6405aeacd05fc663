"""A structure in its initial or another given geometry, as several pictures draw it."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection

from ..common.types import ArrayLike, Bool, Float
from ..common.units import SI, Units
from ..model.result_parts import straight_pieces
from ..model.structure import Structure
from .element_curves import Curves, picture_lines, select_lines
from .ordinates import view_of_ordinates
from .symbols import support_kinds, supported_nodes
from .views import View, choose_view


class UndeformedStructure:
    """A structure in its initial or a given geometry, and the view in which pictures draw it.

    Args:
        structure: `Structure`.
        view: "plan", "elevation", "space", or None for elevation of a structure in a vertical
            plane, else space.
        units: `Units` of the coordinates, None for SI.
        heights: factor on heights in an elevation, or None, as of `choose_view`.
        present: which elements are active, [n_elem] bool; None: all.
        moved: displacement of the nodes from the initial geometry to that drawn, [n_node, 3], m.

    Attributes:
        structure, units, view: as above; the view is a `View`.
        nodes: positions of its nodes, m.
        links, element, group: its straight pieces, as of `straight_pieces`.
        extent: its largest extent along an axis, m.
        held: which nodes with active elements are supported in which way, as of `support_kinds`.
    """

    def __init__(
        self,
        structure: Structure,
        view: str | None,
        units: Units | None,
        heights: float | None = 1.0,
        present: Bool[np.ndarray, " n_elem"] | None = None,
        moved: Float[ArrayLike, "n_node 3"] | float = 0.0,
    ):
        self.structure, self.units = structure, units
        self._is_stated = view is not None
        self.nodes: Float[np.ndarray, "n_node 3"] = np.asarray(structure.nodes, float) + moved
        self.view: View = choose_view(
            self.nodes, view, space=True, units=units or SI, heights=heights
        )
        self.links, self.element, self.group = straight_pieces(structure.groups)
        self.extent = float(np.ptp(self.nodes, axis=0).max())
        if present is None:
            present = np.ones(sum(len(group.links) for group in structure.groups), bool)
        fixed = np.asarray(structure.supports.fixed(structure.n_node))
        held = supported_nodes(structure.groups, present, fixed)
        self.held: Bool[np.ndarray, "4 n_node"] = support_kinds(
            *held, structure.rotating_nodes(), self.view.normal
        )

    def turn_view(
        self, ends: Float[np.ndarray, "n_beam 2 3"], sides: Float[np.ndarray, "n 3"]
    ) -> None:
        """Change `view` to that of `view_of_ordinates`, unless the user has asked for one."""
        if not self._is_stated:
            self.view = view_of_ordinates(self.view, ends, sides)

    def add_lines(
        self,
        axes: Any,
        positions: Float[np.ndarray, "... 3"],
        which: Bool[np.ndarray, " n_elem"],
        curves: Curves | None = None,
        **look: Any,
    ) -> LineCollection:
        """Draw elements, those for which `which` is True, as lines between their nodes.

        `positions` are those of the nodes, [n_node, 3], m; lines are straight without `curves`.
        """
        lines = picture_lines(self.view, positions, (self.links, self.element), curves)
        return self.view.add_lines(axes, select_lines(lines, which[self.element]), **look)
