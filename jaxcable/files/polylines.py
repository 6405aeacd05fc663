"""Make a net of the polylines of a drawing: points that are close become one node."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy  # its parts are imported where they are first used
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..common.types import Float
from .nets import Net
from .omissions import Omissions
from .reading import FileError

_LARGEST_COORDINATE = 1e12  # largest coordinate, m; squares of distances are useless beyond it
_MOST_NEIGHBORS = 50  # points within the tolerance of one, on average; more is a wrong scale


class Polyline(NamedTuple):
    """A chain of straight lines from point to point, as read from a file.

    Attributes:
        where: its place in the file, in words.
        group: name of the group that its lines belong to.
        points: indices of its points in order, from 0.
        may_repeat: whether lines of others may coincide with its lines, as faces share their edges.
    """

    where: str
    group: str
    points: Sequence[int]
    may_repeat: bool = False


def net_from_polylines(
    places: Float[np.ndarray, "n_point 3"],
    polylines: Sequence[Polyline],
    tolerance: float,
    table: Omissions,
    word: str,
) -> Net:
    """Make the `Net` of lines between points; nodes are named after points, numbered from 1.

    Points that no line touches, and lines between nodes that are joined already, are left out.

    Args:
        places: positions of the points, m.
        polylines: the lines.
        tolerance: largest distance of points that become one node, m.
        table: table of omissions, which counts what is left out.
        word: what the file calls a line, for this table.

    Raises:
        FileError: a line without length, coordinates too large, too many points too near.
    """
    if not np.abs(places).max() < _LARGEST_COORDINATE:
        raise FileError(f"coordinates beyond {_LARGEST_COORDINATE:.0e} m; is the scale right?")
    node = _merge_points(places, tolerance)
    found: dict[tuple[int, int], tuple[int, int, str]] = {}
    for line in polylines:
        for first, second in itertools.pairwise(node[line.points].tolist()):
            if first == second:
                raise FileError(f"{line.where}: the line has no length")
            pair = min(first, second), max(first, second)
            if pair in found and not line.may_repeat:
                table.add(f"{word} that occurs again", line.where)
            found.setdefault(pair, (first, second, line.group))
    links: np.ndarray = np.array([(i, j) for i, j, _ in found.values()], np.int32)
    used, links = np.unique(links, return_inverse=True)  # drop points without a line
    links = links.reshape(-1, 2).astype(np.int32)
    origin = np.unique(node, return_index=True)[1]
    for k in np.flatnonzero(~np.isin(node, used)).tolist():
        table.add("point that no line touches", f"point {k + 1}")
    return Net(
        nodes=places[origin][used],
        links=links,
        fixed=np.zeros((len(used), 3), bool),
        kinds=("cable",) * len(links),
        groups=tuple(label for *_, label in found.values()),
        names=tuple(str(k + 1) for k in origin[used]),
    )


def _merge_points(places, tolerance):
    """Return the node of each point, [n_point]; points within `tolerance`, m, become one node."""
    distinct, which = np.unique(places, axis=0, return_inverse=True)
    tree = scipy.spatial.cKDTree(distinct)
    if tree.count_neighbors(tree, tolerance) > _MOST_NEIGHBORS * len(distinct):
        raise FileError(f"too many points closer than {tolerance} m; is the scale right?")
    pairs = tree.query_pairs(tolerance, output_type="ndarray")
    size = (len(distinct),) * 2
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=size)
    label = connected_components(graph, directed=False)[1][which.ravel()]
    first = np.unique(label, return_index=True)[1]
    order = np.empty(len(first), int)
    order[np.argsort(first)] = np.arange(len(first))
    return order[label]
