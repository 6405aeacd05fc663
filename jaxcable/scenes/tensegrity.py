"""The simplest tensegrity: three struts that do not touch each other, joined by nine cables."""

from __future__ import annotations

import numpy as np

from ..analysis.phases import Phase
from ..elements import Bars, Cables
from ..loads import NodalLoads
from ..model.structure import Structure
from ..model.supports import Supports
from .nets import Scene

TWIST = np.pi / 6
"""Angle by which the upper triangle is turned relative to the lower one, rad."""


def simplex(
    radius: float = 1.0,
    height: float = 1.5,
    *,
    twist: float = TWIST,
    pretension: float = 1e3,
    load: float = 20.0,
    cable_stiffness: float = 1e6,
    strut_stiffness: float = 20e6,
    increments: tuple[int, int] = (1, 4),
) -> Scene:
    """Simplex (triplex, three-strut prism): two equal triangles, the upper one turned by `twist`.

    Vertical cables join lower node k to upper node k, which is ahead by the twist. Struts join
    lower node k to upper node k + 1, which is ahead by the twist plus 120 degrees. Equilibrium of a
    lower node in plan, with force densities q_t of the triangles, q_v of the verticals and -q_v of
    the struts, is

        across   sin(twist) - sin(twist + 120) = 0      ->  twist = 30 degrees
        inward   3 q_t = q_v (cos(twist) - cos(twist + 120)) = sqrt(3) q_v,

    so that triangle : vertical : strut = 1/sqrt(3) : 1 : -1 for any radius and height. There is one
    infinitesimal mechanism, a screw motion of one triangle relative to the other, stiffened by the
    prestress.

    Lower nodes are 0 to 2, upper nodes 3 to 5. The supports hold six freedoms of the lower
    triangle; they are statically determinate, so that prestress causes no reactions. Phase 1 adds
    prestress, phase 2 loads the upper nodes.

    Args:
        radius: of the circles of both triangles, m.
        height: m.

    Options:
        twist: rad; only 30 degrees (default) has a state of self-stress, with another twist phase 1
            moves the nodes.
        pretension: of a vertical cable, N.
        load: downward force on every upper node, N.
        cable_stiffness, strut_stiffness: EA, N.
        increments: number of increments of the two phases.

    Returns:
        `Scene` with the groups "triangles", "verticals", "struts".

    Raises:
        ValueError: a radius, height or pretension that is not positive.

    Source: form and force densities are classic (Connelly and Terrell 1995; Tibert and Pellegrino
    2003); the numbers are not taken from a publication.

    Example:
        >>> structure, phases = jc.scenes.simplex()
        >>> found = jc.forms.self_stress(structure)
        >>> density = {kind: state[0, 0] for kind, state in found.force_densities.items()}
        >>> print({kind: round(float(q / density["verticals"]), 6) for kind, q in density.items()})
        {'struts': -1.0, 'triangles': 0.57735, 'verticals': 1.0}
    """
    for name, value in (("radius", radius), ("height", height), ("pretension", pretension)):
        if not value > 0:
            raise ValueError(f"{name} = {value}: must be positive")
    around = 2 * np.pi * np.arange(3) / 3

    def ring(start, z):
        angle = start + around
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(3, z)])

    nodes = np.concatenate([ring(0.0, 0.0), ring(twist, height)])
    lower = np.arange(3)
    ahead = (lower + 1) % 3
    sides = np.column_stack([lower, ahead])
    held = np.zeros((6, 3), bool)
    held[0] = held[1, 0] = held[:3, 2] = True  # node 1 cannot turn about node 0
    structure = Structure(
        nodes,
        {
            "triangles": Cables(
                np.concatenate([sides, sides + 3]), axial_stiffness=cable_stiffness
            ),
            "verticals": Cables(
                np.column_stack([lower, lower + 3]), axial_stiffness=cable_stiffness
            ),
            "struts": Bars(np.column_stack([lower, ahead + 3]), axial_stiffness=strut_stiffness),
        },
        supports=Supports(held),
    )
    q = pretension / np.linalg.norm(nodes[3] - nodes[0])
    return Scene(
        structure,
        [
            Phase(
                force_density={"triangles": q / np.sqrt(3.0), "verticals": q, "struts": -q},
                increments=increments[0],
            ),
            Phase(
                loads=NodalLoads([3, 4, 5], (0.0, 0.0, -load)),
                increments=increments[1],
            ),
        ],
    )
