"""Plane cable trusses: a bearing and a stabilising cable, prestressed against each other."""

from __future__ import annotations

import numpy as np

from ..analysis.phases import Phase
from ..elements import Bars, Cables
from ..loads import NodalLoads
from ..model.structure import Structure
from ..model.supports import Supports
from .nets import Scene

FORMS = ("biconcave", "biconvex")
LOADED = ("full", "half")


def cable_truss(
    form: str = "biconcave",
    span: float = 40.0,
    *,
    sags: tuple[float, float] = (2.4, 1.6),
    gap: float = 1.0,
    panels: int = 10,
    pretension: float = 300e3,
    load: float = 3e3,
    loaded: str = "full",
    cable_stiffness: float = 200e6,
    tie_stiffness: float = 40e6,
    increments: tuple[int, int] = (1, 4),
) -> Scene:
    """Cable truss of two parabolas in the plane y = 0, tied by verticals.

    A parabola ``z = 4 f x^2 / L^2`` whose tension has the horizontal part H pulls every node with

        H (z_{i-1} - 2 z_i + z_{i+1}) / d = 8 H f d / L^2,     d = L / panels,

    the same at all of them: a vertical between the two parabolas carries that, and the truss is in
    equilibrium if ``H f`` is equal in both. Force densities are ``H / d`` in the parabolas. There
    is this one state of self-stress and, from three panels on, ``panels - 2`` mechanisms, which it
    stiffens.

    - "biconcave": the bearing cable hangs above, the stabilising one is arched below, nearest to
      each other in the middle; verticals are cables ("ties").
    - "biconvex": a lens, the bearing cable below, with its verticals in compression ("ties" are
      bars).

    Nodes 0 to `panels` are those of the bearing cable, then come those of the stabilising one. The
    ends are anchored, all nodes held across the plane. Phase 1 prestresses, phase 2 loads the inner
    nodes of the upper cable.

    Args:
        form: "biconcave" or "biconvex".
        span: m.
        sags: f of the bearing and of the stabilising cable, m.
        gap: between them, where they are nearest: in the middle, or at the anchors (0 there lets
            them meet in a biconvex truss), m.
        panels: at least 3.
        pretension: horizontal part of the tension of the bearing cable, N.
        load: on the plan, downward, N/m.
        loaded: "full", or "half" for the nodes left of the middle alone (and half of that in it).
        cable_stiffness, tie_stiffness: EA, N.
        increments: of the two phases.

    Raises:
        ValueError: unknown `form` or `loaded`, or a size that gives no truss.

    Returns:
        `Scene` with the groups "bearing", "stabilising", "ties".

    A scene of our own; form and closed form as in books on cable roofs (Schleyer 1969; Buchholdt
    1999).

    Example:
        One state of self-stress and ``panels - 2`` mechanisms:

        >>> structure, phases = jc.scenes.cable_truss(panels=10)
        >>> found = jc.forms.self_stress(structure)
        >>> found.s, found.m
        (1, 8)
    """
    for name, value, known in (("form", form, FORMS), ("loaded", loaded, LOADED)):
        if value not in known:
            raise ValueError(f"{name} = {value!r}: expected one of {', '.join(known)}")
    if isinstance(panels, bool) or int(panels) != panels or panels < 3:
        raise ValueError(f"panels = {panels!r}: expected a whole number of at least 3")
    concave = form == "biconcave"
    for name, size in (("span", span), ("sags[0]", sags[0]), ("sags[1]", sags[1])):
        if not size > 0:
            raise ValueError(f"{name} = {size}: must be positive")
    if not (gap > 0 or (gap == 0 and not concave)):
        raise ValueError(f"gap = {gap}: must be positive (or 0 in a biconvex truss)")
    if not pretension > 0:
        raise ValueError(f"pretension = {pretension}: must be positive")

    along = np.linspace(-1.0, 1.0, panels + 1)
    shape = along**2 if concave else along**2 - 1  # of the bearing cable, 0 where they are nearest
    side = 1.0 if concave else -1.0  # of the bearing cable: above or below
    rows = [
        np.column_stack([0.5 * span * along, np.zeros(panels + 1), z])
        for z in (side * gap / 2 + sags[0] * shape, -side * gap / 2 - sags[1] * shape)
    ]
    nodes = np.concatenate(rows)
    cable = np.column_stack([np.arange(panels), np.arange(1, panels + 1)])
    inner = np.arange(1, panels)
    ties = np.column_stack([inner, inner + panels + 1])
    held = np.zeros((len(nodes), 3), bool)
    held[:, 1] = True
    held[[0, panels, panels + 1, 2 * panels + 1]] = True
    tie = Cables if concave else Bars
    structure = Structure(
        nodes,
        {
            "bearing": Cables(cable, axial_stiffness=cable_stiffness),
            "stabilising": Cables(cable + panels + 1, axial_stiffness=cable_stiffness),
            "ties": tie(ties, axial_stiffness=tie_stiffness),
        },
        supports=Supports(held),
    )
    panel = span / panels
    pull = 8 * pretension * sags[0] * panel / span**2
    height = np.abs(nodes[ties[:, 0], 2] - nodes[ties[:, 1], 2])
    density = {
        "bearing": pretension / panel,
        "stabilising": pretension * sags[0] / sags[1] / panel,
        "ties": side * pull / height,
    }
    share = np.full(panels - 1, 1.0)
    if loaded == "half":
        share = np.where(2 * inner < panels, 1.0, np.where(2 * inner == panels, 0.5, 0.0))
    force = np.zeros((panels - 1, 3))
    force[:, 2] = -load * panel * share
    upper = inner if concave else inner + panels + 1
    return Scene(
        structure,
        [
            Phase(force_density=density, increments=increments[0]),
            Phase(loads=NodalLoads(upper, force), increments=increments[1]),
        ],
    )
