"""Plane frames that snap: the toggle of Williams, the frame of Lee."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import jaxcable as jc
from jaxcable.scenes.building_blocks import Scene, chain_links, downward_loads


def toggle_frame(n: int = 8, load: float = 80.0) -> Scene:
    """Two beams, clamped at their feet and joined rigidly at the apex, under a load on the apex.

    Half-span 12.943, rise 0.386, section 0.753 by 0.243, E 1.03e7: inches and pounds.

    Args:
        n: number of elements of each beam.
        load: downward force on the apex.

    Returns:
        `Scene`; the load is on node n, the apex.

    Source: Williams, Quarterly J. of Mechanics and Applied Mathematics 17 (1964).

    Example:
        >>> structure, phases = scenes.toggle_frame(n=8)
        >>> section = structure.elements.section
        >>> inertia = section.inertia()[0]
        >>> print(f"{section.total_area:.6f} in2, {inertia:.8f} in4")  # b h, b h^3 / 12
        0.182979 in2, 0.00090039 in4
    """
    half_span, rise, width, height = 12.943, 0.386, 0.753, 0.243
    x = np.linspace(-half_span, half_span, 2 * n + 1)
    nodes = np.column_stack([x, 0 * x, rise * (1 - np.abs(x) / half_span)])
    section = solid(width * height, width * height**3 / 12, 1.03e7)
    beams = jc.Beams(chain_links(range(2 * n + 1)), section=section, torsional_stiffness=1.0)
    structure = jc.Structure(nodes, beams, supports=in_plane(2 * n + 1, clamped=[0, 2 * n]))
    return Scene(structure, [jc.Phase(loads=downward_loads([n], load))])


def lee_frame(n: int = 5, load: float = 30.0) -> Scene:
    """Column and beam joined rigidly, hinged at their far ends, with a load on the beam.

    The load acts at a fifth of the beam from the column. Lengths 120, A 6, I 2, E 720 (consistent
    units). The path has two limit points and snaps back in between; the first limit point is
    published at a load of 18.552.

    Args:
        n: number of elements of each fifth of the beam; the column has 5 n elements.
        load: downward force.

    Returns:
        `Scene`; the load is on node 6 n.

    Source: Lee, Manuel, Rossow, J. Eng. Mech. Div. ASCE 94 (1968); the value 18.552 is that of
    Schweizerhof and Wriggers, Comp. Meth. Appl. Mech. Eng. 59 (1986).

    Example:
        >>> structure, phases = scenes.lee_frame(n=5)
        >>> print(structure.n_node, structure.nodes[25], structure.nodes[30])  # corner, load
        51 [  0.   0. 120.] [ 24.   0. 120.]
    """
    along = np.linspace(0.0, 120.0, 5 * n + 1)
    column = np.column_stack([0 * along, 0 * along, along])
    beam = np.column_stack([along, 0 * along, 0 * along + 120.0])[1:]
    nodes = np.concatenate([column, beam])
    section, links = solid(6.0, 2.0, 720.0), chain_links(range(10 * n + 1))
    beams = jc.Beams(links, section=section, torsional_stiffness=1.0, up=(0.0, 1.0, 0.0))
    structure = jc.Structure(nodes, beams, supports=in_plane(10 * n + 1, pinned=[0, 10 * n]))
    return Scene(structure, [jc.Phase(loads=downward_loads([6 * n], load))])


def solid(area: float, inertia: float, modulus: float) -> jc.Section:
    """Section of four fibres, one in each quadrant, with the exact area and second moments."""
    arm = np.sqrt(inertia / area)
    y, z = arm * np.array([-1.0, 1.0, 1.0, -1.0]), arm * np.array([-1.0, -1.0, 1.0, 1.0])
    return jc.Section(y, z, np.full(4, area / 4), [jc.Elastic(modulus)])


def in_plane(n_node: int, pinned: Sequence[int] = (), clamped: Sequence[int] = ()) -> jc.Supports:
    """Supports that keep all nodes in the x-z plane, with rotations about y only.

    Args:
        n_node: number of nodes.
        pinned: numbers of nodes whose displacement is held.
        clamped: numbers of nodes whose displacement and rotation are held.
    """
    held = np.zeros((n_node, 6), bool)
    held[:, [1, 3, 5]] = True
    held[list(pinned), :3] = True
    held[list(clamped)] = True
    return jc.Supports(held)
