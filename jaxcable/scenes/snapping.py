"""Structures that snap: the truss of von Mises, the toggle of Williams, the frame of Lee."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..analysis.phases import Phase
from ..elements import Bars, Beams
from ..loads import NodalLoads
from ..materials import Elastic
from ..model.structure import Structure
from ..model.supports import Supports
from ..sections import Section
from .nets import Scene


def von_mises_truss(
    rise: float = 0.1,
    half_span: float = 1.0,
    *,
    axial_stiffness: float = 1e6,
    load: float = 500.0,
    hanger: float | None = None,
    sway: bool = False,
) -> Scene:
    """Two bars that meet in a shallow apex under a vertical load, in the x-z plane.

    Equilibrium with the apex at height z over the feet: ``P = 2 EA (l0 - l)/l0 z/l``; limit point
    at ``l = (b^2 l0)^(1/3)``. With a `hanger` of stiffness k the load acts at the hanger's end,
    which moves by ``P/k`` more: with a soft hanger the path snaps back. If the apex may sway, steep
    trusses bifurcate first, where ``l^3 - l0 l^2 + l0 b^2 = 0``.

    Args:
        rise, half_span: m.

    Options:
        axial_stiffness: EA of the bars, N.
        load: downward force, N.
        hanger: stiffness of a bar of length 1 m from the apex to the load, N/m; None for no bar.
        sway: whether the apex may move in x; it is held out of plane in any case.

    Returns:
        `Scene`; the apex is node 1. With a hanger the groups are "bars" and "hanger", the load is
        on node 3.

    Source: von Mises (1923).

    Example:
        >>> structure, phases = jc.scenes.von_mises_truss(rise=0.1, load=500.0)
        >>> path = jc.trace_path(structure, phases)
        >>> print(path.status, f"{500 * path.failure_load:.6f} N")  # the limit point
        0 381.087190 N
    """
    nodes = np.array([[-half_span, 0, 0], [0, 0, rise], [half_span, 0, 0], [0, 0, rise - 1.0]])
    held = np.ones((4, 3), bool)
    held[1:4:2, 2] = False
    held[1, 0] = not sway
    bars = Bars([[0, 1], [1, 2]], axial_stiffness=axial_stiffness)
    if hanger is None:
        structure = Structure(nodes[:3], bars, supports=Supports(held[:3]))
        return Scene(structure, [Phase(loads=NodalLoads([1], (0.0, 0.0, -load)))])
    elements = {"bars": bars, "hanger": Bars([[1, 3]], axial_stiffness=hanger)}
    structure = Structure(nodes, elements, supports=Supports(held))
    return Scene(structure, [Phase(loads=NodalLoads([3], (0.0, 0.0, -load)))])


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
        >>> structure, phases = jc.scenes.toggle_frame(n=8)
        >>> section = structure.elements.section
        >>> inertia = section.inertia()[0]
        >>> print(f"{section.total_area:.6f} in2, {inertia:.8f} in4")  # b h, b h^3 / 12
        0.182979 in2, 0.00090039 in4
    """
    half_span, rise, width, height = 12.943, 0.386, 0.753, 0.243
    x = np.linspace(-half_span, half_span, 2 * n + 1)
    nodes = np.column_stack([x, 0 * x, rise * (1 - np.abs(x) / half_span)])
    section = solid(width * height, width * height**3 / 12, 1.03e7)
    links = np.column_stack([np.arange(2 * n), np.arange(1, 2 * n + 1)])
    beams = Beams(links, section=section, torsional_stiffness=1.0)
    structure = Structure(nodes, beams, supports=in_plane(2 * n + 1, clamped=[0, 2 * n]))
    return Scene(structure, [Phase(loads=NodalLoads([n], (0.0, 0.0, -load)))])


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
        >>> structure, phases = jc.scenes.lee_frame(n=5)
        >>> print(structure.n_node, structure.nodes[25], structure.nodes[30])  # corner, load
        51 [  0.   0. 120.] [ 24.   0. 120.]
    """
    along = np.linspace(0.0, 120.0, 5 * n + 1)
    column = np.column_stack([0 * along, 0 * along, along])
    beam = np.column_stack([along, 0 * along, 0 * along + 120.0])[1:]
    nodes = np.concatenate([column, beam])
    links = np.column_stack([np.arange(10 * n), np.arange(1, 10 * n + 1)])
    section = solid(6.0, 2.0, 720.0)
    beams = Beams(links, section=section, torsional_stiffness=1.0, up=(0.0, 1.0, 0.0))
    structure = Structure(nodes, beams, supports=in_plane(10 * n + 1, pinned=[0, 10 * n]))
    return Scene(structure, [Phase(loads=NodalLoads([6 * n], (0.0, 0.0, -load)))])


def solid(area: float, inertia: float, modulus: float) -> Section:
    """Section of four fibres, one in each quadrant, with the exact area and second moments."""
    arm = np.sqrt(inertia / area)
    y, z = arm * np.array([-1.0, 1.0, 1.0, -1.0]), arm * np.array([-1.0, -1.0, 1.0, 1.0])
    return Section(y, z, np.full(4, area / 4), [Elastic(modulus)])


def in_plane(n_node: int, pinned: Sequence[int] = (), clamped: Sequence[int] = ()) -> Supports:
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
    return Supports(held)
