"""Plane cable trusses: a bearing and a stabilising cable that prestress each other."""

from __future__ import annotations

import numpy as np

import jaxcable as jc
from jaxcable.common import checks
from jaxcable.scenes.building_blocks import (
    Scene,
    chain_links,
    downward_loads,
    require_positive,
    two_phase_scene,
)

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

    A cable along a parabola ``z = 4 f x^2 / L^2``, with the horizontal component H of its tension,
    exerts a vertical force on every node,

        H (z_{i-1} - 2 z_i + z_{i+1}) / d = 8 H f d / L^2,     d = L / panels,

    which is the same at all nodes. The verticals between the two parabolas carry these forces, and
    the truss is in equilibrium if ``H f`` is the same for both parabolas. Force densities are
    ``H / d`` in the parabolas. This is the only state of self-stress. It stiffens ``panels - 2``
    mechanisms.

    - "biconcave": the bearing cable hangs above, the stabilising cable is arched below, and they
      are nearest in the middle; the verticals are cables ("ties").
    - "biconvex": a lens with the bearing cable below and verticals in compression ("ties" are
      bars).

    Nodes 0 to `panels` are those of the bearing cable, followed by those of the stabilising cable.
    The ends are anchored, and all nodes are held out of plane. Phase 1 adds prestress, phase 2
    loads the inner nodes of the upper cable.

    Args:
        form: "biconcave" or "biconvex".
        span: m.

    Options:
        sags: f of the bearing and of the stabilising cable, m.
        gap: vertical distance of the two cables where they are nearest, m: in the middle of a
            biconcave truss, at the anchors of a biconvex truss (where it may be 0).
        panels: number of panels, at least 3.
        pretension: horizontal component of the tension of the bearing cable, N.
        load: per length in plan, downward, N/m.
        loaded: "full", or "half" for the nodes left of the middle, with half a load in the middle.
        cable_stiffness, tie_stiffness: EA, N.
        increments: number of increments of the two phases.

    Returns:
        `Scene` with the groups "bearing", "stabilising", "ties".

    Raises:
        ValueError: unknown `form` or `loaded`, or a size that gives no truss.

    Source: form and equilibrium as in books on cable roofs (Schleyer 1969; Buchholdt 1999); the
    numbers are not taken from a publication.

    Example:
        A single state of self-stress and ``panels - 2`` mechanisms:

        >>> structure, phases = scenes.cable_truss(panels=10)
        >>> found = jc.forms.self_stress(structure)
        >>> found.s, found.m
        (1, 8)
    """
    for name, value, known in (("form", form, FORMS), ("loaded", loaded, LOADED)):
        if value not in known:
            raise ValueError(f"{name} = {value!r}: expected one of {', '.join(known)}")
    checks.require_whole_number(panels, "panels", least=3)
    concave = form == "biconcave"
    require_positive(**{"span": span, "sags[0]": sags[0], "sags[1]": sags[1]})
    if not (gap > 0 or (gap == 0 and not concave)):
        raise ValueError(f"gap = {gap}: must be positive (or 0 in a biconvex truss)")
    require_positive(pretension=pretension)

    along = np.linspace(-1.0, 1.0, panels + 1)
    # shape of the bearing cable, zero where the cables are nearest
    shape = along**2 if concave else along**2 - 1
    side = 1.0 if concave else -1.0  # of the bearing cable: above or below
    parabolas = [
        np.column_stack([0.5 * span * along, np.zeros(panels + 1), z])
        for z in (side * gap / 2 + sags[0] * shape, -side * gap / 2 - sags[1] * shape)
    ]
    nodes = np.concatenate(parabolas)
    cable = chain_links(range(panels + 1))
    inner = np.arange(1, panels)
    ties = np.column_stack([inner, inner + panels + 1])
    held = np.zeros((len(nodes), 3), bool)
    held[:, 1] = True
    held[[0, panels, panels + 1, 2 * panels + 1]] = True
    tie = jc.Cables if concave else jc.Bars
    elements = {
        "bearing": jc.Cables(cable, axial_stiffness=cable_stiffness),
        "stabilising": jc.Cables(cable + panels + 1, axial_stiffness=cable_stiffness),
        "ties": tie(ties, axial_stiffness=tie_stiffness),
    }
    structure = jc.Structure(nodes, elements, supports=jc.Supports(held))
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
    upper = inner if concave else inner + panels + 1
    roof = downward_loads(upper, load * panel * share)
    return two_phase_scene(structure, increments, roof, force_density=density)
