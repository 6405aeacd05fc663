"""An elastic cable under any uniform load, integrated apart: positions, sags and lowest points.

``dr/ds = T/EA + T/|T|`` with ``T = T1 - q s``, by SciPy's quadrature of Gauss and Kronrod; T1 by
its root finder. No formula of the package is used.
"""

import numpy as np
from scipy.integrate import quad_vec
from scipy.optimize import brentq, minimize_scalar, root


class HangingCable:
    """A cable between two points, with an unstressed length, EA and a load per unstressed length.

    `guess` is the tension vector at the first end, N, near enough for the root finder.
    """

    def __init__(self, first, last, length, stiffness, load, guess):
        self.first, self.last = np.asarray(first, float), np.asarray(last, float)
        self.length, self.stiffness, self.load = length, stiffness, np.asarray(load, float)
        size = np.linalg.norm(guess)

        def miss(scaled):
            self.pull = scaled * size
            return (self.at(length) - self.last) / length

        found = root(miss, np.asarray(guess) / size, tol=1e-15, method="hybr")
        assert np.abs(miss(found.x)).max() < 1e-13
        self.ends = np.linalg.norm([self.pull, self.pull - length * self.load], axis=1)

    def tangent(self, s):
        """Derivative of the position by the unstressed length, at one place or at several."""
        tension = self.pull - np.multiply.outer(s, self.load)
        size = np.linalg.norm(tension, axis=-1, keepdims=True)
        return tension / self.stiffness + tension / size

    def at(self, s):
        # the interval is divided where the cable bends most: at the least tension
        turn = self.pull @ self.load / max(self.load @ self.load, 1e-300)
        points = [turn] if 0 < turn < s else None
        found = quad_vec(self.tangent, 0, s, epsabs=1e-13, epsrel=1e-14, points=points)
        return self.first + found[0]

    def least(self, function, places=400):
        """Least value of a function of the position along the cable, and the position.

        Positions by the trapezoidal rule are near enough to say between which places it is.
        """
        s = np.linspace(0, self.length, places + 1)
        rates = self.tangent(s)
        steps = 0.5 * (rates[1:] + rates[:-1]) * s[1]
        near = self.first + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
        k = int(np.argmin([function(x) for x in near]))
        bounds = s[max(k - 2, 0)], s[min(k + 2, places)]
        found = minimize_scalar(
            lambda x: function(self.at(x)), bounds=bounds, method="bounded", options={"xatol": 1e-9}
        )
        best = min([found.x, *bounds], key=lambda x: function(self.at(x)))
        return function(self.at(best)), self.at(best)

    def sag_at_midspan(self):
        chord = self.last - self.first
        level = chord * [1, 1, 0] / np.hypot(*chord[:2])
        half = 0.5 * np.hypot(*chord[:2])
        s = brentq(lambda s: (self.at(s) - self.first) @ level - half, 0, self.length, xtol=1e-13)
        return self.first[2] + 0.5 * chord[2] - self.at(s)[2]

    def below_chord(self, point):
        """Minus the vertical distance below the chord."""
        chord = self.last - self.first
        part = (point - self.first)[:2] @ chord[:2] / (chord[:2] @ chord[:2])
        return point[2] - self.first[2] - part * chord[2]

    def near_chord(self, point):
        """Minus the distance from the chord."""
        unit = (self.last - self.first) / np.linalg.norm(self.last - self.first)
        return -np.linalg.norm(np.cross(point - self.first, unit))
