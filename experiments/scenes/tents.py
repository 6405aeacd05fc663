"""The edge of a tent: a cable between two guyed pylons, loaded by the membrane."""

from __future__ import annotations

import numpy as np

import jaxcable as jc
from jaxcable.scenes.building_blocks import Scene, chain_links, two_phase_scene


def tent_edge(
    span: float = 20.0,
    sag: float = 2.0,
    *,
    n: int = 16,
    height: float = 8.0,
    lean: float = 2.0,
    reach: float = 6.0,
    pressure: float = 3e3,
    uplift: float = 1.5e3,
    edge_stiffness: float = 60e6,
    guy_stiffness: float = 40e6,
    pylon_stiffness: float = 400e6,
    increments: tuple[int, int] = (1, 4),
) -> Scene:
    """Edge cable of a tent between the tops of two pylons, each with two guys.

    The membrane is not part of the structure. It lies behind the edge, towards +y, and acts on the
    edge as a follower pressure in its plane, always at right angles to the cable; under it the edge
    is a circular arc. The pylons are struts on hinges that lean outwards, towards -y; the guys run
    from their tops to the ground outside. With the pretension of phase 1 the given geometry is in
    equilibrium: with chords c of the arc that differ in direction by phi, and half of the pressure
    on each chord at its ends, the edge has ``T = p c / (2 tan(phi/2))``, and each pylon and its two
    guys balance the force at the end of the edge. Phase 2 adds gusts: more pressure and, along the
    edge, uplift per initial length. The scene is not taken from a publication.

    Args:
        span, sag: of the edge between the tops, in the level plane at `height`, m.

    Options:
        n: number of elements of the edge.
        height: of the tops, m.
        lean: offset of a pylon's top from its foot, towards -y, m.
        reach: scale of the distances of the guys' anchors from the feet, outwards and towards -y,
            m.
        pressure: of the membrane on the edge, N/m; phase 2 adds half of it.
        uplift: in phase 2, N/m.
        edge_stiffness, guy_stiffness, pylon_stiffness: EA, N.
        increments: number of increments of the two phases.

    Returns:
        `Scene` with the groups "edge", "guys", "pylons"; nodes 0 and n are the tops.

    Raises:
        ValueError: fewer than two elements; proportions with compressed guys or pylons in tension.

    Example:
        >>> structure, phases = scenes.tent_edge(span=20.0, sag=2.0, n=16, pressure=3e3)
        >>> radius = (20.0**2 / 4 + 2.0**2) / (2 * 2.0)  # radius of the arc, m
        >>> print(f"{phases[0].pretension['edge'] / (3e3 * radius):.4f}")  # close to T = p r
        0.9997
    """
    if n < 2:
        raise ValueError(f"n = {n}: an edge that sags has at least 2 elements")
    radius = (span**2 / 4 + sag**2) / (2 * sag)
    half = np.arcsin(span / (2 * radius))
    angle = np.linspace(-half, half, n + 1)
    edge = np.column_stack(
        [radius * np.sin(angle), radius * (np.cos(angle) - np.cos(half)), np.full(n + 1, height)]
    )
    phi = 2 * half / n
    tension = pressure * radius * np.cos(phi / 2)
    out = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
    tops = edge[[0, n]]
    feet = tops + np.array([0, lean, -height])
    anchors = np.stack(
        [
            feet + reach * (0.4 * out + np.array([0, -1.2, 0])),
            feet + reach * (1.2 * out + np.array([0, -0.4, 0])),
        ],
        axis=1,
    )
    nodes = np.concatenate([edge, feet, anchors.reshape(4, 3)])
    guys = [(0, n + 3), (0, n + 4), (n, n + 5), (n, n + 6)]
    pylons = [(0, n + 1), (n, n + 2)]
    elements = {
        "edge": jc.Cables(chain_links(range(n + 1)), axial_stiffness=edge_stiffness),
        "guys": jc.Cables(guys, axial_stiffness=guy_stiffness),
        "pylons": jc.Bars(pylons, axial_stiffness=pylon_stiffness),
    }
    guy_tension, pylon_force = np.empty(4), np.empty(2)
    for k, (top, inner) in enumerate(((0, 1), (n, n - 1))):
        ends = [n + 3 + 2 * k, n + 4 + 2 * k, n + 1 + k]
        ways = nodes[ends] - nodes[top]
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        last = nodes[inner] - nodes[top]
        across = np.cross([0, 0, 1.0], np.sign(last[0]) * last)
        pull = tension * last / np.linalg.norm(last) + pressure / 2 * across
        guy_tension[2 * k], guy_tension[2 * k + 1], pylon_force[k] = np.linalg.solve(ways.T, -pull)
    if guy_tension.min() <= 0 or pylon_force.max() >= 0:
        raise ValueError("lean, reach: guys would push or pylons pull; let the anchors reach out")
    structure = jc.Structure(nodes, elements, jc.pinned(np.arange(n + 1, n + 7)))

    def membrane(amount):
        return jc.CablePressure(amount, axis=(0, 0, 1), on="edge")

    gusts = [
        membrane(0.5 * pressure),
        jc.LineLoads((0, 0, uplift), on="edge", per="initial"),
    ]
    forces = {"edge": tension, "guys": guy_tension, "pylons": pylon_force}
    return two_phase_scene(
        structure, increments, gusts, pretension=forces, loads=membrane(pressure)
    )
