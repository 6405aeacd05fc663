"""Spoked-wheel roofs: spokes between compression rings and a tension ring, lifted into place."""

from __future__ import annotations

import numpy as np

from ..analysis.phases import Phase
from ..common import checks
from ..common.tree import replace
from ..elements import Bars, Cables
from ..loads import SelfWeight
from ..model.structure import Structure
from ..model.supports import restrained
from .building_blocks import (
    STEEL,
    STEEL_WEIGHT,
    STRAND,
    STRAND_STRESS,
    Scene,
    chain_links,
    downward_loads,
    points_on_circle,
    require_positive,
)


def roof_ring(
    n: int = 24,
    *,
    stages: bool = True,
    lifts: int = 4,
    drop: float = 12.0,
    radius: float = 60.0,
    hub: float = 20.0,
    height: float = 8.0,
    pretension: float = 1e6,
    load: float = 500.0,
) -> Scene:
    """Return the roof of a stadium as a spoked wheel: two compression rings and a tension ring.

    The compression rings stand above each other on columns, with bearings that slide radially.
    Unstressed lengths are such that the wheel has the drawn shape under its own weight W, with the
    force `pretension` in the lower spokes: at a node of the tension ring
    ``T_upper sin a = T_lower sin a + W`` and ``(T_upper + T_lower) cos a = 2 T_ring sin(pi / n)``.

    In stages:

    - The tension ring hangs `drop` below its place, on upper spokes that are lengthened by strands.
    - Jacks shorten the strands in equal stages, which lifts the ring.
    - The lower spokes are added, unstressed where their ends are, and pulled to their lengths: this
      stresses the wheel. Until then the bearings of the lower ring are locked.
    - Last the load acts.

    Without stages the wheel is stressed in its drawn shape; the end state is the same. The scene is
    not taken from a publication.

    Args:
        n: number of upper spokes, and of lower ones.

    Options:
        stages: whether the wheel is lifted in stages; else all of it is there from the start.
        lifts: number of stages in which it is lifted.
        drop: height by which the tension ring is lifted, m.
        radius, hub: radii of the compression rings and of the tension ring, m.
        height: height between the compression rings, m.
        pretension: force in the lower spokes under own weight, N.
        load: load on the roof between the rings, N/m2; half of it acts on the tension ring.

    Returns:
        `Scene` with the groups "rings" (in compression), "hub" (in tension), "upper" and "lower"
        (spokes). Order of nodes: upper ring, lower ring, tension ring, [n] each.

    Raises:
        ValueError: fewer than 3 spokes, no lift, a size that is not positive, a hub that is not
            smaller than the rings.

    Example:
        >>> structure, phases = jc.scenes.roof_ring(12)
        >>> {kind: len(group.links) for kind, group in structure.elements.items()}
        {'rings': 24, 'hub': 12, 'upper': 12, 'lower': 12}
        >>> len(phases)
        8
    """
    checks.require_whole_number(n, "n", least=3)
    checks.require_whole_number(lifts, "lifts")
    require_positive(drop=drop, radius=radius, hub=hub, height=height, pretension=pretension)
    if not hub < radius:
        raise ValueError(f"hub = {hub}: must be less than the radius of the rings, {radius} m")
    angle = 2 * np.pi * np.arange(n) / n
    rings = (radius, 0.5 * height), (radius, -0.5 * height), (hub, 0.0)
    nodes = np.concatenate([points_on_circle(r, angle, z) for r, z in rings])
    number = np.arange(n)
    upper, lower, inner = number, n + number, 2 * n + number
    parts, short = _wheel_element_properties(n, radius, hub, height, pretension)
    compressed = np.concatenate([chain_links(upper, closed=True), chain_links(lower, closed=True)])
    elements = {
        "rings": Bars(compressed, **parts["rings"]),
        "hub": Cables(chain_links(inner, closed=True), **parts["hub"]),
        "upper": Cables(np.column_stack([inner, upper]), **parts["upper"]),
        "lower": Cables(np.column_stack([inner, lower]), **parts["lower"]),
    }
    outward, up = points_on_circle(1.0, angle, 0.0), np.array([0.0, 0.0, 1.0])
    axes = np.stack([outward, np.cross(up, outward), np.broadcast_to(up, outward.shape)], axis=1)
    bearings = restrained(np.concatenate([upper, lower]), "yz", axes=np.concatenate([axes, axes]))
    structure = Structure(nodes, elements, supports=bearings)
    nothing = dict.fromkeys(elements)
    pulled = {**nothing, "lower": short["lower"]}
    share = 0.5 * load * np.pi * (radius**2 - hub**2) / n
    roof = Phase(loads=downward_loads(inner, share))
    if not stages:
        return Scene(structure, [Phase(rest_length=pulled, loads=SelfWeight()), roof])
    strand = np.hypot(radius - hub, 0.5 * height + drop) - np.hypot(radius - hub, 0.5 * height)
    hanging = Phase(rest_length={**nothing, "upper": short["upper"] + strand}, loads=SelfWeight())
    lift = Phase(shortening={**nothing, "upper": strand / lifts})
    # a ring of straight pieces that nothing holds inward or outward is a mechanism
    locked = restrained(upper, "yz", axes=axes) + restrained(lower, "xyz", axes=axes)
    joined = [Phase(adds="lower"), Phase(rest_length=pulled, supports=bearings)]
    structure = replace(structure, supports=locked)
    return Scene(structure, [hanging, *[lift] * lifts, *joined, roof])


def _wheel_element_properties(n, radius, hub, height, pretension):
    """Find stiffness and lengths of a wheel in equilibrium under own weight, by statics.

    Returns:
        For each group by name a dict of arguments (axial stiffness, unstressed length, weight); and
            the unstressed lengths of all groups by name, m.
    """
    spoke = np.hypot(radius - hub, 0.5 * height)
    sine, cosine = 0.5 * height / spoke, (radius - hub) / spoke
    chords = 2 * np.sin(np.pi / n) * np.array([radius, hub])
    fan = 2 * np.sin(np.pi / n)  # of two segments of a ring, radially
    area = {"upper": 2 * pretension / STRAND_STRESS, "lower": 2 * pretension / STRAND_STRESS}
    area["hub"] = 4 * pretension * cosine / fan / STRAND_STRESS
    area["rings"] = 2 * pretension / fan / 150e6
    weight = {name: STEEL_WEIGHT * value for name, value in area.items()}
    length = {"upper": spoke, "lower": spoke, "hub": chords[1], "rings": chords[0]}
    short = dict(length)
    # Weights are those of unstressed lengths. With the default numbers each round reduces the error
    # by more than 1e3, and the fifth changes nothing; softer cables need more.
    for _ in range(20):
        own = 0.5 * (weight["upper"] * short["upper"] + weight["lower"] * short["lower"])
        above = pretension + (own + weight["hub"] * short["hub"]) / sine
        force = {"lower": pretension, "upper": above, "hub": (pretension + above) * cosine / fan}
        for name, pull in force.items():
            short[name] = length[name] / (1 + pull / (STRAND * area[name]))
    # each compression ring carries the forces of its own spokes
    push = np.repeat([above * cosine / fan, pretension * cosine / fan], n)
    short["rings"] = chords[0] / (1 - push / (STEEL * area["rings"]))
    modulus = {"rings": STEEL}
    return {
        name: {
            "axial_stiffness": modulus.get(name, STRAND) * area[name],
            "rest_length": None if name == "lower" else short[name],  # joined unstressed
            "weight": weight[name],
        }
        for name in area
    }, short
