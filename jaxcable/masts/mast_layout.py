"""The layout of a mast: its nodes, elements and patches, from the heights of its parts."""

from __future__ import annotations

import functools
import itertools
from typing import NamedTuple

import numpy as np

from ..common import checks

SAME_HEIGHT = 1e-6
"""Difference of heights, m, below which they are one."""


class Patch(NamedTuple):
    """A part of a mast: its name, its ends as indices of breaks (`Layout`), its elements."""

    name: str
    low: int
    high: int
    elements: tuple[int, int]


class Layout(NamedTuple):
    """Nodes and elements of a mast, from `layout_of`.

    Heights of breaks are in the order: base, guy levels, tops of sections, middles of the spans
    between guy levels, ancillaries.

    Attributes:
        nodes: of each node on the axis the breaks below and above, and the share of the latter.
        sections: index of the section of each element.
        guys, ancillaries: node of each guy level, and of each ancillary.
        patches: spans between guy levels, and parts from the middle of one to that of the next.
    """

    nodes: tuple[tuple[int, int, float], ...]
    sections: tuple[int, ...]
    guys: tuple[int, ...]
    ancillaries: tuple[int, ...]
    patches: tuple[Patch, ...]


@functools.lru_cache(maxsize=64)
def layout_of(
    tops: tuple[float, ...], guys: tuple[float, ...], others: tuple[float, ...], longest: float
) -> Layout:
    """Return the `Layout` of heights of sections, guy levels, ancillaries; `longest` element, m."""
    heights = list(break_heights(np.array(tops), np.array(guys), np.array(others)))
    order: list[int] = []
    for k in sorted(range(len(heights)), key=lambda k: (round(heights[k] / SAME_HEIGHT), k)):
        if not order or heights[k] - heights[order[-1]] > SAME_HEIGHT:
            order.append(k)
    nodes: list[tuple[int, int, float]] = [(0, 0, 0.0)]
    sections, node_of = [], {0: 0}
    for low, high in itertools.pairwise(order):
        count = max(1, int(np.ceil((heights[high] - heights[low]) / longest - 1e-9)))
        nodes += [(low, high, (k + 1) / count) for k in range(count)]
        middle = 0.5 * (heights[low] + heights[high])
        sections += [int(np.searchsorted(tops, middle))] * count
        node_of[high] = len(nodes) - 1

    def node(z):
        return node_of[min(order, key=lambda k: abs(heights[k] - z))]

    count = len(guys)
    top = 1 + count + len(tops) - 1  # index of the upper end of the mast
    spans = [0, *range(1, count + 1)]
    if tops[-1] - guys[-1] > SAME_HEIGHT:
        spans.append(top)
    middles = [1 + count + len(tops) + k for k in range(count)]
    parts = [(f"span {k + 1}", *pair) for k, pair in enumerate(itertools.pairwise(spans))]
    middle = [0, *middles, spans[-1]]
    parts += [
        (f"about guys {k}" if k else "to mid-span 1", *pair)
        for k, pair in enumerate(itertools.pairwise(middle))
    ]
    patches = [Patch(n, a, b, (node(heights[a]), node(heights[b]))) for n, a, b in parts]
    own = [node(z) for z in guys], [node(z) for z in others]
    return Layout(tuple(nodes), tuple(sections), tuple(own[0]), tuple(own[1]), tuple(patches))


def break_heights(tops, guys, others):
    """Return the heights of all breaks of a `Layout`, m, in its order; arrays [n] of heights."""
    xp = checks.numpy_or_jax(tops, guys, others)
    ground = xp.zeros(1)
    middles = 0.5 * (guys + xp.concatenate([ground, guys[:-1]]))
    return xp.concatenate([ground, guys, tops, middles, others])
