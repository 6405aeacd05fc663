"""The simplest tensegrity: three struts that do not touch each other, joined by nine cables."""

from __future__ import annotations

import numpy as np

from ..elements import Bars, Cables
from ..model.structure import Structure
from ..model.supports import Supports
from .building_blocks import (
    Scene,
    chain_links,
    downward_loads,
    points_on_circle,
    require_positive,
    two_phase_scene,
)

TWIST = np.pi / 6
"""Angle of the upper triangle relative to the lower one at which there is a self-stress, rad."""


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
    """Return a simplex (three-strut tensegrity prism): two triangles, the upper rotated by `twist`.

    Vertical cables join lower node k to upper node k, which is ahead by the twist. Struts join
    lower node k to upper node k + 1, which is ahead by the twist plus 120 degrees. Equilibrium of a
    lower node in plan, with force densities q_t of the triangles, q_v of the verticals and -q_v of
    the struts, is

        across   sin(twist) - sin(twist + 120) = 0      ->  twist = 30 degrees
        inward   3 q_t = q_v (cos(twist) - cos(twist + 120)) = sqrt(3) q_v,

    so that triangle : vertical : strut = 1/sqrt(3) : 1 : -1 for any radius and height. There is one
    infinitesimal mechanism, a screw motion of one triangle relative to the other, stiffened by the
    prestress.

    Lower nodes are 0 to 2, upper nodes 3 to 5. The supports hold six degrees of freedom of the
    lower triangle; they are statically determinate, so that prestress causes no reactions. Phase 1
    adds prestress, phase 2 loads the upper nodes.

    Args:
        radius: radius of the circles through both triangles, m.
        height: distance of the triangles, m.

    Options:
        twist: rotation of the upper triangle, rad; only 30 degrees (default) has a state of
            self-stress, with another twist phase 1 moves the nodes.
        pretension: of a vertical cable, N.
        load: downward force on every upper node, N.
        cable_stiffness, strut_stiffness: EA of cables and of struts, N.
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
    require_positive(radius=radius, height=height, pretension=pretension)
    angle = 2 * np.pi * np.arange(3) / 3
    nodes = np.concatenate(
        [points_on_circle(radius, angle, 0.0), points_on_circle(radius, twist + angle, height)]
    )
    lower = np.arange(3)
    sides = chain_links(lower, closed=True)
    held = np.zeros((6, 3), bool)
    held[0] = held[1, 0] = held[:3, 2] = True  # node 1 cannot turn about node 0
    triangles, verticals = np.concatenate([sides, sides + 3]), np.column_stack([lower, lower + 3])
    struts = sides + np.array([0, 3])
    elements = {
        "triangles": Cables(triangles, axial_stiffness=cable_stiffness),
        "verticals": Cables(verticals, axial_stiffness=cable_stiffness),
        "struts": Bars(struts, axial_stiffness=strut_stiffness),
    }
    q = pretension / np.linalg.norm(nodes[3] - nodes[0])
    return two_phase_scene(
        Structure(nodes, elements, supports=Supports(held)),
        increments,
        downward_loads([3, 4, 5], load),
        force_density={"triangles": q / np.sqrt(3.0), "verticals": q, "struts": -q},
    )
