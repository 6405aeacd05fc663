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
        """Return the nodal loads that replace the loads of edges and faces, [n_node, 3], N.

        Half of the load of an edge acts at each end. Each side of a face takes the load on the
        triangle between it and the mean of the corners, half of it at each end.
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


def add_missing_distributed_loads(
    nodal_loads: Float[np.ndarray, "n_node 3"],
    distributed: DistributedLoads,
    force_densities: Float[np.ndarray, " n_edge"],
    supported: Bool[np.ndarray, " n_node"],
    table: Omissions,
) -> Float[np.ndarray, "n_node 3"]:
    """Return nodal loads with those of edges and faces added, unless they contain these already.

    Files of results may state the loads of edges and faces twice: as such, and in the loads of
    nodes. This is so if the loads of nodes alone balance the force densities at all free nodes;
    then `nodal_loads` is returned unchanged.

    Args:
        nodal_loads: loads of nodes in the file, [n_node, 3], N.
        distributed: loads of edges and faces.
        force_densities: of the edges in the file, [n_edge], N/m, zero for none; all zero: loads are
            added.
        supported: whether a support holds a node, [n_node].
        table: table of omissions, which counts loads that are not added.

    Returns:
        [n_node, 3], N.
    """
    more = distributed.to_nodes()
    free = ~supported
    size = np.abs(more[free]).max(initial=0.0)
    if nodal_loads[free].any() and force_densities.any() and size > 0:
        rest = nodal_loads.copy()
        ends = distributed.nodes[distributed.links]
        pull = force_densities[:, None] * (ends[:, 1] - ends[:, 0])
        np.add.at(rest, distributed.links[:, 0], pull)
        np.add.at(rest, distributed.links[:, 1], -pull)
        if np.abs(rest[free]).max() <= _BALANCED * size:
            why = "in the loads of nodes already, which are in balance with q"
            table.add("load of an edge", "", why, int(distributed.on_edges.any(axis=1).sum()))
            table.add("load of a face", "", why, int(distributed.on_faces.any(axis=1).sum()))
            return nodal_loads
    return nodal_loads + more
