"""Ropes with Coulomb friction in NumPy: the conditions that hold, and their solution by relaxation.

For given positions of the nodes the conditions have one solution, because they are the optimality
conditions of a strictly convex problem.
"""

import numpy as np
from scipy.optimize import brentq


def angles(places):
    """Angles between successive segments of a chain, rad."""
    way = np.diff(places, axis=0)
    unit = way / np.linalg.norm(way, axis=1, keepdims=True)
    halves = (np.linalg.norm(unit[1:] + s * unit[:-1], axis=1) for s in (-1, 1))
    return 2 * np.arctan2(*halves)


def violations(places, tension, before, bound, stiffness, law=None):
    """By how much a rope misses its law, Coulomb's, and the direction of its slips.

    Args:
        places: positions of its nodes, [n + 1, 3], m.
        tension: of its segments, [n], N; all positive.
        before: their unstressed lengths at the end of the last increment, [n], m.
        bound: largest logarithms of ratios of tensions, [n - 1].
        stiffness: EA, N; or `law`, strain by tension.

    Returns:
        The largest violation: of the sum of unstressed lengths over the elongation of the whole,
        of a bound, or of a slip without the ratio that it needs; and the unstressed lengths, m.
    """
    length = np.linalg.norm(np.diff(places, axis=0), axis=1)
    strain = tension / stiffness if law is None else law(tension)
    now = length / (1 + strain)
    lost = abs(now.sum() - before.sum()) / (length * strain).sum()
    ratio, slip = np.diff(np.log(tension)), -np.cumsum(now - before)[:-1]
    beyond = np.maximum(np.abs(ratio) - bound, 0.0)
    slips = np.abs(slip) > 1e-9 * length.sum()
    missed = np.where(slips, np.abs(ratio - np.sign(slip) * bound), 0.0)
    return max([lost, *beyond, *missed]), now


def axle_bounds(angle, ratio):
    """Largest logarithms of the ratios of tensions on pulleys with friction at their axles.

    The balance of moments, ``(x - 1)^2 = k^2 (x^2 + 1 - 2 x cos(angle))`` with x the ratio of the
    tensions and k = `ratio`, is a quadratic equation for x.
    """
    d = 2 * ratio**2 * np.sin(angle / 2) ** 2 / (1 - ratio**2)
    return np.log1p(d + np.sqrt(d * (d + 2)))


def relaxed(length, before, bound, stiffness):
    """Tensions of a rope, [n], N, by its complementarity conditions: one deviator after the other.

    At each deviator the rope slips as far as its conditions want while the others are held, again
    and again (Gauss-Seidel), which is coordinate descent on a convex function; Newton steps for
    those that slip then give the last digits.

    Args:
        length: of the segments now, [n], m.
        before: unstressed lengths at the end of the last increment, [n], m.
        bound: largest logarithms of ratios of tensions, [n - 1]; infinite at clamps.
        stiffness: EA, N.
    """
    slip, n = np.zeros(len(length) - 1), len(length)

    def tensions(slip):
        now = before - np.diff(slip, prepend=0, append=0)
        return np.maximum(stiffness * (length - now) / now, 0.0)

    def missed(j, sign, slip):
        """By how much the tension after deviator j is beyond its largest ratio, N."""
        tension = tensions(slip)
        return tension[j + 1] - tension[j] * np.exp(sign * bound[j])

    def pair(j):
        """Slip at deviator j that meets its conditions while the others are held."""

        def moved(x, sign):
            return missed(j, sign, np.where(np.arange(n - 1) == j, x, slip))

        sign = 1.0 if moved(0.0, 1.0) > 0 else -1.0 if moved(0.0, -1.0) < 0 else 0.0
        if sign == 0:
            return 0.0
        # tensions are equal at the latest where both have the same strain
        own = before - np.diff(np.where(np.arange(n - 1) == j, 0.0, slip), prepend=0, append=0)
        share = length[j : j + 2] / length[j : j + 2].sum()
        even = own[j] - share[0] * (own[j] + own[j + 1])
        if sign * moved(even, sign) >= 0:  # both become slack
            return even
        return brentq(moved, 0.0, even, args=(sign,), xtol=1e-16, rtol=1e-14)

    for _ in range(5000):
        last = slip.copy()
        for j in np.flatnonzero(bound < np.inf):
            slip[j] = pair(j)
        # Newton steps need all segments taut
        enough = 1e-9 if (tensions(slip) > 0).all() else 1e-15
        if np.abs(slip - last).max() <= enough * np.abs(length - before).max():
            break
    going = np.flatnonzero(slip)
    for _ in range(4 if going.size and (tensions(slip) > 0).all() else 0):
        now, tension = before - np.diff(slip, prepend=0, append=0), tensions(slip)
        rate = (stiffness + tension) / now  # of a tension by less unstressed length
        factor = np.exp(np.sign(slip[going]) * bound[going])
        off = tension[going + 1] - tension[going] * factor
        matrix = np.zeros((n - 1, n - 1))
        for row, j in enumerate(going):
            matrix[j, j] = -rate[j + 1] - rate[j] * factor[row]
            if j > 0:
                matrix[j, j - 1] = rate[j] * factor[row]
            if j < n - 2:
                matrix[j, j + 1] = rate[j + 1]
        slip[going] -= np.linalg.solve(matrix[np.ix_(going, going)], off)
    return tensions(slip)


def draw_in(force, bound, length, stiffness, slipped):
    """Tensions of a tendon on fixed deviators after its anchor has slipped in, [n], N.

    The end has had the largest tension, `force`, and losses along the tendon; it slips back by
    `slipped`, m, as far as needed. Found by bisection for the tension at the anchor.
    """
    grown = np.concatenate([[0.0], np.cumsum(bound)])
    jacked = force * np.exp(-grown)

    def after(anchor):
        return np.minimum(jacked, anchor * np.exp(grown))

    def drawn(anchor):
        return np.sum(length / (1 + after(anchor) / stiffness) - length / (1 + jacked / stiffness))

    low, high = 0.0, force
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if drawn(middle) > slipped else (low, middle)
    return after(0.5 * (low + high))
