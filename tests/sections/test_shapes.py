"""Shapes of sections: areas, second moments, torsion, composites, what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.fibres import composite_cells

import jaxcable as jc
from jaxcable import materials
from jaxcable.sections import Section, bredt_torsion

ONE = jc.Elastic(1.0)

KINDS = ["quadrilaterals", "triangles"]


def order(errors):
    """Order of convergence under repeated halving, from the last two."""
    return np.log2(errors[-2] / errors[-1])


def fibre_sums(section):
    """Second moments of the fibres as points, by NumPy: sum A z^2, sum A y^2, sum A y z."""
    y, z, area = (np.asarray(v) for v in (section.y, section.z, section.area))
    return np.array([area @ z**2, area @ y**2, area @ (y * z)])


EXACT = 1e-12
"""Relative error of sums over some hundred cells, of fourth powers that partly cancel."""


# --- shapes


@pytest.mark.parametrize("cells", KINDS)
def test_disc(cells):
    d, errors = 0.3, []
    exact = np.pi * d**4 / 64
    for n in (5, 10, 20, 40):
        section = Section.disc(d, ONE, (n, n), cells)
        assert section.n_fibre == n * n * (1 if cells == "quadrilaterals" else 2)
        assert section.area.sum() == pytest.approx(np.pi * d**2 / 4, rel=1e-14)
        assert np.allclose(section.inertia(), [exact, exact, 0], rtol=EXACT, atol=EXACT * exact)
        second = fibre_sums(section)
        errors.append(np.abs(second[:2] - exact).max() / exact)
        assert abs(second[2]) <= 1e-3 * exact  # diagonals alternate, but not in mirror images
    assert abs(order(errors) - 2) < 0.1, errors
    assert 0.005 < errors[1] < 0.02  # 10 x 10 cells: what linear laws must not have
    oblong = Section.disc(d, ONE, (3, 8), cells).inertia()
    assert np.allclose(oblong, [exact, exact, 0], rtol=EXACT, atol=EXACT * exact)
    assert float(section.torsion[0]) == pytest.approx(np.pi * d**4 / 32, rel=1e-14)


@pytest.mark.parametrize("cells", KINDS)
def test_ring(cells):
    d, t, errors = 0.3, 0.04, []
    exact = np.pi / 64 * (d**4 - (d - 2 * t) ** 4)
    for n in (1, 2, 4, 8):
        section = Section.ring(d, t, ONE, (n, 12 * n), cells)
        area = np.pi / 4 * (d**2 - (d - 2 * t) ** 2)
        assert section.area.sum() == pytest.approx(area, rel=1e-14)
        assert np.allclose(section.inertia(), [exact, exact, 0], rtol=EXACT, atol=EXACT * exact)
        errors.append(np.abs(fibre_sums(section)[:2] - exact).max() / exact)
    assert abs(order(errors) - 2) < 0.1, errors
    assert float(section.torsion[0]) == pytest.approx(2 * exact, rel=1e-14)


@pytest.mark.parametrize("cells", KINDS)
def test_rectangle(cells):
    b, h = 0.2, 0.3
    section = Section.rectangle(b, h, ONE, (6, 10), cells)
    assert section.area.sum() == pytest.approx(b * h, rel=1e-14)
    i_y, i_z, i_yz = fibre_sums(section)
    if cells == "quadrilaterals":  # a strip at its centre lacks its own b t^3 / 12: closed form
        assert i_y == pytest.approx(b * h**3 / 12 * (1 - 1 / 10**2), rel=1e-14)
        assert i_z == pytest.approx(h * b**3 / 12 * (1 - 1 / 6**2), rel=1e-14)
    else:  # triangles at their centroids lack less
        assert b * h**3 / 12 * (1 - 1 / 10**2) < i_y < b * h**3 / 12
    assert abs(i_yz) <= 1e-3 * i_y  # as for the disc
    i_y, i_z, i_yz = b * h**3 / 12, h * b**3 / 12, 0.0
    assert np.allclose(section.inertia(), [i_y, i_z, i_yz], rtol=EXACT, atol=EXACT * i_y)
    moved = section.shifted(0.5, -0.7)
    # parallel axes; the sums differ by rounding
    expected = [i_y + b * h * 0.7**2, i_z + b * h * 0.5**2, i_yz - b * h * 0.35]
    assert np.allclose(moved.inertia(), expected, rtol=1e-13)
    assert np.allclose(moved.centroid(), [0.5, -0.7], rtol=1e-13)
    assert np.allclose(moved.centred().inertia(), [i_y, i_z, 0], rtol=EXACT, atol=EXACT * i_y)
    assert np.allclose(moved.points - section.points, [0.5, -0.7], rtol=1e-13)


def test_i_shape():
    h, b, web, flange = 0.4, 0.18, 0.0086, 0.0135  # IPE 400 without its fillets
    area = 2 * b * flange + (h - 2 * flange) * web
    i_y = (b * h**3 - (b - web) * (h - 2 * flange) ** 3) / 12
    i_z = (2 * flange * b**3 + (h - 2 * flange) * web**3) / 12
    errors = []
    for n in (2, 4, 8, 16):
        section = Section.i_shape(h, b, web, flange, ONE, (2 * n, n, 3 * n))
        assert section.area.sum() == pytest.approx(area, rel=1e-14)
        assert np.allclose(section.inertia(), [i_y, i_z, 0], rtol=EXACT, atol=EXACT * i_y)
        second = fibre_sums(section)
        errors.append([abs(second[0] - i_y) / i_y, abs(second[1] - i_z) / i_z])
        assert abs(second[2]) <= 1e-14 * i_y  # two axes of symmetry
    assert np.abs(order(np.array(errors)) - 2).max() < 0.1, errors
    torsion = (2 * b * flange**3 + (h - 2 * flange) * web**3) / 3  # thin walls
    assert float(section.torsion[0]) == pytest.approx(torsion, rel=1e-14)
    assert section.counts == (section.n_fibre,) and len(section.cells) == section.n_fibre


def test_box():
    b, h, web, flange = 1.2, 0.5, 0.012, 0.02
    inner_b, inner_h = b - 2 * web, h - 2 * flange
    i_y, i_z = (b * h**3 - inner_b * inner_h**3) / 12, (h * b**3 - inner_h * inner_b**3) / 12
    errors = []
    for n in (2, 4, 8, 16):
        section = Section.box(b, h, web, ONE, flange=flange, shape=(2 * n, n, 3 * n))
        assert section.n_fibre == 2 * (2 * n * n + n * 3 * n)
        assert section.area.sum() == pytest.approx(b * h - inner_b * inner_h, rel=1e-14)
        assert np.allclose(section.inertia(), [i_y, i_z, 0], rtol=EXACT, atol=EXACT * i_y)
        second = fibre_sums(section)
        errors.append([abs(second[0] - i_y) / i_y, abs(second[1] - i_z) / i_z])
        assert abs(second[2]) <= 1e-14 * i_y  # two axes of symmetry
    assert np.abs(order(np.array(errors)) - 2).max() < 0.1, errors
    wide, tall = b - web, h - flange  # of the middle line; Bredt: 4 A^2 / sum(l / t)
    bredt = 4 * (wide * tall) ** 2 / (2 * wide / flange + 2 * tall / web)
    assert float(section.torsion[0]) == pytest.approx(bredt, rel=1e-14)
    assert section.placed and section.counts == (section.n_fibre,)
    # one thickness all around, in the closed form of a square tube, t a^3
    square = Section.box(0.2, 0.2, 0.01, ONE)
    assert float(square.torsion[0]) == pytest.approx(0.01 * 0.19**3, rel=1e-14)
    slope = jax.grad(lambda t: Section.box(0.2, 0.2, t, ONE).total_area)(0.01)
    assert float(slope) == pytest.approx(4 * (0.2 - 2 * 0.01), rel=1e-12)  # of 4 t (a - t)


def polygon_moments(points):
    """Area and second moments of a polygon by Green's theorem, signed by its direction."""
    (y, z), (v, w) = np.transpose(points), np.transpose(np.roll(points, -1, axis=0))
    cross = y * w - v * z
    return np.array(
        [
            cross.sum() / 2,
            (cross * (z * z + z * w + w * w)).sum() / 12,
            (cross * (y * y + y * v + v * v)).sum() / 12,
            (cross * (y * w + 2 * y * z + 2 * v * w + v * z)).sum() / 24,
        ]
    )


def turned(points, angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array(points) @ np.array([[c, s], [-s, c]])


L_SHAPE = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 4], [0, 4.0]]) / 10

HOLE = np.array([[0.3, 0.3], [0.3, 0.6], [0.6, 0.6], [0.6, 0.3]]) / 10  # clockwise

POLYGONS = {
    "L with a square hole": (L_SHAPE, [HOLE]),
    "the same, turned": (turned(L_SHAPE, 0.4), [turned(HOLE, 0.4)]),
    "triangle": (np.array([[0, 0], [0.3, 0.05], [0.1, 0.2]]), []),
    "clockwise triangle": (np.array([[0.1, 0.2], [0.3, 0.05], [0, 0]]), []),
    "two holes": (L_SHAPE, [HOLE, HOLE + np.array([0.0, 0.2])]),
}


@pytest.mark.parametrize("cells", KINDS)
@pytest.mark.parametrize("name", POLYGONS)
def test_polygon(name, cells):
    outline, holes = POLYGONS[name]
    exact = np.abs(polygon_moments(outline)[0])
    sign = np.sign(polygon_moments(outline)[0])
    exact = sign * polygon_moments(outline)
    for hole in holes:
        exact = exact - np.sign(polygon_moments(hole)[0]) * polygon_moments(hole)
    errors = []
    for size in (0.02, 0.01, 0.005):
        section = Section.polygon(outline, holes, ONE, size, cells)
        # rounding of some 1e3 areas and of the crossings of edges
        assert section.area.sum() == pytest.approx(exact[0], rel=1e-13)
        errors.append(np.abs(fibre_sums(section) - exact[1:]).max() / exact[1:3].max())
        assert np.allclose(section.inertia(), exact[1:], rtol=EXACT)
        assert (np.asarray(section.area) > 0).all()
    # strips end at the corners, so halving the size halves the cells only nearly
    assert abs(order(errors) - 2) < 0.25, errors
    assert errors[-1] < 1e-3


def test_mesh_takes_triangles_and_quadrilaterals_either_way_round():
    points = np.array([[0, 0], [2, 0], [2, 1], [0, 1.0]])
    quad, clockwise = (Section.mesh(points, [c], ONE) for c in ([0, 1, 2, 3], [0, 3, 2, 1]))
    two = Section.mesh(points, [[0, 1, 2], [0, 3, 2]], ONE)
    mixed = Section.mesh(points, [[0, 1, 2, 2], [3, 2, 0, 0]], ONE)
    for section in (quad, clockwise, two, mixed):
        # rounding of a centroid
        assert section.area.sum() == 2
        assert section.area @ section.y == pytest.approx(2.0, rel=1e-15)
        assert section.area @ section.z == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize("cell", [[0, 1, 2, 3], [0, 3, 2, 1]])
def test_mesh_of_traced_points_has_positive_areas(cell):
    """Also of a cell given clockwise, as while the points are concrete."""
    points = np.array([[0, 0], [2, 0], [2, 1], [0, 1.0]])

    def area(points):
        return Section.mesh(points, [cell], ONE).total_area

    value, gradient = jax.jit(jax.value_and_grad(area))(points)
    assert value == 2
    # d(area)/d(point): half the diagonal opposite, turned by a right angle
    assert np.allclose(gradient, [[-0.5, -1], [0.5, -1], [0.5, 1], [-0.5, 1]], rtol=1e-15)


def test_mesh_with_a_law_for_every_cell():
    """Cells are put in order of their laws; forces do not depend on the order given."""
    steel, soft = jc.Elastic(210e9), jc.Elastic(30e9)
    points = np.array([[y, z] for y in (0.0, 1.0, 2.0, 3.0) for z in (0.0, 1.0)])
    cells = [[0, 2, 3, 1], [2, 4, 5, 3], [4, 6, 7, 5]]
    section = Section.mesh(points, cells, [steel, soft, steel])
    assert section.counts == (2, 1) and section.laws == (steel, soft)
    assert np.allclose(np.sort(section.y[:2]), [0.5, 2.5]) and section.y[2] == 1.5
    stiffness = section.stiffness()
    ea = 2 * 210e9 + 30e9
    # squares of 1 m: 1/12 about their own axes
    expected = [[ea, 0.5 * ea, -1.5 * ea], [0.5 * ea, ea / 3, -0.75 * ea]]
    last = [-1.5 * ea, -0.75 * ea, 210e9 * (0.5**2 + 2.5**2) + 30e9 * 1.5**2 + ea / 12]
    assert np.allclose(stiffness, [*expected, last], rtol=1e-14)


# --- torsion


def test_torsion_of_rectangles():
    """Timoshenko and Goodier, art. 109: 0.1406 a^4 for a square, 0.229 b t^3 for 2:1."""
    square, flat, tall, thin = (
        float(Section.rectangle(b, h, ONE, (1, 1)).torsion[0])
        for b, h in ((0.3, 0.3), (0.4, 0.2), (0.2, 0.4), (10.0, 0.01))
    )
    assert square == pytest.approx(0.140577 * 0.3**4, rel=4e-6)  # six digits
    assert flat == pytest.approx(0.2287 * 0.4 * 0.2**3, rel=3e-4)  # four digits
    assert tall == flat
    # long: (1 - 0.6302 t / b) b t^3 / 3
    assert thin == pytest.approx(10 * 0.01**3 / 3 * (1 - 0.630249e-3), rel=1e-9)


def test_torsional_stiffness():
    steel, soft = jc.Elastic(210e9), jc.Elastic(30e9)
    tube = Section.composite([Section.disc(0.28, soft), Section.ring(0.3, 0.01, steel)])
    exact = 30e9 * 0.28**4 + 210e9 * (0.3**4 - 0.28**4)
    exact *= np.pi / 32 / (2 * 1.2)
    # rounding of the difference of fourth powers
    assert float(tube.torsional_stiffness(0.2)) == pytest.approx(exact, rel=1e-13)
    with pytest.raises(ValueError, match="torsional_stiffness: missing"):
        Section.polygon(L_SHAPE, None, ONE, 0.05).torsional_stiffness()


TORSION_OF_BOX = 0.01 * 0.19**3
"""Bredt, square box of 200 x 200 x 10 mm: t a^3 with the middle line a = 190 mm."""


def four_plates(torsion=None):
    """A box of 200 x 200 x 10 mm."""
    flange = Section.rectangle(0.2, 0.01, ONE, (4, 1))
    side = Section.rectangle(0.01, 0.18, ONE, (1, 4))
    plates = [flange.shifted(z=0.095), flange.shifted(z=-0.095)]
    return Section.composite(
        [*plates, side.shifted(y=0.095), side.shifted(y=-0.095)], torsion=torsion
    )


def test_four_plates_have_no_torsion_constant_of_their_own():
    """Loose ones have 2.4e-7 m4 together, a box 6.9e-5; which of both is not known."""
    loose = 2 * (0.2 + 0.18) * 0.01**3 / 3
    assert 1 / 300 < loose / TORSION_OF_BOX < 1 / 250
    box = four_plates()
    assert box.torsion is None
    with pytest.raises(ValueError, match=r"no known torsion constant \(a composite has one if"):
        box.torsional_stiffness()
    with pytest.raises(ValueError, match="torsional_stiffness: missing"):
        jc.Beams([[0, 1]], section=box)
    middle = 0.095 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    stated = four_plates(bredt_torsion(middle, 0.01))
    # four products
    assert float(stated.torsion[0]) == pytest.approx(TORSION_OF_BOX, rel=1e-14)
    second = (0.2**4 - 0.18**4) / 12
    assert np.allclose(stated.inertia(), [second, second, 0], rtol=EXACT, atol=EXACT * second)


def test_bredt_of_a_ring_and_of_walls_of_two_thicknesses():
    """A polygon of n sides about a thin ring: 2 pi r^3 t; a box: 2 b^2 h^2 / (b / t + h / s)."""
    n, r, t = 2000, 0.3, 0.004
    angle = 2 * np.pi * np.arange(n) / n
    ring = r * np.column_stack([np.cos(angle), np.sin(angle)])
    # a polygon of n sides differs from its circle by (2 pi / n)^2 / 6 in area and by a quarter of
    # that in length
    assert bredt_torsion(ring, t) == pytest.approx(2 * np.pi * r**3 * t, rel=3 * (np.pi / n) ** 2)
    b, h, s = 0.4, 0.25, 0.007
    box = np.array([[0, 0], [b, 0], [b, h], [0, h]])
    exact = 2 * (b * h) ** 2 / (b / t + h / s)
    for points, walls in ((box, [t, s, t, s]), (box[::-1], [t, s, t, s])):
        assert bredt_torsion(points, walls) == pytest.approx(exact, rel=1e-14)
    # traced: d/ds of it, by hand
    slope = jax.jit(jax.grad(lambda s: bredt_torsion(box, jnp.array([t, s, t, s]))))(s)
    assert float(slope) == pytest.approx(exact * (h / s**2) / (b / t + h / s), rel=1e-13)


def test_torsion_constants_add_up_about_one_centre_only():
    """Of discs and rings; also of parts that are composites, while traced, and of one part."""
    tube, core = Section.ring(0.3, 0.01, ONE, (1, 12)), Section.disc(0.28, jc.Elastic(2.0), (4, 4))
    inner, wall = np.pi / 32 * 0.28**4, np.pi / 32 * (0.3**4 - 0.28**4)
    filled = Section.composite([tube, core])
    assert np.allclose(filled.torsion, [wall, inner], rtol=EXACT)
    sheath = Section.ring(0.32, 0.01, core.laws[0], (1, 12))
    coated = Section.composite([filled.shifted(y=0.1), sheath.shifted(y=0.1)])
    outer = np.pi / 32 * (0.32**4 - 0.3**4)
    assert np.allclose(coated.torsion, [wall, inner + outer], rtol=EXACT)
    assert np.allclose(Section.composite([four_plates(3e-5)]).torsion, 3e-5, rtol=1e-15)
    for others in (
        [core, core.shifted(y=0.4)],  # two rods
        [tube, core.shifted(z=1e-3)],
        [tube, Section.rectangle(0.1, 0.1, ONE)],
        [core, Section([0.0], [0.0], [1e-3], ONE, torsion=[1e-6])],
    ):
        assert Section.composite(others).torsion is None

    @jax.jit
    def traced(d, y):
        core = Section.disc(d, ONE, (4, 4)).shifted(y=y)
        return Section.composite([tube, core]).torsion

    assert np.allclose(traced(0.28, 0.0), wall + inner, rtol=EXACT)
    assert np.isnan(traced(0.28, 1e-3)).all()


# --- the axis


CORNER = np.array([[0, 0], [0.1, 0], [0.1, 0.01], [0.01, 0.01], [0.01, 0.1], [0, 0.1]])


def used(section, **options):
    """A structure with a beam of the section."""
    beam = jc.Beams([[0, 1]], section=section, torsional_stiffness=1.0, **options)
    return jc.Structure([[0.0, 0, 0], [3.0, 0, 0]], beam, jc.clamped([0]))


def test_centred_puts_the_axis_at_the_centroid():
    """An L of 100 x 100 x 10 mm as two rectangles, by hand."""
    area = 0.1 * 0.01 + 0.01 * 0.09
    at = (0.1 * 0.01 * 0.05 + 0.01 * 0.09 * 0.005) / area
    second = (0.01 * 0.1**3 + 0.09 * 0.01**3) / 3 - area * at**2
    product = 0.1 * 0.01 * 0.05 * 0.005 + 0.09 * 0.01 * 0.005 * 0.055 - area * at**2
    section = Section.polygon(CORNER, None, ONE, 0.02)
    assert np.allclose(section.centroid(), at, rtol=EXACT)
    centred = section.centred()
    assert np.allclose(centred.inertia(), [second, second, product], rtol=EXACT)
    assert np.allclose(centred.points, section.points - at, rtol=0, atol=1e-16)
    assert np.abs(np.asarray(centred.stiffness())[0, 1:]).max() <= 1e-15 * area  # N without M


def test_centroid_of_two_laws_is_weighted_by_stiffness():
    soft, stiff = jc.Elastic(1e9), jc.Elastic(3e9)
    one, two = Section.rectangle(0.1, 0.1, soft), Section.rectangle(0.1, 0.1, stiff)
    section = Section.composite([one, two.shifted(z=0.2)])
    assert np.allclose(section.centroid(), [0, 0.15], rtol=EXACT, atol=1e-17)
    stiffness = np.asarray(jax.jit(lambda s: s.centred().stiffness())(section))
    assert np.abs(stiffness[0, 1:]).max() <= 1e-15 * stiffness[0, 0]
    # own 0.1^4 / 12, and 0.15 and 0.05 m of lever
    exact = 1e9 * 0.01 * (0.15**2 + 3 * 0.05**2) + 4e9 * 0.1**4 / 12
    assert stiffness[1, 1] == pytest.approx(exact, rel=EXACT)


def test_a_beam_off_its_centroid_by_chance_is_warned_of():
    section = Section.polygon(CORNER, None, ONE, 0.02)
    text = (
        r"elements\.section: its centroid is at y = 0\.0286842, z = 0\.0286842 m from the axis .* "
        r"\.centred\(\) puts the axis there, \.shifted\(\) says that it is meant"
    )
    with pytest.warns(jc.InputWarning, match=text):
        used(section)
    mesh = Section.mesh([[0, 0], [0.1, 0], [0.1, 0.2], [0, 0.2]], [[0, 1, 2, 3]], ONE)
    with pytest.warns(jc.InputWarning, match=r"y = 0\.05, z = 0\.1 m from"):
        used(mesh)
    plate = Section.rectangle(0.1, 0.01, ONE)
    with pytest.warns(jc.InputWarning, match="centroid"):
        used(Section.composite([plate, Section.rectangle(0.01, 0.1, ONE).shifted(z=0.055)]))
    # where it is said, or at the centroid, there is no warning (an error in this suite)
    for fine in (section.centred(), section.shifted(), section.shifted(y=0.1), mesh.centred()):
        used(fine)
    used(plate.shifted(z=0.3))
    used(Section.mesh(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 8, [[0, 1, 2, 3]], ONE))
    used(Section.polygon(CORNER - 0.02868421052631579, None, ONE, 0.02))
    # the axial force of bars and cables has no axis to be off
    jc.Structure([[0.0, 0, 0], [3.0, 0, 0]], jc.Bars([[0, 1]], section=section), jc.pinned([0]))
    # and numbers that are traced are not looked at
    jax.jit(lambda e: used(Section.mesh(mesh.points, [[0, 1, 2, 3]], jc.Elastic(e))).nodes)(1.0)


# --- composites


def test_concrete_filled_tube():
    ea = np.pi / 4 * (33e9 * 0.28**2 + 210e9 * (0.3**2 - 0.28**2))
    ei = np.pi / 64 * (33e9 * 0.28**4 + 210e9 * (0.3**4 - 0.28**4))
    for n in (1, 2, 4, 8):
        section = composite_cells(n)
        stiffness = np.asarray(section.stiffness())
        assert stiffness[0, 0] == pytest.approx(ea, rel=1e-13)  # areas are exact
        assert np.allclose(np.diagonal(stiffness)[1:], ei, rtol=EXACT)
        # two axes of symmetry: the axis is the centroid
        assert np.abs(stiffness - np.diag(np.diagonal(stiffness))).max() <= 1e-13 * ea
        area, law = section.axial()
        assert float(area * law.modulus) == pytest.approx(ea, rel=1e-13)


def test_strand_with_a_soft_core():
    """Core and strand share the strain; the axial law is their weighted sum."""
    strand, core = materials.strand(unloading="reversible"), jc.Elastic(1e9)
    section = Section.composite([Section.disc(0.02, core), Section.ring(0.05, 0.015, strand)])
    areas = np.pi / 4 * np.array([0.02**2, 0.05**2 - 0.02**2])
    e = np.array([-0.01, 0.004, 0.015])

    @jax.jit
    def both(section, e):
        area, law = section.axial()
        return area, section.forces(e, 0 * e, 0 * e)[0], area * law.stress_at(e)

    area, *pulls = both(section, e)
    assert float(area) == pytest.approx(areas.sum(), rel=1e-13)
    expected = areas[0] * 1e9 * e + areas[1] * np.interp(e, strand.strain, strand.stress)
    for pull in pulls:  # sums over fibres
        assert np.abs(pull - expected).max() <= 1e-12 * expected.max()
    assert [len(p) for p in (section.laws, section.counts)] == [2, 2]
    assert np.asarray(section.cells).max() == len(section.points) - 1


def test_composite_joins_the_fibres_of_one_law():
    law, other = jc.Elastic(1.0), jc.Elastic(2.0)
    a = Section.rectangle(1.0, 1.0, law, (1, 1))
    b = Section.rectangle(1.0, 1.0, other, (1, 2))
    joined = Section.composite([a, b.shifted(2.0), a.shifted(4.0)])
    assert joined.laws == (law, other) and joined.counts == (2, 2)
    assert joined.y.tolist() == [0, 4, 2, 2]
    assert np.allclose(np.asarray(joined.points)[joined.cells].mean(1)[:, 0], joined.y)
    assert joined.torsion is None  # of loose rectangles, of a welded one? nobody knows


# --- what is refused


SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1.0]]

BAD = {
    "diameter": (lambda: Section.disc(-0.1, ONE), "diameter = -0.1: must be positive"),
    "disc shape": (
        lambda: Section.disc(0.1, ONE, (0, 5)),
        r"shape = \(0, 5\): expected 2 integers",
    ),
    "disc of many diameters": (
        lambda: Section.disc([0.1, 0.2], ONE),
        r"dimension: expected a scalar, got shape \(2,\)",
    ),
    "ring of one number": (lambda: Section.ring(0.3, 0.01, ONE, 16), "shape = 16: expected 2"),
    "disc cells": (lambda: Section.disc(0.1, ONE, cells="hex"), "cells = 'hex': expected one of"),
    "law": (lambda: Section.disc(0.1, 210e9), r"laws\[0\]: float is not a uniaxial law"),
    "thickness": (lambda: Section.ring(0.3, 0.0, ONE), "thickness = 0.0: must be positive"),
    "too thick": (lambda: Section.ring(0.3, 0.15, ONE), "thickness = .*: twice is too thick"),
    "ring shape": (
        lambda: Section.ring(0.3, 0.01, ONE, (1, 2)),
        r"shape = \(1, 2\): expected 2 integers, at least \(1, 3\)",
    ),
    "width": (lambda: Section.rectangle(0.0, 1.0, ONE), "width = 0.0: must be positive"),
    "height": (lambda: Section.rectangle(1.0, -1.0, ONE), "height = -1.0: must be positive"),
    "rectangle shape": (
        lambda: Section.rectangle(1.0, 1.0, ONE, (2.0, 2)),
        r"shape = \(2.0, 2\): expected 2 integers",
    ),
    "i web": (lambda: Section.i_shape(0.4, 0.2, 0.0, 0.01, ONE), "web = 0.0: must be positive"),
    "i flange": (lambda: Section.i_shape(0.4, 0.2, 0.01, 0.2, ONE), "flange"),
    "box web": (lambda: Section.box(0.2, 0.4, 0.1, ONE), "thickness = 0.1: twice is too thick"),
    "box flange": (
        lambda: Section.box(0.4, 0.2, 0.01, ONE, flange=0.1),
        "flange = 0.1: twice is too thick",
    ),
    "low box": (lambda: Section.box(0.4, 0.02, 0.01, ONE), "thickness = 0.01: twice is too thick"),
    "box height": (lambda: Section.box(0.4, 0.0, 0.01, ONE), "height = 0.0: must be positive"),
    "box shape": (
        lambda: Section.box(0.4, 0.2, 0.01, ONE, shape=(4, 4)),
        r"shape = \(4, 4\): expected 3 integers",
    ),
    "i shape": (
        lambda: Section.i_shape(0.4, 0.2, 0.01, 0.01, ONE, (4, 4)),
        r"shape = \(4, 4\): expected 3 integers",
    ),
    "outline": (
        lambda: Section.polygon([[0, 0], [1, 1]], None, ONE, 0.1),
        r"points: expected shape \[n, 2\] with n >= 3, got \(2, 2\)",
    ),
    "hole": (
        lambda: Section.polygon(SQUARE, [[[0, 0, 0]]], ONE, 0.1),
        r"holes\[0\]: expected shape \[n, 2\]",
    ),
    "size": (lambda: Section.polygon(SQUARE, None, ONE, 0.0), "size = 0.0: must be positive"),
    "infinite size": (
        lambda: Section.polygon(SQUARE, None, ONE, np.inf),
        "size = inf: must be finite",
    ),
    "crossing": (
        lambda: Section.polygon([[0, 0], [1, 1], [1, 0], [0, 1]], None, ONE, 0.1),
        "the outline crosses itself",
    ),
    "hole outside": (
        lambda: Section.polygon(SQUARE, [np.array(SQUARE) + 0.5], ONE, 0.1),
        "a hole crosses it or another hole",
    ),
    "mesh cells": (
        lambda: Section.mesh(SQUARE, [[0, 1]], ONE),
        r"cells: expected shape \[n_cell, 3\] or \[n_cell, 4\], got \(1, 2\)",
    ),
    "mesh number": (
        lambda: Section.mesh(SQUARE, [[0, 1, 2], [0, 2, 4]], ONE),
        r"cells\[1\] = .*4.*: there are 4 points",
    ),
    "mesh floats": (
        lambda: Section.mesh(SQUARE, [[0, 1, 2.5]], ONE),
        "cells: expected integers, got float64",
    ),
    "mesh points": (
        lambda: Section.mesh(np.zeros((4, 3)), [[0, 1, 2]], ONE),
        r"points: expected shape \[n_point, 2\], got \(4, 3\)",
    ),
    "mesh laws": (
        lambda: Section.mesh(SQUARE, [[0, 1, 2]], [ONE, ONE]),
        "laws: expected one law or 1, got 2",
    ),
    "flat cell": (
        lambda: Section.mesh([[0, 0], [1, 0], [2, 0.0]], [[0, 1, 2]], ONE),
        r"area\[0\] = .*: a fibre's area must be positive",
    ),
    "composite torsion": (
        lambda: Section.composite([Section.disc(0.1, ONE), Section.disc(0.1, jc.Elastic(2.0))], 1),
        r"torsion: expected shape \(2,\), one constant per law, got shape \(\)",
    ),
    "composite torsion of one law": (
        lambda: Section.composite([Section.disc(0.1, ONE)], [1.0, 2.0]),
        r"torsion: expected a scalar, one constant per law, got shape \(2,\)",
    ),
    "negative torsion": (
        lambda: Section.composite([Section.disc(0.1, ONE)], -1.0),
        "torsion = -1.0: must be positive",
    ),
    "bredt points": (
        lambda: bredt_torsion([[0, 0], [1, 1]], 0.1),
        r"points: expected shape \[n, 2\] with n >= 3, got \(2, 2\)",
    ),
    "bredt thickness": (
        lambda: bredt_torsion(SQUARE, [0.1, 0.1, 0.0, 0.1]),
        r"thickness\[2\] = 0.0: must be positive",
    ),
    "bredt thicknesses": (
        lambda: bredt_torsion(SQUARE, [0.1, 0.1]),
        r"thickness: expected a scalar or shape \(4,\), one value per wall, got shape \(2,\)",
    ),
    "bredt crossing": (
        lambda: bredt_torsion([[0, 0], [1, 1], [1, 0], [0, 1]], 0.1),
        r"points: the line crosses itself: the edge from points\[0\] to points\[1\] crosses",
    ),
    "bredt line": (
        lambda: bredt_torsion([[0, 0], [1, 1], [2, 2]], 0.1),
        "points: all on one line, which has no area",
    ),
    "own": (
        lambda: Section([0.0], [0.0], [1.0], ONE, own=[[1.0, 1.0]]),
        r"own: expected shape \[n_fibre, 3\], got \(1, 2\)",
    ),
    "nothing": (lambda: Section.composite([]), "sections: a composite needs at least one"),
    "y": (lambda: Section([[0.0]], [0.0], [1.0], ONE), r"y: expected shape \[n_fibre\]"),
    "z": (lambda: Section([0.0], [0.0, 1.0], [1.0], ONE), r"z: expected shape \[n_fibre\] as y"),
    "area": (
        lambda: Section([0.0, 1.0], [0.0, 1.0], [1.0, 0.0], ONE),
        r"area\[1\] = 0.0: a fibre's area must be positive",
    ),
    "counts": (
        lambda: Section([0.0], [0.0], [1.0], (ONE, ONE), (1,)),
        r"counts = \(1,\): must give every law its number of fibres",
    ),
    "ratios": (
        lambda: Section.disc(0.1, jc.materials.steel()).interaction(n_axial=1),
        "n_axial = 1: expected at least 2",
    ),
    "interaction": (
        lambda: Section.disc(0.1, ONE).interaction(),
        "interaction: no fibre of this section ever fails",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_sections_are_refused(name):
    make, message = BAD[name]
    # a warning on the way (such as of a division by zero) is an error in this suite
    with pytest.raises(ValueError, match=message):
        make()


def test_outline_of_a_polygon_cannot_be_traced():
    with pytest.raises(ValueError, match="points: cannot be traced; use "):
        jax.jit(lambda p: Section.polygon(p, None, ONE, 0.1).total_area)(np.array(SQUARE))
