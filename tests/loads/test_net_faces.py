"""Faces of nets in plan: closed borders, free ends, and both, against areas of known outlines."""

import warnings

import numpy as np
import pytest

import jaxcable as jc


def outline(places):
    """Area within a polygon [n, 2] by the shoelace formula, m2."""
    x, y = np.asarray(places, float)[:, :2].T
    return 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def covered(nodes, faces):
    """Plan area of faces, m2; each must go anticlockwise, and quadrilaterals be convex."""
    total = 0.0
    for a, b, c, d in np.asarray(nodes)[faces][..., :2]:
        for one in ((a, b, c), (a, c, d)) if (c != d).any() else ((a, b, c),):
            (ux, uy), (vx, vy) = one[1] - one[0], one[2] - one[0]
            assert ux * vy - uy * vx > 0
            total += 0.5 * (ux * vy - uy * vx)
    return total


def tent():
    """Nodes and links of a net whose four edge cables bow inward, and its outline in turn."""
    n, width, depth, sag = 6, 30.0, 40.0, 0.1
    s = np.linspace(0, 1, n + 1)
    u, v = np.meshgrid(s, s, indexing="ij")
    x = width * (u + (1 - 2 * u) * 4 * sag * v * (1 - v))
    y = depth * (v + (1 - 2 * v) * 4 * sag * u * (1 - u))
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    links = [*zip(number[:-1].ravel(), number[1:].ravel(), strict=True)]
    links += [*zip(number[:, :-1].ravel(), number[:, 1:].ravel(), strict=True)]
    rim = [*number[:-1, 0], *number[-1, :-1], *number[:0:-1, -1], *number[0, :0:-1]]
    return np.stack([x, y, 3 * u * v], -1).reshape(-1, 3), np.array(links), rim


def quiet(*args):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return jc.net_faces(*args)


def test_nothing_outside_of_edge_cables():
    """889 m2 within the edge cables; the hull of the same net has 1200 m2."""
    nodes, links, rim = tent()
    faces = quiet(nodes, links)
    inside = outline(nodes[rim])
    assert covered(nodes, faces) == pytest.approx(inside, rel=1e-13)  # rounding of the sums
    assert inside < 0.75 * 30 * 40
    assert len(faces) == 36
    # guys from the corners out to anchors change nothing, as the edge cables run on into them
    far = np.array([[-9.0, -9, -3], [39, -9, -3], [39, 49, -3], [-9, 49, -3]])
    guys = [[corner, len(nodes) + k] for k, corner in enumerate((0, 42, 48, 6))]
    with_guys = np.concatenate([nodes, far])
    assert covered(with_guys, quiet(with_guys, [*links, *guys])) == pytest.approx(inside, rel=1e-13)


def test_masts_and_stays_are_no_part_of_the_net():
    """Vertical masts below the corners, anchors far out: nodes that no link of the net touches."""
    nodes, links, rim = tent()
    feet = nodes[[0, 6, 42, 48]] - np.array([0.0, 0, 5])
    far = np.array([[-900.0, -900, -3], [39, 490, -3]])
    more = np.concatenate([feet, nodes, far])  # before and behind the net
    faces = quiet(more, links + 4)
    np.testing.assert_array_equal(faces - 4, quiet(nodes, links))
    assert covered(more, faces) == pytest.approx(outline(nodes[rim]), rel=1e-13)
    with pytest.raises(ValueError, match="same place in plan; give the links of the net alone"):
        jc.net_faces(more, [*(links + 4), [0, 4]])
    crossed = [*(links + 4), [4, 52]]  # a diagonal through the whole net
    with pytest.raises(ValueError, match="some cross in plan"):
        jc.net_faces(more, crossed)


def cut_grid(inside):
    """Grid of unit cells whose cables end where `inside(i, j)` does, without edge cables."""
    places = [(i, j) for j in range(8) for i in range(8) if inside(i, j)]
    number = {place: k for k, place in enumerate(places)}
    free = {p for p in places if all(q in number for q in ((p[0] + 1, p[1]), (p[0] - 1, p[1])))}
    free &= {p for p in places if all(q in number for q in ((p[0], p[1] + 1), (p[0], p[1] - 1)))}
    links = [
        (number[p], number[q])
        for p in places
        for q in ((p[0] + 1, p[1]), (p[0], p[1] + 1))
        if q in number and (p in free or q in free)
    ]
    used = sorted({k for link in links for k in link})
    again = {k: n for n, k in enumerate(used)}
    return np.array([(*places[k], 0.0) for k in used]), [(again[a], again[b]) for a, b in links]


def test_free_ends_of_a_net_that_is_not_convex():
    """An L: its notch, along which cables lie, is air; five outer corners are cut off."""
    nodes, links = cut_grid(lambda i, j: i <= 3 or j <= 3)
    corners = [(0, 0), (7, 0), (7, 3), (3, 7), (0, 7)]
    with pytest.warns(jc.InputWarning, match="18.5 of 30.5 m2 lie outside of all links"):
        faces = jc.net_faces(nodes, links)
    expected = 33 - 0.5 * len(corners)
    assert covered(nodes, faces) == pytest.approx(expected, rel=1e-13)
    inside = jc.net_faces(nodes, links, border="links")
    assert covered(nodes, inside) == pytest.approx(expected - 18.5, rel=1e-13)
    # without the cables along the notch but for the corner itself, which two of them reach
    inner = np.flatnonzero((nodes[:, :2] == 3).all(axis=1))[0]
    links = [link for link in links if inner not in link or min(nodes[list(link), :2].min(0)) < 3]
    again = jc.net_faces(nodes, links, border="ends")
    assert covered(nodes, again) == pytest.approx(expected, rel=1e-13)
    hull = np.array([(1, 0), (6, 0), (7, 1), (7, 2), (2, 7), (1, 7), (0, 6), (0, 1)])
    assert outline(hull) == expected + 4.5  # what the convex hull adds


@pytest.mark.parametrize("sag", [0.0, 0.4])
def test_edge_cable_on_one_side_and_free_ends_on_three(sag):
    """Top edge cable between corners of one link; the other sides are straight between ends."""
    n = 5
    places = [(i, j) for j in range(n) for i in range(n + 1)]
    places = [p for p in places if p not in {(0, 0), (n, 0)}]
    number = {p: k for k, p in enumerate(places)}
    links = [(number[i, j], number[i + 1, j]) for j in range(1, n) for i in range(n)]
    links += [(number[i, j], number[i, j + 1]) for j in range(n - 1) for i in range(1, n)]
    nodes = np.array([(*p, 0.0) for p in places])
    top = nodes[:, 1] == n - 1
    nodes[top, 1] -= sag * nodes[top, 0] * (n - nodes[top, 0]) / (n / 2) ** 2
    faces = jc.net_faces(nodes, links, border="ends")
    way = [(1, 0), (n - 1, 0), (n, 1), (n, n - 1)]
    edge = [nodes[number[i, n - 1], :2] for i in range(n - 1, 0, -1)]
    expected = outline([*way, *edge, (0, n - 1), (0, 1)])
    assert covered(nodes, faces) == pytest.approx(expected, rel=1e-13)
    assert outline([*way, (0, n - 1), (0, 1)]) - expected == pytest.approx(
        0 if sag == 0 else outline([*edge, (0, n - 1), (n, n - 1)]), abs=1e-12
    )


def test_cables_side_by_side_have_their_hull():
    """No link joins them: strips of 1 m between cables of 4, 5 and 4 m."""
    nodes = [[0.0, 0, 0], [4, 0, 0], [-0.5, 1, 0], [4.5, 1, 0], [0, 2, 0], [4, 2, 0]]
    with pytest.warns(jc.InputWarning, match="9 of 9 m2"):
        faces = jc.net_faces(nodes, [[0, 1], [2, 3], [4, 5]])
    assert covered(nodes, faces) == pytest.approx(9.0, rel=1e-14)


def test_meshes_that_are_not_convex():
    """An arrow head, and a hall of six corners with a cable that ends within it."""
    arrow = np.array([[0.0, 0, 0], [2, 1, 0], [0, 4, 0], [-2, 1, 0.0]])
    arrow[0, 1] = 2.0
    ring = [[0, 1], [1, 2], [2, 3], [3, 0]]
    assert covered(arrow, quiet(arrow, ring)) == pytest.approx(outline(arrow), rel=1e-14)
    hall = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3], [0.5, 2.0]])
    hall = np.column_stack([hall, np.zeros(7)])
    links = [[k, (k + 1) % 6] for k in range(6)]
    faces = quiet(hall, [*links, [6, 5]])
    assert covered(hall, faces) == pytest.approx(outline(hall[:6]), rel=1e-14)


def test_meshes_of_a_hexagonal_star():
    """Six triangles inside, none outside; without its spokes one mesh of six corners."""
    angle = np.arange(6) * np.pi / 3
    rim = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    nodes = np.concatenate([rim, [[0.0, 0.0, 0.5]]])
    faces = jc.net_faces(nodes, [[k, 6] for k in range(6)], border="ends")
    assert faces.shape == (6, 4) and (faces[:, 2] == faces[:, 3]).all()
    expected = {frozenset({k, (k + 1) % 6, 6}) for k in range(6)}
    assert {frozenset(face) for face in faces.tolist()} == expected
    assert covered(nodes, faces) == pytest.approx(outline(rim), rel=1e-13)
    around = [[k, (k + 1) % 6] for k in range(6)]
    hexagon = jc.net_faces(rim, around)
    assert hexagon.shape == (4, 4)  # in four triangles
    assert jc.net_faces(nodes, around).tolist() == hexagon.tolist()  # no link touches node 6


def octagons(*links):
    """Two rings of eight nodes, 2 m and 1 m in radius, joined by some links."""
    turn = np.arange(8) * np.pi / 4
    ring = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    loops = [[first + k, first + (k + 1) % 8] for first in (0, 8) for k in range(8)]
    return np.vstack([2 * ring, ring]), [*loops, *links]


def test_a_part_inside_a_mesh_is_covered_once():
    nodes, links = octagons([0, 8])
    assert covered(nodes, quiet(nodes, links)) == pytest.approx(outline(nodes[:8]), rel=1e-13)
    with pytest.raises(ValueError, match=r"with node 8 lies inside a mesh .* with node 0; join"):
        jc.net_faces(*octagons())
