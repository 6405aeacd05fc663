"""An elastic cable between given ends, integrated numerically, under what is stated of it.

Along the unstressed length s the tension vector is ``T(s) = T0 - q s`` with the load per unstressed
length q, and ``dr/ds = T / EA + T / |T|``. Gauss's rule integrates; SciPy finds T0, the unstressed
length and the place of midspan.
"""

import numpy as np
from scipy.optimize import root

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(160)


def reach(first, load, stiffness, s):
    """Vector from the first end to the point at the unstressed length s, m."""
    at = 0.5 * s * (POINTS + 1)
    pull = first - np.outer(at, load)
    size = np.linalg.norm(pull, axis=1)[:, None]
    return 0.5 * s * WEIGHTS @ (pull / stiffness + pull / size)


def cable(chord, per_length, on_whole, stiffness, kind, value, guess):
    """Solve for a cable on which a tension or a sag is stated.

    Args:
        chord: from the first end to the second, [3], m.
        per_length, on_whole: load per unstressed length, [3], N/m, and on the whole cable, [3], N.
        stiffness: EA, N.
        kind: "first" or "second" (end tension), "horizontal", or "sag".
        value: N or m.
        guess: horizontal force, N, and unstressed length, m.

    Returns:
        Unstressed length, m; forces of the supports at its first and second end, [3] each, N.
    """
    chord, level = np.asarray(chord, float), np.array([*chord[:2], 0.0])
    plan, level = np.linalg.norm(level), level / np.linalg.norm(level)
    force, length = guess
    load = on_whole / length + per_length

    def errors(x):
        pull, size, middle = force * x[:3], length * x[3], length * x[4]
        load = on_whole / size + per_length
        last = pull - size * load
        half = reach(pull, load, stiffness, middle)
        found = {
            "first": np.linalg.norm(pull),
            "second": np.linalg.norm(last),
            "horizontal": 0.5 * (pull + last) @ level,
            "sag": 0.5 * chord[2] - half[2],
        }[kind]
        away = (reach(pull, load, stiffness, size) - chord) / plan
        return [*away, found / value - 1, half @ level / plan - 0.5]

    straight = force / plan * chord + 0.5 * length * load
    found = root(errors, [*(straight / force), 1.0, 0.5], tol=1e-14, options={"maxfev": 4000})
    assert np.abs(errors(found.x)).max() < 1e-12, found.message
    first, size = force * found.x[:3], length * found.x[3]
    return size, -first, first - on_whole - size * per_length
