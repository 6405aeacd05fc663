"""Shear flexibility of beams: closed forms, locking, a rod by shooting, columns, fibre sections."""

import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import beam
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import jaxcable as jc
from jaxcable.common.tree import copy_with

LENGTH = 2.0
EA, EIY, EIZ, GJ, GAY, GAZ = 8e7, 8e4, 3e4, 6e4, 2e6, 5e5
SECTION = jc.Section.linear(EA, EIY, EIZ, GJ, GAY, GAZ)
SMALL = 1e-3
"""Forces, N, that deflect by 1e-8 of the length: what is not linear is below 1e-15."""
CURVE = jc.Polygonal([-0.05, -2e-3, 0.0, 2e-3, 0.05], [-580e6, -420e6, 0.0, 420e6, 580e6])


def line(n, section=SECTION, length=LENGTH, supports=None, **options):
    return beam(n, section, length, supports, **options)


def solved(structure, loads, **options):
    return converged(jc.solve(structure, jc.Phase(loads=loads, **options)))


def rotation_of(solution, node):
    """Rotation vector of a node, rad."""
    return Rotation.from_quat(np.asarray(solution.rotation[node]), scalar_first=True).as_rotvec()


# --- linear theory, exact with the fewest elements; rounding of some 1e-13 is divided by 1e-8


FORCE = (0.0, SMALL, -2 * SMALL)
# a load, and of a unit of it: bending times EI, shear times GA, rotation times EI, moment
ON_CANTILEVER = {
    "tip": (jc.NodalLoads([1], FORCE), LENGTH**3 / 3, LENGTH, LENGTH**2 / 2, LENGTH),
    "uniform": (jc.LineLoads(FORCE), LENGTH**4 / 8, LENGTH**2 / 2, LENGTH**3 / 6, LENGTH**2 / 2),
}


@pytest.mark.parametrize("load", ON_CANTILEVER)
def test_a_cantilever_of_one_element(load):
    """P L^3 / 3 EI + P L / GA in both planes, each with its own EI and GA."""
    loads, bent, sheared, turned, moment = ON_CANTILEVER[load]
    solution = solved(line(1), loads)
    expected = [bent / EIZ + sheared / GAY, -2 * (bent / EIY + sheared / GAZ)]
    assert solution.displacement[1, 1:] == pytest.approx(SMALL * np.array(expected), rel=1e-9)
    expected = SMALL * turned * np.array([2 / EIY, 1 / EIZ])
    assert rotation_of(solution, 1)[1:] == pytest.approx(expected, rel=1e-9)
    assert solution.reaction_moments[0, 1] == pytest.approx(-2 * SMALL * moment, rel=1e-9)


def test_slender_and_stocky_beams_do_not_lock():
    """A clamped beam of two elements whose length is 1 to 1000 times its depth of 1 m."""
    E, G = 30e9, 12.5e9
    for length in (1.0, 10.0, 100.0, 1000.0):
        I, GA, force = 1 / 12, 5 / 6 * G, 1 / length**2  # no membrane forces
        section = jc.Section.linear(E, E * I, E * I, G * 0.14, GA, GA)
        structure = line(2, section, length, jc.clamped([0, 2]))
        sag = solved(structure, jc.NodalLoads([1], (0.0, 0.0, -force))).displacement[1, 2]
        expected = force * length**3 / 192 / (E * I) + force * length / 4 / GA
        # stiffnesses from EA / L to EI / L^3 differ by (L/d)^2 = 1e6: of rounding 1e-10 is left
        assert sag == pytest.approx(-expected, rel=1e-9)


def test_a_stepped_cantilever_of_two_sections():
    """Groups of sections by numbers become one bundle, each element with its own numbers."""
    weak = jc.Section.linear(EA, EIY / 2, EIZ, GJ, GAY, GAZ / 3)
    nodes = [[0.0, 0.0, 0.0], [LENGTH / 2, 0.0, 0.0], [LENGTH, 0.0, 0.0]]
    groups = [jc.Beams([[0, 1]], section=SECTION), jc.Beams([[1, 2]], section=weak)]
    structure = jc.Structure(nodes, groups, jc.clamped([0]))
    tip = solved(structure, jc.NodalLoads([2], (0.0, 0.0, -SMALL))).displacement[2, 2]
    bent = SMALL * LENGTH**3 / 24 * (7 / EIY + 2 / EIY)
    sheared = SMALL * LENGTH / 2 * (1 / GAZ + 3 / GAZ)
    assert tip == pytest.approx(-bent - sheared, rel=1e-9)


def test_an_axis_off_the_centroid_under_a_load_along_it():
    """Shear and axial strain are coupled; linear theory by statics, integrated by hand."""
    z, q = 0.3, SMALL
    tip = solved(line(1, SECTION.shifted(z=z)), jc.LineLoads((q, 0.0, 0.0))).displacement[1]
    # N = q (L - x) in the node axis, hence M = -N z about the centroid; no shear force across
    assert tip[2] == pytest.approx(q * z * LENGTH**3 / 3 / EIY, rel=1e-9)
    along = q * LENGTH**2 / 2 * (1 / EA + z**2 / EIY)
    assert tip[0] == pytest.approx(along, rel=1e-9)


@pytest.mark.slow
def test_frequencies_of_a_beam_with_shear():
    """w^2 = EI k^4 / m / (1 + EI k^2 / GA): Timoshenko's beam without rotary inertia.

    The error is (k h)^2/12 of the share of shear, which extrapolation takes away.
    """
    mass, found = 40.0, []
    for n in (8, 16):
        supports = jc.restrained([0, n], "xyz", "x")
        structure = line(n, weight=mass * 9.80665, supports=supports)
        state = converged(jc.solve(structure, jc.Phase()))
        found.append(np.asarray(jc.dynamics.modes(structure, state, 2).squared))
    k = np.pi / LENGTH
    squared = [ei * k**4 / mass / (1 + ei * k**2 / ga) for ei, ga in ((EIZ, GAY), (EIY, GAZ))]
    assert found[1] == pytest.approx(sorted(squared), rel=1e-3)
    assert (4 * found[1] - found[0]) / 3 == pytest.approx(sorted(squared), rel=1e-4)


# --- large rotations, against a rod integrated by shooting


def rod_tip(ei, ga, ea, force):
    """Tip of a plane rod of length 1, clamped along x, under a dead force (Fx, Fz) at its tip.

    Stretch e along the tangent, angle g between tangent and cross-section, bending k = t', with the
    energy ``EA e^2 + GA g^2 + EI k^2`` over 2; the equations are those of its stationary points.
    """
    force = np.asarray(force)

    def strains(turn):
        """Stretch and tangent at a rotation of the cross-section; Newton's method for g."""
        g = 0.0
        for _ in range(12):
            tangent = np.array([np.cos(turn + g), np.sin(turn + g)])
            along, across = force @ tangent, force @ np.array([-tangent[1], tangent[0]])
            e = along / ea
            g -= (ga * g - (1 + e) * across) / (ga + (1 + e) * along - across**2 / ea)
        return e, tangent

    def slope(_, v):
        e, tangent = strains(v[2])
        across = np.array([-tangent[1], tangent[0]])
        return [*((1 + e) * tangent), v[3] / ei, -(1 + e) * force @ across]

    def end(moment):
        found = solve_ivp(slope, (0, 1), [0, 0, 0, moment], rtol=1e-11, atol=1e-13)
        return found.y[:, -1]

    low, high = 0.0, np.linalg.norm(force)
    moment = brentq(lambda m: end(m)[3], low, high, xtol=1e-13)
    return end(moment)[:3]


@pytest.mark.slow
def test_a_rod_that_turns_far_converges_with_second_order():
    """Tip of a cantilever that turns by more than 60 degrees; shear angles reach 0.3 rad."""
    ei, ga, ea, force = 1.0, 12.0, 60.0, (-0.5, 4.0)
    x, z, turn = rod_tip(ei, ga, ea, force)
    assert turn > 1.0
    section = jc.Section.linear(ea, ei, ei, 1.0, ga, ga)
    errors = []
    for n in (2, 4, 8, 16):
        structure = line(n, section, 1.0)
        loads = jc.NodalLoads([n], (force[0], 0.0, force[1]))
        solution = solved(structure, loads, increments=4)
        tip = solution.displacement[n]
        error = [tip[0] + 1 - x, tip[2] - z, -rotation_of(solution, n)[1] - turn]
        errors.append(float(np.abs(np.array(error)).max()))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders[1:] == pytest.approx(2.0, abs=0.2), errors
    assert errors[-1] < 2e-3


# --- columns


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.05, 0.5])
def test_a_column_buckles_at_engessers_load(ratio):
    """P = PE / (1 + PE / GA); Haringx's load would be 10 % larger at PE / GA = 0.5.

    The error is of second order in the length of elements, which extrapolation takes away.
    """
    euler, found = np.pi**2 * EIY / LENGTH**2, []
    ga = euler / ratio
    section = jc.Section.linear(1e6 * EA, EIY, 4 * EIY, GJ, ga, ga)  # no shortening
    for n in (8, 16):
        supports = jc.restrained([0], "xyz", "x") + jc.restrained([n], "yz")
        structure = line(n, section, supports=supports)
        state = solved(structure, jc.NodalLoads([n], (-1.0, 0.0, 0.0)))
        found.append(float(jc.stiffness.buckling_factor(structure, state).factor[0]))
    engesser = euler / (1 + euler / ga)
    assert found[1] == pytest.approx(engesser, rel=1e-3)
    assert (4 * found[1] - found[0]) / 3 == pytest.approx(engesser, rel=1e-4)


# --- fibre sections


@pytest.mark.slow
def test_a_yielding_cantilever_with_shear():
    """A nonlinear law: curvatures of an independent fibre integration, shear angle V / GA."""
    fibres, n, force, ga = jc.Section.rectangle(0.1, 0.2, CURVE, (2, 8)), 16, 200e3, 2e7
    middles = (np.arange(8) + 0.5) * 0.025 - 0.1

    def moment(curvature):
        return 0.1 * 0.025 * middles @ np.interp(curvature * middles, CURVE.strain, CURVE.stress)

    places, weights = np.polynomial.legendre.leggauss(400)
    x = LENGTH / 2 * (1 + places)
    bent = [brentq(lambda k, at=at: moment(k) - force * (LENGTH - at), 0, 0.4) for at in x]
    assert max(bent) > 2 * 2e-3 / 0.1  # well beyond the corner of the law
    bending = LENGTH / 2 * weights @ (np.array(bent) * (LENGTH - x))
    tips = []
    for section in (fibres, fibres.with_shear(GAz=ga)):
        solution = solved(line(n, section), jc.NodalLoads([n], (0.0, 0.0, -force)), increments=4)
        tips.append(float(solution.displacement[n, 2]))
    turned = float(np.linalg.norm(rotation_of(solution, n)))
    steepest = turned + force / ga  # slope of the axis at the tip
    assert turned < 0.04
    # lever arms are shorter by the square of slopes over two, and with them yielding curvatures
    assert tips[0] == pytest.approx(-bending, rel=turned**2)
    assert tips[1] - tips[0] == pytest.approx(-force * LENGTH / ga, rel=2 * steepest**2)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["numbers", "fibres"])
def test_gradients_by_shear_stiffnesses(kind):
    """A cantilever that bends far in both planes."""
    base, size = SECTION, 1e4
    if kind == "fibres":
        base, size = jc.Section.rectangle(0.1, 0.2, CURVE, (2, 6)), 4e4
    load = jc.Phase(loads=jc.NodalLoads([2], (0.0, size, -2 * size)))

    def tip(shear):
        section = copy_with(base, GAy=shear[0], GAz=shear[1])
        solution = jc.solve(line(2, section), load, TIGHT)
        return solution.displacement[2] @ jnp.array([1.0, 0.7, 0.4]), solution.status

    assert (np.asarray(assert_gradient(tip, [2e6, 5e5], 20.0, corrupted=1.1)) != 0).all()
