"""Elastic catenaries in extended precision, for `convex_oracle`: chord and tension either way.

Of tension T(s) = F - q s along the unstressed length, s from -L0 / 2 to L0 / 2, the chord is

    chord(F) = integral of T / EA + T / |T|

a function of one F only, as it is the gradient of a convex energy of F. F has a component v along
q and h across it; the differences of Irvine's closed forms are written without cancellation, down
to a load or a lateral force of nothing.
"""

from copy import copy

import numpy as np
from oracles.convex_cones import WIDE, dot

TINY = WIDE("1e-24")  # of the weight or the length, what stands for nothing across the load


def unit(a, otherwise=0):
    """Unit vectors along a, [n, 3]; `otherwise` where a is zero."""
    size = np.sqrt(dot(a, a))[:, None]
    return np.where(size > 0, a / np.where(size > 0, size, 1), otherwise)


class Hung:
    """Elastic catenaries from nodes i to j: stiffness EA [n], N, length [n], m, load q [n, 3], N/m.

    `w` and `u` are the size and the direction of the loads; one of nearly nothing stands for none.
    """

    def __init__(self, elements):
        self.i, self.j = np.array([e.links for e in elements], int).reshape(-1, 2).T
        self.EA = np.array([e.stiffness for e in elements], WIDE)
        self.rest = np.array([e.rest_length for e in elements], WIDE)
        self.q = np.array([e.load for e in elements], WIDE).reshape(-1, 3)
        self.u = unit(self.q, np.eye(3)[2])
        self.w = np.maximum(np.sqrt(dot(self.q, self.q)), WIDE("1e-25") * self.EA / self.rest)

    def _some(self, pick):
        other = copy(self)
        for name, value in vars(self).items():
            setattr(other, name, value[pick])
        return other

    def half(self):
        """Half of the weights, which each of the ends carries, [n, 3], N."""
        return self.q * self.rest[:, None] / 2

    def parts(self, F):
        """Components of F across and along the loads, and the unit vectors across, [n, 3]."""
        v = dot(F, self.u)
        across = F - v[:, None] * self.u
        axis = np.eye(3)[np.argmin(np.abs(self.u), 1)]
        other = unit(axis - dot(axis, self.u)[:, None] * self.u)
        h = np.maximum(np.sqrt(dot(across, across)), TINY * self.w * self.rest)
        return h, v, unit(across, other)

    def chord(self, h, v):
        """Chord across and along, m, its square less L0^2, slopes A, a and c, m/N; as in `slopes`.

        A is the integral of 1 / |T|, a that of h^2 / |T|^3 and c that of h v / |T|^3.
        """
        w, rest, EA = self.w, self.rest, self.EA
        D = w * rest
        top, low = v + D / 2, v - D / 2
        r, s = np.hypot(h, top), np.hypot(h, low)
        R, f = r + s, np.hypot(h, v)
        up = np.where(top > 0, h**2 / np.where(top > 0, r + top, 1), r - top)
        down = np.where(low < 0, h**2 / np.where(low < 0, s - low, 1), s + low)
        x = D / R
        double = np.log1p(2 * D / (up + down))  # twice the area tangent of x
        series = 0
        for k in range(19, 1, -2):
            series = (series + 1 / WIDE(k)) * x**2
        A = double / w
        bow = np.where(x < 0.05, 2 * x * series, double - 2 * x) / w
        first = rest / EA + 2 * rest / R
        sag = D**2 / 4 * (1 / (r + f) + 1 / (s + f)) - 2 * (v * D) ** 2 / (R * (r + f) * (s + f))
        strain = f / EA - sag / R
        excess = rest**2 * strain * (2 + strain) + h**2 * bow * (2 * first + bow)
        turn = np.arctan2(h * D, h**2 + top * low)
        mean = np.hypot(h / r + h / s, top / r + low / s)
        S = 2 * np.sin(turn / 2) / w / np.where(mean > 0, mean, 1)
        cross = (top > 0) & (low < 0)
        a = np.where(cross, (top / r - low / s) / w, S * (h / r + h / s))
        c = np.where(cross, (h / s - h / r) / w, S * (top / r + low / s))
        return h * (first + bow), v * first, excess, A, a, c

    def slopes(self, F):
        """Derivatives of the chords by F, [n, 3, 3], m/N."""
        h, v, e = self.parts(F)
        *_, A, a, c = self.chord(h, v)
        A, a, c = (x[:, None, None] for x in (A, a, c))
        ee, eu, uu = (
            x[:, :, None] * y[:, None, :] for x, y in ((e, e), (e, self.u), (self.u, self.u))
        )
        own = (self.rest / self.EA)[:, None, None] + A
        return own * np.eye(3) - A * uu - a * (ee - uu) - c * (eu + np.swapaxes(eu, 1, 2))

    def miss(self, F, d, l, low):
        """Chords d, of lengths l + low, less those of forces F, [n, 3], m."""
        h, v, e = self.parts(F)
        x, z, excess, *_ = self.chord(h, v)
        return self._less(d, x[:, None] * e + z[:, None] * self.u, excess, l, low)

    def _less(self, d, own, excess, l, low):
        """Vectors d less `own`; along d by their squares less L0^2, so without cancellation."""
        length = np.sqrt(dot(own, own))
        longer = ((l - self.rest + low) * (l + self.rest) - excess) / (l + length)
        apart = unit(own) - unit(d)
        along = longer + length * dot(apart, apart) / 2
        gap = d - own
        return gap + (along - dot(gap, unit(d)))[:, None] * unit(d)

    def guess(self, d, l):
        """Forces of a straight bar, or of a shallow parabola where the chord is shorter than L0."""
        full = np.cbrt(self.EA * (self.w * self.rest) ** 2 / 24)
        slack = np.maximum(self.rest / np.where(l > 0, l, 1) - 1, WIDE("1e-30"))
        size = np.minimum(full, self.w * self.rest / np.sqrt(24 * slack))
        size = size + self.EA * np.maximum(l / self.rest - 1, 0)
        return size[:, None] * unit(d)

    def pull(self, d, l, low, F=None):
        """Forces F of chords d, of lengths l + low, [n, 3], N; from F nearby, if given."""
        along = dot(d, self.u)
        across = d - along[:, None] * self.u
        e = np.where(dot(across, across)[:, None] > 0, unit(across), self.parts(0 * d)[2])
        across = np.maximum(np.sqrt(dot(across, across)), TINY * self.rest)
        chord = np.column_stack([across, along]), l, low
        h, v, _ = self.parts(self.guess(d, l) if F is None else F)
        h, v, done = self._newton(h, v, chord, 12)
        if not done.all():
            rest = self._some(~done)
            part = tuple(x[~done] for x in chord)
            h[~done], v[~done], _ = rest._newton(*rest._nested(part), part, 8)
        return h[:, None] * e + v[:, None] * self.u

    def _flat(self, h, v, chord):
        """What is missing across and along, m, and the slopes of `chord`."""
        x, z, excess, *slopes = self.chord(h, v)
        return *self._less(chord[0], np.column_stack([x, z]), excess, *chord[1:]).T, *slopes

    def _newton(self, h, v, chord, most):
        """Newton's method in h and v; whether it has converged."""
        active, last = h > 0, np.full(len(h), np.inf)
        soft = self.rest / self.EA
        for _ in range(most):
            x, z, A, a, c = self._flat(h, v, chord)
            p, q = soft + A - a, soft + a
            det = p * q - c * c
            dh, dv = (q * x + c * z) / det, (c * x + p * z) / det
            size = np.abs(dh) / h + np.abs(dv) / np.hypot(np.hypot(h, v), self.w * self.rest)
            active = active & ~((size < 1e-6) & (size >= last / 2)) & (size > 0)
            if not active.any():
                break
            last = size
            h = np.where(active, np.where(dh < -0.9 * h, h / 10, h + dh), h)
            v = np.where(active, v + dv, v)
        return h, v, ~active | (size < 1e-9)

    def _nested(self, chord):
        """Safeguarded: the logarithm of h, and within it v for each h."""
        d, l, _ = chord
        D, soft = self.w * self.rest, self.rest / self.EA
        x0, z0 = d.T
        low = np.log(x0 / self.rest * TINY * D)
        high = np.log(D + self.EA * (x0 + l) / self.rest)
        share = np.abs(z0) / self.rest
        way = low + (high - low) / 2
        for _ in range(120):
            h = np.exp(way)
            bound = share * np.minimum(self.EA, (h + D / 2) / np.maximum(1 - share, 1e-30))
            least, most = np.where(z0 > 0, 0, -bound), np.where(z0 > 0, bound, 0)
            v = (least + most) / 2
            for _ in range(100):
                x, z, A, a, c = self._flat(h, v, chord)
                least, most = np.where(z > 0, v, least), np.where(z > 0, most, v)
                new = v + z / (soft + a)
                new = np.where((new >= least) & (new <= most), new, (least + most) / 2)
                moved, v = np.abs(new - v), new
                if (moved <= 1e-15 * (np.abs(v) + h)).all():
                    break
            low, high = np.where(x > 0, way, low), np.where(x > 0, high, way)
            slope = (soft + A - a - c**2 / (soft + a)) * h
            new = way + np.log1p(np.maximum(x / (x0 - x), -0.99)) * (x0 - x) / slope
            new = np.where((new > low) & (new < high), new, (low + high) / 2)
            moved, way = np.abs(new - way), new
            if (moved < 1e-12).all():
                break
        return np.exp(way), v

    def tension(self, F):
        """Mean of the tensions of both ends, and each of them, N."""
        near, far = (np.sqrt(dot(T, T)) for T in (F + self.half(), F - self.half()))
        return (near + far) / 2, near, far
