"""Grids of cables of which many are longer than their span, and carry a few loads at random nodes.

Every kind is a square grid of n by n nodes at distances of 1 m in a plane, held at its corners; one
node in twenty carries 1 N downward, across the plane.
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
