"""Distribute loads of edges and faces to nodes, as force density programs do."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..common.types import Bool, Float, Int
from .omissions import Omissions

_BALANCED = 1e-3
"""Unbalanced force of nodes, over the largest load of edges and faces, that counts as balance.

Programs that work in single precision leave less; loads that are missing leave the whole of it.
"""


class DistributedLoads(NamedTuple):
    """Loads of the edges and faces of a net.

    Attributes:
        nodes: positions, [n_node, 3], m.
        links: node numbers of the edges, [n_edge, 2].
        on_edges: loads per length, [n_edge, 3], N/m.
        faces: node numbers around each face, a list of lists.
        on_faces: loads per area, [n_face, 3], N/m2.
    """

    nodes: Float[np.ndarray, "n_node 3"]
    links: Int[np.ndarray, "n_edge 2"]
    on_edges: Float[np.ndarray, "n_edge 3"]
    faces: list[list[int]]
    on_faces: Float[np.ndarray, "n_face 3"]

    def to_nodes(self) -> Float[np.ndarray, "n_node 3"]:
        """Return the nodal loads that the loads of edges and faces amount to, [n_node, 3], N.

        An edge gives half of its load to each end; the sides of a face take its load by areas.
        """
        found = np.zeros_like(self.nodes)
        ends = self.nodes[self.links]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        for side in (0, 1):
            np.add.at(found, self.links[:, side], 0.5 * lengths[:, None] * self.on_edges)
        for ring, load in zip(self.faces, self.on_faces, strict=True):
            if load.any():
                corners = self.nodes[ring]
                following = np.roll(corners, -1, axis=0)
                middle = corners.mean(axis=0)
                areas = 0.5 * np.linalg.norm(np.cross(corners - middle, following - middle), axis=1)
                for shares in (areas, np.roll(areas, 1)):  # of a side, at both of its ends
                    np.add.at(found, ring, 0.5 * shares[:, None] * load)
        return found


def add_distributed_loads(
    own: Float[np.ndarray, "n_node 3"],
    spread: DistributedLoads,
    densities: Float[np.ndarray, " n_edge"],
    held: Bool[np.ndarray, " n_node"],
    table: Omissions,
) -> Float[np.ndarray, "n_node 3"]:
    """Return the sum of the loads of nodes, and of edges and faces as nodal loads, [n_node, 3], N.

    Files of results may hold the loads of edges and faces twice: as such, and in the loads of
    nodes. This is so if the loads of nodes alone are in balance with the force densities; then
    `own` is returned.

    Args:
        own: loads of nodes in the file, [n_node, 3], N.
        spread: loads of edges and faces.
        densities: force densities of the edges, N/m; zero for none.
        held: whether a support holds a node.
        table: table of omissions, which counts loads that are not added.
    """
    more = spread.to_nodes()
    free = ~held
    size = np.abs(more[free]).max(initial=0.0)
    if own[free].any() and densities.any() and size > 0:
        rest = own.copy()
        ends = spread.nodes[spread.links]
        pull = densities[:, None] * (ends[:, 1] - ends[:, 0])
        np.add.at(rest, spread.links[:, 0], pull)
        np.add.at(rest, spread.links[:, 1], -pull)
        if np.abs(rest[free]).max() <= _BALANCED * size:
            why = "in the loads of nodes already, which are in balance with q"
            table.add("load of an edge", "", why, int(spread.on_edges.any(axis=1).sum()))
            table.add("load of a face", "", why, int(spread.on_faces.any(axis=1).sum()))
            return own
    return own + more
