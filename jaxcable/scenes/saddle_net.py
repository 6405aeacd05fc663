"""The large saddle net of the paper: its topology and section, with an assumed geometry."""

from __future__ import annotations

from ..common.tree import replace
from ..elements import Cables
from ..materials import Elastic
from ..materials.law import Law
from ..sections import Section
from .building_blocks import Scene
from .nets import saddle

DIAMETER = 0.05  # m: the paper's area is 19.63 cm2


def saddle_net(
    law: Law | None = None,
    spacing: float = 10.0,
    *,
    rise: float = 0.1,
    pretension: float = 30e3,
    load: float = 90e3,
    increments: tuple[int, int] = (500, 435),
    shape: tuple[int, int] = (10, 10),
) -> Scene:
    """Return the large saddle net of the paper: 201 links, 132 nodes, 15 x 6 of them free.

    E 210 kN/mm2, circular fibre section of 50 mm with 10 x 10 quadrilaterals. Phase 1 tensions all
    cables to 30 kN; phase 2 anchors them and adds 90 kN to every free node. The phases have 500 and
    435 increments.

    The published spacing and heights are only in a figure. Here the plan is regular and the heights
    are those of `saddle`, so that the results cannot reproduce the published displacements.

    Args:
        law: uniaxial law of the fibres; default linear.
        spacing: of the cables, m.

    Options:
        rise: as in `saddle`.
        pretension: of every cable in the initial geometry, N.
        load: downward force on every free node, N.
        increments: number of increments of the two phases.
        shape: number of cells of the section, a pair, see `Section.disc`.

    Returns:
        `Scene`.

    Source: Mihanovic, Trogrlic, Zivaljic (2011), section 5.3.

    Example:
        >>> structure, phases = jc.scenes.saddle_net()
        >>> structure.n_node, len(structure.elements.links), structure.elements.section.n_fibre
        (132, 201, 100)
    """
    structure, phases = saddle(
        15, 6, spacing, rise, pretension=pretension, load=load, increments=increments
    )
    section = Section.disc(DIAMETER, Elastic(210e9) if law is None else law, shape)
    cables = Cables(structure.elements.links, section=section)
    return Scene(replace(structure, elements=cables), phases)
