"""Single cables: the isolated cable of the literature, and a cable with a stated sag."""

from __future__ import annotations

from typing import Any

import numpy as np

import jaxcable as jc
from jaxcable.forms.hanging_cables import hanging_chain
from jaxcable.scenes.building_blocks import Scene, chain_links, downward_loads, two_phase_scene

FOOT, POUND, INCH = 0.3048, 4.4482216152605, 0.0254


def isolated_cable(
    n: int = 0, load: float = 8000 * POUND, *, increments: tuple[int, int] = (1, 1)
) -> Scene:
    """Cable between supports 1000 ft apart with a point load at 400 ft; EA/N up to 800.

    Area 0.85 in2, E 19 000 ksi, weight 3.16 lb/ft, unstressed lengths 412.8837 ft and 613.0422 ft
    on the two sides of the load. Phase 1 adds self-weight; phase 2 adds 8 kip, which moves the
    loaded node by 18.456746888 ft down and 2.819439381 ft along the span (computed with exact
    catenaries).

    Args:
        n: number of straight elements on each side of the load, or 0 for one catenary a side.
        load: downward, N.

    Options:
        increments: number of increments of the two phases.

    Returns:
        `Scene`; the loaded node is number n, or 1 of the catenaries.

    Raises:
        ValueError: `n` below 0.

    Source: Michalos and Birnstiel (1962); Jayaraman and Knudson (1981).

    Example:
        >>> structure, phases = scenes.isolated_cable()
        >>> print(np.round(structure.elements.rest_length, 2), np.ptp(structure.nodes[:, 0]))  # m
        [125.85 186.86] 304.8
    """
    lengths = np.array([412.8837, 613.0422]) * FOOT
    corners = np.array([[0.0, 0, 0], [400.0, 0, -30.0], [1000.0, 0, 0]]) * FOOT
    shared: dict[str, Any] = {"axial_stiffness": 0.85 * 19e6 * POUND, "weight": 3.16 * POUND / FOOT}
    if n < 0:
        raise ValueError(f"n = {n}: a number of elements, or 0 for catenaries")
    if n == 0:
        nodes, group = corners, jc.Catenaries([[0, 1], [1, 2]], rest_length=lengths, **shared)
    else:
        parameter = np.arange(2 * n + 1) / n
        nodes = np.column_stack([np.interp(parameter, [0, 1, 2], x) for x in corners.T])
        rest_length = np.repeat(lengths / n, n)
        group = jc.Cables(chain_links(range(2 * n + 1)), rest_length=rest_length, **shared)
    structure = jc.Structure(nodes, group, jc.pinned([0, len(nodes) - 1]))
    return two_phase_scene(
        structure, increments, downward_loads([max(n, 1)], load), loads=jc.SelfWeight()
    )


def suspended_cable(
    span: float = 120.0,
    rise: float = 12.0,
    *,
    sag: float = 9.0,
    n: int = 0,
    axial_stiffness: float = 60e6,
    weight: float = 30.0,
    ice: float = 20.0,
    increments: tuple[int, int] = (1, 2),
) -> Scene:
    """Cable between two points at different heights with a stated sag, then loaded by ice.

    Phase 1 adds self-weight, with the unstressed length that gives the sag; phase 2 adds ice as a
    line load per unstressed length. The scene is not taken from a publication.

    Args:
        span, rise: horizontal and vertical distance of the second support from the first, m.

    Options:
        sag: vertical distance from the chord at midspan under self-weight, m.
        n: number of straight elements, a chain that starts in equilibrium, or 0 for one catenary.
        axial_stiffness: EA, N.
        weight, ice: N/m.
        increments: number of increments of the two phases.

    Returns:
        `Scene`.

    Example:
        >>> structure, phases = scenes.suspended_cable(span=120.0, rise=0.0, sag=9.0, n=20)
        >>> print(f"{structure.nodes[10, 2]:.6f} m")  # the middle of the chain as it starts
        -9.000000 m
    """
    ends = np.array([[0.0, 0.0, 0.0], [span, 0.0, rise]])
    shared: dict[str, Any] = {"axial_stiffness": axial_stiffness, "weight": weight}
    first: dict[str, Any] = {"loads": jc.SelfWeight()}
    if n == 0:
        nodes, group = ends, jc.Catenaries([[0, 1]], **shared)
        first["sag"] = sag
    else:
        nodes, rest_length = hanging_chain(ends[0], ends[1], n, sag, weight, axial_stiffness)
        group = jc.Cables(chain_links(range(n + 1)), rest_length=rest_length, **shared)
    structure = jc.Structure(nodes, group, jc.pinned([0, len(nodes) - 1]))
    return two_phase_scene(structure, increments, jc.LineLoads((0, 0, -ice)), **first)
