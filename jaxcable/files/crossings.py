"""Find where links cross or touch in plan without a node, and split them there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # its parts are imported where they are first used
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..common.types import Bool, Float, Int

LARGEST_GAP = 0.25
"""Height between two links, over the length of the shorter one, up to which they are one net."""

_PARALLEL = 1e-9  # sine of the angle between links below which rounding places their crossing
_FINEST = 0.1  # shortest piece over the mean link: some ten pieces for each link at most


class NodesOnLinks(NamedTuple):
    """Nodes that lie on a link between its ends in plan: [n] pairs of a node and a link.

    Attributes:
        link, node: indices of the link and the node.
        fraction: position of the node along the link, from 0 to 1.
        distance: distance of the node from the link in plan, m.
        height: height of the node above the link, m.
        length_scale: length of the link, or of the shortest link at the node if that is shorter, m.
    """

    link: Int[np.ndarray, " n"]
    node: Int[np.ndarray, " n"]
    fraction: Float[np.ndarray, " n"]
    distance: Float[np.ndarray, " n"]
    height: Float[np.ndarray, " n"]
    length_scale: Float[np.ndarray, " n"]


class Crossings(NamedTuple):
    """Places at which `split_links` makes nodes, or leads a link through a node.

    Attributes:
        pairs: indices of two links that cross in plan without a node, [n_crossing, 2].
        fractions: position of the crossing along both links, from 0 to 1, [n_crossing, 2].
        joints: `NodesOnLinks` that are joined to their link (T-joints).
        n_apart: number of further places that are not joined, because the heights differ too much.
    """

    pairs: Int[np.ndarray, "n_crossing 2"]
    fractions: Float[np.ndarray, "n_crossing 2"]
    joints: NodesOnLinks
    n_apart: int


class SplitNet(NamedTuple):
    """A net whose links are split where they cross or touch.

    Attributes:
        nodes: the nodes of the net, followed by new ones, [n_all, 3], m.
        links: node numbers of the parts of links, [n_piece, 2].
        original_link: index of the link that each part belonged to, [n_piece].
        length_fraction: length of each part over that of its link, [n_piece].
    """

    nodes: Float[np.ndarray, "n_all 3"]
    links: Int[np.ndarray, "n_piece 2"]
    original_link: Int[np.ndarray, " n_piece"]
    length_fraction: Float[np.ndarray, " n_piece"]


def link_lengths(
    nodes: Float[np.ndarray, "n_node 3"], links: Int[np.ndarray, "n_elem 2"]
) -> tuple[Float[np.ndarray, " n_elem"], Float[np.ndarray, " n_node"]]:
    """Return the length of each link, and the length of the shortest link at each node, m."""
    length = np.linalg.norm(nodes[links[:, 1]] - nodes[links[:, 0]], axis=1)
    shortest = np.full(len(nodes), np.inf)
    np.minimum.at(shortest, links.ravel(), np.repeat(length, 2))
    return length, shortest


def find_nodes_on_links(
    nodes: Float[np.ndarray, "n_node 3"],
    links: Int[np.ndarray, "n_elem 2"],
    tolerance: float,
    share: float = 0.0,
) -> NodesOnLinks:
    """Find the nodes that lie on a link in plan, and not at its ends.

    A node lies on a link if its distance from the link in plan is at most d, and its distances from
    the ends are larger than d, with d = `tolerance` (m) + `share` times the length of the link, or
    of the shortest link at the node if this is shorter. On a vertical link the position of a node
    is measured by its height.
    """
    length, shortest = link_lengths(nodes, links)
    tree, owner, step = _kd_tree_of_segments(nodes[:, :2], links)
    used = np.unique(links)
    reach = tolerance + share * float(length.max())
    found = scipy.spatial.cKDTree(nodes[used, :2]).sparse_distance_matrix(
        tree, 0.5 * step + reach, output_type="ndarray"
    )
    pairs = _unique_pairs(owner[found["j"]], used[found["i"]], len(nodes))
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
    return NodesOnLinks(*(value[good] for value in (link, node, at, off, above, near)))


def find_crossings(
    nodes: Float[np.ndarray, "n_node 3"],
    links: Int[np.ndarray, "n_elem 2"],
    held: Bool[np.ndarray, " n_node"],
    tolerance: float,
    gap: float = LARGEST_GAP,
) -> Crossings:
    """Find where links cross in plan, and which nodes lie on links, if their heights are close.

    A node is joined to a link above or below it only if it is the free end of a single link. Other
    nodes, such as anchors and the lower chord of a plane truss, have their height for a reason.

    Args:
        nodes, links: positions, m, and node numbers of the links.
        held: whether a support holds a node.
        tolerance: distance in plan within which a node lies on a link, m.
        gap: largest difference in height, over the length of the shorter link, of what is joined.
    """
    joints = find_nodes_on_links(nodes, links, tolerance)
    single = np.bincount(links.ravel(), minlength=len(nodes)) == 1
    limit = np.where((single & ~held)[joints.node], gap * joints.length_scale, tolerance)
    close = np.abs(joints.height) <= limit
    apart = int((~close).sum())
    joints = NodesOnLinks(*(value[close] for value in joints))
    tree, owner, step = _kd_tree_of_segments(nodes[:, :2], links)
    pairs = np.sort(owner[tree.query_pairs(step * (1 + 1e-9), output_type="ndarray")], axis=1)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    pairs = _unique_pairs(pairs[:, 0], pairs[:, 1], len(links))
    pairs = pairs[(links[pairs[:, 0], :, None] != links[pairs[:, 1], None]).all(axis=(1, 2))]
    first, way = nodes[links[:, 0]], nodes[links[:, 1]] - nodes[links[:, 0]]
    p, q = pairs.T
    flat = np.linalg.norm(way[:, :2], axis=1)
    turn = _cross_product_in_plan(way[p], way[q])
    skew = np.abs(turn) > _PARALLEL * flat[p] * flat[q]
    turn, between = np.where(skew, turn, 1.0), first[q] - first[p]
    at = np.stack(
        [
            _cross_product_in_plan(between, way[q]) / turn,
            _cross_product_in_plan(between, way[p]) / turn,
        ],
        axis=1,
    )
    inside = np.minimum(at, 1 - at) * flat[pairs] > tolerance
    good = skew & inside.all(axis=1)
    pairs, at = pairs[good], at[good]
    good = _share_no_node(pairs, links, joints)
    pairs, at = pairs[good], at[good]
    height = first[pairs, 2] + at * way[pairs, 2]
    length, _ = link_lengths(nodes, links)
    close = np.abs(height[:, 1] - height[:, 0]) <= gap * length[pairs].min(axis=1)
    return Crossings(pairs[close], at[close], joints, apart + int((~close).sum()))


def split_links(
    nodes: Float[np.ndarray, "n_node 3"],
    links: Int[np.ndarray, "n_elem 2"],
    found: Crossings,
    tolerance: float,
) -> SplitNet:
    """Split links at their crossings; a new node has the mean height of the links there.

    A node on a link stays where it is. Of pieces that coincide, the one of the first link stays.

    Args:
        nodes, links: positions, m, and node numbers of the links.
        found: what `find_crossings` has found for this net.
        tolerance: distance in plan of crossings that become one node, m.
    """
    pairs, at = found.pairs, found.fractions
    first, way = nodes[links[:, 0]], nodes[links[:, 1]] - nodes[links[:, 0]]
    places = first[pairs] + at[..., None] * way[pairs]  # on both links, [n_crossing, 2, 3]
    label = _merge_crossings(places[:, 0, :2], pairs, tolerance)
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
    place = np.concatenate(
        [0.0 * every, 1.0 + 0.0 * every, at.ravel()[once], found.joints.fraction]
    )
    order = np.lexsort((place, link))
    link, node, place = link[order], node[order], place[order]
    real = (link[1:] == link[:-1]) & (node[1:] != node[:-1])
    cut = np.stack([node[:-1], node[1:]], axis=1)[real].astype(np.int32)
    single = np.sort(np.unique(np.sort(cut, axis=1), axis=0, return_index=True)[1])
    share = np.diff(place)[real][single]
    return SplitNet(np.concatenate([nodes, new]), cut[single], link[:-1][real][single], share)


def _kd_tree_of_segments(plan, links):
    """Cut links into short segments, so that a search for crossings compares neighbors only.

    `plan` are the nodes in plan, [n_node, 2], m. Return a k-d tree of the midpoints of the
    segments, the index of the link of each segment, and the largest length of a segment, m:
    segments whose midpoints are farther apart than this do not cross.
    """
    first, way = plan[links[:, 0]], plan[links[:, 1]] - plan[links[:, 0]]
    length = np.linalg.norm(way, axis=1)
    step = max(float(np.median(length)), _FINEST * float(length.mean())) or 1.0
    count = np.maximum(np.ceil(length / step), 1).astype(int)
    owner = np.repeat(np.arange(len(links)), count)
    number = np.arange(len(owner)) - (np.cumsum(count) - count)[owner]
    middles = first[owner] + ((number + 0.5) / count[owner])[:, None] * way[owner]
    return scipy.spatial.cKDTree(middles), owner, step


def _unique_pairs(first, second, count):
    """Return each pair (first[k], second[k]) of indices once, [n, 2]; `second` is below `count`."""
    return np.stack(np.divmod(np.unique(first.astype(np.int64) * count + second), count), axis=1)


def _cross_product_in_plan(a, b):
    """Return the z components of cross products of vectors; both arguments are [n, 2 or 3].

    The result is [n].
    """
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _share_no_node(pairs, links, joints) -> Bool[np.ndarray, " n"]:
    """Return for pairs of links, [n, 2] indices, whether the two have no node in common, [n] bool.

    The nodes of a link are its ends, and those that lie on it according to `joints`, a
    `NodesOnLinks`.
    """
    on: dict[int, set[int]] = {}
    for link, node in zip(joints.link.tolist(), joints.node.tolist(), strict=True):
        on.setdefault(link, set(links[link].tolist())).add(node)
    free = np.ones(len(pairs), bool)
    candidates = np.flatnonzero(np.isin(pairs, joints.link).any(axis=1))
    for k in candidates.tolist():
        p, q = pairs[k].tolist()
        free[k] = (on.get(p) or set(links[p].tolist())).isdisjoint(on.get(q) or links[q].tolist())
    return free


def _merge_crossings(places, pairs, tolerance):
    """Return the index of the new node of each crossing, [n_crossing].

    Crossings that share a link and are at most `tolerance`, m, apart in plan get the same node.

    Args:
        places: positions of the crossings in plan, [n_crossing, 2], m.
        pairs: indices of the two links of each crossing, [n_crossing, 2].
        tolerance: distance, m.
    """
    if not len(places):
        return np.zeros(0, int)
    near = scipy.spatial.cKDTree(places).query_pairs(tolerance, output_type="ndarray")
    alike = (pairs[near[:, 0], :, None] == pairs[near[:, 1], None]).any(axis=(1, 2))
    i, j = near[alike].T
    graph = coo_matrix((np.ones(len(i)), (i, j)), shape=(len(places),) * 2)
    return connected_components(graph, directed=False)[1]
