"""Forces of a section from its strains: NumPy fibre sums, closed forms, history."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.laws import kinematic
from oracles.fibres import (
    LONG,
    SECTIONS,
    STEEL_YIELD,
    composite_cells,
    forces,
    law_sum,
    sizes,
    tangent,
)
from oracles.traced import traced

import jaxcable as jc
from jaxcable import materials
from jaxcable.common import status
from jaxcable.sections import Section

ONE = jc.Elastic(1.0)

# --- forces from strains


def test_forces_of_an_elastic_section_are_exact():
    """Circles by pi d^4 / 64 and parallel axes, whatever the mesh; and its energy."""
    y, z = 0.05, -0.02
    section = composite_cells(1).shifted(y, z)
    parts = [(33e9, 0.28, 0.0), (210e9, 0.3, 0.28)]
    ea = sum(E * np.pi / 4 * (d**2 - i**2) for E, d, i in parts)
    ei = sum(E * np.pi / 64 * (d**4 - i**4) for E, d, i in parts)
    lever = np.array([1.0, z, -y])
    expected = ea * np.outer(lever, lever) + np.diag([0.0, ei, ei])
    matrix = tangent(section, np.array([1e-4, 2e-3, -3e-3]))
    # rounding of sums over 32 fibres
    assert np.abs(matrix - expected).max() <= 1e-14 * ea
    assert np.abs(matrix - matrix.T).max() <= 1e-15 * np.abs(matrix).max()
    assert np.abs(matrix - section.stiffness()).max() <= 1e-15 * np.abs(matrix).max()
    strains = np.random.default_rng(0).normal(size=(20, 3)) * 1e-3
    force = strains @ expected
    assert np.abs(forces(section, strains) - force).max() <= 1e-14 * np.abs(force).max()
    energy, slope = traced(jax.vmap(jax.value_and_grad(lambda v: section.energy(*v))))(strains)
    assert np.allclose(energy, 0.5 * np.sum(strains * force, axis=1), rtol=1e-13)
    assert np.abs(slope - force).max() <= 1e-14 * np.abs(force).max()
    found, own = traced(lambda v: section.forces_and_tangent(*v.T))(strains)
    assert np.abs(found - force).max() <= 1e-14 * np.abs(force).max()
    assert np.abs(own - expected[None]).max() <= 1e-14 * ea


def test_exact_inertia_is_differentiable():
    """d(EI)/d(diameter) of a tube and a disc, by traced dimensions: pi (d^3 - d_i^3) / 16."""

    @traced
    @jax.jacrev
    def slopes(d):
        both = Section.ring(d, 0.01, ONE, (1, 6)), Section.disc(d, ONE, (2, 2))
        return jnp.stack([section.stiffness()[1, 1] for section in both])

    # sums over cells, of which fourth powers cancel to a tenth
    expected = np.pi / 16 * np.array([0.3**3 - 0.28**3, 0.3**3])
    np.testing.assert_allclose(slopes(0.3), expected, rtol=1e-12)


@traced
def all_of(section, strains):
    """Forces, slope of the energy, forces again with their tangents."""
    slope = jax.vmap(jax.grad(lambda v: section.energy(*v)))(strains)
    force, tangents = section.forces_and_tangent(*strains.T)
    return jnp.stack(section.forces(*strains.T), axis=-1), slope, force, tangents


@pytest.mark.parametrize("name", SECTIONS)
def test_forces_of_a_nonlinear_section_are_the_fibre_sum(name):
    """And the slope of its energy; its tangent is the derivative of its forces."""
    section = SECTIONS[name]
    strains = np.random.default_rng(1).normal(size=(200, 3)) * [5e-3, 0.1, 0.1]
    *found, tangents = all_of(section, strains)
    expected = law_sum(section, strains)
    for force in found:
        # rounding of stresses E e, up to 10 times the yield stress, in sums over some 50 fibres
        assert np.abs(force - expected).max() <= 1e-13 * np.abs(expected).max()
    at_zero = tangent(section, np.zeros(3))
    # the slope at the origin is that of tension; a sum in another order
    assert np.abs(at_zero - section.stiffness()).max() <= 1e-14 * np.abs(at_zero).max()
    for strain, own in zip(strains[:5], tangents, strict=False):
        matrix = np.asarray(tangent(section, strain))
        assert np.abs(matrix - matrix.T).max() <= 1e-14 * np.abs(at_zero).max()
        assert np.abs(matrix - own).max() <= 1e-14 * np.abs(at_zero).max()


def test_distance_of_the_nearest_fibre_from_a_corner():
    section = SECTIONS["concrete-filled tube"]
    strains = np.random.default_rng(4).normal(size=(30, 3)) * [1e-3, 5e-3, 5e-3]
    got = traced(lambda v: section.corner_distance(*v.T))(strains)
    y, z = np.asarray(section.y), np.asarray(section.z)
    e = strains[:, :1] + strains[:, 1:2] * z - strains[:, 2:] * y
    each = [
        np.abs(part[:, :, None] - np.asarray(law.strain)).min((1, 2))
        for law, part in zip(section.laws, np.split(e, [section.counts[0]], axis=1), strict=True)
    ]
    assert np.abs(got - np.minimum(*each)).max() <= 1e-17  # roundings of strains of 0.05


# --- plasticity in closed form


def test_moment_of_an_elastic_plastic_rectangle():
    """M = My (1.5 - 0.5 (k_y / k)^2), perfectly plastic; second order in the fibre size.

    At last b h^2 s_y / 4, exact for a sum over fibres of which all have yielded.
    """
    b, h, numbers = 0.1, 0.2, (20, 40, 80)
    first = b * h**2 / 6 * 235e6  # moment at first yield
    ratio = np.array([1.5, 2.0, 3.0, 5.0, 8.0])  # k / k_y
    curvature = np.outer(ratio * STEEL_YIELD / (h / 2), [0, 1, 0])
    exact = first * (1.5 - 0.5 / ratio**2)
    errors = []
    for n in numbers:
        got = forces(Section.rectangle(b, h, LONG, (1, n)), curvature)
        assert np.abs(got[:, 0]).max() <= 1e-9 * first / h  # no axial force: rounding
        # the error of one curvature jumps with the place of the last elastic fibre: their largest
        errors.append(np.abs(got[:, 1] - exact).max() / first)
        assert errors[-1] <= 0.5 / (n / 2 * 1.0) ** 2 * ratio.max()
    assert abs(np.polyfit(np.log(numbers), np.log(errors), 1)[0] + 2) < 0.3, errors
    # the innermost fibre, h / 2 n from the axis, yields at n times first yield
    got = forces(Section.rectangle(b, h, LONG, (1, n)), curvature / ratio[0] * (n + 0.5))
    assert float(got[0, 1]) == pytest.approx(b * h**2 / 4 * 235e6, rel=1e-13)


# --- history


CYCLE = 0.05 * np.concatenate(
    [np.linspace(0, 1, 8)[1:], np.linspace(1, -1, 15)[1:], np.linspace(-1, 0.6, 12)[1:]]
)


def test_moment_cycle_against_a_fibre_simulation():
    """Both axes and a constant elongation; every increment settles."""
    section = Section.rectangle(0.1, 0.2, materials.steel(), (3, 8))
    y, z, area = (np.asarray(v) for v in (section.y, section.z, section.area))
    strains = np.column_stack([np.full(len(CYCLE), 5e-4), CYCLE, 0.4 * CYCLE])

    def increment(memory, v):
        force = jnp.stack(section.forces(*v, memory))
        settled = section.commit_memory(*v, memory)
        return settled, (force, jnp.stack(section.forces(*v, settled)))

    start = section.initial_memory()
    _, (got, again) = traced(lambda s: jax.lax.scan(increment, start, s))(strains)
    update, memory, expected = kinematic(210e9, 2.1e9, 235e6), np.zeros(section.n_fibre), []
    for e0, ky, kz in strains:
        stress, memory = update(e0 + ky * z - kz * y, memory)
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
    stress, memory = update(bent[0] + bent[1] * z - bent[2] * y, np.zeros(section.n_fibre))
    # of the parallel part, which yields alone: E ep = (E - Et) p
    state = (jnp.asarray(memory)[:, None] * 210e9 / (210e9 - 2.1e9),)

    @traced
    def strains(target):
        found = section.strains(*target, state)
        return jnp.stack(found.strain), found.status

    target = np.array([(stress * area).sum(), (stress * area) @ z, -(stress * area) @ y])
    for factor in (1.0, 0.5, 0.0):
        found, code = strains(factor * target)
        assert int(code) == status.OK
        trial, _ = update(found[0] + found[1] * z - found[2] * y, memory)
        left = np.array([(trial * area).sum(), (trial * area) @ z, -(trial * area) @ y])
        # 64 eps of the forces of all fibres
        assert (np.abs(left - factor * target) / sizes(section)).max() <= 1e-12
    assert 0.5 * bent[1] < found[1] < bent[1]


def test_strains_of_a_batch_do_not_forget_the_plastic_strains():
    """One memory for many forces, or one for each of them."""
    section = Section.rectangle(0.1, 0.2, materials.steel(), (1, 2))
    p, force = 0.01 - STEEL_YIELD, np.array([1e6, -1e6])  # all fibres pulled to 0.01
    one, each = (np.full((2, 1), p),), (np.full((2, 2, 1), [[[p]], [[0.0]]]),)
    found = traced(lambda m: section.strains(force, 0 * force, 0 * force, m).strain[0])
    # unloading: E e - (E - Et) p = N / A
    for memory, left in ((one, [p, p]), (each, [p, 0.0])):
        expected = (force / 0.02 + (210e9 - 2.1e9) * np.array(left)) / 210e9
        np.testing.assert_allclose(found(memory), expected, rtol=1e-12)


def test_own_second_moments_of_a_fibre_are_moved_to_the_axis():
    """A right triangle as one fibre, legs b along y and h along z, by parallel axes."""
    b, h, y, z, area = 0.3, 0.2, 0.01, -0.02, 0.03
    own = np.array([b * h**3 / 36, h * b**3 / 36, -(b**2) * h**2 / 72])
    one = Section([y], [z], [area], jc.Elastic(2e9), own=own[None])
    i_y, i_z, i_yz = own + area * np.array([z * z, y * y, y * z])
    rows = [[area, area * z, -area * y], [area * z, i_y, -i_yz], [-area * y, -i_yz, i_z]]
    # a few roundings
    assert np.allclose(one.stiffness(), 2e9 * np.array(rows), rtol=1e-14)
