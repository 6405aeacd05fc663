"""Orthogonal nets: the flat net of the paper, and parametric saddles."""

from __future__ import annotations

import numpy as np

from ..common.types import Float, Int
from ..elements import Cables
from ..model.structure import Structure
from ..model.supports import pinned
from .building_blocks import Scene, downward_loads, two_phase_scene


def orthogonal_grid(
    n_x: int, n_y: int
) -> tuple[Int[np.ndarray, "n_node 2"], Int[np.ndarray, "n_elem 2"], Int[np.ndarray, " n_free"]]:
    """Return the topology of an orthogonal net of `n_x` by `n_y` free nodes, without corner nodes.

    Returns:
        places: grid coordinates (i, j) of every node, [n_node, 2]; i varies fastest.
        links: cables along x first, then cables along y, [n_elem, 2].
        free: indices of the free nodes, [n_x n_y]; i varies fastest.
    """
    corners = {(0, 0), (n_x + 1, 0), (0, n_y + 1), (n_x + 1, n_y + 1)}
    places = [(i, j) for j in range(n_y + 2) for i in range(n_x + 2) if (i, j) not in corners]
    number = {place: k for k, place in enumerate(places)}
    along_x = [(number[i, j], number[i + 1, j]) for j in range(1, n_y + 1) for i in range(n_x + 1)]
    along_y = [(number[i, j], number[i, j + 1]) for i in range(1, n_x + 1) for j in range(n_y + 1)]
    free = [number[i, j] for j in range(1, n_y + 1) for i in range(1, n_x + 1)]
    return np.array(places), np.array(along_x + along_y), np.array(free)


def add_zero_height(plan: Float[np.ndarray, "n_node 2"]) -> Float[np.ndarray, "n_node 3"]:
    """Return positions [n_node, 3] with height z = 0 for positions in plan, [n_node, 2]."""
    return np.column_stack([plan, np.zeros(len(plan))])


def make_anchored_net(
    nodes: Float[np.ndarray, "n_node 3"], cables: Cables, free: Int[np.ndarray, " n_free"]
) -> Structure:
    """Return a `Structure` of cables in which all nodes are pinned except for those in `free`."""
    return Structure(nodes, cables, supports=pinned(np.setdiff1d(np.arange(len(nodes)), free)))


def flat_net(load: float = 150.0, increments: tuple[int, int] = (1, 10)) -> Scene:
    """Return the flat net of the paper: 3 x 3 cells, 12 links, four free nodes.

    Cells of 0.4 m, EA 97.97 kN, pretension 200 N in phase 1; phase 2 loads every free node.

    Args:
        load: downward force on each free node, N; the ultimate load of the paper is 150 N.
        increments: number of increments of the two phases.

    Returns:
        `Scene`.

    Source: Mihanovic, Trogrlic, Zivaljic (2011), section 5.1.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases)
        >>> print(f"{jc.describe(solution.status)}: {solution.displacement[3, 2]:.9f} m")
        converged: -0.012838093 m
    """
    places, links, free = orthogonal_grid(2, 2)
    structure = make_anchored_net(
        add_zero_height(0.4 * places), Cables(links, axial_stiffness=97.97e3), free
    )
    return two_phase_scene(structure, increments, downward_loads(free, load), pretension=200.0)


def saddle(
    n_x: int,
    n_y: int,
    spacing: float = 1.0,
    rise: float = 0.1,
    *,
    axial_stiffness: float = 16e6,
    pretension: float = 20e3,
    load: float = 500.0,
    increments: tuple[int, int] = (1, 1),
) -> Scene:
    """Return a saddle net that is rectangular in plan and anchored at all edges.

    The initial surface is ``z = rise (L_x (2x/L_x - 1)^2 - L_y (2y/L_y - 1)^2)``.

    Args:
        n_x, n_y: number of free nodes along x and y; spans are ``L = spacing (n + 1)``.
        spacing: of the cables, m.
        rise: rise, or fall, from the middle of the net to the middle of an edge, relative to the
            span between the two edges.

    Options:
        axial_stiffness: EA, N.
        pretension: of every cable in phase 1, N.
        load: downward force on every free node in phase 2, N.
        increments: number of increments of the two phases.

    Returns:
        `Scene`.

    Raises:
        ValueError: no free node along x or along y.

    Example:
        >>> structure, _ = jc.scenes.saddle(3, 3, spacing=1.0, rise=0.1)
        >>> x, y, z = structure.nodes.T
        >>> print(structure.n_node, f"{z.min():.1f} to {z.max():.1f} m")  # at the edges
        21 -0.4 to 0.4 m
    """
    if n_x < 1 or n_y < 1:
        raise ValueError(
            f"n_x, n_y = {n_x}, {n_y}: a saddle has at least one free node in each direction"
        )
    places, links, free = orthogonal_grid(n_x, n_y)
    x, y = spacing * places.T
    span_x, span_y = spacing * (n_x + 1), spacing * (n_y + 1)
    z = rise * (span_x * (2 * x / span_x - 1) ** 2 - span_y * (2 * y / span_y - 1) ** 2)
    cables = Cables(links, axial_stiffness=axial_stiffness)
    structure = make_anchored_net(np.column_stack([x, y, z]), cables, free)
    return two_phase_scene(structure, increments, downward_loads(free, load), pretension=pretension)
