"""What must hold of ropes with Coulomb friction, looked at in NumPy: conditions, and no solver.

For given positions of the nodes they have one solution, because they are the optimality conditions
of a strictly convex problem.
"""

import numpy as np


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
