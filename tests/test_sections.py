"""Fibre sections: closed forms, NumPy fibre sums, equilibrium of a section, its derivatives."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable import materials, status
from jaxcable.sections import Section

ONE = jc.Elastic(1.0)
KINDS = ["quadrilaterals", "triangles"]
STEEL_YIELD = 235e6 / 210e9


def order(errors):
    """Order of convergence under repeated halving, from the last two."""
    return np.log2(errors[-2] / errors[-1])


# --- shapes


@pytest.mark.parametrize("cells", KINDS)
def test_disc(cells):
    d, errors = 0.3, []
    exact = np.pi * d**4 / 64
    for n in (5, 10, 20, 40):
        section = Section.disc(d, ONE, (n, n), cells)
        assert section.n_fibre == n * n * (1 if cells == "quadrilaterals" else 2)
        assert section.area.sum() == pytest.approx(np.pi * d**2 / 4, rel=1e-14)
        second = section.inertia()
        errors.append(np.abs(np.array(second[:2]) - exact).max() / exact)
        assert abs(second[2]) <= 1e-3 * exact  # diagonals alternate, but not in mirror images
    assert abs(order(errors) - 2) < 0.1, errors
    assert errors[1] < 0.02  # 10 x 10 cells
    assert float(section.torsion[0]) == pytest.approx(np.pi * d**4 / 32, rel=1e-14)


@pytest.mark.parametrize("cells", KINDS)
def test_ring(cells):
    d, t, errors = 0.3, 0.04, []
    exact = np.pi / 64 * (d**4 - (d - 2 * t) ** 4)
    for n in (1, 2, 4, 8):
        section = Section.ring(d, t, ONE, (n, 12 * n), cells)
        area = np.pi / 4 * (d**2 - (d - 2 * t) ** 2)
        assert section.area.sum() == pytest.approx(area, rel=1e-14)
        second = np.array(section.inertia())
        errors.append(np.abs(second[:2] - exact).max() / exact)
    assert abs(order(errors) - 2) < 0.1, errors
    assert float(section.torsion[0]) == pytest.approx(2 * exact, rel=1e-14)


@pytest.mark.parametrize("cells", KINDS)
def test_rectangle(cells):
    b, h = 0.2, 0.3
    section = Section.rectangle(b, h, ONE, (6, 10), cells)
    assert section.area.sum() == pytest.approx(b * h, rel=1e-14)
    i_y, i_z, i_yz = (float(v) for v in section.inertia())
    if cells == "quadrilaterals":  # a strip at its centre lacks its own b t^3 / 12: closed form
        assert i_y == pytest.approx(b * h**3 / 12 * (1 - 1 / 10**2), rel=1e-14)
        assert i_z == pytest.approx(h * b**3 / 12 * (1 - 1 / 6**2), rel=1e-14)
    else:  # triangles at their centroids lack less
        assert b * h**3 / 12 * (1 - 1 / 10**2) < i_y < b * h**3 / 12
    assert abs(i_yz) <= 1e-3 * i_y  # as for the disc
    moved = section.shifted(0.5, -0.7)
    # parallel axes; the sums differ by rounding
    expected = [i_y + b * h * 0.7**2, i_z + b * h * 0.5**2, i_yz - b * h * 0.35]
    assert np.allclose(moved.inertia(), expected, rtol=1e-13)
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
        second = section.inertia()
        errors.append([abs(second[0] - i_y) / i_y, abs(second[1] - i_z) / i_z])
        assert abs(second[2]) <= 1e-14 * i_y  # two axes of symmetry
    assert np.abs(order(np.array(errors)) - 2).max() < 0.1, errors
    torsion = (2 * b * flange**3 + (h - 2 * flange) * web**3) / 3  # thin walls
    assert float(section.torsion[0]) == pytest.approx(torsion, rel=1e-14)
    assert section.counts == (section.n_fibre,) and len(section.cells) == section.n_fibre


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
        errors.append(np.abs(np.array(section.inertia()) - exact[1:]).max() / exact[1:3].max())
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
    expected = [[ea, 0.5 * ea, -1.5 * ea], [0.5 * ea, 0.25 * ea, -0.75 * ea]]
    last = [-1.5 * ea, -0.75 * ea, 210e9 * (0.5**2 + 2.5**2) + 30e9 * 1.5**2]
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


# --- composites


def composite_cells(n):
    """Concrete-filled tube; cells of the core and of the wall are halved together."""
    core = Section.disc(0.28, jc.Elastic(33e9), (4 * n, 4 * n))
    return Section.composite([core, Section.ring(0.3, 0.01, jc.Elastic(210e9), (n, 16 * n))])


def test_concrete_filled_tube():
    ea = np.pi / 4 * (33e9 * 0.28**2 + 210e9 * (0.3**2 - 0.28**2))
    ei = np.pi / 64 * (33e9 * 0.28**4 + 210e9 * (0.3**4 - 0.28**4))
    errors = []
    for n in (1, 2, 4, 8):
        section = composite_cells(n)
        stiffness = np.asarray(section.stiffness())
        assert stiffness[0, 0] == pytest.approx(ea, rel=1e-13)  # areas are exact
        errors.append(np.abs(np.diagonal(stiffness)[1:] - ei).max() / ei)
        # two axes of symmetry: the axis is the centroid
        assert np.abs(stiffness - np.diag(np.diagonal(stiffness))).max() <= 1e-13 * ea
        area, law = section.axial()
        assert float(area * law.modulus) == pytest.approx(ea, rel=1e-13)
    assert abs(order(errors) - 2) < 0.1, errors


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
    # each law's torsion constants are added
    assert np.allclose(joined.torsion, [2 * a.torsion[0], b.torsion[0]], rtol=1e-15)


# --- forces from strains


def law_sum(section, strains, stress_of=None):
    """N, My, Mz [n, 3] by a NumPy fibre sum; `stress_of(law, strain)` or the points' curve."""
    y, z, area = (np.asarray(v) for v in (section.y, section.z, section.area))
    e = strains[:, :1] + strains[:, 1:2] * z - strains[:, 2:] * y
    parts = np.split(e, np.cumsum(section.counts)[:-1], axis=1)
    stress = [(stress_of or curve_stress)(*pair) for pair in zip(section.laws, parts, strict=True)]
    force = np.concatenate(stress, axis=1) * area
    return np.stack([force.sum(1), (force * z).sum(1), -(force * y).sum(1)], axis=1)


def curve_stress(law, strain):
    if isinstance(law, jc.Elastic):
        return float(law.E) * strain
    e, s = np.asarray(law.strain), np.asarray(law.stress)
    return np.where((strain >= e[0]) & (strain <= e[-1]), np.interp(strain, e, s), 0.0)


@jax.jit
def forces(section, strains):
    return jnp.stack(section.forces(*strains.T), axis=-1)


@jax.jit
def tangent(section, strain):
    return jax.jacfwd(lambda v: jnp.stack(section.forces(*v)))(strain)


REVERSIBLE = materials.steel(unloading="reversible")
CONCRETE = jc.Polygonal(  # parabola of EN 1992-1-1, 3.1.7, by four points; tension nearly cut off
    [-3.5e-3, -2e-3, -1.5e-3, -1e-3, -5e-4, 0.0, 5e-6, 5e-2],
    [-30e6, -30e6, -28.125e6, -22.5e6, -13.125e6, 0.0, 0.13125e6, 0.15e6],
)
PERFECT = materials.steel(hardening=0.0, unloading="reversible")
SECTIONS = {
    "steel rectangle": Section.rectangle(0.1, 0.2, REVERSIBLE, (6, 8)),
    "concrete-filled tube": Section.composite(
        [
            Section.disc(0.28, CONCRETE, (6, 6)),
            Section.ring(0.3, 0.01, REVERSIBLE, (1, 16)),
        ]
    ),
    "perfectly plastic rectangle": Section.rectangle(0.1, 0.2, PERFECT, (6, 8)),
}


def test_forces_of_an_elastic_section_are_the_fibre_sum():
    section = composite_cells(1).shifted(0.05, -0.02)
    strains = np.random.default_rng(0).normal(size=(20, 3)) * 1e-3
    expected = law_sum(section, strains)
    size = np.abs(expected).max()
    # rounding of sums over 32 fibres
    assert np.abs(forces(section, strains) - expected).max() <= 1e-14 * size
    matrix = tangent(section, strains[0])
    assert np.abs(matrix - matrix.T).max() <= 1e-15 * np.abs(matrix).max()
    assert np.abs(matrix - section.stiffness()).max() <= 1e-15 * np.abs(matrix).max()


@pytest.mark.parametrize("name", SECTIONS)
def test_forces_of_a_nonlinear_section_are_the_fibre_sum(name):
    section = SECTIONS[name]
    strains = np.random.default_rng(1).normal(size=(200, 3)) * [5e-3, 0.1, 0.1]
    got, expected = forces(section, strains), law_sum(section, strains)
    # rounding of stresses E e, up to 10 times the yield stress, in sums over some 50 fibres
    assert np.abs(got - expected).max() <= 1e-13 * np.abs(expected).max()
    at_zero = tangent(section, np.zeros(3))
    # the slope at the origin is that of tension; a sum in another order
    assert np.abs(at_zero - section.stiffness()).max() <= 1e-14 * np.abs(at_zero).max()
    for strain in strains[:5]:
        matrix = np.asarray(tangent(section, strain))
        assert np.abs(matrix - matrix.T).max() <= 1e-14 * np.abs(at_zero).max()


@pytest.mark.parametrize("name", SECTIONS)
def test_energy_and_its_slope(name):
    section = SECTIONS[name]
    strains = np.random.default_rng(2).normal(size=(50, 3)) * [2e-3, 0.05, 0.05]

    @jax.jit
    @jax.vmap
    def energy(v):
        return jax.grad(lambda v: section.energy(*v))(v)

    expected = law_sum(section, strains)
    assert np.abs(energy(strains) - expected).max() <= 1e-13 * np.abs(expected).max()  # as above


def test_fibre_strains_and_stresses_have_a_last_axis_of_fibres():
    section = SECTIONS["concrete-filled tube"]
    e0, ky, kz = strains = np.random.default_rng(3).normal(size=(3, 2, 5)) * 1e-3

    @jax.jit
    def all_of(section, v):
        return section.fibre_strain(*v), section.fibre_stress(*v), section.forces(*v)

    strain, stress, force = all_of(section, strains)
    assert strain.shape == stress.shape == (2, 5, section.n_fibre)
    assert [f.shape for f in force] == [(2, 5)] * 3
    expected = e0[1, 2] + ky[1, 2] * np.asarray(section.z) - kz[1, 2] * np.asarray(section.y)
    assert np.abs(strain[1, 2] - expected).max() <= 1e-18  # rounding of strains of 1e-3
    single = jax.eval_shape(all_of, section, np.zeros(3))
    assert single[0].shape == single[1].shape == (section.n_fibre,)
    assert [v.shape for v in single[2]] == [()] * 3
    virgin = Section.rectangle(1.0, 1.0, materials.steel(), (2, 3)).virgin((4,))
    assert [p.shape for p in virgin] == [(4, 6, 1)]


def test_distance_of_the_nearest_fibre_from_a_corner():
    section = SECTIONS["concrete-filled tube"]
    strains = np.random.default_rng(4).normal(size=(30, 3)) * [1e-3, 5e-3, 5e-3]
    got = jax.jit(lambda v: section.corner_distance(*v.T))(strains)
    y, z = np.asarray(section.y), np.asarray(section.z)
    e = strains[:, :1] + strains[:, 1:2] * z - strains[:, 2:] * y
    each = [
        np.abs(part[:, :, None] - np.asarray(law.strain)).min((1, 2))
        for law, part in zip(section.laws, np.split(e, [section.counts[0]], axis=1), strict=True)
    ]
    assert np.abs(got - np.minimum(*each)).max() <= 1e-17  # roundings of strains of 0.05


# --- plasticity in closed form


def test_moment_of_an_elastic_plastic_rectangle():
    """M = My (1.5 - 0.5 (k_y / k)^2), perfectly plastic; second order in the fibre size."""
    b, h = 0.1, 0.2
    first = b * h**2 / 6 * 235e6  # moment at first yield
    ratio = np.array([1.5, 2.0, 3.0, 5.0, 8.0])  # k / k_y
    exact = first * (1.5 - 0.5 / ratio**2)
    errors = []
    for n in (20, 40, 80, 160):
        section = Section.rectangle(b, h, PERFECT, (1, n))
        k = ratio * STEEL_YIELD / (h / 2)
        got = forces(section, np.column_stack([np.zeros(5), k, np.zeros(5)]))
        assert np.abs(got[:, 0]).max() <= 1e-9 * first / h  # no axial force: rounding
        # the error of one curvature jumps with the place of the last elastic fibre: their largest
        errors.append(np.abs(got[:, 1] - exact).max() / first)
        assert errors[-1] <= 0.5 / (n / 2 * 1.0) ** 2 * ratio.max()
    assert abs(np.polyfit(np.log([20, 40, 80, 160]), np.log(errors), 1)[0] + 2) < 0.3, errors


LONG = jc.Polygonal([-1, -STEEL_YIELD, 0, STEEL_YIELD, 1], [-235e6, -235e6, 0, 235e6, 235e6])


def test_plastic_moment_of_a_rectangle():
    """b h^2 s_y / 4: exact for a sum over fibres of which all have yielded."""
    b, h = 0.1, 0.2
    section = Section.rectangle(b, h, LONG, (1, 50))
    # the innermost fibre, h / 100 from the axis, yields at 50 times first yield
    k = np.array([[0.0, 50.5 * STEEL_YIELD / (h / 2), 0.0]])
    assert forces(section, k)[0, 1] == pytest.approx(b * h**2 / 4 * 235e6, rel=1e-13)


# --- equilibrium of the section


@jax.jit
def solve(section, target):
    return section.strains(*target.T)


def feasible(section, n=1000, seed=5):
    """Random strains up to just before the end of the first fibre, most of them small."""
    rng = np.random.default_rng(seed)
    y, z = np.asarray(section.y), np.asarray(section.z)
    size = max(np.abs(y).max(), np.abs(z).max())
    way = rng.normal(size=(n, 3))
    way = way / np.linalg.norm(way, axis=1, keepdims=True) / [1, size, size]
    rate = way[:, :1] + way[:, 1:2] * z - way[:, 2:] * y
    reach = np.inf
    parts = np.split(rate, np.cumsum(section.counts)[:-1], axis=1)
    for law, part in zip(section.laws, parts, strict=True):
        end = np.where(part > 0, float(law.strain[-1]), float(law.strain[0]))
        reach = np.minimum(reach, (end / part).min(1))
    return way * (0.999 * reach * 10 ** rng.uniform(-2.5, 0, n))[:, None]


def sizes(section):
    """Sums of largest forces of the fibres: N, and moments about y and z."""
    largest = [np.abs(law.stress).max() for law in section.laws]
    force = np.repeat(largest, section.counts) * np.asarray(section.area)
    lever = np.abs([np.asarray(section.z), np.asarray(section.y)])
    return np.array([force.sum(), *(force * lever).sum(1)])


def least_stiffness(section, strains):
    """Smallest eigenvalue of the tangent relative to that of the unused section, per strain."""
    y, z, area = (np.asarray(v) for v in (section.y, section.z, section.area))
    radius = np.sqrt([(area * z**2).sum() / area.sum(), (area * y**2).sum() / area.sum()])
    lever = np.stack([np.ones_like(y), z / radius[0], -y / radius[1]], axis=1)
    e = strains @ (lever * [1, *radius]).T

    def least(modulus):
        return np.linalg.eigvalsh(np.einsum("nf,fi,fj->nij", modulus * area, lever, lever))[:, 0]

    moduli, initial = [], []
    parts = np.split(e, np.cumsum(section.counts)[:-1], axis=1)
    for law, part in zip(section.laws, parts, strict=True):
        slopes = np.diff(law.stress) / np.diff(law.strain)
        moduli.append(slopes[np.clip(np.searchsorted(law.strain, part) - 1, 0, len(slopes) - 1)])
        initial.append(np.full_like(part, slopes.max()))
    return least(np.concatenate(moduli, 1)) / least(np.concatenate(initial, 1))


@functools.cache
def solved(name):
    """All of one section in one batch: 1000 feasible forces, 100 infeasible, the surface twice."""
    section = SECTIONS[name]
    strains = feasible(section)
    inside = law_sum(section, strains)
    # beyond what all fibres together can carry, whatever the strains
    outside = 1.01 * inside[:100] / (np.abs(inside[:100]) / sizes(section)).max(1, keepdims=True)
    surface = jax.jit(lambda s: s.interaction(n_angle=10, n_axial=11))(section)
    surface = np.stack([np.asarray(v).ravel() for v in surface], axis=1)
    target = np.concatenate([inside, outside, 0.999 * surface, 1.001 * surface])
    state = jax.tree.map(np.asarray, solve(section, target))
    return strains, target, surface, np.stack(state.strain, axis=1), state


@pytest.mark.parametrize("name", SECTIONS)
def test_equilibrium_of_random_forces(name):
    section = SECTIONS[name]
    strains, target, _, found, state = solved(name)
    target, found = target[:1000], found[:1000]
    assert (state.status[:1000] == status.OK).all()
    # 64 eps of the forces of all fibres is what the iteration ends at
    error = np.abs(law_sum(section, found) - target) / sizes(section)
    assert error.max() <= 1e-10
    # Strains are no better than the forces over the tangent. Without a stiff part, or with one on
    # a single line of fibres, a perfectly plastic section has no unique strains at all.
    y, z = np.asarray(section.y), np.asarray(section.z)
    e = strains[:, :1] + strains[:, 1:2] * z - strains[:, 2:] * y
    elastic = (np.abs(e) < STEEL_YIELD) @ np.asarray(section.area) / np.sum(section.area)
    firm = (elastic >= 0.1) & (least_stiffness(section, strains) > 1e-6)
    assert firm.sum() > 600
    size = max(np.abs(y).max(), np.abs(z).max())
    error = np.abs(found - strains)[firm] * [1, size, size] / STEEL_YIELD
    assert error.max() <= 1e-10
    assert (state.steps[:1000] <= 20).all()


@pytest.mark.parametrize("name", SECTIONS)
def test_forces_beyond_the_capacity(name):
    *_, found, state = solved(name)
    assert (state.status[1000:1100] == status.BEYOND_CAPACITY).all()
    assert np.isnan(found[1000:1100]).all()


@pytest.mark.parametrize("name", SECTIONS)
def test_interaction_surface_is_the_limit_of_equilibrium(name):
    """For laws that rise: a thousandth inside there is equilibrium, a thousandth outside none."""
    _, _, surface, _, state = solved(name)
    assert np.isfinite(surface).all() and len(surface) == 110
    assert (state.status[1100:1210] == status.OK).all()
    assert (state.status[1210:] == status.BEYOND_CAPACITY).all()


def test_interaction_of_a_perfectly_plastic_rectangle():
    """(N / Np)^2 + |M| / Mp = 1, within the error of fibres that pass through yield."""
    b, h, n = 0.1, 0.2, 40
    section = Section.rectangle(b, h, LONG, (1, n))
    force, about_y, _ = jax.jit(lambda s: s.interaction(n_angle=2, n_axial=41))(section)
    n_p, m_p = b * h * 235e6, b * h**2 / 4 * 235e6
    sum_ = (force[:, 0] / n_p) ** 2 + jnp.abs(about_y[:, 0]) / m_p
    # at the neutral axis one fibre of n is cut: an error of half its share in N, and of its
    # square in M; N / Np is at most 1
    assert np.abs(sum_ - 1).max() <= 2 / n
    assert np.ptp(force[:, 0]) > 1.99 * n_p  # from compression to tension


def test_law_without_compression_does_not_bound_compression():
    section = Section.rectangle(0.1, 0.1, materials.strand(), (2, 2))
    surface = np.stack(jax.jit(lambda s: s.interaction(n_angle=4, n_axial=5))(section), axis=-1)
    assert np.isinf(surface[0]).all() and np.isfinite(surface[1:]).all()


def test_single_precision_stays_single():
    section = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), SECTIONS["steel rectangle"])
    target = (0.5 * sizes(SECTIONS["steel rectangle"]) * [0.3, 0.5, 0.2]).astype(np.float32)
    state = jax.jit(lambda s, t: s.strains(*t))(section, target)
    assert int(state.status) == status.OK
    assert {v.dtype for v in state.strain} == {jnp.dtype("float32")}
    strain = np.array([state.strain], float)
    error = law_sum(SECTIONS["steel rectangle"], strain) - target
    # 64 eps of float32 is 8e-6
    assert (np.abs(error) / sizes(SECTIONS["steel rectangle"])).max() <= 2e-5


# --- derivatives of the strains

FORCES = np.array([0.2, 0.55, 0.3])  # parts of the capacities; fibres yield at two corners


def parameters(width=0.1, height=0.2):
    e, s = np.asarray(REVERSIBLE.strain), np.asarray(REVERSIBLE.stress)
    return {
        "force": FORCES * sizes(Section.rectangle(width, height, REVERSIBLE, (4, 5))),
        "width": np.array(width),
        "height": np.array(height),
        "strain": e,
        "stress": s,
    }


def scaled_strains(change):
    """Strains times (1, height, width) of a rectangle; its 15 parameters are changed by parts."""
    start = parameters()
    factor = 1 + change
    force = start["force"] * factor[:3]
    width, height = start["width"] * factor[3], start["height"] * factor[4]
    law = jc.Polygonal(start["strain"] * factor[5:10], start["stress"] * factor[10:])
    state = Section.rectangle(width, height, law, (4, 5)).strains(*force)
    strain = jnp.stack(state.strain) * jnp.array([1, start["height"], start["width"]])
    return strain / STEEL_YIELD, state.status


def curvature(change):
    return scaled_strains(change)[0][1]


@jax.jit
def values(changes):
    return jax.vmap(scaled_strains)(changes)


@jax.jit
def forward(change):
    return jax.jacfwd(lambda c: scaled_strains(c)[0])(change)


@jax.jit
def backward(change):
    """Gradient and Hessian of the curvature."""
    return jax.grad(curvature)(change), jax.hessian(curvature)(change)


START = np.zeros(15)


def test_taylor_of_the_strains():
    """With respect to forces, width, height and all points of the curve."""
    steps = 1e-4 * 0.5 ** np.arange(4)
    direction = np.random.default_rng(6).normal(size=15)
    found, codes = (np.asarray(v) for v in values(np.append(0.0, steps)[:, None] * direction))
    assert (codes == status.OK).all()
    jacobian = np.asarray(forward(START))
    # everything moves them but the origin and the ends of the curve in compression and tension
    assert (np.abs(jacobian).max(0) > 1e-3).sum() >= 9
    for k in range(3):

        def slope(row, k=k):
            remainder = np.abs(found[1:, k] - found[0, k] - steps * (row @ direction))
            return np.polyfit(np.log(steps), np.log(remainder), 1)[0]

        assert abs(slope(jacobian[k]) - 2) < 0.1
        # negative control: the entry of the largest effect off by a hundredth
        wrong = jacobian[k].copy()
        wrong[np.argmax(np.abs(wrong * direction))] *= 1.01
        assert slope(wrong) < 1.5


def test_derivatives_of_the_strains_against_differences():
    h = 1e-5
    found = np.asarray(values(h * np.concatenate([np.eye(15), -np.eye(15)]))[0])
    difference = (found[:15] - found[15:]).T / (2 * h)
    jacobian = np.asarray(forward(START))
    # truncation: h^2 = 1e-10 times a third derivative, and rounding 1e-13 / h
    assert np.abs(difference - jacobian).max() <= 1e-7 * np.abs(jacobian).max()
    gradient, second = (np.asarray(v) for v in backward(START))
    # both modes are the same sums, through a matrix of condition 100
    assert np.abs(gradient - jacobian[1]).max() <= 1e-10 * np.abs(jacobian).max()
    assert np.abs(second - second.T).max() <= 1e-9 * np.abs(second).max()
    for direction in np.random.default_rng(7).normal(size=(2, 15)):
        plus, minus = (np.asarray(forward(s * h * direction))[1] for s in (1, -1))
        expected = (plus - minus) / (2 * h)
        assert np.abs(second @ direction - expected).max() <= 1e-6 * np.abs(second).max()


def test_strains_are_the_inverse_of_forces():
    """At a point away from corners the Jacobian is the inverse of the tangent."""
    section = Section.rectangle(0.1, 0.2, REVERSIBLE, (4, 5))
    scale = STEEL_YIELD / np.array([1, 0.2, 0.1])
    strain = np.asarray(values(START[None])[0][0]) * scale
    y, z = np.asarray(section.y), np.asarray(section.z)
    e = np.abs(strain[0] + strain[1] * z - strain[2] * y)
    # far enough from a corner for the steps of all tests above; some fibres yield
    assert np.abs(e / STEEL_YIELD - 1).min() > 5e-3
    assert 3 < np.count_nonzero(e > STEEL_YIELD) < 17
    jacobian = np.asarray(forward(START))[:, :3] * scale[:, None] / parameters()["force"]
    product = jacobian @ np.asarray(tangent(section, strain))
    # in units of the strains of the tests above: rounding times the condition of the matrix, 100
    assert np.abs(product / scale[:, None] * scale - np.eye(3)).max() <= 1e-11


@pytest.mark.parametrize("shape", ["disc", "tube"])
def test_derivative_with_respect_to_the_diameter(shape):
    target = jnp.array([2e5, 8e4, 3e4]) * (1.0 if shape == "disc" else 0.5)

    def of_diameter(d):
        if shape == "disc":
            section = Section.disc(d, REVERSIBLE, (4, 4))
        else:
            section = Section.ring(d, 0.1 * d, REVERSIBLE, (1, 12))
        state = section.strains(*target)
        return state.strain[1], state.status

    f = jax.jit(jax.value_and_grad(of_diameter, has_aux=True))
    (_, code), slope = f(0.15)
    h = 1e-6
    difference = (f(0.15 + h)[0][0] - f(0.15 - h)[0][0]) / (2 * h)
    assert int(code) == status.OK
    # truncation (h / d)^2 and rounding eps d / h
    assert float(slope) == pytest.approx(float(difference), rel=1e-7)


def test_failed_states_have_nan_derivatives_and_leave_others_alone():
    section = SECTIONS["steel rectangle"]
    good = FORCES * sizes(section)
    batch = np.stack([good, 5 * good, good])

    @jax.jit
    @jax.grad
    def gradient(scale, weights):
        state = section.strains(*(scale * batch).T)
        return weights @ jnp.where(jnp.isnan(state.strain[1]) & (weights == 0), 0, state.strain[1])

    every, others = (gradient(1.0, np.array(w)) for w in ([1.0, 1.0, 1.0], [1.0, 0.0, 1.0]))
    assert np.isnan(every) and np.isfinite(others) and others > 0


def test_zero_forces_and_too_few_iterations():
    section = SECTIONS["steel rectangle"]
    target = np.stack([np.zeros(3), 0.9 * FORCES * sizes(section)])
    state = jax.jit(lambda t: section.strains(*t.T, max_steps=1))(target)
    assert state.status.tolist() == [status.OK, status.NOT_CONVERGED]
    assert state.steps.tolist() == [0, 1]
    strain = np.stack(state.strain, axis=1)
    assert (strain[0] == 0).all() and np.isnan(strain[1]).all()


# --- history


def kinematic(E, tangent, yield_stress):
    """State and update of bilinear kinematic hardening by return mapping, for many fibres."""
    H = E * tangent / (E - tangent)

    def update(strain, plastic):
        over = E * (strain - plastic) - H * plastic
        flow = np.maximum(0.0, np.abs(over) - yield_stress) / (E + H)
        plastic = plastic + np.sign(over) * flow
        return E * (strain - plastic), plastic

    return update


CYCLE = 0.05 * np.concatenate(
    [np.linspace(0, 1, 8)[1:], np.linspace(1, -1, 15)[1:], np.linspace(-1, 0.6, 12)[1:]]
)


def test_moment_cycle_against_a_fibre_simulation():
    """Both axes and a constant elongation; every increment settles."""
    section = Section.rectangle(0.1, 0.2, materials.steel(), (3, 8))
    y, z, area = (np.asarray(v) for v in (section.y, section.z, section.area))
    strains = np.column_stack([np.full(len(CYCLE), 5e-4), CYCLE, 0.4 * CYCLE])

    def increment(plastic, v):
        force = jnp.stack(section.forces(*v, plastic))
        settled = section.settle(*v, plastic)
        return settled, (force, jnp.stack(section.forces(*v, settled)))

    _, (got, again) = jax.jit(lambda s: jax.lax.scan(increment, section.virgin(), s))(strains)
    update, plastic, expected = kinematic(210e9, 2.1e9, 235e6), np.zeros(section.n_fibre), []
    for e0, ky, kz in strains:
        stress, plastic = update(e0 + ky * z - kz * y, plastic)
        expected.append([(stress * area).sum(), (stress * area) @ z, -(stress * area) @ y])
    size = sizes(section)
    # rounding of stresses E e, 5 times yield, over 32 increments
    assert (np.abs(got - np.array(expected)) / size).max() <= 1e-13
    assert (np.abs(again - got) / size).max() <= 1e-13
    # the cycle dissipates: a moment of the other sign is left when the curvature is zero again
    back = np.argmin(np.abs(CYCLE[10:])) + 10
    assert got[back, 1] < -0.3 * size[1]


def test_strains_at_given_plastic_strains():
    """Unloading to no force leaves the residual curvature; forces come back with the strains."""
    section = Section.rectangle(0.1, 0.2, materials.steel(), (3, 8))
    bent = np.array([5e-4, 0.04, 0.015])
    update = kinematic(210e9, 2.1e9, 235e6)
    y, z, area = (np.asarray(v) for v in (section.y, section.z, section.area))
    stress, plastic = update(bent[0] + bent[1] * z - bent[2] * y, np.zeros(section.n_fibre))
    # of the parallel part, which yields alone: E ep = (E - Et) p
    state = (jnp.asarray(plastic)[:, None] * 210e9 / (210e9 - 2.1e9),)

    @jax.jit
    def strains(target):
        found = section.strains(*target, state)
        return jnp.stack(found.strain), found.status

    target = np.array([(stress * area).sum(), (stress * area) @ z, -(stress * area) @ y])
    for factor in (1.0, 0.5, 0.0):
        found, code = strains(factor * target)
        assert int(code) == status.OK
        trial, _ = update(found[0] + found[1] * z - found[2] * y, plastic)
        left = np.array([(trial * area).sum(), (trial * area) @ z, -(trial * area) @ y])
        # 64 eps of the forces of all fibres
        assert (np.abs(left - factor * target) / sizes(section)).max() <= 1e-12
    assert 0.5 * bent[1] < found[1] < bent[1]


def test_strains_of_a_batch_do_not_forget_the_plastic_strains():
    """One state for many forces: either taken into account or refused, never ignored."""
    section = Section.rectangle(0.1, 0.2, materials.steel(), (1, 2))
    p = 0.01 - STEEL_YIELD  # all fibres pulled to 0.01
    state = (np.full((2, 1), p),)
    try:
        found = jax.jit(lambda t: section.strains(*t, state).strain[0])(
            np.array([[1e6], [0.0], [0.0]])
        )
    except ValueError as error:
        assert "plastic" in str(error)
    else:
        # unloading: E e - (E - Et) p = N / A
        expected = (1e6 / 0.02 + (210e9 - 2.1e9) * p) / 210e9
        assert float(found[0]) == pytest.approx(expected, rel=1e-12)


def test_section_without_width_resists_what_it_can():
    """One column of fibres: no stiffness about z, so neither moment nor derivative there."""
    section = Section.rectangle(0.1, 0.2, REVERSIBLE, (1, 10))

    @jax.jit
    def strains(target):
        state = section.strains(*target)
        return jnp.stack(state.strain)[:2], state.status

    target = np.array([1e6, 2e5, 0.0])
    found, code = strains(target)
    assert int(code) == status.OK
    got = law_sum(section, np.array([[*found, 0.0]]))[0]
    assert (np.abs(got - target)[:2] / sizes(section)[:2]).max() <= 1e-12  # 64 eps of the forces
    assert int(strains(np.array([1e6, 0.0, 1e3]))[1]) != status.OK


# --- what is refused

SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1.0]]
BAD = {
    "diameter": (lambda: Section.disc(-0.1, ONE), "diameter = -0.1: must be positive"),
    "disc shape": (
        lambda: Section.disc(0.1, ONE, (0, 5)),
        r"shape = \(0, 5\): expected 2 integers",
    ),
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
