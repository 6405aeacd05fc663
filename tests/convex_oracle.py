"""Equilibrium of nets of cables, ropes, jacks and catenaries in extended precision (NumPy).

The potential energy is convex: its least value is a second-order cone program. With a segment's
length bounded by t, |d| <= t, and the bounds of an element adding up to L0 (1 + N / EA), the force
of the element is the multiplier N, and the pull q of a segment is a vector with |q| <= N:

    sum over the segments at a node of q = load,   sum of t = L0 + (L0 / EA) N,   N t = q . d

A primal-dual interior-point method with the scaling of Nesterov and Todd follows N t - q . d to
zero from any start; stiffness enters only as the flexibility L0 / EA. Newton's method with the
forces as unknowns beside the displacements then takes the last digits. A catenary is a chain of
cables in the first method, loaded at the knots so that Gauss's rule integrates it, and exact in
the second.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

WIDE = np.longdouble
EPS = np.finfo(WIDE).eps
CLOSE = WIDE("1e-12")  # of the largest sum of forces at a node: residual of what is found
ROUNDS = 16  # roundings of an element's elongation that a residual may show


@dataclass
class Element:
    """An element of a net.

    Attributes:
        kind: "cable", "rope", "jack" or "catenary".
        links: nodes that it joins, two, or two and more for a rope.
        stiffness: axial stiffness EA, N; None for a jack.
        rest_length: unstressed length L0, m; None for a jack.
        force: constant tension of a jack, N.
        load: dead load of a catenary per unstressed length, [3], N/m.
    """

    kind: str
    links: tuple
    stiffness: float = None
    rest_length: np.longdouble = None
    force: float = None
    load: tuple = None


@dataclass
class Scene:
    """A net: nodes [n, 3] in m, free [n, 3], loads [n, 3] in N, prescribed movements [n, 3] in m.

    `prescribed` counts where a freedom is not free; None for supports that stay.
    """

    nodes: np.ndarray
    free: np.ndarray
    load: np.ndarray
    elements: list
    prescribed: np.ndarray = None


@dataclass
class Found:
    """An equilibrium, or the last state before the search ended.

    Attributes:
        displacement: of the nodes, [n, 3], m.
        tension: of the elements, N; of a catenary the mean of both ends.
        residual: load less pull of the elements at `displacement`, 0 where held, [n, 3], N.
        scale: largest sum over a node of the sizes of end forces and load, N.
        floor: force that rounding of displacements in double precision leaves at a node, [n], N.
        found: whether it is an equilibrium.
        why: in words.
        steps: factorisations of the interior-point method and of Newton's method.
    """

    displacement: np.ndarray
    tension: list
    residual: np.ndarray
    scale: np.longdouble
    floor: np.ndarray
    found: bool
    why: str
    steps: tuple = (0, 0)


class _Net:
    """A scene's cables, ropes and jacks as arrays over elements and over their segments."""

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
        axial = [e for e in scene.elements if e.kind != "catenary"]
        of = [(a, b, k) for k, e in enumerate(axial) for a, b in pairwise(e.links)]
        self.i, self.j, self.of = np.array(of, int).reshape(-1, 3).T
        self.jack = np.array([e.kind == "jack" for e in axial], bool)
        self.force = wide([e.force if e.kind == "jack" else 0 for e in axial])
        self.EA = wide([0 if e.kind == "jack" else e.stiffness for e in axial])
        self.rest = wide([0 if e.kind == "jack" else e.rest_length for e in axial])
        self.flex = np.where(self.jack, 0, self.rest / np.where(self.jack, 1, self.EA))
        self.single = np.bincount(self.of, minlength=len(axial)) == 1
        self.p = self.load[self.free]
        self.met = ()  # elements of segments that have lost their length

    def total(self, x):
        """Sum over the segments of each element."""
        out = np.zeros(len(self.jack), WIDE)
        np.add.at(out, self.of, x)
        return out

    def spread(self, q, out=None):
        """Forces q [segments, 3] of the segments on the free unknowns, as their nodes feel it."""
        out = np.zeros(self.count + 1, WIDE)
        np.add.at(out, self.number[self.i], -q)
        np.add.at(out, self.number[self.j], q)
        return out[:-1]

    def across(self, x):
        """Differences of the free unknowns x over the segments, [segments, 3]."""
        x = np.append(x, WIDE(0))
        return x[self.number[self.j]] - x[self.number[self.i]]

    def matrix(self, blocks, rows, weight):
        """Sum of `blocks` [segments, 3, 3] over the segments, and of weighted rows' products."""
        out = np.zeros((self.count + 1,) * 2, WIDE)
        i, j = self.number[self.i], self.number[self.j]
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


def _dot(a, b):
    return (a * b).sum(-1)


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


def _joined(nodes, moved, lower, i, j):
    """Vectors from nodes i to j as two numbers each, and their lengths as two numbers each, m."""
    (a, a_low), (b, b_low) = _sum(nodes[j], -nodes[i]), _sum(moved[j], -moved[i])
    d, low = _sum(a, b)
    d, low = _sum(d, low + a_low + b_low + (lower[j] - lower[i]))
    squares, left = _square(d)
    total, more = _sum(squares[:, 0], squares[:, 1])
    total, rest = _sum(total, squares[:, 2])
    rest = rest + more + left.sum(-1) + 2 * _dot(d, low)
    l = np.sqrt(total)
    square, less = _square(l)
    return d, l, ((total - square) - less + rest) / np.where(l > 0, 2 * l, 1)


def _elongations(net, moved, lower):
    """Vectors and lengths of the segments, elongations of the elements, m, without cancellation."""
    d, l, low = _joined(net.nodes, moved, lower, net.i, net.j)
    long, rest = -net.rest, net.total(low)
    for k in np.unique(_rank(net.of)):  # one segment of each element at a time
        pick = _rank(net.of) == k
        at = net.of[pick]
        long[at], more = _sum(long[at], l[pick])
        rest[at] += more
    return d, l, long + rest


def _rank(of):
    """Place of each segment within its element, where segments of an element are neighbours."""
    return np.arange(len(of)) - np.searchsorted(of, of)


def _factor(A):
    """Cholesky factor of A scaled to a diagonal of ones; what has no stiffness is held."""
    s = np.diag(A)
    s = np.where(s > 0, 1 / np.sqrt(np.where(s > 0, s, 1)), 1)
    A = A * s[:, None] * s
    L = np.zeros_like(A)
    for k in range(len(A)):
        column = A[k:, k] - L[k:, :k] @ L[k, :k]
        pivot = column[0] if column[0] > 4 * len(A) * EPS else WIDE(1e30)
        L[k:, k] = column / np.sqrt(pivot)
        L[k, k] = np.sqrt(pivot)
    return L, s


def _solve(factor, b):
    L, s = factor
    y = b * s
    for k in range(len(y)):
        y[k] /= L[k, k]
        y[k + 1 :] -= L[k + 1 :, k] * y[k]
    for k in range(len(y) - 1, -1, -1):
        y[k] /= L[k, k]
        y[:k] -= L[k, :k] * y[k]
    return y * s


class _Cones:
    """Scaling of Nesterov and Todd of pairs z = (t, d), y = (N, -q) in second-order cones.

    W y = W^-1 z with W = theta (w0, w'; w, 1 + w w' / (1 + w0)) and w0^2 = 1 + w' w.
    The distances t - |d| and N - |q| are given, as differences they would be rounded.
    """

    def __init__(self, d, above, q, over):
        ld, lq = np.sqrt(_dot(d, d)), np.sqrt(_dot(q, q))
        sz, sy = np.sqrt(above * (2 * ld + above)), np.sqrt(over * (2 * lq + over))
        apart = d / np.where(ld > 0, ld, 1)[:, None] - q / np.where(lq > 0, lq, 1)[:, None]
        self.gap = ld * lq * _dot(apart, apart) / 2 + above * lq + over * ld + above * over
        half = np.sqrt((1 + self.gap / (sz * sy)) / 2)
        z0, z = (ld + above) / sz, d / sz[:, None]
        y0, y = (lq + over) / sy, -q / sy[:, None]
        self.w = (z - y) / (2 * half)[:, None]
        length = np.sqrt(_dot(self.w, self.w))
        self.w0 = np.sqrt(1 + length**2)
        self.theta = np.sqrt(sz / sy)
        self.a = 1 + 2 * length**2
        unit = self.w / np.where(length > 0, length, 1)[:, None]
        along = unit[:, :, None] * unit[:, None, :]
        less = (2 * length**2 / self.a)[:, None, None]
        self.f = self.theta**2 / self.a  # dt by -dN
        self.t = 2 * (self.w0 / self.a)[:, None] * self.w  # dt by dd, dq by dN
        self.K = (np.eye(3) - less * along) / (self.theta**2)[:, None, None]  # dq by dd
        self.size = np.sqrt(sz * sy)
        low = ((half + z0)[:, None] * y + (half + y0)[:, None] * z) / (z0 + y0 + 2 * half)[:, None]
        self.point = np.column_stack([half, low]) * self.size[:, None]  # W y

    def scaled(self, v, way):
        """W v (way 1) or W^-1 v (way -1)."""
        inner = _dot(self.w, v[:, 1:])
        first = self.w0 * v[:, 0] + way * inner
        rest = v[:, 1:] + (way * v[:, 0] + inner / (1 + self.w0))[:, None] * self.w
        return np.column_stack([first, rest]) * (self.theta**way)[:, None]

    def product(self, a, b):
        return np.column_stack([_dot(a, b), a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:]])

    def quotient(self, r):
        """What gives r when multiplied with the scaled point."""
        l0, l1 = self.point[:, 0], self.point[:, 1:]
        first = (l0 * r[:, 0] - _dot(l1, r[:, 1:])) / self.size**2
        return np.column_stack([first, (r[:, 1:] - l1 * first[:, None]) / l0[:, None]])

    def room(self, step):
        """Largest share of a scaled step that stays in all cones."""
        p = self.point / self.size[:, None]
        first = p[:, 0] * step[:, 0] - _dot(p[:, 1:], step[:, 1:])
        rest = step[:, 1:] - p[:, 1:] * ((first + step[:, 0]) / (p[:, 0] + 1))[:, None]
        return 1 / max(((np.sqrt(_dot(rest, rest)) - first) / self.size).max(), WIDE(1e-30))


def _longer(a, b):
    """Growth of the lengths of vectors a by vectors b."""
    c = a + b
    sum_ = np.sqrt(_dot(a, a)) + np.sqrt(_dot(c, c))
    return _dot(b, 2 * a + b) / np.where(sum_ > 0, sum_, 1)


def _interior(net, start, most=80):
    """Interior-point method from displacements `start` [n, 3], m.

    Yields displacements, forces N and the number of factorisations, once it is near and then after
    each further step.
    """
    moved = np.where(net.free, start, net.still)
    zero = np.zeros_like(moved)
    d, l, long = _elongations(net, moved, zero)
    size = max(l.max(), net.rest.max())
    strain = np.maximum(long, 0) / np.where(net.jack, 1, net.rest)
    pull = max(np.abs(net.p).max(initial=0), net.force.max(), (net.EA * strain).max())
    if pull == 0:
        yield moved, np.zeros_like(net.force), net.jack, 0
        return
    N = np.where(net.jack, net.force, pull)
    own = N[net.of]
    t = (pull * size / own + np.sqrt((pull * size / own) ** 2 + 4 * l**2)) / 2
    q = (own / t)[:, None] * d
    above, over = t - l, own * (t - l) / t  # t - |d| and N - |q|
    segments = net.total(np.ones_like(own))
    level, before = [], (N, net.total(above))
    for steps in range(most):
        r = net.p - net.spread(q)
        miss = np.where(net.jack, 0, net.flex * N - long - net.total(above))
        cones = _Cones(d, above, q, over)
        margin = net.total(above)
        lost = N.max() < EPS**2 * net.EA.max()
        near = np.abs(r).max(initial=0) < 1e-12 * N.max() and np.abs(miss).max() < 1e-12 * size
        if lost or (near and cones.gap.max() < 1e-13 * N.max() * size):
            yield moved.copy(), N, N * before[1] > before[0] * margin, steps
        before = N, margin
        level.append(cones.gap.max())
        net.met = net.of[(l + above < 1e-9 * size) & (over > 1e-3 * N[net.of])]
        still = near and level[-1] > min(level[-6:-5], default=np.inf)
        if lost or len(net.met) or still or level[-1] < EPS**1.5 * N.max() * size:
            break
        flex = net.flex + net.total(cones.f)
        k = np.where(net.jack, 0, 1 / flex)
        rows = net.rows(cones.t)
        alone = np.where(net.single, k, 0)[net.of][:, None, None]
        blocks = cones.K + alone * cones.t[:, :, None] * cones.t[:, None, :]
        factor = _factor(net.matrix(blocks, rows, k))

        def step(aim, share, cones=cones, k=k, rows=rows, factor=factor, r=r, miss=miss):
            eta = cones.scaled(cones.quotient(aim), -1)
            known = k * (net.total(cones.f * eta[:, 0]) - share * miss)
            off = eta[:, 1:] + cones.t * eta[:, :1]
            dx = _solve(factor, share * r + net.spread(off) - known @ rows)
            dd = net.across(dx)
            dN = k * (rows @ dx) + known
            each = dN[net.of]
            dt = cones.f * (eta[:, 0] - each) + _dot(cones.t, dd)
            dq = (cones.K @ dd[:, :, None])[:, :, 0] + cones.t * each[:, None] - off
            primal = cones.scaled(np.column_stack([dt, dd]), -1)
            dual = cones.scaled(np.column_stack([each, -dq]), 1)
            return dx, dN, dt, dq, primal, dual

        square = cones.product(cones.point, cones.point)
        *_, primal, dual = step(-square, 1)
        share = 1 - min(1, cones.room(primal), cones.room(dual))
        aim = -square - cones.product(primal, dual)
        aim[:, 0] += share**3 * cones.gap.mean()
        dx, dN, dt, dq, primal, dual = step(aim, 1 - share**3)
        way = min(1, 0.99 * cones.room(primal), 0.99 * cones.room(dual))
        moved[net.free] += way * dx
        above = above + way * dt - _longer(d, way * net.across(dx))
        over = over + way * dN[net.of] - _longer(q, way * dq)
        q = q + way * dq
        own = np.sqrt(_dot(q, q)) + over  # N as its small parts sum up, not as it once was rounded
        N = np.where(net.jack, net.force, net.total(own) / segments)
        own = N[net.of] / own
        q, over = q * own[:, None], over * own
        if not (above.min() > 0 and over.min() > 0):
            break
        d, l, long = _elongations(net, moved, zero)
    yield moved, N, N * before[1] > before[0] * margin, steps


def _at(net, moved, lower, tension=None):
    """Residual, sums of the sizes of forces and floor at each node, tensions of a state, N."""
    d, l, long = _elongations(net, moved, lower)
    N = np.where(net.jack, net.force, np.maximum(long, 0) / np.where(net.jack, 1, net.flex))
    N = N if tension is None else np.asarray(tension, WIDE)
    own = N[net.of]
    pull = own[:, None] * d / np.where(l > 0, l, 1)[:, None]
    residual, sums = net.load.copy(), np.sqrt(_dot(net.load, net.load))
    floor = np.zeros_like(sums)
    shift = moved[net.j] - moved[net.i]
    unsure = (net.EA / np.where(net.jack, 1, net.rest))[net.of] * np.sqrt(_dot(shift, shift))
    for nodes, sign in ((net.j, 1), (net.i, -1)):
        np.add.at(residual, nodes, -sign * pull)
        np.add.at(sums, nodes, own)
        np.add.at(floor, nodes, unsure * np.finfo(float).eps)
    return np.where(net.free, residual, 0), sums, floor, N


def _excess(state, scale=None):
    """Largest residual as a multiple of what is allowed; scale per node or for all nodes, N."""
    residual, sums, floor, _ = state
    room = floor * (EPS / np.finfo(float).eps * ROUNDS)
    room = np.maximum(CLOSE * (sums if scale is None else scale), room)
    size = np.sqrt(_dot(residual, residual))
    return (size / np.where(size > 0, np.maximum(room, WIDE(1e-4000)), 1)).max()


def _polish(net, moved, N, taut, most=8):
    """Newton's method with displacements and forces unknown; a cable is slack or taut as both say.

    Returns displacements, forces, the excess of the residual and factorisations.
    """
    moved, zero = moved.copy(), np.zeros_like(moved)
    flex = np.where(net.jack, 1, net.flex)
    best = moved, N, np.inf
    for steps in range(most):
        excess = _excess(_at(net, moved, zero))
        settled = excess <= 0.1 and excess >= 0.1 * best[2]  # rounding is left
        if excess < best[2]:
            best = moved.copy(), N, excess
        if settled or excess < 1e-5:
            break
        d, l, long = _elongations(net, moved, zero)
        t = d / np.where(l > 0, l, 1)[:, None]
        gap = np.where(net.jack, 0, long - net.flex * N)
        taut = (long > 0 if steps else taut) & ~net.jack
        N = np.where(taut | net.jack, N, 0)
        gap = np.where(taut, gap, 0) / flex
        k = np.where(taut, 1 / flex, 0)
        own = N[net.of]
        axial = t[:, :, None] * t[:, None, :]
        blocks = (np.maximum(own, 0) / np.where(l > 0, l, 1))[:, None, None] * (np.eye(3) - axial)
        blocks = blocks + np.where(net.single, k, 0)[net.of][:, None, None] * axial
        rows = net.rows(t)
        matrix = net.matrix(blocks, rows, k)
        matrix[np.diag_indices(net.count)] *= 1 + WIDE("1e-16")
        dx = _solve(_factor(matrix), net.p - net.spread(own[:, None] * t) - gap @ rows)
        N = N + np.where(taut, k * (rows @ dx) + gap, 0)
        moved[net.free] += dx
    return *best, steps


def _unbounded(scene):
    """Whether loads move nodes away without end, by pulls that jacks and cables cannot hold.

    Such movements lengthen no cable: the nodes that cables join move as one. With them as the nodes
    of a net of the jacks, each within reach of a soft cable's unstressed length, the soft cables
    are stressed if and only if there is no end.
    """
    free, load = np.asarray(scene.free, bool), np.asarray(scene.load, WIDE)
    group = np.arange(len(free))
    for e in scene.elements:
        for a, b in pairwise(e.links):
            if e.kind != "jack":
                group[group == group[a]] = group[b]
    names, group = np.unique(group, return_inverse=True)
    n = len(names)
    loose = np.ones((n + 1, 3), bool)
    np.logical_and.at(loose, group, free)
    loose[n] = False
    total, size = np.zeros((n + 1, 3), WIDE), np.abs(load[free]).max(initial=0)
    np.add.at(total, group, load)
    held = [
        replace(e, links=tuple(group[list(e.links)])) for e in scene.elements if e.kind == "jack"
    ]
    held = [e for e in held if e.links[0] != e.links[1]]
    size = max([size, *(e.force for e in held)])
    total[~loose] = 0
    if np.abs(total).max(initial=0) <= CLOSE * size:
        return False
    soft = [Element("cable", (k, n), size, WIDE(1)) for k in range(n)]
    net = _Net(Scene(np.zeros((n + 1, 3)), loose, total, held + soft))
    *_, (_, N, _, _) = _interior(net, net.still)
    return bool(N[len(held) :].max() > 1e-9 * size)


def find(scene, start=None):
    """Equilibrium of a scene from displacements `start` [n, 3], m."""
    net = _Net(scene)
    start = np.zeros_like(net.nodes) if start is None else np.asarray(start, WIDE)
    if _unbounded(scene):
        why = "no equilibrium: loads move nodes away without end"
        return Found(net.still, None, None, None, None, False, why)
    best, newton = (None, None, np.inf), 0
    for moved, N, taut, steps in _interior(net, start):  # noqa: B007
        *last, more = _polish(net, moved, N, taut)
        newton += more
        best = min(best, last, key=lambda b: b[2])
        if best[2] <= 1:
            break
    moved, N, _ = best
    state = _at(net, moved, np.zeros_like(moved))
    residual, sums, floor, _ = state
    scale = sums.max()
    found, why = bool(_excess(state, scale) <= 1), "equilibrium"
    if scale <= 64 * EPS * net.EA.max(initial=0):
        found, why = True, "all forces are lost"
    elif not found and len(net.met):
        why = f"no equilibrium: element {net.met[0]} draws two of its nodes together"
    elif not found:
        why = "the search did not converge"
    return Found(moved, list(N), residual, scale, floor, found, why, (steps, newton))


def check(scene, displacement_hi, displacement_lo=None, tension=None):
    """Residual [n, 3] and largest sum of forces at a node, N, of a state's displacements, m.

    The displacement is the sum of two arrays. With `tension`, N, of each element, the residual of
    these at the state's directions.
    """
    net = _Net(scene)
    high = np.asarray(displacement_hi, WIDE)
    low = np.zeros_like(high) if displacement_lo is None else np.asarray(displacement_lo, WIDE)
    residual, sums, *_ = _at(net, high, low, tension)
    return residual, sums.max()
