"""Second-order cone programs of nets in extended precision, for `convex_oracle`.

A primal-dual interior-point method: the scaling of Nesterov and Todd, Mehrotra's predictor and
corrector, and the distances from the cones' boundaries as variables, so that they keep all their
digits while they go to zero.
"""

import numpy as np

WIDE = np.longdouble
EPS = np.finfo(WIDE).eps


def dot(a, b):
    """Products of vectors along the last axis."""
    return (a * b).sum(-1)


def factor(A):
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


def solve(factors, b):
    """Solution of A x = b by A's `factor`."""
    L, s = factors
    y = b * s
    for k in range(len(y)):
        y[k] /= L[k, k]
        y[k + 1 :] -= L[k + 1 :, k] * y[k]
    for k in range(len(y) - 1, -1, -1):
        y[k] /= L[k, k]
        y[:k] -= L[k, :k] * y[k]
    return y * s


class Cones:
    """Scaling of Nesterov and Todd of pairs z = (t, d), y = (N, -q) in second-order cones.

    W y = W^-1 z with W = theta (w0, w'; w, 1 + w w' / (1 + w0)) and w0^2 = 1 + w' w.
    The distances t - |d| and N - |q| are given, as differences they would be rounded.
    """

    def __init__(self, d, above, q, over):
        ld, lq = np.sqrt(dot(d, d)), np.sqrt(dot(q, q))
        sz, sy = np.sqrt(above * (2 * ld + above)), np.sqrt(over * (2 * lq + over))
        apart = d / np.where(ld > 0, ld, 1)[:, None] - q / np.where(lq > 0, lq, 1)[:, None]
        self.gap = ld * lq * dot(apart, apart) / 2 + above * lq + over * ld + above * over
        half = np.sqrt((1 + self.gap / (sz * sy)) / 2)
        z0, z = (ld + above) / sz, d / sz[:, None]
        y0, y = (lq + over) / sy, -q / sy[:, None]
        self.w = (z - y) / (2 * half)[:, None]
        length = np.sqrt(dot(self.w, self.w))
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
        inner = dot(self.w, v[:, 1:])
        first = self.w0 * v[:, 0] + way * inner
        rest = v[:, 1:] + (way * v[:, 0] + inner / (1 + self.w0))[:, None] * self.w
        return np.column_stack([first, rest]) * (self.theta**way)[:, None]

    def product(self, a, b):
        return np.column_stack([dot(a, b), a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:]])

    def quotient(self, r):
        """What gives r when multiplied with the scaled point."""
        l0, l1 = self.point[:, 0], self.point[:, 1:]
        first = (l0 * r[:, 0] - dot(l1, r[:, 1:])) / self.size**2
        return np.column_stack([first, (r[:, 1:] - l1 * first[:, None]) / l0[:, None]])

    def room(self, step):
        """Largest share of a scaled step that stays in all cones."""
        p = self.point / self.size[:, None]
        first = p[:, 0] * step[:, 0] - dot(p[:, 1:], step[:, 1:])
        rest = step[:, 1:] - p[:, 1:] * ((first + step[:, 0]) / (p[:, 0] + 1))[:, None]
        return 1 / max(((np.sqrt(dot(rest, rest)) - first) / self.size).max(), WIDE(1e-30))


def _longer(a, b):
    """Growth of the lengths of vectors a by vectors b."""
    c = a + b
    both = np.sqrt(dot(a, a)) + np.sqrt(dot(c, c))
    return dot(b, 2 * a + b) / np.where(both > 0, both, 1)


class Interior:
    """State of the method on a net: displacements `moved`, forces N and pulls q of segments, N.

    `above` is t - |d|, m, `over` is N - |q|, N, `met` names elements with a segment of no length.
    """

    def __init__(self, net, start):
        self.net, self.met = net, ()
        self.moved = np.where(net.free, start, net.still)
        d, l, long = net.elongations(self.moved)
        self.size = max(l.max(initial=0), net.rest.max(initial=0))
        strain = np.maximum(long, 0) / np.where(net.jack, 1, net.rest)
        pull = max(np.abs(net.p).max(initial=0), net.force.max(initial=0))
        pull = max(pull, (net.EA * strain).max(initial=0))
        self.N = np.where(net.jack, net.force, pull)
        own = np.where(self.N > 0, self.N, 1)[net.of]
        t = (pull * self.size / own + np.sqrt((pull * self.size / own) ** 2 + 4 * l**2)) / 2
        self.above, self.over = t - l, own * (t - l) / t  # all in the middle of their cones
        self.q = (own / t)[:, None] * d

    def walk(self, most=80):
        """Yields which elements are likely taut, the factorisations and whether this is the end.

        Once near the end, and then after each step.
        An element is taut rather than slack if its force falls less than its room to lengthen.
        """
        net, before, gaps = self.net, None, []
        if not self.N.any():
            yield net.jack, 0, True
            return
        for steps in range(most):
            d, l, long = net.elongations(self.moved)
            margin = net.total(self.above)
            r = net.p - net.spread(self.q)
            miss = np.where(net.jack, 0, net.flex * self.N - long - margin)
            now = self.N, margin
            taut = now[0] * before[1] > before[0] * now[1] if before else self.N > 0
            before = now
            top = self.N.max()
            inside = self.above.min() > 0 and self.over.min() > 0
            near = np.abs(r).max(initial=0) < 1e-12 * top
            near = near and np.abs(miss).max() < 1e-12 * self.size
            if inside:
                cones = Cones(d, self.above, self.q, self.over)
            gaps.append(cones.gap.max())
            close = gaps[-1] / (top * self.size)
            short = (l + self.above < 1e-9 * self.size) & (self.over > 1e-6 * self.N[net.of])
            self.met = np.unique(net.of[short & (self.N[net.of] > 1e-12 * top)])
            stalls = near and gaps[-1] > min(gaps[-6:-5], default=np.inf)
            last = not inside or stalls or len(self.met) or close < EPS**1.5
            last = last or top < EPS**2 * net.EA.max() or steps == most - 1
            if last or (near and close < 1e-13):
                yield taut, steps, last
            if last:
                return
            self._step(cones, d, r, miss)

    def _step(self, cones, d, r, miss):
        net = self.net
        solution = self._linear(cones, r, miss)
        square = cones.product(cones.point, cones.point)
        *_, primal, dual = solution(-square, 1)
        share = 1 - min(1, cones.room(primal), cones.room(dual))
        aim = -square - cones.product(primal, dual)
        aim[:, 0] += share**3 * cones.gap.mean()
        dx, dN, dt, dq, primal, dual = solution(aim, 1 - share**3)
        way = min(1, 0.99 * cones.room(primal), 0.99 * cones.room(dual))
        self.moved[net.free] += way * dx
        self.above = self.above + way * dt - _longer(d, way * net.across(dx))
        self.over = self.over + way * dN[net.of] - _longer(self.q, way * dq)
        self.q = self.q + way * dq
        # N as its parts sum up, not as it was rounded while it was larger
        own = np.sqrt(dot(self.q, self.q)) + self.over
        self.N = np.where(net.jack, net.force, net.total(own) / np.maximum(net.segments, 1))
        own = self.N[net.of] / own
        self.q, self.over = self.q * own[:, None], self.over * own

    def _linear(self, cones, r, miss):
        """Solver of the linear equations of a step, for an aim of the products and a share."""
        net = self.net
        k = 1 / np.where(net.jack, np.inf, net.flex + net.total(cones.f))
        rows = net.rows(cones.t)
        alone = np.where(net.single, k, 0)[net.of][:, None, None]
        blocks = cones.K + alone * cones.t[:, :, None] * cones.t[:, None, :]
        factors = factor(net.matrix(blocks, rows, k))

        def solution(aim, share):
            eta = cones.scaled(cones.quotient(aim), -1)
            known = k * (net.total(cones.f * eta[:, 0]) - share * miss)
            off = eta[:, 1:] + cones.t * eta[:, :1]
            dx = solve(factors, share * r + net.spread(off) - known @ rows)
            dd = net.across(dx)
            dN = k * (rows @ dx) + known
            each = dN[net.of]
            dt = cones.f * (eta[:, 0] - each) + dot(cones.t, dd)
            dq = (cones.K @ dd[:, :, None])[:, :, 0] + cones.t * each[:, None] - off
            primal = cones.scaled(np.column_stack([dt, dd]), -1)
            dual = cones.scaled(np.column_stack([each, -dq]), 1)
            return dx, dN, dt, dq, primal, dual

        return solution
