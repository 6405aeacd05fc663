"""An arch of beams that a net of cables stiffens."""

from __future__ import annotations

import numpy as np

import jaxcable as jc
from jaxcable.scenes.building_blocks import (
    STEEL,
    STEEL_WEIGHT,
    Scene,
    chain_links,
    downward_loads,
    two_phase_scene,
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
        >>> structure, phases = scenes.strung_arch(span=20.0, rise=4.0, n=16)
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
    tube = jc.Section.ring(0.1683, 0.008, jc.Elastic(STEEL), (2, 24))
    area = np.pi * 0.008 * (0.1683 - 0.008)
    elements = {
        "arch": jc.Beams(chain_links(range(n + 1)), section=tube, weight=STEEL_WEIGHT * area),
        "net": jc.Cables(cables, axial_stiffness=165e9 * 100e-6, weight=STEEL_WEIGHT * 100e-6),
    }
    structure = jc.Structure(nodes, elements, supports=jc.clamped([0, n]))
    loaded = downward_loads(np.arange(1, n // 2 if one_sided else n), load)
    return two_phase_scene(
        structure, increments, loaded, pretension=pretension, loads=jc.SelfWeight()
    )
