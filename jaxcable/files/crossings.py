"""Where links of a drawing cross or touch in plan without a node, and how they are split there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..common.types import Bool, Float, Int

GAP = 0.25
"""Height between two links, over the length of the shorter one, up to which they are one net."""

_PARALLEL = 1e-9  # sine of the angle between lines that do not cross
_FINEST = 0.1  # least length of a piece in the search, over the mean length of the links


class Touching(NamedTuple):
    """Links with a node of another link on their inside, in plan.

    Attributes:
        link, node: numbers of both, [n].
        at: place of the node along the link, from 0 to 1, [n].
        off: distance of the node from the link, in plan, [n], m.
        above: height of the node above the link, [n], m.
        near: length of the link, or of the shortest link at the node if that is shorter, [n], m.
    """

    link: Int[np.ndarray, " n"]
    node: Int[np.ndarray, " n"]
    at: Float[np.ndarray, " n"]
    off: Float[np.ndarray, " n"]
    above: Float[np.ndarray, " n"]
    near: Float[np.ndarray, " n"]


class Crossings(NamedTuple):
    """What `split` makes nodes of.

    Attributes:
        pairs: links that cross in plan without a node, [n_crossing, 2].
        at: place of the crossing along both links, from 0 to 1, [n_crossing, 2].
        joints: `Touching` within the tolerance: T-joints.
        apart: number of crossings and joints that are none because their heights differ too much.
    """

    pairs: Int[np.ndarray, "n_crossing 2"]
    at: Float[np.ndarray, "n_crossing 2"]
    joints: Touching
    apart: int


class Pieces(NamedTuple):
    """A net that is split where its links cross and touch.

    Attributes:
        nodes: those before, and new ones behind them, [n_all, 3], m.
        links: [n_piece, 2].
        origin: link that a piece belonged to, [n_piece].
        share: length of the piece over that of the link, [n_piece].
    """

    nodes: Float[np.ndarray, "n_all 3"]
    links: Int[np.ndarray, "n_piece 2"]
    origin: Int[np.ndarray, " n_piece"]
    share: Float[np.ndarray, " n_piece"]


def shortest_links(
    nodes: Float[np.ndarray, "n_node 3"], links: Int[np.ndarray, "n_elem 2"]
) -> tuple[Float[np.ndarray, " n_elem"], Float[np.ndarray, " n_node"]]:
    """Length of every link, [n_elem], and of the shortest link at every node, [n_node], m."""
    length = np.linalg.norm(nodes[links[:, 1]] - nodes[links[:, 0]], axis=1)
    shortest = np.full(len(nodes), np.inf)
    np.minimum.at(shortest, links.ravel(), np.repeat(length, 2))
    return length, shortest


def touching(
    nodes: Float[np.ndarray, "n_node 3"],
    links: Int[np.ndarray, "n_elem 2"],
    tolerance: float,
    share: float = 0.0,
) -> Touching:
    """The `Touching` with `off` of at most a limit, and more than that from the link's ends.

    The limit is `tolerance`, m, and `share` of `near` beyond it. Along a link that is vertical the
    place of a node is its height.
    """
    length, shortest = shortest_links(nodes, links)
    tree, owner, step = _pieces(nodes[:, :2], links)
    used = np.unique(links)
    reach = tolerance + share * float(length.max())
    found = cKDTree(nodes[used, :2]).sparse_distance_matrix(
        tree, 0.5 * step + reach, output_type="ndarray"
    )
    pairs = _distinct(owner[found["j"]], used[found["i"]], len(nodes))
    link, node = pairs[(links[pairs[:, 0]] != pairs[:, 1:]).all(axis=1)].T
    near = np.minimum(length[link], shortest[node])
    limit = tolerance + share * near
    first, way = nodes[links[link, 0]], nodes[links[link, 1]] - nodes[links[link, 0]]
    to = nodes[node] - first
    flat = np.linalg.norm(way[:, :2], axis=1)
    upright = flat <= limit
    square = np.where(upright, way[:, 2], flat) ** 2
    along = np.where(upright, to[:, 2] * way[:, 2], np.sum(to[:, :2] * way[:, :2], axis=1))
    at = along / np.where(square > 0, square, 1.0)
    off = np.linalg.norm(to[:, :2] - at[:, None] * way[:, :2], axis=1)
    above = np.where(upright, 0.0, to[:, 2] - at * way[:, 2])
    good = (off <= limit) & (np.sqrt(square) * np.minimum(at, 1 - at) > limit)
    return Touching(*(value[good] for value in (link, node, at, off, above, near)))


def crossings(
    nodes: Float[np.ndarray, "n_node 3"],
    links: Int[np.ndarray, "n_elem 2"],
    held: Bool[np.ndarray, " n_node"],
    tolerance: float,
    gap: float = GAP,
) -> Crossings:
    """The `Crossings` of links.

    Nodes join a link above or below them only if they are ends that nothing holds: others, as the
    anchors and the lower cables of a plane truss, have their height for a reason.

    Args:
        nodes, links: of the net, m.
        held: whether a support holds a node, [n_node] bool.
        tolerance: distance in plan within which a node lies on a link, m.
        gap: largest height between what is joined, over the length of the shorter link.
    """
    joints = touching(nodes, links, tolerance)
    single = np.bincount(links.ravel(), minlength=len(nodes)) == 1
    limit = np.where((single & ~held)[joints.node], gap * joints.near, tolerance)
    close = np.abs(joints.above) <= limit
    apart = int((~close).sum())
    joints = Touching(*(value[close] for value in joints))
    tree, owner, step = _pieces(nodes[:, :2], links)
    pairs = np.sort(owner[tree.query_pairs(step * (1 + 1e-9), output_type="ndarray")], axis=1)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    pairs = _distinct(pairs[:, 0], pairs[:, 1], len(links))
    pairs = pairs[(links[pairs[:, 0], :, None] != links[pairs[:, 1], None]).all(axis=(1, 2))]
    first, way = nodes[links[:, 0]], nodes[links[:, 1]] - nodes[links[:, 0]]
    p, q = pairs.T
    flat = np.linalg.norm(way[:, :2], axis=1)
    turn = _cross(way[p], way[q])
    skew = np.abs(turn) > _PARALLEL * flat[p] * flat[q]
    turn, between = np.where(skew, turn, 1.0), first[q] - first[p]
    at = np.stack([_cross(between, way[q]) / turn, _cross(between, way[p]) / turn], axis=1)
    inside = np.minimum(at, 1 - at) * flat[pairs] > tolerance
    good = skew & inside.all(axis=1)
    pairs, at = pairs[good], at[good]
    good = _without_node(pairs, links, joints)
    pairs, at = pairs[good], at[good]
    height = first[pairs, 2] + at * way[pairs, 2]
    length, _ = shortest_links(nodes, links)
    close = np.abs(height[:, 1] - height[:, 0]) <= gap * length[pairs].min(axis=1)
    return Crossings(pairs[close], at[close], joints, apart + int((~close).sum()))


def split(
    nodes: Float[np.ndarray, "n_node 3"],
    links: Int[np.ndarray, "n_elem 2"],
    found: Crossings,
    tolerance: float,
) -> Pieces:
    """The `Pieces` of links; a node of a crossing has the mean height of the links there.

    A node of a T-joint stays where it is. Pieces that lie on each other are one, of the first link.

    Args:
        nodes, links: of the net, m.
        found: its `Crossings`.
        tolerance: distance in plan of crossings that become one node, m.
    """
    pairs, at = found.pairs, found.at
    first, way = nodes[links[:, 0]], nodes[links[:, 1]] - nodes[links[:, 0]]
    places = first[pairs] + at[..., None] * way[pairs]  # on both links, [n_crossing, 2, 3]
    label = _merged(places[:, 0, :2], pairs, tolerance)
    count = int(label.max(initial=-1)) + 1
    new = np.zeros((count, 3))
    at_label = np.stack([np.repeat(label, 2), pairs.ravel()], axis=1)
    once = np.unique(at_label, axis=0, return_index=True)[1]  # every link counts once in a mean
    owner = at_label[once, 0]
    np.add.at(new, owner, places.reshape(-1, 3)[once])
    new /= np.maximum(np.bincount(owner, minlength=count), 1)[:, None]
    every = np.arange(len(links))
    link = np.concatenate([every, every, at_label[once, 1], found.joints.link])
    node = np.concatenate([*links.T, len(nodes) + owner, found.joints.node])
    place = np.concatenate([0.0 * every, 1.0 + 0.0 * every, at.ravel()[once], found.joints.at])
    order = np.lexsort((place, link))
    link, node, place = link[order], node[order], place[order]
    real = (link[1:] == link[:-1]) & (node[1:] != node[:-1])
    cut = np.stack([node[:-1], node[1:]], axis=1)[real].astype(np.int32)
    single = np.sort(np.unique(np.sort(cut, axis=1), axis=0, return_index=True)[1])
    share = np.diff(place)[real][single]
    return Pieces(np.concatenate([nodes, new]), cut[single], link[:-1][real][single], share)


def _pieces(plan, links):
    """Middles of short pieces of links in plan, as a tree; their links; and their largest length.

    Pieces of two links that cross have middles within that length, so that long links do not make
    the search for crossings one among all pairs.
    """
    first, way = plan[links[:, 0]], plan[links[:, 1]] - plan[links[:, 0]]
    length = np.linalg.norm(way, axis=1)
    step = max(float(np.median(length)), _FINEST * float(length.mean())) or 1.0
    count = np.maximum(np.ceil(length / step), 1).astype(int)
    owner = np.repeat(np.arange(len(links)), count)
    number = np.arange(len(owner)) - (np.cumsum(count) - count)[owner]
    middles = first[owner] + ((number + 0.5) / count[owner])[:, None] * way[owner]
    return cKDTree(middles), owner, step


def _distinct(first, second, count):
    """Pairs of numbers, each once, [n, 2]; the second ones are below `count`."""
    return np.stack(np.divmod(np.unique(first.astype(np.int64) * count + second), count), axis=1)


def _cross(a, b):
    """Third component of the cross product of vectors in plan, [n]."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _without_node(pairs, links, joints) -> Bool[np.ndarray, " n"]:
    """Whether no node is on both links of a pair, at an end or a joint, [n] bool."""
    on: dict[int, set[int]] = {}
    for link, node in zip(joints.link.tolist(), joints.node.tolist(), strict=True):
        on.setdefault(link, set(links[link].tolist())).add(node)
    free = np.ones(len(pairs), bool)
    candidates = np.flatnonzero(np.isin(pairs, joints.link).any(axis=1))
    for k in candidates.tolist():
        p, q = pairs[k].tolist()
        free[k] = (on.get(p) or set(links[p].tolist())).isdisjoint(on.get(q) or links[q].tolist())
    return free


def _merged(places, pairs, tolerance):
    """Number of the node of every crossing: near crossings that share a link have the same one."""
    if not len(places):
        return np.zeros(0, int)
    near = cKDTree(places).query_pairs(tolerance, output_type="ndarray")
    alike = (pairs[near[:, 0], :, None] == pairs[near[:, 1], None]).any(axis=(1, 2))
    i, j = near[alike].T
    graph = coo_matrix((np.ones(len(i)), (i, j)), shape=(len(places),) * 2)
    return connected_components(graph, directed=False)[1]
