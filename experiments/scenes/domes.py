"""Cable domes of Geiger's and Levy's kind: vertical struts in a net of cables, with hoops."""

from __future__ import annotations

import numpy as np

import jaxcable as jc
from jaxcable.common import checks
from jaxcable.common.types import ArrayLike, Float
from jaxcable.scenes.building_blocks import (
    Scene,
    chain_links,
    downward_loads,
    points_on_circle,
    require_positive,
    two_phase_scene,
)


def geiger_dome(
    span: float = 60.0,
    rise: float = 4.5,
    *,
    sectors: int = 12,
    rings: int = 2,
    struts: Float[ArrayLike, ""] | Float[ArrayLike, " rings+1"] = 6.0,
    pretension: float = 500e3,
    load: float = 300.0,
    cable_stiffness: float | dict[str, float] = 300e6,
    strut_stiffness: float = 1e9,
    increments: tuple[int, int] = (1, 4),
    staggered: bool = False,
) -> Scene:
    """Cable dome after Geiger: radial ridge and diagonal cables, hoops, struts, in vertical planes.

    The top nodes lie on a sphere through the anchors. From the foot of every strut a diagonal runs
    to the top of the next strut outside, or to an anchor; the feet of a ring are joined by a hoop.
    The strut in the middle is the hub. With two rings or more there is one state of self-stress. It
    stiffens ``6 + 2 sectors (rings - 1)`` mechanisms, in which rings turn and twist. With one ring
    there are ``sectors - 2`` states, one of them equal in all sectors, and ``sectors + 3``
    mechanisms.

    Phase 1 adds a prestress with which the given geometry is in equilibrium (`feasible_prestress`).
    Phase 2 adds a roof load on the plan area around every top node. The load reduces the tension of
    the ridges, which keep the struts upright: with the default numbers the rings twist from about
    410 N/m2 on. The analysis of the perfect dome does not show this twist: beyond this load examine
    the lowest eigenvalue (`stiffness.modes`), or analyse a dome with errors of length.

    Args:
        span: diameter of the circle of anchors, m.
        rise: height of the hub's top over the anchors, m.

    Options:
        sectors: number of anchors and of struts in a ring, at least 3.
        rings: number of rings of struts, evenly between hub and anchors.
        struts: length of all struts, or of the hub and of each ring from the inside, [rings + 1],
            m; the foot of a strut must be below the top of the next ring.
        pretension: of the outermost hoop, N.
        load: per plan area, downward, N/m2.
        cable_stiffness: EA of all cables, N, or a dict with "ridges", "diagonals" and "hoops".
        strut_stiffness: EA, N.
        increments: number of increments of the two phases.
        staggered: whether every ring is turned by half a sector, as in `levy_dome`.

    Returns:
        `Scene` with the groups "ridges", "diagonals", "hoops", "struts".

    Raises:
        ValueError: numbers that give no dome, or no prestress with all cables taut.

    Source: the kind of dome is that of Geiger, Stefaniuk and Chen (1986), the prestress follows
    Yuan and Dong (2003); the numbers are not taken from a publication.

    Example:
        ``6 + 2 sectors (rings - 1)`` mechanisms, stiffened by a single state of self-stress:

        >>> structure, phases = scenes.geiger_dome(sectors=6)
        >>> found = jc.forms.self_stress(structure)
        >>> found.s, found.m
        (1, 18)
    """
    nodes, links, groups, tops, areas = _dome(span, rise, sectors, rings, struts, staggered)
    require_positive(pretension=pretension)
    cables = ("ridges", "diagonals", "hoops")
    if not isinstance(cable_stiffness, dict):
        cable_stiffness = dict.fromkeys(cables, cable_stiffness)
    if set(cable_stiffness) != set(cables):
        raise ValueError(f"cable_stiffness: expected the keys {', '.join(cables)}")
    elements = {k: jc.Cables(links[k], axial_stiffness=cable_stiffness[k]) for k in cables}
    elements["struts"] = jc.Bars(links["struts"], axial_stiffness=strut_stiffness)
    anchors = np.arange(len(nodes) - sectors, len(nodes))
    structure = jc.Structure(nodes, elements, supports=jc.pinned(anchors))
    outermost = int(groups["hoops"].max())
    prestress = jc.forms.feasible_prestress(structure, groups, group=outermost, tension=pretension)
    roof = downward_loads(tops, load * areas)
    return two_phase_scene(structure, increments, roof, pretension=prestress.tension)


def levy_dome(span: float = 60.0, rise: float = 4.5, **options) -> Scene:
    """Cable dome after Levy: as `geiger_dome`, but triangulated.

    Every ring is turned by half a sector relative to its neighbours. Two ridges and two diagonals
    run from every strut to the two nearest struts, or anchors, outside. In proportions like the
    default ones there are no mechanisms and ``2 sectors - 5`` states of self-stress; the phases use
    the state that has the full symmetry.

    Arguments, options, errors and phases are those of `geiger_dome`.

    Source: the kind of dome is that of Levy (1994); the numbers are not taken from a publication.

    Example:
        ``2 sectors - 5`` states of self-stress and no mechanism:

        >>> structure, phases = scenes.levy_dome(sectors=6)
        >>> found = jc.forms.self_stress(structure)
        >>> found.s, found.m
        (7, 0)
    """
    return geiger_dome(span, rise, staggered=True, **options)


def _dome(span, rise, sectors, rings, struts, staggered):
    """Geometry and topology of a dome of either kind.

    Returns:
        nodes: top and bottom of the hub; then, for each ring from the inside, the tops of its
            struts and their bottoms; finally the anchors, [n_node, 3], m.
        links: by kind, "ridges", "diagonals", "hoops", "struts", each [n_elem, 2].
        groups: by kind, the number of the group of equal tension of every element, each [n_elem].
        tops: numbers of the hub's top and of the top nodes of the rings, [1 + n_ring sectors].
        areas: roof area in plan carried by each of these nodes, m2.
    """
    checks.require_whole_number(sectors, "sectors", least=3)
    checks.require_whole_number(rings, "rings")
    require_positive(span=span, rise=rise)
    radius = 0.5 * span * np.arange(rings + 2) / (rings + 1)  # hub, rings, anchors
    sphere = (radius[-1] ** 2 + rise**2) / (2 * rise)
    top = np.sqrt(sphere**2 - radius**2) - (sphere - rise)
    top[-1] = 0.0
    if np.shape(struts) not in ((), (rings + 1,)):
        raise ValueError(
            f"struts: expected a length or [{rings + 1}], hub and rings, got {np.shape(struts)}"
        )
    bottom = top[:-1] - struts
    low = bottom < top[1:]
    if not low.all():
        k = int(np.flatnonzero(~low)[0])
        raise ValueError(
            f"struts[{k}]: its foot, at {bottom[k]:.3g} m, must be below the top of the next ring, "
            f"at {top[k + 1]:.3g} m"
        )

    n = sectors
    nodes = [np.array([[0.0, 0.0, top[0]], [0.0, 0.0, bottom[0]]])]
    for ring in range(1, rings + 2):
        angle = 2 * np.pi * (np.arange(n) + (0.5 * (ring % 2) if staggered else 0.0)) / n
        heights = top[ring], *bottom[ring : ring + 1]  # anchors have no bottom
        nodes += [points_on_circle(radius[ring], angle, z) for z in heights]
    nodes = np.concatenate(nodes)

    def at(ring, foot):
        """Numbers of a ring's tops or feet, [n]."""
        return np.full(n, foot) if ring == 0 else 2 + (2 * (ring - 1) + foot) * n + np.arange(n)

    def outward(foot):
        """Links from every ring's tops or feet to the tops of the next ring, a list by ring."""
        links_by_ring = []
        for ring in range(rings + 1):
            inside, outside = at(ring, foot), at(ring + 1, 0)
            pairs = [np.column_stack([inside, outside])]
            if staggered and ring > 0:  # turned by half a sector, forward or back
                other = np.roll(outside, 1 if ring % 2 == 0 else -1)
                pairs.append(np.column_stack([inside, other]))
            links_by_ring.append(np.concatenate(pairs))
        return links_by_ring

    kinds = {
        "ridges": outward(0),
        "diagonals": outward(1),
        "hoops": [chain_links(at(r, 1), closed=True) for r in range(1, rings + 1)],
        "struts": [np.array([[0, 1]])]
        + [np.column_stack([at(r, 0), at(r, 1)]) for r in range(1, rings + 1)],
    }
    groups, count = {}, 0
    for kind, links_by_ring in kinds.items():
        groups[kind] = np.repeat(
            count + np.arange(len(links_by_ring)), [len(links) for links in links_by_ring]
        )
        count += len(links_by_ring)
    border = np.concatenate([[0.0], 0.5 * (radius[1:-1] + radius[:-2]), [radius[-2:].mean()]])
    share = np.pi * np.diff(border**2)
    return (
        nodes,
        {kind: np.concatenate(links_by_ring) for kind, links_by_ring in kinds.items()},
        groups,
        np.concatenate([[0], *(at(r, 0) for r in range(1, rings + 1))]),
        np.concatenate([share[:1], np.repeat(share[1:] / n, n)]),
    )
