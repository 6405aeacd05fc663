"""Shapes of sections: areas, second moments, torsion, the axis, composites."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.traced import traced

import jaxcable as jc
from jaxcable import materials
from jaxcable.sections import Section, bredt_torsion

ONE = jc.Elastic(1.0)
SOFT, STIFF = jc.Elastic(30e9), jc.Elastic(210e9)
EXACT = 1e-12
"""Relative error of sums over some hundred cells, of fourth powers that partly cancel."""


def fibre_sums(section):
    """Second moments of the fibres as points, by NumPy: sum A z^2, sum A y^2, sum A y z."""
    y, z, area = (np.asarray(v) for v in (section.y, section.z, section.area))
    return np.array([area @ z**2, area @ y**2, area @ (y * z)])


# --- shapes


def outline_moments(points):
    """Area and second moments of a polygon by Green's theorem, whatever its direction."""
    (y, z), (v, w) = np.transpose(points), np.transpose(np.roll(points, -1, axis=0))
    cross = y * w - v * z
    found = [
        cross.sum() / 2,
        (cross * (z * z + z * w + w * w)).sum() / 12,
        (cross * (y * y + y * v + v * v)).sum() / 12,
        (cross * (y * w + 2 * y * z + 2 * v * w + v * z)).sum() / 24,
    ]
    return np.sign(found[0]) * np.array(found)


def turned(points, angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array(points) @ np.array([[c, s], [-s, c]])


L_SHAPE = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 4], [0, 4.0]]) / 10
HOLE = np.array([[0.3, 0.3], [0.3, 0.6], [0.6, 0.6], [0.6, 0.3]]) / 10  # clockwise
TRIANGLE = np.array([[0, 0], [0.3, 0.05], [0.1, 0.2]])
POLYGONS = {
    "L with a square hole": (L_SHAPE, [HOLE]),
    "the same, turned": (turned(L_SHAPE, 0.4), [turned(HOLE, 0.4)]),
    "triangle": (TRIANGLE, []),
    "clockwise triangle": (TRIANGLE[::-1], []),
    "two holes": (L_SHAPE, [HOLE, HOLE + np.array([0.0, 0.2])]),
}


def known():
    """Of a shape: how it is made, area, second moments, torsion, number of cells for n = 1."""
    d, inner = 0.3, 0.22
    round_, hollow = np.pi / 64 * d**4, np.pi / 64 * (d**4 - inner**4)
    b, h, web, flange = 0.18, 0.4, 0.0086, 0.0135  # IPE 400 without its fillets
    clear, tall, wide = h - 2 * flange, h - flange, b - web
    parts = (b * h**3 - (b - web) * clear**3) / 12, (2 * flange * b**3 + clear * web**3) / 12
    void = (b - 2 * web, clear)
    box = (b * h**3 - void[0] * clear**3) / 12, (h * b**3 - clear * void[0] ** 3) / 12
    rows = {
        "disc": (
            lambda n, cells: Section.disc(d, ONE, (5 * n, 5 * n), cells),
            *(np.pi / 4 * d**2, (round_, round_, 0), 2 * round_, 25),
        ),
        "oblong mesh of a disc": (
            lambda n, cells: Section.disc(d, ONE, (3 * n, 8 * n), cells),
            *(np.pi / 4 * d**2, (round_, round_, 0), 2 * round_, 24),
        ),
        "ring": (
            lambda n, cells: Section.ring(d, (d - inner) / 2, ONE, (n, 12 * n), cells),
            *(np.pi / 4 * (d**2 - inner**2), (hollow, hollow, 0), 2 * hollow, 12),
        ),
        "rectangle": (  # Timoshenko and Goodier, art. 109: 0.229 b t^3 for 2:1
            lambda n, cells: Section.rectangle(0.2, 0.4, ONE, (3 * n, 5 * n), cells),
            *(0.08, (0.2 * 0.4**3 / 12, 0.4 * 0.2**3 / 12, 0), 0.228682 * 0.4 * 0.2**3, 15),
        ),
        "I": (  # thin walls
            lambda n, _: Section.i_shape(h, b, web, flange, ONE, (4 * n, 2 * n, 6 * n)),
            *(2 * b * flange + clear * web, (*parts, 0)),
            *((2 * b * flange**3 + clear * web**3) / 3, 2 * 8 + 12),
        ),
        "box": (  # Bredt: 4 A^2 / sum(l / t) of the middle line
            lambda n, _: Section.box(b, h, web, ONE, flange, (4 * n, 2 * n, 6 * n)),
            *(b * h - void[0] * void[1], (*box, 0)),
            *(4 * (wide * tall) ** 2 / (2 * wide / flange + 2 * tall / web), 2 * 8 + 2 * 12),
        ),
    }
    for name, (outline, holes) in POLYGONS.items():
        exact = outline_moments(outline) - sum(map(outline_moments, holes))

        def make(n, cells, outline=outline, holes=holes):
            return Section.polygon(outline, holes, ONE, 0.02 / n, cells)

        rows[name] = make, exact[0], exact[1:], None, None
    return rows


SHAPES = known()
KINDS = ["quadrilaterals", "triangles"]


@pytest.mark.parametrize("cells", KINDS)
@pytest.mark.parametrize("name", SHAPES)
def test_area_second_moments_and_torsion(name, cells):
    """Exact whatever the cells; those of the fibres as points of second order in their size."""
    make, area, moments, torsion, count = SHAPES[name]
    errors, size = [], max(moments[:2])
    for n in (1, 2, 4):
        section = make(n, cells)
        assert section.area.sum() == pytest.approx(area, rel=1e-13)  # rounding of 1e3 areas
        assert (np.asarray(section.area) > 0).all()
        assert np.allclose(section.inertia(), moments, rtol=EXACT, atol=EXACT * size)
        assert section.counts == (section.n_fibre,) == (len(section.cells),)
        assert section.placed == (count is not None)  # whether its axis is meant
        second = fibre_sums(section)
        errors.append(np.abs(second - moments).max() / size)
        if count:
            parts = 2 if cells == "triangles" and name not in ("I", "box") else 1
            assert section.n_fibre == count * n**2 * parts
            # two axes of symmetry, but not of diagonals that alternate
            assert parts == 2 or abs(second[2]) <= 1e-14 * size
    # strips of a polygon end at its corners, so halving the size halves its cells only nearly
    assert abs(np.log2(errors[-2] / errors[-1]) - 2) < (0.1 if count else 0.25), errors
    assert 1e-5 < errors[-1] < 2e-2  # what linear laws must not have
    if torsion is None:
        assert section.torsion is None
    else:
        digits = 3e-6 if name == "rectangle" else 1e-14
        assert float(section.torsion[0]) == pytest.approx(torsion, rel=digits)


def test_rectangles_moved():
    b, h = 0.2, 0.3
    section = Section.rectangle(b, h, ONE, (6, 10))
    i_y, i_z = b * h**3 / 12, h * b**3 / 12
    # a strip at its centre lacks its own b t^3 / 12
    expected = [i_y * (1 - 1 / 10**2), i_z * (1 - 1 / 6**2)]
    assert np.allclose(fibre_sums(section)[:2], expected, rtol=1e-14)
    moved = section.shifted(0.5, -0.7)
    # parallel axes; the sums differ by rounding
    expected = [i_y + b * h * 0.7**2, i_z + b * h * 0.5**2, -b * h * 0.35]
    assert np.allclose(moved.inertia(), expected, rtol=1e-13)
    assert np.allclose(moved.centroid(), [0.5, -0.7], rtol=1e-13)
    assert np.allclose(moved.centred().inertia(), [i_y, i_z, 0], rtol=EXACT, atol=EXACT * i_y)
    assert np.allclose(moved.points - section.points, [0.5, -0.7], rtol=1e-13)


CORNERS = np.array([[0, 0], [2, 0], [2, 1], [0, 1.0]])


@pytest.mark.slow_cases("cells0", "cells2", "cells3")
@pytest.mark.parametrize(
    "cells", [[[0, 1, 2, 3]], [[0, 3, 2, 1]], [[0, 1, 2], [0, 3, 2]], [[0, 1, 2, 2], [3, 2, 0, 0]]]
)
def test_a_mesh_takes_cells_either_way_round(cells):
    """Triangles and quadrilaterals of known points, and of traced ones."""
    section = Section.mesh(CORNERS, cells, ONE)
    assert section.area.sum() == 2
    # rounding of a centroid
    assert section.area @ section.y == pytest.approx(2.0, rel=1e-15)
    assert section.area @ section.z == pytest.approx(1.0, rel=1e-15)
    area = jax.value_and_grad(lambda points: Section.mesh(points, cells, ONE).total_area)
    value, gradient = traced(area)(CORNERS)
    assert value == 2
    # d(area)/d(point): half the diagonal opposite, turned by a right angle
    assert np.allclose(gradient, [[-0.5, -1], [0.5, -1], [0.5, 1], [-0.5, 1]], rtol=1e-15)


def test_mesh_with_a_law_for_every_cell():
    """Cells are put in order of their laws; forces do not depend on the order given."""
    points = np.array([[y, z] for y in (0.0, 1.0, 2.0, 3.0) for z in (0.0, 1.0)])
    cells = [[0, 2, 3, 1], [2, 4, 5, 3], [4, 6, 7, 5]]
    section = Section.mesh(points, cells, [STIFF, SOFT, STIFF])
    assert section.counts == (2, 1) and section.laws == (STIFF, SOFT)
    assert np.allclose(np.sort(section.y[:2]), [0.5, 2.5]) and section.y[2] == 1.5
    stiffness = section.stiffness()
    ea = 2 * 210e9 + 30e9
    # squares of 1 m: 1/12 about their own axes
    expected = [[ea, 0.5 * ea, -1.5 * ea], [0.5 * ea, ea / 3, -0.75 * ea]]
    last = [-1.5 * ea, -0.75 * ea, 210e9 * (0.5**2 + 2.5**2) + 30e9 * 1.5**2 + ea / 12]
    assert np.allclose(stiffness, [*expected, last], rtol=1e-14)


# --- torsion


def test_torsion_of_rectangles():
    """Timoshenko and Goodier, art. 109: 0.1406 a^4 for a square; long: (1 - 0.6302 t/b) b t^3/3."""
    square, flat, tall, thin = (
        float(Section.rectangle(b, h, ONE, (1, 1)).torsion[0])
        for b, h in ((0.3, 0.3), (0.4, 0.2), (0.2, 0.4), (10.0, 0.01))
    )
    assert square == pytest.approx(0.140577 * 0.3**4, rel=4e-6)  # six digits
    assert tall == flat
    assert thin == pytest.approx(10 * 0.01**3 / 3 * (1 - 0.630249e-3), rel=1e-9)


def test_torsional_stiffness():
    tube = Section.composite([Section.disc(0.28, SOFT), Section.ring(0.3, 0.01, STIFF)])
    exact = np.pi / 32 * (30e9 * 0.28**4 + 210e9 * (0.3**4 - 0.28**4)) / (2 * 1.2)
    # rounding of the difference of fourth powers
    assert float(tube.torsional_stiffness(0.2)) == pytest.approx(exact, rel=1e-13)


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
    with pytest.raises(ValueError, match="this section has no torsion constant: give "):
        box.torsional_stiffness()
    middle = 0.095 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    stated = four_plates(bredt_torsion(middle, 0.01))
    # four products
    assert float(stated.torsion[0]) == pytest.approx(TORSION_OF_BOX, rel=1e-14)
    second = (0.2**4 - 0.18**4) / 12
    assert np.allclose(stated.inertia(), [second, second, 0], rtol=EXACT, atol=EXACT * second)


@pytest.mark.slow
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
    slope = traced(jax.grad(lambda s: bredt_torsion(box, jnp.array([t, s, t, s]))))(s)
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

    @traced
    def torsion(d, y):
        core = Section.disc(d, ONE, (4, 4)).shifted(y=y)
        return Section.composite([tube, core]).torsion

    assert np.allclose(torsion(0.28, 0.0), wall + inner, rtol=EXACT)
    assert np.isnan(torsion(0.28, 1e-3)).all()


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
    stiffness = np.asarray(traced(lambda s: s.centred().stiffness())(section))
    assert np.abs(stiffness[0, 1:]).max() <= 1e-15 * stiffness[0, 0]
    # own 0.1^4 / 12, and 0.15 and 0.05 m of lever
    exact = 1e9 * 0.01 * (0.15**2 + 3 * 0.05**2) + 4e9 * 0.1**4 / 12
    assert stiffness[1, 1] == pytest.approx(exact, rel=EXACT)


def test_a_beam_off_its_centroid_by_chance_is_warned_of():
    section = Section.polygon(CORNER, None, ONE, 0.02)
    text = (
        r"elements\.section: its centroid is at y = 0\.0286842 m, z = 0\.0286842 m, away from the "
        r"axis .*; take section\.centred\(\) to put the axis into the centroid, or section\.shifted"
    )
    with pytest.warns(jc.InputWarning, match=text):
        used(section)
    mesh = Section.mesh([[0, 0], [0.1, 0], [0.1, 0.2], [0, 0.2]], [[0, 1, 2, 3]], ONE)
    with pytest.warns(jc.InputWarning, match=r"y = 0\.05 m, z = 0\.1 m, away from"):
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
    traced(lambda e: used(Section.mesh(mesh.points, [[0, 1, 2, 3]], jc.Elastic(e))).nodes)(1.0)


# --- composites


def test_strand_with_a_soft_core():
    """Core and strand share the strain; the axial law is their weighted sum."""
    strand, core = materials.strand(unloading="reversible"), jc.Elastic(1e9)
    section = Section.composite([Section.disc(0.02, core), Section.ring(0.05, 0.015, strand)])
    areas = np.pi / 4 * np.array([0.02**2, 0.05**2 - 0.02**2])
    e = np.array([-0.01, 0.004, 0.015])

    @traced
    def both(section, e):
        area, law = section.uniaxial()
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
