"""Faces of a net as seen in plan: its meshes, and the faces between free ends at its border."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..common import checks
from ..common.types import ArrayLike, Float, Int
from ..sections.outlines import points_inside, signed_area

BORDERS = (None, "ends", "links")
CORNER_ANGLE = 45.0
"""Angle, degrees, from which on a turn of the border from link to link is a corner."""

_ZERO_AREA = 1e-12
"""Largest area, relative to the square of the net's size, of faces that count as lines."""


def net_faces(
    nodes: Float[ArrayLike, "n_node 3"],
    links: Int[ArrayLike, "n_elem 2"],
    largest: int = 4,
    border: str | None = None,
) -> Int[np.ndarray, "n_face 4"]:
    """Find the faces of a net in plan: its meshes, and those between free ends at its border.

    Give the links of the net alone: nodes that none of them touches, such as feet of masts and
    anchors of stays, are left out. The meshes are those of the planar graph of the links in the x-y
    plane. Nodes are in anticlockwise order, so that normals point up. Meshes with more than four
    corners, and meshes that are not convex, are split into triangles.

    Where links close the border, no face lies outside of them, whether the border is convex or not.
    A net without edge cables has free ends instead: nodes with a single link. Corners of its border
    are the free ends, and the nodes at which the way around the net turns by 45 degrees or more, in
    the sense of a convex polygon. Between a free end and the next corner, the border is the convex
    hull of the nodes on that way, mostly a straight line. But if that way is a single cable, which
    nowhere turns by 45 degrees or more, it is an edge cable and itself the border. Between corners
    that are no free ends, the links are the border. A single free end has no partner and changes
    nothing. If several parts of a net that no link joins, such as cables side by side, have free
    ends, the border is the convex hull of all these parts.

    Args:
        nodes: [n_node, 3], m.
        links: of a two-way net whose links do not cross in plan, [n_elem, 2].
        largest: number of corners up to which a mesh is one face, 3 or 4.
        border: "links" for the meshes of links alone, "ends" for free ends as above; None is
            "ends" with a warning if faces lie outside of all links.

    Returns:
        [n_face, 4] node numbers, with the last node of triangles repeated; for `AreaLoads` and
        `FacePressure`.

    Raises:
        ValueError: wrong links, two linked nodes at one place in plan (a vertical mast: give the
            links of the net alone), links or lines between free ends that cross, a part of the net
            inside a mesh of another part, an unknown `border`, another `largest`, no face at all.

    Warns:
        InputWarning: `border` is not given, and there is area outside of all links.

    Example:
        Three by three cells without corner nodes and edge cables: five quadrilaterals, four of
        them between free ends, and four triangles, all between free ends.

        >>> structure, _ = jc.scenes.flat_net()
        >>> faces = jc.net_faces(structure.nodes, structure.elements.links, border="ends")
        >>> faces.shape, int((faces[:, 2] == faces[:, 3]).sum())
        ((9, 4), 4)
        >>> jc.net_faces(structure.nodes, structure.elements.links, border="links").shape
        (1, 4)

        Of a structure with masts and stays, the groups of the net and its edges:

        >>> nodes = [[0.0, 0, 3], [2, 0, 3], [2, 2, 3], [0, 2, 3], [0, 0, 0], [-2, -2, 0]]
        >>> elements = {
        ...     "EDGE": jc.Cables([[0, 1], [1, 2], [2, 3], [3, 0]], 1e6),
        ...     "MAST": jc.Bars([[4, 0]], 1e8),
        ...     "STAY": jc.Cables([[0, 5]], 1e6),
        ... }
        >>> links = np.concatenate([elements[name].links for name in ("EDGE",)])
        >>> jc.net_faces(nodes, links).tolist()
        [[0, 1, 2, 3]]
    """
    if border not in BORDERS:
        raise ValueError(f"border = {border!r}: expected None, 'ends' or 'links'")
    if largest not in (3, 4):
        raise ValueError(f"largest = {largest!r}: expected 3 or 4 corners")
    plan = np.asarray(nodes, float)[:, :2]
    links = checks.as_indices(links, "links", width=2)
    if links.size and links.max() >= len(plan):
        k = int((links >= len(plan)).any(axis=1).argmax())
        raise ValueError(f"links[{k}] = {links[k].tolist()}: there are nodes 0 to {len(plan) - 1}")
    edges = {tuple(sorted(link)) for link in links.tolist()}
    nothing = _ZERO_AREA * np.ptp(plan[np.unique(links)], axis=0).max(initial=0.0) ** 2
    rings = _trace_rings(plan, edges)
    _require_planar(plan, edges, rings, nothing)
    if border != "links":
        lines = _find_border_lines(
            plan, edges, [r for r in rings if signed_area(plan[r]) <= nothing]
        )
        if lines:
            _require_uncrossed_border_lines(plan, lines, edges)
            closed, rings = rings, _trace_rings(plan, edges | lines)
            if border is None:
                _warn_of_open_border(plan, lines, closed, rings, nothing)
    faces = []
    for ring in rings:
        if signed_area(plan[ring]) <= nothing:
            continue  # the outside of the net, or a line
        ring = _remove_spurs(ring)
        if not _is_convex_ring(plan[ring]):
            faces += _triangulate(plan, ring)
        elif len(ring) <= largest:
            faces.append([*ring, ring[-1]][:4])
        else:
            faces += [[ring[0], b, c, c] for b, c in itertools.pairwise(ring[1:])]
    if not faces:
        raise ValueError("links: they enclose no mesh in plan")
    return np.array(faces)


def _trace_rings(plan, edges):
    """Return the rings of a planar graph, lists of nodes: around each mesh and each connected part.

    Those around meshes are anticlockwise, those around parts clockwise. `plan` are nodes in plan,
    [n_node, 2], `edges` a set of pairs of linked nodes.
    """
    spokes = [[] for _ in plan]
    for i, j in edges:
        spokes[i].append(j)
        spokes[j].append(i)
    following = {}
    for i, others in enumerate(spokes):
        if not others:
            continue
        directions = plan[others] - plan[i]
        if (directions == 0).all(axis=1).any():
            raise ValueError(
                f"nodes[{i}]: a node that is linked to it has the same place in plan; give the "
                "links of the net alone, without vertical masts"
            )
        order = np.argsort(np.arctan2(directions[:, 1], directions[:, 0]))
        around = [others[k] for k in order]
        for before, after in zip(around, [*around[1:], around[0]], strict=True):
            following[after, i] = before  # arriving from `after`, go on to the next on the right
    rings, left = [], set(following)
    for edge in sorted(following):
        ring = []
        while edge in left:
            left.remove(edge)
            ring.append(edge[0])
            edge = edge[1], following[edge]
        if ring:
            rings.append(ring)
    return rings


def _require_planar(plan, edges, rings, nothing):
    """Raise ValueError if links cross, or a part of the net lies within a mesh of another part.

    `plan` are nodes in plan, [n_node, 2], `edges` pairs of linked nodes, `rings` are those of
    `_trace_rings`, `nothing` is the area, m2, below which a ring is a line.
    """
    ends = np.array(sorted(edges)).T
    graph = coo_array((np.ones(len(edges)), ends), shape=(len(plan), len(plan)))
    count, part = connected_components(graph, directed=False)
    # Euler's formula: the number of rings if no links cross, one around each part included
    alone = len(plan) - len(np.unique(ends))  # nodes without links, each a part by itself
    if len(rings) != len(edges) - (len(plan) - alone) + 2 * (count - alone):
        raise ValueError("links: some cross in plan; put a node where they cross")
    meshes = [ring for ring in rings if signed_area(plan[ring]) > nothing]
    covering = np.isin(part, [part[ring[0]] for ring in meshes])
    for ring in meshes if count > 1 else ():
        others = np.flatnonzero(covering & (part != part[ring[0]]))
        within = others[points_inside(plan[others], plan[ring])]
        if len(within):
            raise ValueError(
                f"links: the part of the net with node {within[0]} lies inside a mesh of another "
                f"part, that with node {ring[0]}; join them with a link"
            )


def _remove_spurs(ring):
    """Return the node numbers of a ring without dead ends: links that it passes to and fro."""
    k = 0
    while k < len(ring) and len(ring) > 3:
        if ring[k - 1] == ring[(k + 1) % len(ring)]:
            ring = [node for j, node in enumerate(ring) if j not in (k, (k + 1) % len(ring))]
            k = 0
        else:
            k += 1
    return ring


def _signed_corner_areas(places):
    """Return twice the area of the triangle of each corner of a ring and its neighbours, [n].

    Positive where the ring turns to the left. `places` are its nodes in plan, [n, 2].
    """
    a, b = places - np.roll(places, 1, axis=0), np.roll(places, -1, axis=0) - places
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _is_convex_ring(places):
    """Return whether an anticlockwise ring, nodes in plan [n, 2], is convex."""
    return bool((_signed_corner_areas(places) >= -1e-9 * np.ptp(places, axis=0).max() ** 2).all())


def _triangulate(plan, ring):
    """Split an anticlockwise ring of nodes, convex or not, into triangles by ear clipping.

    Returns a list of faces [a, b, c, c] of node numbers, as those of `net_faces`. `plan` has the
    positions of all nodes, [n_node, 2]. Raises ValueError for a ring that crosses itself.
    """
    ring, faces = list(ring), []
    while len(ring) > 3:
        turns = _signed_corner_areas(plan[ring])
        best, cut = 0.0, None
        for k in range(len(ring)):
            a, b, c = ring[k - 1], ring[k], ring[(k + 1) % len(ring)]
            rest = plan[[node for node in ring if node not in (a, b, c)]]
            sides = [_signed_areas(plan[i], plan[j], rest) for i, j in ((a, b), (b, c), (c, a))]
            holds_others = (np.stack(sides) >= 0).all(axis=0).any()
            if turns[k] > best and not holds_others:
                best, cut = turns[k], k
        if cut is None:
            raise ValueError(f"links: the mesh of nodes {ring} crosses itself in plan")
        faces.append([ring[cut - 1], ring[cut], *[ring[(cut + 1) % len(ring)]] * 2])
        del ring[cut]
    return [*faces, [*ring, ring[-1]]]


def _signed_areas(a, b, places):
    """Return twice the areas of triangles (a, b, places [n, 2]), [n]; positive left of a to b."""
    return (b[..., 0] - a[..., 0]) * (places[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (
        places[..., 0] - a[..., 0]
    )


def _find_border_lines(plan, edges, outsides):
    """Return the lines that close the border between free ends: a set of sorted pairs of nodes.

    Links among these lines are left out. `edges` is the set of links; `outsides` has the ring
    around each connected part, clockwise; `plan` the positions of all nodes, [n_node, 2].
    """
    count = np.bincount(np.array(sorted(edges)).ravel(), minlength=len(plan))
    open_ = [ring for ring in outsides if (count[ring] == 1).sum() > 1]
    if len(open_) > 1:
        return (
            _successive_pairs(_convex_hull(plan, sorted({node for ring in open_ for node in ring})))
            - edges
        )
    lines = set()
    for ring in open_:
        start = int(np.argmax(count[ring] == 1))
        ring = [*ring[start:], *ring[:start]]
        free = count[ring] == 1
        stops = [*np.flatnonzero(free | _is_corner(plan[ring])), len(ring)]
        ring.append(ring[0])
        for first, last in itertools.pairwise(stops):
            way = ring[first : last + 1]
            if (count[[way[0], way[-1]]] == 1).any() and not _is_single_cable(plan[way]):
                lines |= _successive_pairs(_hull_of_path(plan, way))
    return lines - edges


def _successive_pairs(way):
    """Return the set of sorted pairs of successive nodes of a path, a list of node numbers."""
    return {tuple(sorted(pair)) for pair in itertools.pairwise(way)}


def _is_corner(places):
    """Return which nodes of a clockwise ring are corners, [n] bool; `places` in plan [n, 2].

    A corner turns to the right by `CORNER_ANGLE` or more.
    """
    a, b = places - np.roll(places, 1, axis=0), np.roll(places, -1, axis=0) - places
    return np.arctan2(_signed_corner_areas(places), np.sum(a * b, axis=1)) <= -np.radians(
        CORNER_ANGLE
    ) * (1 - 1e-9)


def _is_single_cable(places):
    """Return whether a path through places [n, 2] turns by less than `CORNER_ANGLE` everywhere."""
    way = np.diff(places, axis=0)
    way = way / np.linalg.norm(way, axis=1, keepdims=True)
    return bool(
        (np.sum(way[1:] * way[:-1], axis=1) > np.cos(np.radians(CORNER_ANGLE)) * (1 + 1e-9)).all()
    )


def _hull_of_path(plan, way):
    """Return the nodes on the convex hull of a path, clockwise from its first to its last node.

    If one of these is not on the hull, only these two are returned. `way` are the nodes of the
    path in order, `plan` the positions of all nodes, [n_node, 2].
    """
    hull = _convex_hull(plan, sorted(set(way)))[:-1]
    if way[0] not in hull or way[-1] not in hull:
        return [way[0], way[-1]]
    start = hull.index(way[0])
    hull = hull[start:] + hull[:start]
    return hull[: hull.index(way[-1]) + 1]


def _convex_hull(plan, nodes):
    """Return the nodes on the convex hull of `nodes`, clockwise, from the leftmost and back to it.

    Nodes on the straight sides of the hull are included (Andrew's monotone chain). `plan` has the
    positions of all nodes, [n_node, 2].
    """
    line = 1e-9 * np.ptp(plan[nodes], axis=0).max() ** 2
    ordered = sorted(nodes, key=lambda k: tuple(plan[k]))

    def half(sequence):
        chain = []
        for node in sequence:
            while len(chain) > 1:
                a, b = plan[chain[-1]] - plan[chain[-2]], plan[node] - plan[chain[-2]]
                if a[0] * b[1] - a[1] * b[0] <= line:
                    break
                chain.pop()
            chain.append(node)
        return chain

    return half(ordered) + half(ordered[::-1])[1:]


def _require_uncrossed_border_lines(plan, lines, edges):
    """Raise ValueError if a line of the border crosses a link or another such line.

    They join free ends; crossings of two links are not looked for here. `lines` and `edges` are
    sets of sorted pairs of nodes, `plan` has positions, [n_node, 2].
    """
    links = np.array(sorted(edges | lines))

    tiny = 1e-9 * np.ptp(plan[links.ravel()], axis=0).max() ** 2
    first, second = plan[links[:, 0]], plan[links[:, 1]]
    for i, j in sorted(lines):
        a, b = plan[i], plan[j]
        sides = np.stack([_signed_areas(a, b, first), _signed_areas(a, b, second)])
        across = np.stack([_signed_areas(first, second, a), _signed_areas(first, second, b)])
        clear = (np.abs(sides) > tiny).all(axis=0) & (np.abs(across) > tiny).all(axis=0)
        crossed = clear & (np.prod(np.sign(sides), 0) < 0) & (np.prod(np.sign(across), 0) < 0)
        if crossed.any():
            raise ValueError(
                f"links: the border from free end {i} to {j} would cross link "
                f"{links[int(crossed.argmax())].tolist()}; add links along the border, and give "
                "border='links'"
            )


def _warn_of_open_border(plan, lines, closed, rings, nothing):
    """Warn if `lines` between free ends add faces, which lie outside of all links.

    `closed` are the rings of the links alone, `rings` those with the lines; `nothing` is the area,
    m2, up to which a ring is a line.
    """
    before, after = (
        sum(area for ring in found if (area := signed_area(plan[ring])) > nothing)
        for found in (closed, rings)
    )
    if after - before > nothing:
        i, j = min(lines)
        checks.warn_user(
            f"net_faces: {after - before:.6g} of {after:.6g} m2 lie outside of all links, between "
            f"free ends of cables such as {i} and {j}; border='ends' keeps these faces, "
            "border='links' leaves them out"
        )
