"""Axial laws and the elastic catenary in NumPy, for `independent`; nothing from the package."""

import numpy as np

import jaxcable as jc

WIDE = np.longdouble


class AxialLaw:
    """Force from strain of the elements of a group: linear, polygonal, or parallel plastic parts.

    Attributes:
        EA: initial axial stiffness, [n], N.
        ends: strains at which the curve ends, or None.
        memory: plastic strains of the parallel parts, [n, n_part], or None.
    """

    def __init__(self, group, dtype):
        self.cable = group.tension_only
        n = len(group.links)
        self.points = self.ends = self.memory = None
        law = group.law
        if group.axial_stiffness is not None:
            self.EA = _seen(group.axial_stiffness, dtype)
            return
        area = _seen(group.area, dtype)
        if isinstance(law, jc.Elastic):
            self.EA = area * _seen(law.E, dtype)
            return
        self.area = area
        self.points = _seen(law.strain, dtype), _seen(law.stress, dtype)
        e, s = self.points
        self.one_sided = self.cable or e[0] == 0
        self.ends = (-np.inf if self.one_sided else e[0]), e[-1]
        slopes = np.diff(s) / np.diff(e)
        zero = int(np.flatnonzero(e == 0)[0])
        self.EA = area * slopes[zero]
        if law.unloading == "elastic":
            # Besseling's parts, of a curve that is the same in tension and compression or has
            # no compression: each yields at a corner and carries the fall of slope there
            self.yields = e[zero + 1 : -1]
            self.shares = slopes[zero:-1] - slopes[zero + 1 :]
            self.last = slopes[-1]
            self.memory = np.zeros((n, len(self.yields)), WIDE)

    def force(self, strain):
        """Axial force, largest stiffness at any strain, forces of parts inside, [n] each, N."""
        nothing = np.zeros_like(strain)
        if self.points is None:
            force, stiffness = self.EA * strain, self.EA + nothing
            inner = nothing
        elif self.memory is None:
            force = self.area * _polygon(*self.points, strain)
            stiffness, inner = self.EA + nothing, nothing
            if self.one_sided:
                force = np.where(strain < 0, 0, force)
        else:
            kept = self._kept(strain)
            force = self.area * (self.last * strain + (self.shares * kept).sum(-1))
            inner = self.area * (np.abs(self.last * strain) + (self.shares * np.abs(kept)).sum(-1))
            stiffness = self.EA + nothing
            if self.one_sided:
                force = np.where(force < 0, 0, force)
        if self.cable and self.memory is None:
            force = np.where(strain < 0, 0, force)
        return force, stiffness, inner

    def _kept(self, strain):
        elastic = strain[:, None] - self.memory
        low = -np.inf if self.one_sided else -self.yields
        return np.clip(elastic, low, self.yields)

    def commit_memory(self, strain):
        """Plastic strains after an increment that ended at `strain`."""
        self.memory = strain[:, None] - self._kept(strain)

    def strain_at(self, force):
        """Strain at a force on the rising branch of an unused material."""
        if self.points is None:
            return force / self.EA
        e, s = self.points
        stress = force / self.area
        zero = int(np.flatnonzero(e == 0)[0])
        top = zero + int(np.argmax(s[zero:]))
        low = zero if self.one_sided else int(np.argmin(s[: zero + 1]))
        return _polygon(s[low : top + 1], e[low : top + 1], stress)

    def beyond(self, strain, eps):
        """Whether an element is strained beyond the curve, by more than rounding."""
        room = 16 * eps * np.abs(self.points[0]).max()
        return (strain > self.ends[1] + room) | (strain < self.ends[0] - room)


def _seen(values, dtype):
    return np.asarray(np.asarray(values), dtype).astype(WIDE)


def _polygon(x, y, at):
    """Piecewise linear interpolation in extended precision; straight on beyond the ends."""
    k = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    return y[k] + (at - x[k]) * ((y[k + 1] - y[k]) / (x[k + 1] - x[k]))


def hang(chord, load, rest, EA):
    """Tension vector in the middle of an elastic catenary, mean end tension, largest stiffness.

    Irvine's integrals along and across the load, solved for both components by Newton's method with
    the exact Jacobian; the horizontal one as its logarithm. NaN if it does not converge.
    """
    weight = np.sqrt((load**2).sum())
    unit = load / weight
    z = chord @ unit
    level = chord - z * unit
    x = np.sqrt((level**2).sum())
    side = level / x
    total = weight * rest

    def chord_of(h, v):
        high, low = v + total / 2, v - total / 2
        r1, r2 = np.hypot(h, high), np.hypot(h, low)
        if low < 0 < high and -low > h:
            arc = np.log((high + r1) * (r2 - low) / h**2)
        elif high <= 0:
            arc = np.log1p((total - 2 * v * total / (r1 + r2)) / (r1 - high))
        else:
            arc = np.log1p((total + 2 * v * total / (r1 + r2)) / (low + r2))
        run = h * (rest / EA + arc / weight)
        rise = v * (rest / EA + 2 * rest / (r1 + r2))
        a = rest / EA + arc / weight - (high / r1 - low / r2) / weight
        b = -h * (1 / r2 - 1 / r1) / weight
        c = rest / EA + (high / r1 - low / r2) / weight
        return np.array([run, rise]), np.array([[a, b], [b, c]])

    aim = np.array([x, z])
    span = np.sqrt(x * x + z * z)
    slack = max(rest**2 / span**2 - 1, WIDE(0))
    strain = max(span / rest - 1, WIDE(0)) + np.cbrt((total / EA) ** 2 / 24)
    force = min(EA * strain, total * np.sqrt(1 / (24 * slack))) if slack > 0 else EA * strain
    h, v = force * x / span, force * z / span
    best = None
    for _ in range(200):
        value, slope = chord_of(h, v)
        miss = aim - value
        det = slope[0, 0] * slope[1, 1] - slope[0, 1] ** 2
        step = np.array(
            [
                (slope[1, 1] * miss[0] - slope[0, 1] * miss[1]) / det,
                (slope[0, 0] * miss[1] - slope[0, 1] * miss[0]) / det,
            ]
        )
        size = np.abs(step).max() / np.hypot(h, v)
        if best is not None and size < 1e-6 and size >= best:
            break  # rounding is left
        best = size if best is None else min(size, best)
        # the horizontal part by a factor, so that it stays positive; no more than e at once
        grown = step[0] / h
        scale = min(WIDE(1), 1 / max(np.abs(grown), WIDE(1e-300)))
        room = 2 * (np.hypot(h, v) + total)
        scale = min(scale, room / max(np.abs(step[1]), WIDE(1e-300)))
        h, v = h * np.exp(scale * grown) if grown < 0 else h + scale * step[0], v + scale * step[1]
    pull = h * side + v * unit
    mean = (np.hypot(h, v + total / 2) + np.hypot(h, v - total / 2)) / 2
    stiffness = max(slope[0, 0], slope[1, 1]) / det
    # of a nearly straight cable the force is known to the rounding of its length only
    if not size < 1e-12 + 64 * np.finfo(WIDE).eps * stiffness * span / np.hypot(h, v):
        return np.nan * pull, np.nan * mean, stiffness
    return pull, mean, stiffness
