"""Grids of cables of which many are longer than their span, and carry a few loads at random nodes.

Every kind is a square grid of n by n nodes at distances of 1 m in a plane, held at its corners; one
node in twenty carries 1 N downward, across the plane. `beside_beams` and `beside_struts` have other
elements, too.
"""

import numpy as np

import jaxcable as jc

KINDS = "half", "third", "patches", "hung"


def grid(n):
    """Nodes [n n, 3], links and corners of a grid."""
    place = np.arange(n * n).reshape(n, n)
    along = np.stack([place[:, :-1].ravel(), place[:, 1:].ravel()], 1)
    links = np.concatenate([along, np.stack([place[:-1].ravel(), place[1:].ravel()], 1)])
    nodes = np.stack([place.ravel() % n, place.ravel() // n, 0 * place.ravel()], 1).astype(float)
    return nodes, links, [0, n - 1, n * n - n, n * n - 1]


def scene(kind, n, ratio=None, dtype=np.float64):
    """Structure and phases; `ratio` is EA over a quarter of the load, None for EA = 1e5 N.

    Kinds: unstressed lengths are 1.15 m in one half ("half"), in a third of the cables at random
    ("third"), in the fields of a chessboard ("patches"), or all ("hung"); others 1 m.
    """
    rng = np.random.default_rng(100 + n)
    nodes, links, corners = grid(n)
    forces = np.zeros((n * n, 3))
    forces[rng.uniform(size=n * n) < 0.05, 2] = -1.0
    forces[corners] = 0
    x, y = nodes[links].mean(1)[:, :2].T
    longer = {
        "half": x > n / 2,
        "third": rng.uniform(size=len(links)) < 1 / 3,
        "patches": (x // 5 + y // 5) % 2 > 0,
        "hung": np.ones(len(links), bool),
    }[kind]
    stiffness = 1e5 if ratio is None else ratio * np.abs(forces).sum() / 4
    cables = jc.Cables(links, axial_stiffness=dtype(stiffness))
    structure = jc.Structure(nodes.astype(dtype), cables, supports=jc.pinned(corners))
    loads = jc.NodalLoads(np.arange(n * n), forces.astype(dtype))
    rest_length = np.where(longer, 1.15, 1.0).astype(dtype)
    return structure, jc.Phase(rest_length=rest_length, loads=loads)


def beside_beams(kind, n, ratio, cables=jc.Cables):
    """The same with a row of beams for the cables in the middle, and with `cables` of any class."""
    structure, phase = scene(kind, n, ratio)
    group, row = structure.elements, n // 2
    is_beam = np.all(group.links.array // n == row, axis=1)
    links, stiffness = group.links.array[~is_beam], group.axial_stiffness[~is_beam]
    section = jc.Section.rectangle(0.3, 0.3, jc.Elastic(1e6))
    groups = {
        "beams": jc.Beams(group.links.array[is_beam], section=section, up=(0.0, 0.0, 1.0)),
        "cables": cables(links, stiffness, rest_length=np.asarray(phase.rest_length)[~is_beam]),
    }
    supports = structure.supports + jc.clamped([row * n, row * n + n - 1])
    return jc.Structure(structure.nodes, groups, supports), jc.Phase(loads=phase.loads)


def beside_struts(seed, ratio, cables=jc.Cables):
    """A cable dome with flying struts, drawn inexactly, of whose cables a third is too long."""
    rng, n = np.random.default_rng(seed), 6
    angle = 2 * np.pi * np.arange(n) / n
    plan = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings = [(3, 0.0), (2, 0.6), (2, -0.6), (1, 0.8), (1, -0.4)]
    nodes = [np.column_stack([radius * plan, np.full(n, z)]) for radius, z in rings]
    nodes = np.concatenate(nodes) + 0.03 * rng.normal(size=(5 * n, 3))
    edge, high, low, top, foot = np.arange(5 * n).reshape(5, n)
    pairs = [(edge, high), (edge, low), (high, top), (low, top), (low, foot)]
    pairs += [(ring, np.roll(ring, -1)) for ring in (high, low, top, foot)]
    links = np.concatenate([np.stack(pair, axis=1) for pair in pairs])
    struts = np.concatenate([np.stack(pair, axis=1) for pair in ((high, low), (top, foot))])
    span = np.linalg.norm(np.diff(nodes[links], axis=1)[:, 0], axis=1)
    too_long = 1 + 0.1 * rng.uniform(size=len(links))
    rest = span * np.where(rng.uniform(size=len(links)) < 0.3, too_long, 1 - 0.3 / ratio)
    groups = {
        "cables": cables(links, ratio * 10 ** rng.uniform(-0.5, 0.5, len(links)), rest_length=rest),
        "struts": jc.Bars(struts, axial_stiffness=ratio),
    }
    forces = 0.05 * rng.normal(size=(5 * n, 3)) - [0, 0, 1] * rng.uniform(0, 0.3, (5 * n, 1))
    load = jc.NodalLoads(np.arange(n, 5 * n), forces[n:])
    return jc.Structure(nodes, groups, jc.pinned(edge)), jc.Phase(loads=load)
