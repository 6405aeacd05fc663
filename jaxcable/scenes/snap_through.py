"""A structure that snaps through: the truss of von Mises."""

from __future__ import annotations

import numpy as np

from ..analysis.phases import Phase
from ..elements import Bars
from ..model.structure import Structure
from ..model.supports import Supports
from .building_blocks import Scene, downward_loads


def von_mises_truss(
    rise: float = 0.1,
    half_span: float = 1.0,
    *,
    axial_stiffness: float = 1e6,
    load: float = 500.0,
    hanger: float | None = None,
    sway: bool = False,
) -> Scene:
    """Return two bars that meet in a shallow apex under a vertical load, in the x-z plane.

    If z is the height of the apex over the feet, ``P = 2 EA (l0 - l)/l0 z/l``; the limit point is
    at ``l = (b^2 l0)^(1/3)``, with the half span b. With a `hanger` of stiffness k the load acts at
    the end of the hanger, which moves by ``P/k`` more; if it is soft, the path snaps back. If the
    apex may sway, steep trusses bifurcate first, where ``l^3 - l0 l^2 + l0 b^2 = 0``.

    Args:
        rise, half_span: height of the apex over the feet, and half of their distance, m.

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
        return Scene(structure, [Phase(loads=downward_loads([1], load))])
    elements = {"bars": bars, "hanger": Bars([[1, 3]], axial_stiffness=hanger)}
    structure = Structure(nodes, elements, supports=Supports(held))
    return Scene(structure, [Phase(loads=downward_loads([3], load))])
