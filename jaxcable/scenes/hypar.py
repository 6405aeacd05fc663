"""The hyperbolic paraboloid net of the paper, and the published deflections.

The published geometry is only in a figure. The plan here (0.4 m spacing, last link of each cable
0.795 m along x and 1.084 m along y) was identified from the published deflections, so that
agreement with them is no validation. Heights cannot be identified from vertical deflections; the
net here is flat.
"""

from __future__ import annotations

import numpy as np

from ..common.types import Float, Int
from ..elements import Cables
from .building_blocks import Scene, downward_loads, two_phase_scene
from .nets import add_zero_height, make_anchored_net, orthogonal_grid

NODE_NAMES = (5, 6, 7, 10, 11, 12, 15, 16, 17, 20, 21, 22)
"""Names of the free nodes in the paper, along x first."""

UNLOADED = (17, 21, 22)
"""Names of the free nodes without load."""

PUBLISHED = {
    "Experiment, Lewis [5]": (
        19.5, 25.3, 22.8, 25.4, 33.6, 28.8, 25.2, 30.6, 21.0, 21.0, 19.8, 14.2,
    ),
    "Krishna [7]": (19.6, 25.9, 23.7, 25.3, 33.0, 28.2, 25.8, 31.3, 21.4, 22.0, 21.1, 15.7),
    "Sufian [9]": (19.3, 25.5, 23.1, 25.8, 34.0, 29.4, 25.7, 31.2, 21.1, 21.1, 19.9, 14.3),
    "Lewis [20]": (19.3, 25.3, 23.0, 25.9, 33.8, 29.4, 26.4, 31.7, 21.9, 21.9, 20.5, 14.8),
    "Kwan [15] a": (
        19.38, 25.62, 22.95, 25.57, 33.79, 29.32, 25.43, 31.11, 21.28, 21.16, 19.79, 14.29,
    ),
    "Kwan [15] b": (
        19.52, 25.35, 23.31, 25.86, 34.05, 29.49, 25.79, 31.31, 21.42, 21.48, 20.0, 14.4,
    ),
    "the paper": (19.0, 25.3, 22.8, 25.7, 34.4, 29.5, 25.5, 31.5, 21.5, 20.8, 19.9, 14.1),
}  # fmt: skip
"""Deflections of the free nodes in the order of `NODE_NAMES`, mm, downward.

Source: Mihanovic, Trogrlic, Zivaljic (2011), Table 3, with its reference numbers.
"""


def hypar_plan() -> tuple[
    Float[np.ndarray, "26 3"], Int[np.ndarray, "31 2"], Int[np.ndarray, " 12"]
]:
    """Return the plan of the net: nodes [26, 3], m, links [31, 2], free node numbers [12]."""
    places, links, free = orthogonal_grid(3, 4)
    nodes = add_zero_height(0.4 * places)
    nodes[places[:, 0] == 4, 0] = 1.2 + 0.795
    nodes[places[:, 1] == 5, 1] = 1.6 + 1.084
    return nodes, links, free


def offsets_from_plan(places: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    """Return the offsets from the plan at which the nodes of the net start, [n, 3], m.

    At the grid point (i, j), a row of `places`, they are waves of 30 mm in plan and 40 mm in
    height: ``0.03 sin(2 i + 3 j), 0.03 cos(3 i + j), 0.04 sin(i + 2 j + 1)``.
    """
    i, j = places.T
    return np.column_stack(
        [
            0.03 * np.sin(2 * i + 3 * j),
            0.03 * np.cos(3 * i + j),
            0.04 * np.sin(i + 2 * j + 1),
        ]
    )


def hypar_net(disturbed: bool = True, increments: tuple[int, int] = (100, 10)) -> Scene:
    """Return the hyperbolic paraboloid net of the paper: 31 links, 26 nodes, 12 of them free.

    EA 100.72 kN. Jacks keep 200 N in every link in phase 1, which finds the form from any start.
    Phase 2 adds 15.7 N to every free node but 17, 21 and 22.

    Args:
        disturbed: whether phase 1 starts from the plan plus `offsets_from_plan`, or from the plan,
            which is in equilibrium already.
        increments: number of increments of the two phases; those of the paper are 100 and 10.

    Returns:
        `Scene`.

    Source: Mihanovic, Trogrlic, Zivaljic (2011), section 5.2; for the plan see the module.

    Example:
        >>> structure, phases = jc.scenes.hypar_net()
        >>> structure.n_node, len(structure.elements.links), [phase.increments for phase in phases]
        (26, 31, [100, 10])
    """
    nodes, links, free = hypar_plan()
    if disturbed:
        places = orthogonal_grid(3, 4)[0]
        nodes[free] += offsets_from_plan(places[free])
    loaded = [n for n, name in zip(free, NODE_NAMES, strict=True) if name not in UNLOADED]
    structure = make_anchored_net(nodes, Cables(links, axial_stiffness=100.72e3), free)
    return two_phase_scene(structure, increments, downward_loads(loaded, 15.7), jacking=200.0)
