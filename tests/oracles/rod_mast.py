"""A guyed mast as one geometrically exact rod with elastic catenaries, by shooting from its base.

Written apart from the package, in NumPy and SciPy: a rod with axial, shear, bending and torsional
stiffness (Antman's theory), whose equations are integrated from the base upwards; at guys its force
jumps by the force of an elastic catenary, whose shape is a quadrature of its tension vector.

Shear is that of Engesser, for lattice and built-up columns (EN 1993-1-1, 6.4): the shear force is
normal to the axis, not in the cross-section. By the energy per length ``(EA e^2 + GA g^2) / 2`` of
the strain e, and of the angle g between the axis and the normal of the cross-section, the shear
force is ``GA g / (1 + e)``. In the cross-section (Reissner, Haringx) it would bend a lattice mast
otherwise, at any length of elements: by some P / GA of what is due to shear.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

GRAVITY = 9.80665
_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(48)
_PLACES, _WEIGHTS = 0.5 * (1 + _PLACES), 0.5 * _WEIGHTS


def guy_pull(anchor, top, length, stiffness, load, guess):
    """Tension vectors of a guy at its anchor and at its top, [3] each, towards the top, N.

    `load` is the force per unstressed length, [3], N/m; `length` the unstressed length, m.
    """

    def miss(first):
        along = first - np.outer(_PLACES * length, load)
        size = np.linalg.norm(along, axis=1, keepdims=True)
        curve = length * (_WEIGHTS @ (along * (1 / size + 1 / stiffness)))
        return curve - (top - anchor)

    first, _, code, _ = fsolve(miss, guess, full_output=True, xtol=1e-13)
    assert code in (1, 4, 5) and np.abs(miss(first)).max() < 1e-9
    return first, first - length * load


def cross(vector):
    """Matrix of the cross product with a vector, [3, 3]."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


class RodMast:
    """A hinged mast, with `sections` (top, EA, EI, GJ, GA), and guys.

    Args:
        sections: list of tuples.
        load: function of the height along the axis: force per length, [3], N/m.
        points: forces at heights, a list of (height, force [3]).
        guys: list of (height, anchor [3], unstressed length, EA, load per length [3]).
    """

    def __init__(self, sections, load, points, guys):
        self.sections, self.load, self.points, self.guys = sections, load, points, guys
        breaks = {0.0, *(s[0] for s in sections), *(g[0] for g in guys), *(p[0] for p in points)}
        self.breaks = sorted(breaks)
        self.pulls = [None] * len(guys)

    def _rates(self, s, state, section):
        rotation, n, m = state[3:12].reshape(3, 3), state[12:15], state[15:18]
        _, EA, EI, GJ, GA = section
        own_n, own_m = rotation.T @ n, rotation.T @ m
        axis = np.array([0.0, 0.0, 1.0])
        for _ in range(8):  # angles of some 1e-4: each round gains four digits
            stretch = 1 + own_n @ axis / EA
            angle = stretch / GA * (own_n - own_n @ axis * axis)
            axis = np.array([angle[0], angle[1], 1.0])
            axis /= np.linalg.norm(axis)
        strain = stretch * axis
        curvature = np.array([own_m[0] / EI, own_m[1] / EI, own_m[2] / GJ])
        along = rotation @ strain
        turned = rotation @ cross(curvature)
        return np.concatenate([along, turned.ravel(), -self.load(s), -np.cross(along, n)])

    def shoot(self, x, record=None):
        """Force and moment left at the top, [6], from base force, tilt and torsion, `x` [6]."""
        n, (tx, ty), torsion = x[:3], x[3:5], x[5]
        angle = np.hypot(tx, ty)
        axis = np.array([tx, ty, 0.0]) / max(angle, 1e-300)
        k = cross(axis)
        rotation = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
        base_moment = rotation @ np.array([0.0, 0.0, torsion])
        state = np.concatenate([np.zeros(3), rotation.ravel(), n, base_moment])
        for low, high in zip([0.0, *self.breaks[:-1]], self.breaks, strict=True):
            if high > low:
                section = next(s for s in self.sections if s[0] > 0.5 * (low + high))
                run = solve_ivp(
                    *(self._rates, (low, high), state), args=(section,), rtol=1e-10, atol=1e-10
                )
                state = run.y[:, -1]
            if record is not None:
                record.append((high, state.copy()))
            for k, (height, anchor, length, stiffness, load) in enumerate(self.guys):
                if height == high:
                    guess = self.pulls[k]
                    if guess is None:
                        chord = state[:3] - anchor
                        guess = chord / np.linalg.norm(chord) * 3e4
                    first, last = guy_pull(anchor, state[:3], length, stiffness, load, guess)
                    self.pulls[k] = first
                    state[12:15] += last  # the guy pulls by -last, n above is n below minus this
            for height, force in self.points:
                if height == high:
                    state[12:15] -= force
        return state[12:18]

    def solve(self, guess):
        """Solve for base force, tilt and torsion from a `guess` [6]; returns `x` and records."""
        scale = np.array([1e4, 1e4, 1e5, 1e-3, 1e-3, 1e3])

        def miss(y):
            return self.shoot(y * scale) / np.array([1e3, 1e3, 1e3, 1e4, 1e4, 1e3])

        y, _, code, text = fsolve(miss, guess / scale, full_output=True, xtol=1e-12)
        assert np.abs(miss(y)).max() < 1e-6, (text, code)
        record = []
        self.shoot(y * scale, record)
        return y * scale, record
