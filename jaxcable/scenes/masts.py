"""Structures of cables and beams: a guyed mast, and an arch stiffened by a net of cables."""

from __future__ import annotations

import numpy as np

from ..analysis.phases import Phase
from ..elements import Beams, Cables
from ..loads import NodalLoads, SelfWeight
from ..materials import Elastic, steel
from ..materials.law import Law
from ..model.structure import Structure
from ..model.supports import clamped, pinned
from ..sections import Section
from .nets import Scene

STEEL_WEIGHT = 77e3  # N/m3 (7 850 kg/m3)


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
    """Guyed mast: a steel tube clamped at its foot, three guys at every level.

    Tube 406.4 x 8.8 mm of S355 steel fibres with elastic unloading; guys of 24 mm spiral strand, EA
    from 353 mm2 at 165 kN/mm2. Phase 1 adds the weight and tensions the guys. Phase 2 adds wind as
    nodal loads on the mast, which grow linearly from half at the foot to the full value at the top.
    The scene is not taken from a publication; the section is a catalogue tube (EN 10210-2).

    Args:
        height: of the mast, m.
        levels: number of levels of guys, evenly up to the top.

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
    mast = np.column_stack([np.zeros(n + 1), np.zeros(n + 1), z])
    anchors, guys = [], []
    for level in range(1, levels + 1):
        top = level * per_level
        radius = max(reach * z[top], 0.3 * height)
        for k in range(3):
            angle = np.pi + 2 * np.pi * k / 3  # one guy straight into the wind
            guys.append((n + 1 + len(anchors), top))
            anchors.append((radius * np.cos(angle), radius * np.sin(angle), 0.0))
    nodes = np.concatenate([mast, anchors])
    tube = Section.ring(0.4064, 0.0088, steel(355e6) if law is None else law, (2, 24))
    links = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    area, guy_area = np.pi * 0.0088 * (0.4064 - 0.0088), 353e-6
    structure = Structure(
        nodes,
        {
            "mast": Beams(links, section=tube, weight=STEEL_WEIGHT * area, points=3),
            "guys": Cables(guys, axial_stiffness=165e9 * guy_area, weight=STEEL_WEIGHT * guy_area),
        },
        supports=clamped([0]) + pinned(np.arange(n + 1, len(nodes))),
    )
    share = np.where(np.arange(1, n + 1) < n, 1.0, 0.5) * height / n
    force = np.zeros((n, 3))
    force[:, 0] = wind * (0.5 + 0.5 * z[1:] / height) * share
    return Scene(
        structure,
        [
            Phase(
                pretension=pretension,
                loads=SelfWeight(),
                increments=increments[0],
            ),
            Phase(loads=NodalLoads(np.arange(1, n + 1), force), increments=increments[1]),
        ],
    )


def strung_arch(
    span: float = 20.0,
    rise: float = 4.0,
    *,
    n: int = 16,
    pretension: float = 20e3,
    load: float = 5e3,
    one_sided: bool = True,
    increments: tuple[int, int] = (4, 10),
) -> Scene:
    """Parabolic arch stiffened by a prestressed net of cables under it.

    The feet of the arch (tube 168.3 x 8 mm, linear) are clamped. Cables of 100 mm2 (165 kN/mm2) run
    from every second node between the quarter points to both feet, crossing each other: they
    stiffen the arch against swaying. Phase 1 tensions them under self-weight, phase 2 loads the
    nodes of the left half, or of both. The scene is not taken from a publication.

    Args:
        span, rise: of the arch, m.

    Options:
        n: number of beam elements, a multiple of 4.
        pretension: of every cable in the initial geometry, N.
        load: downward force on every loaded node, N.
        one_sided: whether only the left half is loaded.
        increments: number of increments of the two phases.

    Returns:
        `Scene` with the groups "arch" and "net".

    Raises:
        ValueError: `n` is no multiple of 4.

    Example:
        >>> structure, phases = jc.scenes.strung_arch(span=20.0, rise=4.0, n=16)
        >>> {kind: len(group.links) for kind, group in structure.elements.items()}
        {'arch': 16, 'net': 10}
        >>> print(structure.nodes[8])  # crown
        [0. 0. 4.]
    """
    if n < 4 or n % 4:
        raise ValueError(f"n = {n}: must be a multiple of 4")
    x = np.linspace(-span / 2, span / 2, n + 1)
    nodes = np.column_stack([x, np.zeros(n + 1), rise * (1 - (2 * x / span) ** 2)])
    tied = [k for k in range(n // 4, 3 * n // 4 + 1, 2)]
    cables = [(foot, k) for k in tied for foot in (0, n)]
    tube = Section.ring(0.1683, 0.008, Elastic(210e9), (2, 24))
    area = np.pi * 0.008 * (0.1683 - 0.008)
    links = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    structure = Structure(
        nodes,
        {
            "arch": Beams(links, section=tube, weight=STEEL_WEIGHT * area),
            "net": Cables(cables, axial_stiffness=165e9 * 100e-6, weight=STEEL_WEIGHT * 100e-6),
        },
        supports=clamped([0, n]),
    )
    loaded = np.arange(1, n // 2 if one_sided else n)
    return Scene(
        structure,
        [
            Phase(
                pretension=pretension,
                loads=SelfWeight(),
                increments=increments[0],
            ),
            Phase(loads=NodalLoads(loaded, (0.0, 0.0, -load)), increments=increments[1]),
        ],
    )
