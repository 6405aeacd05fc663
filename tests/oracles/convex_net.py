"""Nets as arrays in extended precision, for `convex_oracle`: topology, assembly and elongations."""

from itertools import pairwise

import numpy as np
from oracles.convex_cones import WIDE, dot
from oracles.convex_hang import Hung


def _sum(a, b):
    """Rounded sum and what the rounding left."""
    s = a + b
    v = s - a
    return s, (a - (s - v)) + (b - v)


def _square(a):
    """Rounded square and what the rounding left, for 64 bits."""
    c = a * WIDE(2**32 + 1)
    high = c - (c - a)
    low = a - high
    s = a * a
    return s, ((high * high - s) + 2 * high * low) + low * low


def joined(nodes, moved, lower, i, j, shift=0):
    """Vectors from nodes i to j and a shift, m, and their lengths as sums of two numbers, m."""
    (a, a_low), (b, b_low) = _sum(nodes[j], -nodes[i]), _sum(moved[j], -moved[i])
    d, low = _sum(a, b)
    d, low = _sum(d, low + a_low + b_low + (lower[j] - lower[i]) + shift)
    squares, left = _square(d)
    total, more = _sum(squares[:, 0], squares[:, 1])
    total, rest = _sum(total, squares[:, 2])
    rest = rest + more + left.sum(-1) + 2 * dot(d, low)
    l = np.sqrt(total)
    square, less = _square(l)
    return d, l, ((total - square) - less + rest) / np.where(l > 0, 2 * l, 1)


class Net:
    """A scene as arrays: cables, ropes and jacks over elements and segments, catenaries as `hung`.

    `place` are the numbers in the scene of the elements but the catenaries, `hung_place` of these.
    """

    def __init__(self, scene):
        def wide(a):
            return np.asarray(a, WIDE)

        self.nodes, self.load = wide(scene.nodes), wide(scene.load)
        self.free = np.asarray(scene.free, bool)
        self.still = np.zeros_like(self.nodes)
        if scene.prescribed is not None:
            self.still = np.where(self.free, 0, wide(scene.prescribed))
        self.count = int(self.free.sum())
        self.number = np.full(self.free.shape, -1)  # the last entry of a longer vector: held
        self.number[self.free] = np.arange(self.count)
        catenary = np.array([e.kind == "catenary" for e in scene.elements], bool)
        self.place, self.hung_place = np.flatnonzero(~catenary), np.flatnonzero(catenary)
        axial = [scene.elements[k] for k in self.place]
        active = [(k, e) for k, e in enumerate(axial) if e.kind != "jack" or e.force > 0]
        of = [(a, b, k) for k, e in active for a, b in pairwise(e.links)]
        self.i, self.j, self.of = np.array(of, int).reshape(-1, 3).T
        self.jack = np.array([e.kind == "jack" for e in axial], bool)
        self.force = wide([e.force if e.kind == "jack" else 0 for e in axial])
        self.EA = wide([0 if e.kind == "jack" else e.stiffness for e in axial])
        self.rest = wide([0 if e.kind == "jack" else e.rest_length for e in axial])
        self.flex = np.where(self.jack, 0, self.rest / np.where(self.jack, 1, self.EA))
        self.shift = np.zeros((len(self.of), 3), WIDE)  # between a segment's node and its start
        self.segments = np.bincount(self.of, minlength=len(axial))
        self.single = self.segments == 1
        self.hung = Hung([scene.elements[k] for k in self.hung_place])
        self.dead = self.load.copy()
        for nodes in (self.hung.i, self.hung.j):
            np.add.at(self.dead, nodes, self.hung.half())
        self.p = self.dead[self.free]

    def total(self, x):
        """Sum over the segments of each element."""
        out = np.zeros(len(self.jack), WIDE)
        np.add.at(out, self.of, x)
        return out

    def spread(self, q, ends=None):
        """Sums over segments of pulls q [segments, 3] by the free unknowns; or over other ends."""
        i, j = ends or (self.i, self.j)
        out = np.zeros(self.count + 1, WIDE)
        np.add.at(out, self.number[i], -q)
        np.add.at(out, self.number[j], q)
        return out[:-1]

    def across(self, x, ends=None):
        """Differences of the free unknowns x over the segments, [segments, 3]; or other ends."""
        i, j = ends or (self.i, self.j)
        x = np.append(x, WIDE(0))
        return x[self.number[j]] - x[self.number[i]]

    def matrix(self, blocks, rows, weight):
        """Sum of `blocks` [segments, 3, 3] over the segments, and of weighted rows' products.

        Blocks of the catenaries may follow those of the segments.
        """
        out = np.zeros((self.count + 1,) * 2, WIDE)
        i, j = self.number[self.i], self.number[self.j]
        if len(blocks) > len(i):
            i, j = np.r_[i, self.number[self.hung.i]], np.r_[j, self.number[self.hung.j]]
        for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            np.add.at(out, (a[:, :, None], b[:, None, :]), sign * blocks)
        rows, weight = rows[~self.single], weight[~self.single]
        return out[:-1, :-1] + (rows.T * weight) @ rows

    def rows(self, t):
        """Derivatives of the elements' sums of t . d by the free unknowns, [elements, count]."""
        out = np.zeros((len(self.jack), self.count + 1), WIDE)
        for nodes, sign in ((self.j, 1), (self.i, -1)):
            np.add.at(out, (self.of[:, None], self.number[nodes]), sign * t)
        return out[:, :-1]

    def elongations(self, moved, lower=None):
        """Vectors and lengths of segments, elongations of elements, m, without cancellation.

        The displacements are the sums of two arrays.
        """
        lower = np.zeros_like(moved) if lower is None else lower
        d, l, low = joined(self.nodes, moved, lower, self.i, self.j, self.shift)
        long, rest = -self.rest, self.total(low)
        rank = np.arange(len(self.of)) - np.searchsorted(self.of, self.of)
        for k in range(self.segments.max(initial=0)):  # one segment of each element at a time
            at = self.of[rank == k]
            long[at], more = _sum(long[at], l[rank == k])
            rest[at] += more
        return d, l, long + rest

    def chords(self, moved, lower=None):
        """Chords of the catenaries, m, and their lengths as sums of two numbers, m."""
        lower = np.zeros_like(moved) if lower is None else lower
        return joined(self.nodes, moved, lower, self.hung.i, self.hung.j)
