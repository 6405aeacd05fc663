"""Cable-stayed bridges, erected by free cantilevering, segment by segment."""

from __future__ import annotations

import numpy as np

import jaxcable as jc
from jaxcable.scenes.building_blocks import (
    STEEL_WEIGHT,
    STRAND,
    STRAND_STRESS,
    Scene,
    chain_links,
    downward_loads,
    hollow_steel_section,
    two_phase_scene,
)

_ANGLES = "fan", "harp"


def cable_stayed_bridge(
    n: int = 6,
    *,
    stages: bool = True,
    segment: float = 10.0,
    height: float = 30.0,
    stays: str = "fan",
    weight: float = 30e3,
    paving: float = 4e3,
) -> Scene:
    """Return a cable-stayed bridge in one plane: a pylon, and a deck on both sides with stays.

    The deck (a steel box of 2.0 x 1.0 m, 20 mm) is joined rigidly to the pylon (2.0 x 2.0 m, 40
    mm), which is clamped 20 m below. Stays are of strands of 195 kN/mm2, sized for 500 N/mm2 under
    the weight of the finished deck.

    In stages, every phase adds a segment on either side, in line with the segment before it, and
    stresses its stay by a jack with the force whose vertical part is the weight of a segment. The
    last segments have no stay: they reach to bearings. Then the paving is laid. Without stages the
    whole bridge is stressed at once, and paved. The deck is level in neither case: see
    `design.tune`. The scene is not taken from a publication.

    Args:
        n: number of segments on either side; all but the last have a stay.

    Options:
        stages: whether the bridge is erected by free cantilevering, or stands on falsework until it
            is stressed.
        segment: length of a segment, m.
        height: of the pylon above the deck, m.
        stays: "fan", all from the upper third of the pylon, or "harp", all parallel.
        weight: weight of the deck with its slab, which has no stiffness here, N/m.
        paving: its weight, N/m.

    Returns:
        `Scene` with the groups "pylon", "deck" and "stays". Nodes: the pylon from its foot on
        (`n` + 2 of them, the third at the deck), then the ends of segments, left and right by
        turns.

    Raises:
        ValueError: `n` is less than 3, an unknown arrangement of the stays.

    Example:
        >>> structure, phases = scenes.cable_stayed_bridge(4)
        >>> {kind: len(group.links) for kind, group in structure.elements.items()}
        {'pylon': 5, 'deck': 8, 'stays': 6}
        >>> len(phases)
        5
    """
    if n < 3:
        raise ValueError(f"n = {n}: must be at least 3")
    if stays not in _ANGLES:
        raise ValueError(f"stays = {stays!r}: expected one of {', '.join(_ANGLES)}")
    m = n - 1  # stays on either side
    reach = segment * np.arange(1, n + 1)
    top = height * np.arange(1, m + 1) / m
    if stays == "fan":
        top = (2 * height + top) / 3
    pylon = np.zeros((m + 3, 3))
    pylon[:, 2] = [-20.0, -10.0, 0.0, *top]
    deck = np.zeros((n, 2, 3))
    deck[:, 0, 0], deck[:, 1, 0] = -reach, reach
    nodes = np.concatenate([pylon, deck.reshape(-1, 3)])
    ends = len(pylon) + np.arange(2 * n).reshape(n, 2)  # of the segments, left and right
    before = np.concatenate([np.full((1, 2), 2), ends[:-1]])
    heads = np.repeat(3 + np.arange(m)[:, None], 2, axis=1)
    box, tower = hollow_steel_section(2.0, 1.0, 0.02), hollow_steel_section(2.0, 2.0, 0.04)
    length = np.hypot(reach[:m], top)
    force = segment * weight * length / top  # its vertical part is the weight of a segment
    area = (force + segment * paving * length / top) / STRAND_STRESS
    elements = {
        "pylon": jc.Beams(
            chain_links(range(m + 3)),
            up=(1.0, 0.0, 0.0),
            weight=STEEL_WEIGHT * float(tower["section"].total_area),
            **tower,
        ),
        "deck": jc.Beams(np.stack([before, ends], axis=-1).reshape(-1, 2), weight=weight, **box),
        "stays": jc.Cables(
            np.stack([heads, ends[:m]], axis=-1).reshape(-1, 2),
            axial_stiffness=STRAND * np.repeat(area, 2),
            weight=STEEL_WEIGHT * np.repeat(area, 2),
        ),
    }
    structure = jc.Structure(nodes, elements, supports=jc.clamped([0]))
    laid = downward_loads(ends[:m].ravel(), paving * segment)
    bearings = jc.clamped([0]) + jc.restrained(ends[-1], "yz")
    nothing = {"pylon": None, "deck": None}
    if not stages:
        forces = {**nothing, "stays": np.repeat(force, 2)}
        finished = jc.replace(structure, supports=bearings)
        return two_phase_scene(finished, (1, 1), laid, pretension=forces, loads=jc.SelfWeight())
    phases = []
    for k in range(m):
        pair = [2 * k, 2 * k + 1]
        phases.append(
            jc.Phase(
                adds={"pylon": None, "deck": jc.only(pair), "stays": jc.only(pair)},
                placed="attached",
                jacking={**nothing, "stays": jc.only(pair, force[k])},
                loads=jc.SelfWeight() if k == 0 else None,
            )
        )
    last = {"pylon": None, "deck": jc.only([2 * m, 2 * m + 1]), "stays": None}
    return Scene(structure, [*phases, jc.Phase(adds=last, supports=bearings), jc.Phase(loads=laid)])
