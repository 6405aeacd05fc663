"""Find what in a drawn net was most likely not intended: gaps, and crossings without a node."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # its parts are imported where they are first used

from ..common.negligible import vector_text
from ..common.types import Bool, Float, Int
from ..common.units import SI, Units
from .crossings import find_crossings, find_nodes_on_links, link_lengths

NEAR_FRACTION = 0.01
"""Distance, over the length of the shortest link there, below which a gap was not intended.

Gaps of drawings are tenths to some millimetres, and links are decimetres to metres: one per cent
lies between them. The lengths are those at the place itself, so that a short link elsewhere does
not hide a gap.
"""

_ON_LINK = 1e-6  # distance in plan within which a node lies on a link, m


class UnjoinedEnd(NamedTuple):
    """An end of a link that touches, or nearly touches, something that it is not joined to.

    Attributes:
        node: number of the node at the end.
        other: the node or link nearby, in words.
        distance: distance to it, m.
    """

    node: int
    other: str
    distance: float


def near_node_pairs(
    nodes: Float[np.ndarray, "n_node 3"], links: Int[np.ndarray, "n_elem 2"]
) -> tuple[Int[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    """Find pairs of nodes whose distance is less than 1 % of the shortest link at either of them.

    Only the nearest neighbor of each node is compared.

    Returns:
        Node numbers of the pairs, [n, 2], the closest pair first, and their distances, [n], m.
    """
    _, shortest = link_lengths(nodes, links)
    if len(nodes) < 2:
        return np.zeros((0, 2), int), np.zeros(0)
    distances, others = map(np.asarray, scipy.spatial.cKDTree(nodes).query(nodes, k=2))
    every = np.arange(len(nodes))
    second = others[:, 1] == every  # of nodes at one place either may come first
    other = np.where(second, others[:, 0], others[:, 1])
    distance = distances.max(axis=1)
    limit = NEAR_FRACTION * np.minimum(shortest, shortest[other])
    close = np.isfinite(limit) & (distance < limit)
    pairs = np.sort(np.stack([every, other], axis=1)[close], axis=1)
    pairs, first = np.unique(pairs, axis=0, return_index=True)
    distance = distance[close][first]
    order = np.argsort(distance, kind="stable")
    return pairs[order], distance[order]


def unjoined_ends(
    nodes: Float[np.ndarray, "n_node 3"], links: Int[np.ndarray, "n_elem 2"]
) -> list[UnjoinedEnd]:
    """Find ends of links (nodes with a single link) that almost touch another node or link.

    Their distance from it in space is below 1 % of the shortest link there. The list is sorted by
    the index of the node.
    """
    single = np.bincount(links.ravel(), minlength=len(nodes)) == 1
    found = {}
    near = find_nodes_on_links(nodes, links, 0.0, NEAR_FRACTION)
    space = np.hypot(near.distance, near.height)
    for k in np.flatnonzero(single[near.node] & (space < NEAR_FRACTION * near.length_scale)):
        node, far = int(near.node[k]), float(space[k])
        if node not in found or far < found[node].distance:
            between = " to ".join(map(str, links[near.link[k]]))
            found[node] = UnjoinedEnd(node, f"the link from node {between}", far)
    for pair, far in zip(*near_node_pairs(nodes, links), strict=True):
        for node, other in (pair.tolist(), pair[::-1].tolist()):
            if single[node]:
                found[node] = UnjoinedEnd(node, f"node {other}", float(far))
    return [found[node] for node in sorted(found)]


def describe_likely_mistakes(
    nodes: Float[np.ndarray, "n_node 3"],
    links: Int[np.ndarray, "n_elem 2"],
    held: Bool[np.ndarray, " n_node"],
) -> list[str]:
    """Return a text for each kind of likely mistake in a net, with what to do about it, a list.

    The kinds are nodes very close to each other, links that cross without a node, and ends that
    almost touch a link.

    Args:
        nodes, links: positions, m, and node numbers of the links.
        held: whether a node is supported, [n_node] bool.
    """
    told = []
    pairs, distance = near_node_pairs(nodes, links)
    if len(pairs):
        i, j = pairs[0].tolist()
        told.append(
            f"{pluralize(len(pairs), 'pair')} of nodes closer than {NEAR_FRACTION:.0%} of the "
            f"shortest link there: nodes {i} and {j} at {format_position(nodes[i])}, "
            f"{_format_millimetres(distance[0])} apart; to join them, read the file with a larger "
            "tolerance (--tol)"
        )
    found = find_crossings(nodes, links, held, _ON_LINK)
    if len(found.pairs) or len(found.joints.link):
        some = (
            nodes[found.joints.node[:1]]
            if len(found.joints.link)
            else _first_crossing_position(nodes, links, found)
        )
        told.append(
            f"{pluralize(len(found.pairs), 'crossing')} of links in plan without a node, and "
            f"{pluralize(len(found.joints.link), 'node')} on a link that it is no end of, such as "
            f"at {format_position(some[0])}; to join them there, use Net.split (--split)"
        )
    on_nodes = {k for pair in pairs.tolist() for k in pair} | set(found.joints.node.tolist())
    gaps = [
        gap for gap in unjoined_ends(nodes, links) if not (held[gap.node] or gap.node in on_nodes)
    ]
    if gaps:
        gap = min(gaps, key=lambda gap: gap.distance)
        told.append(
            f"{pluralize(len(gaps), 'end')} closer to a link than {NEAR_FRACTION:.0%} of its "
            f"length: node {gap.node} at {format_position(nodes[gap.node])}, "
            f"{_format_millimetres(gap.distance)} from {gap.other}; to join them, "
            "use Net.split (--split) with a larger tolerance (--tol)"
        )
    return told


def _first_crossing_position(nodes, links, crossings):
    """Return where the first of the `Crossings` is, on the first of its two links, [1, 3], m."""
    first, last = nodes[links[crossings.pairs[0, 0]]]
    return (first + crossings.fractions[0, 0] * (last - first))[None]


def format_position(node: Float[np.ndarray, " 3"], units: Units = SI) -> str:
    """Return the position of a node, m, as text in `units`: "(x, y, z) m"."""
    return f"{vector_text(units.from_si(node, 'm'))} {units.length}"


def _format_millimetres(distance):
    """Return a distance, given in m, as text in millimetres."""
    return f"{1e3 * distance:.3g} mm"


def pluralize(number: int, word: str) -> str:
    """Return a number with its noun as text: "1 increment", "2 increments"."""
    return f"{number} {word}" + ("" if number == 1 else "s")
