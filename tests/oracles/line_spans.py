"""Spans of a line apart from the package: catenaries by quadrature, the law of a conductor, chains.

The shape of a span is the integral of ``(1 + T/EA) t ds`` over its unstressed length with Gauss
points, not a closed form; the force at its first end is found by Newton's method on this integral.
"""

import numpy as np

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(24)
POINTS, WEIGHTS = 0.5 * (1 + POINTS), 0.5 * WEIGHTS


def tensions_along(pull, load):
    """Tension vectors at the Gauss points, [24, 3], of a span that pulls its first node by `pull`.

    `load` is the whole load along it, [3], N.
    """
    return pull - POINTS[:, None] * load


def end_pulls(first, last, load, length, stiffness):
    """Forces of a span on its end nodes, [2, 3], N, for given ends, by Newton's method."""
    chord = last - first
    size = np.linalg.norm(chord)
    slack = max(length - size, 1e-4 * length)
    level = min(np.linalg.norm(load) * np.sqrt(length / (24 * slack)), 0.01 * stiffness)
    pull = level * chord / size + 0.5 * load
    for _ in range(50):
        vectors = tensions_along(pull, load)
        sizes = np.linalg.norm(vectors, axis=1)
        error = length * WEIGHTS @ ((1 / stiffness + 1 / sizes)[:, None] * vectors) - chord
        units = vectors / sizes[:, None]
        across = np.eye(3) - units[:, :, None] * units[:, None, :]
        slope = np.einsum("k,kij->ij", WEIGHTS / sizes, across) + np.eye(3) / stiffness
        step = np.linalg.solve(length * slope, error)
        pull = pull - step * min(1.0, 0.5 * np.linalg.norm(pull) / max(np.linalg.norm(step), 1e-30))
        if np.abs(error).max() < 1e-12 * length:
            break
    assert np.abs(error).max() < 1e-11 * length
    return np.stack([pull, load - pull])


def layer_stress(layer, strain, permanent):
    """Stress of a layer of a conductor, Pa, by its polynomial and its line of unloading."""
    inside = min(strain, float(layer.limit))
    powers = np.arange(len(layer.initial))
    slope = sum(k * layer.initial[k] * float(layer.limit) ** (k - 1) for k in powers[1:])
    first = np.sum(layer.initial * inside**powers) + slope * (strain - inside)
    return min(first, float(layer.modulus) * (strain - permanent))


def conductor_tension(conductor, strain, temperature, permanent):
    """Tension of a conductor, N: strands around a core carry no compression."""
    warmer = temperature - float(conductor.temperature)
    parts = [
        layer_stress(layer, strain - float(layer.expansion) * warmer, p)
        for layer, p in zip(conductor.layers, permanent, strict=True)
    ]
    return float(conductor.area) * (sum(max(p, 0.0) for p in parts[:-1]) + parts[-1])


def state_loads(section, state, lengths, rest_lengths):
    """Whole loads along the spans of a section, [n_span, 3], N: mass, ice and wind as defined."""
    conductor, count = section.conductor, len(lengths)
    ice = np.broadcast_to(np.asarray(state.ice), (count,))
    weight = float(conductor.weight) * np.asarray(lengths)
    volume = np.pi * ice * (float(conductor.diameter) + ice) * np.asarray(rest_lengths)
    down = weight + 9.80665 * float(state.ice_density) * volume
    angle = np.radians(float(state.wind_direction))
    blows = np.array([np.cos(angle), np.sin(angle), 0.0])
    nodes, total = np.asarray(section.nodes()), []
    for k, (a, b) in enumerate(section.layout.spans):
        chord = nodes[b] - nodes[a]
        unit = chord / np.linalg.norm(chord)
        across = blows - (blows @ unit) * unit
        width = float(conductor.diameter) + 2 * ice[k]
        force = float(state.wind) * float(state.drag) * width * np.linalg.norm(chord)
        total.append(force * np.linalg.norm(across) * across - [0.0, 0.0, down[k]])
    return np.array(total)


def string_loads(section, state):
    """Weight of every string of a section and wind on it as drawn, [n_string, 3], N."""
    nodes, total = np.asarray(section.nodes()), []
    angle = np.radians(float(state.wind_direction))
    blows = np.array([np.cos(angle), np.sin(angle), 0.0])
    for held, hung in section.layout.strings:
        tower = section.layout.towers[held]
        drawn = nodes[hung] - nodes[held]
        drawn = drawn / np.linalg.norm(drawn)
        across = blows - (blows @ drawn) * drawn
        area = float(np.asarray(section.string_area)[tower])
        weight = np.array([0.0, 0.0, float(np.asarray(section.string_weight)[tower])])
        total.append(1.2 * float(state.wind) * area * np.linalg.norm(across) * across - weight)
    return np.array(total)


def node_forces(section, state, positions, pulls, broken=None):
    """Sum of all forces on the clamps of strings, [n_string, 3], N: zero in equilibrium."""
    own = section.layout
    total = np.zeros((len(own.towers), 3))
    for k, (a, b) in enumerate(own.spans):
        if k != broken:
            total[a] += pulls[k][0]
            total[b] += pulls[k][1]
    for (held, hung), load in zip(own.strings, string_loads(section, state), strict=True):
        length = float(np.asarray(section.string_length)[own.towers[held]])
        axis = positions[hung] - positions[held]
        size = np.linalg.norm(axis)
        total[hung] += 0.5 * load - 1e9 * (size - length) / length * axis / size
    return total[[hung for _, hung in own.strings]]


def broken_chain(section, state, lengths, stiffness, weights, start, broken):
    """Positions of a section with a broken span by Newton's method, and the largest residual, N.

    Args:
        section, state: of calm air, without ice.
        lengths: unstressed, [n_span], m; stiffness: EA, [n_span], N; weights: whole, [n_span], N.
        start: positions from which clamps are looked for, [n_node, 3], m.
        broken: index of the broken span.
    """
    own = section.layout
    hung = [node for _, node in own.strings]

    def residual(x):
        places = start.copy()
        places[hung] = x.reshape(-1, 3)
        pulls = [
            None
            if k == broken
            else end_pulls(
                places[a], places[b], np.array([0.0, 0.0, -weights[k]]), lengths[k], stiffness[k]
            )
            for k, (a, b) in enumerate(own.spans)
        ]
        return node_forces(section, state, places, pulls, broken).ravel()

    x = start[hung].ravel()
    for _ in range(60):
        force = residual(x)
        step = 1e-6 * np.eye(len(x))
        slope = np.stack([(residual(x + h) - force) / 1e-6 for h in step], axis=1)
        move = np.linalg.solve(slope, force)
        x = x - move * min(1.0, 0.5 / np.abs(move).max())
        if np.abs(move).max() < 1e-7:
            break
    places = start.copy()
    places[hung] = x.reshape(-1, 3)
    return places, np.abs(residual(x)).max()
