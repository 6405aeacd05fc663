"""Cables with friction: tendon, stay over a saddle, tackle, hoop of a dome, ropeway."""

from __future__ import annotations

import numpy as np

import jaxcable as jc
from jaxcable.common import checks
from jaxcable.scenes.building_blocks import Scene, chain_links, require_positive

from .domes import levy_dome


def post_tensioned_beam(
    span: float = 30.0,
    drape: float = 0.8,
    *,
    n: int = 20,
    force: float = 3e6,
    friction: float = 0.19,
    wobble: float = 0.001,
    draw_in: float = 0.006,
    axial_stiffness: float = 3e8,
    width: float = 0.5,
    depth: float = 2.0,
    modulus: float = 34e9,
) -> Scene:
    """Concrete beam with a tendon in a parabolic duct, which is stressed from its first end.

    The nodes 0 to n of the axis are followed by those of the duct between the ends, each joined to
    the axis by a rigid link. Phase 1 jacks the tendon, with the weight of the beam; phase 2 locks
    it off; in phase 3 the wedges of the anchor draw in. The scene is not taken from a publication.

    Args:
        span: m.
        drape: of the parabola at midspan, below the axis, m.

    Options:
        n: number of elements of the beam, and of segments of the tendon, at least 2.
        force: of the jack, N.
        friction: coefficient of friction in the duct, without unit.
        wobble: friction of unintended angles, 1/m.
        draw_in: by how much the wedges slip into the anchor, m.
        axial_stiffness: EA of the tendon, N.
        width, depth: of the beam, m.
        modulus: of elasticity of the concrete, N/m2.

    Returns:
        `Scene` with the groups "beam" and "tendon".

    Raises:
        ValueError: `n` below 2, or a size that is not positive.

    Source: losses by friction as in EN 1992-1-1, 5.10.5.2: ``exp(-(mu theta + w x))``.

    Example:
        >>> structure, phases = scenes.post_tensioned_beam(n=4)
        >>> print(structure.elements["tendon"].links.array, len(phases))
        [[0 5 6 7 4]] 3
    """
    checks.require_whole_number(n, "n", least=2)
    require_positive(span=span, drape=drape, force=force, draw_in=draw_in)
    x = np.linspace(0.0, span, n + 1)
    axis = np.stack([x, 0 * x, 0 * x], axis=1)
    duct = axis[1:-1] - np.outer(4 * drape * x[1:-1] / span * (1 - x[1:-1] / span), [0, 0, 1.0])
    ducts = n + np.arange(1, n)
    tendon = jc.FrictionCables(
        links=[[0, *ducts, n]],
        axial_stiffness=axial_stiffness,
        friction=friction,
        wobble=wobble,
    )
    section = jc.Section.rectangle(width, depth, jc.Elastic(modulus))
    beam = jc.Beams(chain_links(range(n + 1)), section, up=(0, 0, 1.0), weight=25e3 * width * depth)
    supports = jc.restrained([0], "xyz", "x") + jc.restrained([n], "yz", "x")
    rigid = np.stack([np.arange(1, n), ducts], axis=1)
    structure = jc.Structure(
        np.concatenate([axis, duct]), {"beam": beam, "tendon": tendon}, supports, rigid=rigid
    )
    phases = [
        jc.Phase(jacking={"tendon": force}, loads=jc.SelfWeight()),
        jc.Phase(),
        jc.Phase(shortening={"tendon": -draw_in}),
    ]
    return Scene(structure, phases)


def saddle_stay(
    height: float = 6.0,
    *,
    friction: float = 0.15,
    pretension: float = 20e3,
    load: float = 6e3,
    axial_stiffness: float = 2e6,
    saddle_stiffness: float = 1e6,
    clamped: bool = False,
    increments: int = 5,
) -> Scene:
    """Stay over a saddle on a mast: a load that hangs on one side slips it over, and is taken away.

    The stay runs from an anchor over the saddle, node 1, which springs hold along its span, to
    another anchor; the load hangs at node 2, where a clip holds the stay. Phase 1 adds pretension,
    phase 2 the load, phase 3 takes it away. The scene is not taken from a publication.

    Args:
        height: of the saddle above the anchors, m.

    Options:
        friction: coefficient of friction on the saddle, without unit.
        pretension: N.
        load: downward, N.
        axial_stiffness: EA of the stay, N.
        saddle_stiffness: of the saddle along the span and across, N/m.
        clamped: whether the stay is clamped to the saddle, too.
        increments: number of increments of the phases 2 and 3.

    Returns:
        `Scene` with the groups "stay" and "saddle".

    Raises:
        ValueError: a size that is not positive.

    Source: Euler (1769) for the ratio of tensions at the saddle.

    Example:
        >>> structure, phases = scenes.saddle_stay()
        >>> print(phases[0].clamped["stay"])  # at the saddle, and at the clip
        [[0. 1.]]
    """
    require_positive(height=height, pretension=pretension, load=load)
    nodes = [[-8.0, 0.0, 0.0], [0.0, 0.0, height], [5.0, 0.0, 0.5 * height], [10.0, 0.0, 0.0]]
    stay = jc.FrictionCables(
        links=[[0, 1, 2, 3]], axial_stiffness=axial_stiffness, friction=friction
    )
    saddle = jc.Springs([1], (saddle_stiffness, saddle_stiffness, 1e8))
    supports = jc.pinned([0, 3]) + jc.restrained([2], "y")
    structure = jc.Structure(nodes, {"stay": stay, "saddle": saddle}, supports)
    clamps = np.array([[float(clamped), 1.0]])
    on, off = (jc.NodalLoads([2], (0.0, 0.0, force)) for force in (-load, load))
    phases = [
        jc.Phase(pretension={"stay": pretension}, clamped={"stay": clamps}),
        jc.Phase(loads=on, increments=increments),
        jc.Phase(loads=off, increments=increments),
    ]
    return Scene(structure, phases)


def block_and_tackle(
    load: float = 3e3,
    axle_friction: float = 0.05,
    *,
    depth: float = 4.0,
    raised: float = 0.6,
    axial_stiffness: float = 2e5,
    increments: int = 6,
) -> Scene:
    """Tackle of three parts: a load is lifted and lowered by a rope over pulleys with friction.

    The rope runs from its hand end, node 0, over a pulley of the fixed upper block, node 1, around
    the pulley of the lower block, node 2, over another pulley of the upper block, and is tied to
    the lower block, from which the load hangs; all parts are upright. Phase 1 hangs the load on it,
    phase 2 pulls the hand end down by three times the way of the load, phase 3 lets it up again.

    With ``r = (1 + k) / (1 - k)`` for a pulley around which the rope turns by 180 degrees the hand
    has ``load r^3 / (1 + r + r^2)`` while it lifts, and the same with 1 / r while it lowers.

    Args:
        load: N.
        axle_friction: friction coefficient of the axles times their radius over that of the
            pulleys, k, without unit.

    Options:
        depth: of the lower block below the upper one, m.
        raised: by how much the load is lifted, m.
        axial_stiffness: EA of the rope, N.
        increments: number of increments of the phases 2 and 3.

    Returns:
        `Scene` with the group "rope".

    Raises:
        ValueError: a size that is not positive.

    Source: balance of moments about each axle.

    Example:
        >>> structure, phases = scenes.block_and_tackle()
        >>> print(structure.elements["rope"].links.array)
        [[0 1 2 1 2]]
    """
    require_positive(load=load, depth=depth, raised=raised)
    nodes = [[0.0, 0.0, -0.5 * depth], [0.0, 0.0, 0.0], [0.0, 0.0, -depth]]
    rope = jc.FrictionCables(
        links=[[0, 1, 2, 1, 2]], axial_stiffness=axial_stiffness, axle_friction=axle_friction
    )
    structure = jc.Structure(
        nodes, {"rope": rope}, supports=jc.pinned([0, 1]) + jc.restrained([2], "xy")
    )
    lift, lower = (jc.SupportMovement([0], (0.0, 0.0, way)) for way in (-3 * raised, 3 * raised))
    phases = [
        jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -load))),
        jc.Phase(loads=lift, increments=increments),
        jc.Phase(loads=lower, increments=increments),
    ]
    return Scene(structure, phases)


def dome_hoop(
    sectors: int = 8,
    *,
    friction: float = 0.1,
    load: float = 300.0,
    clamped: bool = True,
    increments: int = 3,
) -> Scene:
    """Levy dome whose hoop is one rope through the feet of the struts, under snow on one half.

    The dome is `levy_dome` with one ring. Phase 1 adds its prestress: the rope has one tension.
    Phase 2 closes the clamps at the struts, and adds the roof load where x is positive.

    Args:
        sectors: number of anchors and of struts in the ring, at least 3.

    Options:
        friction: coefficient of friction in the feet of the struts, without unit.
        load: per plan area, downward, N/m2.
        clamped: whether phase 2 closes the clamps; otherwise the rope can slip.
        increments: number of increments of phase 2.

    Returns:
        `Scene` with the groups "ridges", "diagonals", "hoop", "struts".

    Raises:
        ValueError: as of `levy_dome`.

    Example:
        >>> structure, phases = scenes.dome_hoop(sectors=4)
        >>> print(structure.elements["hoop"].links.array)
        [[6 7 8 9 6]]
    """
    dome, (prestress, loading) = levy_dome(sectors=sectors, rings=1, load=load)
    elements = dict(dome.elements)
    hoops = elements.pop("hoops")
    ring = [*hoops.links[:, 0], hoops.links[0, 0]]
    elements["hoop"] = jc.FrictionCables(
        links=[ring], axial_stiffness=float(hoops.axial_stiffness[0]), friction=friction
    )
    tension = dict(prestress.pretension)
    tension["hoop"] = tension.pop("hoops")[:1]
    snow = loading.loads
    there = np.asarray(dome.nodes)[snow.nodes.array, 0] > 0
    snow = jc.NodalLoads(snow.nodes.array, np.where(there[:, None], snow.forces, 0.0))
    structure = jc.Structure(dome.nodes, elements, dome.supports)
    phases = [
        jc.Phase(pretension=tension),
        jc.Phase(loads=snow, increments=increments, clamped={"hoop": 1.0} if clamped else None),
    ]
    return Scene(structure, phases)


def ropeway(
    span: float = 400.0,
    rise: float = 60.0,
    *,
    tension: float = 300e3,
    load: float = 25e3,
    weight: float = 60.0,
    axial_stiffness: float = 80e6,
    friction: float = 0.08,
    rides: int = 2,
    increments: int = 1,
) -> Scene:
    """Track rope of a ropeway over saddles on two towers, on which a cabin moves up.

    The rope, hanging catenaries in one cable, runs from an anchor (node 0) over the towers (nodes 1
    and 3) to another anchor (node 4). The cabin is node 2, over which the rope slides without
    friction; it is free in z. Phase 1 hangs up the rope, phase 2 adds the cabin near tower 1, the
    others move it, at the end to 40 m before tower 3. The scene is not taken from a publication.

    Args:
        span: between the towers, m, above 100.
        rise: from the first tower to the second one, m.

    Options:
        tension: of the rope in straight lines, from which its unstressed length follows, N.
        load: weight of the cabin, N.
        weight: of the rope, N/m.
        axial_stiffness: EA of the rope, N.
        friction: coefficient of friction in the saddles, without unit.
        rides: number of phases that move the cabin by equal distances.
        increments: of each of them.

    Returns:
        `Scene` with the group "rope".

    Raises:
        ValueError: a size that is not positive, or a `span` of at most 100 m.

    Source: catenaries as of `Catenaries`; Euler (1769) for the ratio of tensions at the saddles.

    Example:
        >>> structure, phases = scenes.ropeway(rides=3)
        >>> print(structure.elements["rope"].links.array, len(phases))
        [[0 1 2 3 4]] 5
    """
    require_positive(span=span - 100.0, tension=tension, load=load)
    tower, start, end = np.array([50.0, 0.0, 30.0]), 30.0, span - 40.0
    top = tower + np.array([span, 0.0, rise])
    chord = (top - tower) / span  # per meter of x
    anchor = top + np.array([70.0, 0.0, -20.0])
    nodes = [np.zeros(3), tower, tower + start * chord, top, anchor]
    rope = jc.SlidingCatenaries(
        links=[[0, 1, 2, 3, 4]],
        axial_stiffness=axial_stiffness,
        weight=weight,
        friction=[[friction, 0.0, friction]],
    )
    supports = jc.pinned([0, 1, 3, 4]) + jc.restrained([2], "xy")
    move = jc.SupportMovement([2], ((end - start) / rides, 0.0, 0.0))
    phases = [
        jc.Phase(pretension=tension, loads=jc.SelfWeight()),
        jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -load))),
        *rides * [jc.Phase(loads=move, increments=increments)],
    ]
    return Scene(jc.Structure(nodes, {"rope": rope}, supports), phases)
