"""A cable of elastic catenaries over deviators with Coulomb friction, in NumPy, for given places.

Between its nodes x_0 ... x_n the cable hangs under a load along -z per unstressed length, in
segments of unstressed lengths a_i. A slip s_j > 0 carries cable over deviator j, from segment j to
segment j + 1. Written apart from the package: catenaries are solved for the force at their first
end, and slips by trial of all combinations of sticking and slipping deviators.

Arithmetic is that of `numpy.longdouble` (80 bits on x86): a stiff cable loses the digits of EA/T.
(Irvine, Cable Structures, 1981.)
"""

import itertools

import numpy as np

WIDE = np.longdouble
_POINTS, _WEIGHTS = (np.asarray(x, WIDE) for x in np.polynomial.legendre.leggauss(24))
_POINTS, _WEIGHTS = (1 + _POINTS) / 2, _WEIGHTS / 2  # on [0, 1]; for Newton's matrix alone


def _distances(level, rise, load, stiffness, length):
    """Horizontal and vertical distance between the ends under a force (level, rise) at the first.

    Irvine's closed form without cancellation: a difference of asinh is twice an atanh.
    """
    later = rise + load * length
    both = np.hypot(level, rise) + np.hypot(level, later)
    y = load * length / both
    growth = np.arctanh(y) / y if y > 0 else WIDE(1)
    across = level * length / stiffness + 2 * level * length * growth / both
    return across, (rise + later) * length * (1 / (2 * stiffness) + 1 / both)


def _flexibilities(level, rise, load, stiffness, length):
    """Derivatives of `_distances` by the force, m/N: across/level, across/rise, up/rise."""
    later = rise + load * length
    first, last = np.hypot(level, rise), np.hypot(level, later)
    if load * length > 0.3 * (first + last):  # deep: quadrature would be poor
        whole = 2 * np.arctanh(load * length / (first + last)) / load
        part = (later / last - rise / first) / load
        mixed = -level * (1 / first - 1 / last) / load
        return length / stiffness + whole - part, mixed, length / stiffness + part
    along = rise + load * length * _POINTS
    f = _WEIGHTS * length / np.hypot(level, along) ** 3
    direct = length / stiffness
    return direct + f @ along**2, -level * (f @ along), direct + level**2 * f.sum()


def _first_force(across, up, load, stiffness, length, start=None):
    """Force (level, rise) at the first end of a catenary that spans (across, up), N.

    The distances are the gradient of a strictly convex function of the force, so that damped
    Newton steps end there; they go on to the last bits.
    """
    across, up, load, stiffness, length = map(WIDE, (across, up, load, stiffness, length))
    level, rise = start or _first_guess(across, up, load, stiffness, length)
    last = np.inf
    for _ in range(300):
        x, z = _distances(level, rise, load, stiffness, length)
        a, b, d = _flexibilities(level, rise, load, stiffness, length)
        gx, gz, det = x - across, z - up, a * d - b * b
        step = np.array([b * gz - d * gx, b * gx - a * gz]) / det
        size, scale = np.abs(step).sum(), np.hypot(level, rise) + load * length
        part, slope = WIDE(1), np.array([gx, gz]) @ step
        while size > 1e-12 * scale and part > 1e-12:  # far away: a step must not pass the minimum
            there = _distances(
                level + part * step[0], rise + part * step[1], load, stiffness, length
            )
            if abs((np.array(there) - [across, up]) @ step) <= 0.9 * abs(slope):
                break
            part /= 2
        level, rise = level + part * step[0], rise + part * step[1]
        if size <= WIDE(1e-17) * scale or (last < 1e-13 * scale and size > last / 4):
            return level, rise
        last = size
    assert start, "a catenary was not found"
    return _first_force(across, up, load, stiffness, length)


def _first_guess(across, up, load, stiffness, length):
    """Force at the first end of a taut cable, or of a parabola."""
    chord = np.hypot(across, up)
    level = stiffness * max(chord - length, 0) / length * across / chord + stiffness * WIDE(1e-7)
    if length > chord:
        slack = 6 * (np.sqrt(length**2 - up**2) / across - 1)
        level = max(level, load * across / (2 * np.sqrt(slack)))
    return level, level * up / across - load * length / 2


def catenary(across, up, load, stiffness, length):
    """Tensions at both ends, N, and sag below the chord at midspan, m, of an elastic catenary.

    It spans (`across`, `up`), m, with a load in N per meter of its unstressed `length`, m.
    """
    level, rise = _first_force(across, up, load, stiffness, length)
    at, load, stiffness = WIDE(length) / 2, WIDE(load), WIDE(stiffness)
    for _ in range(50):  # Newton's method for the unstressed length up to midspan
        x, z = _distances(level, rise, load, stiffness, at)
        grows = level / stiffness + level / np.hypot(level, rise + load * at)
        at -= (x - WIDE(across) / 2) / grows
    last = np.hypot(level, rise + load * length)
    return np.array([np.hypot(level, rise), last]), WIDE(up) / 2 - z


def _vectors(first, last, load, stiffness, length, known, key):
    """Tension vectors along the cable at both ends of a segment in space, [2, 3], N.

    `known` keeps forces by `key`, from which the next search begins.
    """
    chord = last - first
    across = np.hypot(chord[0], chord[1])
    level, rise = _first_force(across, chord[2], load, stiffness, length, known.get(key))
    known[key] = level, rise
    flat = level * chord[:2] / across
    return np.array([[*flat, rise], [*flat, rise + WIDE(load) * length]])


def ratios_and_bounds(vectors, friction):
    """Logarithms of the ratios of tensions at the deviators, and friction times their angles."""
    before, after = vectors[:-1, 1], vectors[1:, 0]
    ratios = np.log((after**2).sum(axis=1) / (before**2).sum(axis=1)) / 2
    sine = np.linalg.norm(np.cross(before, after), axis=1)
    return ratios, np.asarray(friction, WIDE) * np.arctan2(sine, (before * after).sum(axis=1))


def _solve_pattern(nodes, lengths, load, stiffness, friction, pattern):
    """Slips, [n - 1], and vectors where those of `pattern` slip with its signs; None: not found."""
    n, slipping, known = len(lengths), np.flatnonzero(pattern), {}
    sign = np.asarray(pattern, WIDE)[slipping]

    def vectors_at(length, only=None, others=None):
        return np.array(
            [
                _vectors(nodes[i], nodes[i + 1], load, stiffness, length[i], known, i)
                if only in (None, i)
                else others[i]
                for i in range(n)
            ]
        )

    def missed(vectors):
        ratios, bounds = ratios_and_bounds(vectors, friction)
        return ratios[slipping] - sign * bounds[slipping]

    slips = np.zeros(n - 1, WIDE)
    vectors = vectors_at(lengths)
    off, beyond = missed(vectors), 0
    for _ in range(80):
        norm = np.abs(off).max(initial=0)
        if norm <= 1e-15 or beyond > 2:
            return slips, vectors
        length, slopes = lengths - np.diff(slips, prepend=0, append=0), []
        for i in range(n):
            longer = length + np.eye(n)[i] * 1e-9 * length
            slopes.append((missed(vectors_at(longer, i, vectors)) - off) / (1e-9 * length[i]))
        matrix = np.array([slopes[j + 1] - slopes[j] for j in slipping], float).T
        step, part, found = np.linalg.lstsq(matrix, -off.astype(float))[0], WIDE(1), False
        while part > 1e-9 and not found:
            trial = slips.copy()
            trial[slipping] += part * step
            new = lengths - np.diff(trial, prepend=0, append=0)
            if (new > length / 20).all():
                there = vectors_at(new)
                found = np.abs(missed(there)).max() < (1 - part / 10) * norm
            part /= 2
        if not found:
            return (slips, vectors) if norm < 1e-13 else None
        beyond += norm < 1e-14
        slips, vectors, off = trial, there, missed(there)
    return None


def step(nodes, lengths, load, stiffness, friction):
    """Solutions of one step of Coulomb friction from unstressed lengths, a list.

    Args:
        nodes: positions of the nodes now, [n + 1, 3], m.
        lengths: unstressed, at the end of the last step, [n], m.
        load: per unstressed length, N/m.
        stiffness: EA, N.
        friction: coefficients at the deviators, [n - 1].

    Returns:
        For every combination of sticking and slipping that agrees with its own ratios and slips:
        slips, [n - 1], m; unstressed lengths, [n], m; tensions at both ends of the segments,
        [n, 2], N; and the vectors of these along the cable, [n, 2, 3], N. One, if segments are
        shallow.
    """
    nodes, lengths = np.asarray(nodes, WIDE), np.asarray(lengths, WIDE)
    solutions = []
    for pattern in itertools.product((0, 1, -1), repeat=len(lengths) - 1):
        found = _solve_pattern(nodes, lengths, load, stiffness, friction, pattern)
        if found is None:
            continue
        slips, vectors = found
        ratios, bounds = ratios_and_bounds(vectors, friction)
        still, sign = np.array(pattern) == 0, np.array(pattern)
        # tolerances of rounding: both slips and logarithms are known to 1e-15
        sticks = np.abs(ratios) <= bounds + 1e-13
        follows = sign * slips >= -1e-13 * lengths.sum()
        # a slip of zero is also one that sticks: such solutions are returned once
        known = [np.abs(slips - other[0]).max() < 1e-9 * lengths.sum() for other in solutions]
        if np.where(still, sticks, follows).all() and not any(known):
            new = lengths - np.diff(slips, prepend=0, append=0)
            solutions.append((slips, new, np.linalg.norm(vectors, axis=2), vectors))
    return solutions
