"""Bridges whose decks hang on cables: erected from the middle of their span."""

from __future__ import annotations

import numpy as np

from ..analysis.phases import Phase
from ..common.selection import only
from ..elements import Bars, Beams, Cables
from ..loads import SelfWeight
from ..model.structure import Structure
from ..model.supports import pinned, restrained
from .building_blocks import (
    STEEL,
    STEEL_WEIGHT,
    STRAND,
    STRAND_STRESS,
    Scene,
    chain_links,
    downward_loads,
    hollow_steel_section,
    require_positive,
)

_PIER = 4.0  # height of the deck above the feet of the pylons, m
# Rounds of statics, which correct the weights of cables and hangers. With the default numbers each
# reduces the error by 1e4, and the sixth changes nothing; a lighter deck needs more.
_N_ROUNDS = 50


def suspension_footbridge(
    n: int = 10,
    *,
    stages: bool = True,
    span: float = 60.0,
    sag: float = 6.0,
    dead: float = 4e3,
    planks: float = 1e3,
) -> Scene:
    """Return a suspension footbridge in one plane: cables over two pylons, hangers, a girder.

    The pylons are hinged at their feet; frames beside them keep their tops in the plane. Lengths of
    cables and hangers follow from statics: under the dead load the girder is straight and level. If
    H is the thrust of the cables and `a` the distance of hangers, the load at node k of the cables
    is ``H (z_k - z_{k-1}) / a - H (z_{k+1} - z_k) / a``. For the deck alone, this is the parabola
    with ``H = dead span^2 / (8 sag)``.

    In stages:

    - First the cables hang freely.
    - Segments of the deck are hung from the middle outward, with open joints; the cables change
      their shape at every stage.
    - When all hang, the joints are closed: the girder is unstressed in the shape that it has then.
    - Last the planks are laid; the girder carries a part of them by its bending stiffness.

    Without stages everything is there at once, and the end state is the same. The scene is not
    taken from a publication.

    Args:
        n: number of segments of the deck, even.

    Options:
        stages: whether the bridge is erected in stages; else all of it is there from the start.
        span: distance of the pylons, m; the cables are anchored a third of it behind them.
        sag: sag of the cables, m; the shortest hangers are 1 m long.
        dead: weight of the deck with its girder, N/m.
        planks: weight of the planks, N/m.

    Returns:
        `Scene` with the groups "pylons", "cables", "hangers" and "girder". Order of nodes: both
        anchors, both feet, both tops, the cables, the girder from abutment to abutment.

    Raises:
        ValueError: `n` is odd or less than 4; a size or weight that is not positive.

    Example:
        >>> structure, phases = jc.scenes.suspension_footbridge(6)
        >>> {kind: len(group.links) for kind, group in structure.elements.items()}
        {'pylons': 2, 'cables': 8, 'hangers': 5, 'girder': 6}
        >>> len(phases)
        6
    """
    if n < 4 or n % 2:
        raise ValueError(f"n = {n}: must be even, and at least 4")
    require_positive(span=span, sag=sag, dead=dead, planks=planks)
    x = np.linspace(-span / 2, span / 2, n + 1)
    height, posts, strands, hung = _bridge_heights_and_properties(x, span, sag, dead)
    back = x[-1] + span / 3
    nodes = np.zeros((2 * n + 6, 3))
    nodes[:6, 0] = [-back, back, x[0], x[-1], x[0], x[-1]]
    nodes[2:4, 2], nodes[4:6, 2] = -_PIER, height[[0, -1]]
    on_cable, on_deck = 6 + np.arange(n - 1), 5 + n + np.arange(n + 1)
    nodes[on_cable, 0], nodes[on_cable, 2], nodes[on_deck, 0] = x[1:-1], height[1:-1], x
    hangers = np.column_stack([on_cable, on_deck[1:-1]])
    elements = {
        "pylons": Bars([[2, 4], [3, 5]], **posts),
        "cables": Cables(chain_links([0, 4, *on_cable, 5, 1]), **strands),
        "hangers": Cables(hangers, **hung),
        "girder": Beams(chain_links(on_deck), **hollow_steel_section(0.4, 0.5, 0.01)),
    }
    abutments = restrained(on_deck[:1], "xyz", "x") + restrained(on_deck[-1:], "yz", "x")
    supports = pinned([0, 1, 2, 3]) + restrained([4, 5], "y") + abutments
    structure = Structure(nodes, elements, supports=supports)
    laid = downward_loads(on_deck[1:-1], planks * span / n)
    segment = dead * span / n
    if not stages:
        deck = downward_loads(on_deck[1:-1], segment)
        return Scene(structure, [Phase(loads=[SelfWeight(), deck]), Phase(loads=laid)])
    nothing = {"pylons": None, "cables": None, "girder": None}
    phases, middle = [Phase(loads=SelfWeight())], n // 2
    for k in range(1, middle + 1):  # segments between hangers that are k - 1 and k from the middle
        new = [middle - k, middle + k] if k > 1 else [middle - 1, middle, middle + 1]
        adds = only([j - 1 for j in new]) if k < middle else None  # abutments have no hangers
        ends = [j for s in (-1, 1) for j in (middle + s * (k - 1), middle + s * k) if 0 < j < n]
        at, halves = np.unique(ends, return_counts=True)
        phases.append(
            Phase(
                adds=None if adds is None else {**nothing, "hangers": adds},
                placed="attached",
                loads=downward_loads(on_deck[at], 0.5 * segment * halves),
            )
        )
    return Scene(structure, [*phases, Phase(adds="girder"), Phase(loads=laid)])


def _bridge_heights_and_properties(x, span, sag, dead):
    """Find the shape of the cables, and lengths and stiffness of the elements, by statics.

    Args:
        x: positions of the hangers and the pylons, [n + 1], m.
        span, sag, dead: as for `suspension_footbridge`.

    Returns:
        Heights of the nodes of the cables, [n + 1], m; then for pylons, cables and hangers a dict
            of arguments each: axial stiffness, unstressed length, weight.
    """
    a = x[1] - x[0]
    load = dead * a * np.ones(len(x) - 2)
    for _ in range(_N_ROUNDS):
        # heights for a thrust of 1: second differences are the loads over the thrust
        bent = np.linalg.solve(
            (2 * np.eye(len(load)) - np.eye(len(load), k=1) - np.eye(len(load), k=-1)) / a, load
        )
        thrust = bent.max() / sag
        height = 1.0 + sag - np.concatenate([[0.0], bent, [0.0]]) / thrust
        ends = np.concatenate([[x[0] - span / 3], x, [x[-1] + span / 3]])
        heights = np.concatenate([[0.0], height, [0.0]])
        chord = np.hypot(np.diff(ends), np.diff(heights))
        # the backstays hold the same thrust, as pylons rock
        force = thrust * chord / np.diff(ends)
        area = 1.5 * dead * span**2 / (8 * sag) / STRAND_STRESS
        slack = chord / (1 + force / (STRAND * area))
        thin = dead * a / STRAND_STRESS
        pull = dead * a + 0.5 * STEEL_WEIGHT * thin * height[1:-1]
        short = height[1:-1] / (1 + pull / (STRAND * thin))
        own = STEEL_WEIGHT * area * slack[1:-1]
        load = dead * a + STEEL_WEIGHT * thin * short + 0.5 * (own[:-1] + own[1:])
    steep = np.abs(np.diff(heights) / np.diff(ends))
    post = STEEL * 8e-3
    push = thrust * (steep[0] + steep[1]) + 0.5 * STEEL_WEIGHT * area * (slack[0] + slack[1])
    posts = {
        "axial_stiffness": post,
        "rest_length": (height[0] + _PIER) / (1 - push / post),
    }
    strands = {
        "axial_stiffness": STRAND * area,
        "rest_length": slack,
        "weight": STEEL_WEIGHT * area,
    }
    hung = {"axial_stiffness": STRAND * thin, "rest_length": short, "weight": STEEL_WEIGHT * thin}
    return height, posts, strands, hung
