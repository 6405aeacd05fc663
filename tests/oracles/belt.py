"""A cable over circles in a plane, in NumPy: common tangents in closed form, and arcs."""

import numpy as np


def belt(centers, radii, turns):
    """Directions, straight lengths and arcs of a cable over circles, as a belt over pulleys.

    Two circles with signed radii, positive where the belt turns to the left, are d apart in the
    direction phi. Their common tangent has the direction ``phi - asin((rho_2 - rho_1) / d)`` and
    the length ``sqrt(d^2 - (rho_2 - rho_1)^2)``.

    Args:
        centers: [n + 1, 2], m; both ends have no radius.
        radii: of the circles between the ends, [n - 1], m.
        turns: 1 where the belt turns to the left, -1 to the right, [n - 1].

    Returns:
        Directions of the straight parts, [n], rad, their lengths, [n], m, and the angles of the
        arcs, [n - 1], rad, negative where the belt would have to be held down.
    """
    signed = np.pad(np.asarray(radii) * turns, 1)
    way, differ = np.diff(centers, axis=0), np.diff(signed)
    apart = np.hypot(*way.T)
    direction = np.arctan2(way[:, 1], way[:, 0]) - np.arcsin(differ / apart)
    angle = np.diff(direction) * turns
    # between a quarter turn back and three quarters
    angle = (angle + np.pi / 2) % (2 * np.pi) - np.pi / 2
    return direction, np.sqrt(apart**2 - differ**2), angle


def lengths_to_marks(centers, initial, radii, turns, rotation=0.0):
    """Lengths of a belt between marks on its circles, [n], m, and the angles of its arcs.

    A mark is fixed to each circle in the middle of the arc that the belt has with the centers
    `initial`; the circles have rotated to the left since then by `rotation`, [n - 1], rad.
    """
    start, _, half = belt(initial, radii, turns)
    now, straight, angle = belt(centers, radii, turns)
    swing = (now - start + np.pi) % (2 * np.pi) - np.pi
    after = radii * (half / 2 + (swing[1:] - rotation) * turns)
    before = radii * (half / 2 - (swing[:-1] - rotation) * turns)
    return straight + np.append(before, 0) + np.append(0, after), angle
