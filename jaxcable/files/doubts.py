"""What in a drawn net was most likely not intended: gaps, and crossings without a node."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..common.types import Bool, Float, Int
from .crossings import crossings, shortest_links, touching

NEAR = 0.01
"""Distance, over the length of the shortest link there, below which a gap was not intended.

Gaps of drawings are tenths to some millimetres, and links are decimetres to metres: one per cent
lies between them. The lengths are those at the place itself, so that a short link elsewhere does
not hide a gap.
"""

_ON = 1e-6  # distance in plan within which a node lies on a link, m


class Gap(NamedTuple):
    """A node that nearly, or exactly, meets what it is not joined to.

    Attributes:
        node: its number.
        other: what is near, in words.
        distance: to it, m.
    """

    node: int
    other: str
    distance: float


def near_pairs(
    nodes: Float[np.ndarray, "n_node 3"], links: Int[np.ndarray, "n_elem 2"]
) -> tuple[Int[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    """Pairs of nodes nearer than `NEAR` of the shortest link at both, and their distances, m.

    For every node the nearest other one is looked at; the nearest pair is first.
    """
    _, shortest = shortest_links(nodes, links)
    if len(nodes) < 2:
        return np.zeros((0, 2), int), np.zeros(0)
    distances, others = map(np.asarray, cKDTree(nodes).query(nodes, k=2))
    every = np.arange(len(nodes))
    second = others[:, 1] == every  # of nodes at one place either may come first
    other = np.where(second, others[:, 0], others[:, 1])
    distance = distances.max(axis=1)
    limit = NEAR * np.minimum(shortest, shortest[other])
    close = np.isfinite(limit) & (distance < limit)
    pairs = np.sort(np.stack([every, other], axis=1)[close], axis=1)
    pairs, first = np.unique(pairs, axis=0, return_index=True)
    distance = distance[close][first]
    order = np.argsort(distance, kind="stable")
    return pairs[order], distance[order]


def loose_ends(
    nodes: Float[np.ndarray, "n_node 3"], links: Int[np.ndarray, "n_elem 2"]
) -> list[Gap]:
    """Ends (nodes with one link) that lie so near to another node or link that they belong to it.

    That is: nearer than `NEAR` of the shortest link there, in space; sorted by their numbers.
    """
    single = np.bincount(links.ravel(), minlength=len(nodes)) == 1
    found = {}
    near = touching(nodes, links, 0.0, NEAR)
    space = np.hypot(near.off, near.above)
    for k in np.flatnonzero(single[near.node] & (space < NEAR * near.near)):
        node, far = int(near.node[k]), float(space[k])
        if node not in found or far < found[node].distance:
            between = " to ".join(map(str, links[near.link[k]]))
            found[node] = Gap(node, f"the link from node {between}", far)
    for pair, far in zip(*near_pairs(nodes, links), strict=True):
        for node, other in (pair.tolist(), pair[::-1].tolist()):
            if single[node]:
                found[node] = Gap(node, f"node {other}", float(far))
    return [found[node] for node in sorted(found)]


def doubts(
    nodes: Float[np.ndarray, "n_node 3"],
    links: Int[np.ndarray, "n_elem 2"],
    held: Bool[np.ndarray, " n_node"],
) -> list[str]:
    """What in a net was most likely not intended, a list of texts with what to do.

    Args:
        nodes, links: of the net, m.
        held: whether a support holds a node, [n_node] bool.
    """
    told = []
    pairs, distance = near_pairs(nodes, links)
    if len(pairs):
        i, j = pairs[0].tolist()
        told.append(
            f"{counted(len(pairs), 'pair')} of nodes closer than {NEAR:.0%} of the shortest link "
            f"there: nodes {i} and {j} at {place(nodes[i])}, {_millimetres(distance[0])} apart; "
            "to join them, read the file with a larger tolerance (--tol)"
        )
    found = crossings(nodes, links, held, _ON)
    if len(found.pairs) or len(found.joints.link):
        some = nodes[found.joints.node[:1]] if len(found.joints.link) else _at(nodes, links, found)
        told.append(
            f"{counted(len(found.pairs), 'crossing')} of links in plan without a node, and "
            f"{counted(len(found.joints.link), 'node')} on a link that it is no end of, such as at "
            f"{place(some[0])}; to join them there, use Net.split (--split)"
        )
    on_nodes = {k for pair in pairs.tolist() for k in pair} | set(found.joints.node.tolist())
    gaps = [gap for gap in loose_ends(nodes, links) if not (held[gap.node] or gap.node in on_nodes)]
    if gaps:
        gap = min(gaps, key=lambda gap: gap.distance)
        told.append(
            f"{counted(len(gaps), 'end')} closer to a link than {NEAR:.0%} of its length: node "
            f"{gap.node} at {place(nodes[gap.node])}, {_millimetres(gap.distance)} from {gap.other}"
            "; to join them, use Net.split (--split) with a larger tolerance (--tol)"
        )
    return told


def _at(nodes, links, found):
    """The place of the first crossing, on the first of both links, [1, 3]."""
    first, last = nodes[links[found.pairs[0, 0]]]
    return (first + found.at[0, 0] * (last - first))[None]


def place(node: Float[np.ndarray, " 3"]) -> str:
    """A place as text: (x, y, z) m."""
    return f"({', '.join(f'{x:.6g}' for x in node + 0.0)}) m"


def _millimetres(distance):
    """A distance as text."""
    return f"{1e3 * distance:.3g} mm"


def counted(number: int, word: str) -> str:
    """A number with its noun as text: 1 increment, 2 increments."""
    return f"{number} {word}" + ("" if number == 1 else "s")
