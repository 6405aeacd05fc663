"""Masts: a steel tube with guys at several levels."""

from __future__ import annotations

import numpy as np

from ..elements import Beams, Cables
from ..loads import NodalLoads, SelfWeight
from ..materials import steel
from ..materials.law import Law
from ..model.structure import Structure
from ..model.supports import clamped, pinned
from ..sections import Section
from .building_blocks import (
    STEEL_WEIGHT,
    Scene,
    chain_links,
    points_on_circle,
    two_phase_scene,
)


def guyed_mast(
    height: float = 60.0,
    levels: int = 3,
    *,
    per_level: int = 4,
    reach: float = 0.5,
    pretension: float = 40e3,
    wind: float = 1000.0,
    law: Law | None = None,
    increments: tuple[int, int] = (4, 10),
) -> Scene:
    """Return a guyed mast: a steel tube clamped at its foot, three guys at every level.

    Tube 406.4 x 8.8 mm of S355 steel fibres with elastic unloading; guys of 24 mm spiral strand, EA
    from 353 mm2 at 165 kN/mm2. Phase 1 adds the weight and tensions the guys. Phase 2 adds wind as
    nodal loads on the mast, which grow linearly from half at the foot to the full value at the top.
    The scene is not taken from a publication; the section is a catalogue tube (EN 10210-2).

    Args:
        height: of the mast, m.
        levels: number of levels of guys, evenly spaced up to the top.

    Options:
        per_level: number of beam elements between two levels.
        reach: distance of the anchors from the foot, relative to the height of their level; the
            distance is at least 0.3 of the height of the mast.
        pretension: of every guy in the initial geometry, N.
        wind: force per length at the top, along x, N/m.
        law: uniaxial law of the tube; default steel of 355 MPa.
        increments: number of increments of the two phases.

    Returns:
        `Scene` with the groups "mast" and "guys".

    Raises:
        ValueError: no level of guys, or no element between two levels.

    Example:
        >>> structure, phases = jc.scenes.guyed_mast(levels=3, per_level=4)
        >>> {kind: len(group.links) for kind, group in structure.elements.items()}
        {'mast': 12, 'guys': 9}
        >>> print(f"{structure.nodes[12, 2]:.0f} m")
        60 m
    """
    if levels < 1 or per_level < 1:
        raise ValueError(f"levels, per_level = {levels}, {per_level}: must be at least 1")
    n = levels * per_level
    z = np.linspace(0.0, height, n + 1)
    tops = per_level * np.arange(1, levels + 1)
    angle = np.pi + 2 * np.pi * np.arange(3) / 3  # one guy straight into the wind
    anchors = [points_on_circle(max(reach * z[top], 0.3 * height), angle, 0.0) for top in tops]
    nodes = np.concatenate([np.column_stack([0 * z, 0 * z, z]), *anchors])
    guys = np.column_stack([np.arange(n + 1, len(nodes)), np.repeat(tops, 3)])
    tube = Section.ring(0.4064, 0.0088, steel(355e6) if law is None else law, (2, 24))
    area, guy_area = np.pi * 0.0088 * (0.4064 - 0.0088), 353e-6
    structure = Structure(
        nodes,
        {
            "mast": Beams(
                chain_links(range(n + 1)), section=tube, weight=STEEL_WEIGHT * area, points=3
            ),
            "guys": Cables(guys, axial_stiffness=165e9 * guy_area, weight=STEEL_WEIGHT * guy_area),
        },
        supports=clamped([0]) + pinned(np.arange(n + 1, len(nodes))),
    )
    share = np.where(np.arange(1, n + 1) < n, 1.0, 0.5) * height / n
    force = np.zeros((n, 3))
    force[:, 0] = wind * (0.5 + 0.5 * z[1:] / height) * share
    wind_loads = NodalLoads(np.arange(1, n + 1), force)
    return two_phase_scene(
        structure, increments, wind_loads, pretension=pretension, loads=SelfWeight()
    )
