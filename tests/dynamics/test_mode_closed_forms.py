"""Natural modes against closed forms: hanging cables, beams, participation, mechanisms."""

import numpy as np
import pytest
from banks.shapes import beam, pieces
from oracles.convergence import converged
from scenes.frames import in_plane
from scipy.optimize import brentq

import jaxcable as jc
from jaxcable.dynamics import modes

pytestmark = [
    pytest.mark.filterwarnings("ignore:elements.*no phase has SelfWeight"),
    pytest.mark.filterwarnings(
        "ignore:elements.*the stiffness EA is more than"
    ),  # shallow: 1 / 500
    pytest.mark.filterwarnings("ignore:fixed. leaves free"),  # on purpose
]

GRAVITY = 9.80665
SPAN, SAG, WEIGHT = 100.0, 0.2, 10.0
FORCE = WEIGHT * SPAN**2 / (8 * SAG)  # N, horizontal, of the parabola


def hung(n, stretchiness):
    """A cable of n pieces in its plane, whose parameter of Irvine is `stretchiness`."""
    arc = SPAN * (1 + 8 * (SAG / SPAN) ** 2)
    stiffness = stretchiness * FORCE * arc / (SPAN * (8 * SAG / SPAN) ** 2)
    x = np.linspace(0.0, SPAN, n + 1)
    nodes = np.column_stack([x, 0 * x, -4 * SAG * x / SPAN * (1 - x / SPAN)])
    cable = jc.Cables(pieces(n)[1], axial_stiffness=stiffness, weight=WEIGHT)
    supports = jc.pinned([0, n]) + jc.restrained(range(1, n), "y")
    structure = jc.Structure(nodes, cable, supports)
    tension = FORCE * np.linalg.norm(np.diff(nodes, axis=0), axis=1) / (SPAN / n)
    phase = jc.Phase(pretension=tension, loads=jc.SelfWeight())
    return structure, converged(jc.solve(structure, phase))


def symmetric_frequency(stretchiness):
    """First symmetric mode in the plane, over that of the string: Irvine and Caughey 1974."""

    def equation(half):
        return np.sin(half) - (half - 4 / stretchiness * half**3) * np.cos(half)

    return 2 * brentq(equation, 1.0, 1.4999 * np.pi) / np.pi


STRING = np.sqrt(FORCE * GRAVITY / WEIGHT) / (2 * SPAN)  # Hz


def errors(n, stretchiness):
    """Errors of the symmetric and of the antisymmetric mode with n pieces, over the frequencies."""
    found = converged(modes(*hung(n, stretchiness), 3))
    shape = np.asarray(found.shape)[:, :, 2]
    even = [bool(abs(row + row[::-1]).max() > 1) for row in shape]
    assert even.index(True) == int(stretchiness > 4 * np.pi**2)  # the cross-over
    symmetric, other = (float(found.frequency[even.index(kind)]) / STRING for kind in (True, False))
    return symmetric / symmetric_frequency(stretchiness) - 1, other / 2 - 1


@pytest.mark.slow_cases("30.0")
@pytest.mark.parametrize("stretchiness", [4.0, 30.0, 100.0])
def test_hanging_cables_through_the_cross_over(stretchiness):
    """At 4 pi^2 the symmetric mode becomes faster than the antisymmetric one.

    Irvine's theory leaves out 8 (d/L)^2, 3e-5; cables are straight between nodes: order 2.
    """
    coarse, middle, fine = (np.array(errors(n, stretchiness)) for n in (20, 40, 80))
    assert np.abs(fine).max() < 1e-4
    assert (np.log2(np.abs((coarse - middle) / (middle - fine))) > 1.95).all()


EI, MASS, LENGTH = 2100.0, 7.85, 4.0


def slender(n, supports, force=0.0):
    """A beam of n elements in its plane under a pull, N."""
    section = jc.Section.linear(1e9, EI, EI, 1e5)
    structure = beam(n, section, LENGTH, supports, up=(0.0, 0, 1), weight=MASS * GRAVITY)
    loads = jc.NodalLoads([n], (force, 0.0, 0.0)) if force else None
    return structure, converged(jc.solve(structure, jc.Phase(loads=loads)))


@pytest.mark.slow_cases("clamped", "free")
@pytest.mark.parametrize("which", ["clamped", "free", "pulled"])
def test_beams(which):
    """Three frequencies of 12 elements, of order 4: ``cos b cosh b`` is -1 or 1; a pinned one."""
    unit = np.sqrt(EI / MASS) / LENGTH**2 / (2 * np.pi)
    if which == "pulled":
        force, k = 5000.0, np.pi * np.arange(1, 4)
        exact = k**2 * np.sqrt(1 + force * LENGTH**2 / EI / k**2) * unit
    else:
        sign, starts = (1, (1, 4, 7)) if which == "clamped" else (-1, (4, 7, 10))
        roots = [brentq(lambda b: np.cos(b) + sign / np.cosh(b), s, s + 1.5) for s in starts]
        exact = np.square(roots) * unit
    found = []
    for n in (6, 12):
        supports = in_plane(n + 1, clamped=[0] if which != "pulled" else [])
        if which == "pulled":
            supports = supports + jc.restrained([0], "x") + jc.restrained([0, n], "z")
        structure, solution = slender(n, supports, force if which == "pulled" else 0.0)
        fixed = None
        if which == "free":  # in its plane: three motions of a rigid body, then the modes
            fixed = np.tile([False, True, False, True, False, True], (n + 1, 1))
        result = converged(modes(structure, solution, 6, fixed=fixed))
        frequency = np.asarray(result.frequency)
        if which == "free":
            assert np.abs(result.squared[:3]).max() < 1e-7 * result.squared[3]
            assert list(result.repeated) == [True] * 3 + [False] * 3
            frequency = frequency[3:]
        found.append(frequency[:3] / exact - 1)
    coarse, fine = np.abs(found)
    # shortening of the pulled one by its force over EA changes its mass per length by 5e-6
    assert fine.max() < 1e-3 and (np.log2(coarse / fine)[1:] > 3.6).all(), found
    assert fine[0] < 2e-5


def test_effective_masses():
    """Of a string ``8 / (pi k)^2`` of its mass in odd modes, and of all what can move."""
    nodes, links = pieces(40, 10.0)
    cable = jc.Cables(links, axial_stiffness=1e7, weight=5.0)
    supports = jc.pinned([0, 40]) + jc.restrained(range(1, 40), "y")
    structure = jc.Structure(nodes, cable, supports)
    solution = converged(jc.solve(structure, jc.Phase(pretension=1000.0)))
    found = converged(modes(structure, solution, 78))
    mass = 5.0 * 10.0 / GRAVITY / (1 + 1000.0 / 1e7)
    across = np.asarray(found.effective_mass)[:4, 2] / mass
    expected = 8 / (np.pi * np.arange(1, 5)) ** 2 * [1, 0, 1, 0]
    assert np.allclose(across, expected, atol=2e-3)  # a fortieth squared, of the mass at supports
    total = np.asarray(found.total_mass)
    np.testing.assert_allclose(found.effective_mass.sum(axis=0), total, rtol=1e-10, atol=1e-12)
    assert total[1] == 0 and total[0] == pytest.approx(total[2], rel=1e-12)
    assert 0.97 * mass < total[2] < mass  # supports hold half of a piece at each end
    assert float(found.modal_mass[0]) == pytest.approx(mass / 2, rel=1e-3)
    assert float(found.participation[0, 2]) == pytest.approx(4 / np.pi, rel=2e-3)


def test_effective_masses_of_a_cantilever():
    """Of few elements: the first mode has 0.613 of the mass; all modes and the support have all.

    Across: ``4 (s / b)^2``, s = (sinh b - sin b) / (cosh b + cos b). Along: what
    the support moves with is the Schur complement of the consistent masses, by NumPy.
    """
    b = brentq(lambda b: np.cos(b) * np.cosh(b) + 1, 1.8, 1.9)
    ratio = (np.sinh(b) - np.sin(b)) / (np.cosh(b) + np.cos(b))
    section, mass = jc.Section.rectangle(0.1, 0.2, jc.Elastic(2e11)), 400.0 / GRAVITY
    n = 4
    nodes, links = pieces(n, 4.0)
    beam = jc.Beams(links, section=section, weight=100.0)
    structure = jc.Structure(nodes, beam, jc.clamped([0]))
    solution = converged(jc.solve(structure, jc.Phase()))
    found = converged(modes(structure, solution, 6 * n, masses=0.0, distribution="consistent"))
    across = np.asarray(found.effective_mass)[:, 2].max() / mass
    assert across == pytest.approx(4 * (ratio / b) ** 2, abs=2e-6)  # a 64th of that of two elements
    np.testing.assert_allclose(found.effective_mass.sum(axis=0), found.total_mass, rtol=1e-9)
    along = np.zeros((n + 1, n + 1))
    for k in range(n):
        along[k : k + 2, k : k + 2] += mass / n / 6 * np.array([[2, 1], [1, 2]])
    held = along[0, 0] - along[0, 1:] @ np.linalg.solve(along[1:, 1:], along[1:, 0])
    assert float(found.total_mass[0]) + held == pytest.approx(mass, rel=1e-10)


def test_slack_cables_and_what_they_hold_are_left_out():
    """Two masses on a taut string; a third one hangs on slack cables, in which nothing pulls."""
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [1, 0, -1]]
    links = [[0, 1], [1, 2], [2, 3], [1, 4], [0, 4]]
    cables = jc.Cables(links, axial_stiffness=1e6, rest_length=[0.99, 0.99, 0.99, 1.5, 2.0])
    structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 3]))
    solution = jc.solve(structure, jc.Phase())
    assert int(solution.status) == 0 and list(solution.tension > 0) == [True] * 3 + [False] * 2
    with pytest.warns(jc.InputWarning, match="state: 1 node is held by slack cables only, such as"):
        found = converged(modes(structure, solution, masses=2.0))
    assert list(found.loose) == [False] * 4 + [True] and len(found.frequency) == 6
    force, length = float(solution.tension[0]), 1.0
    np.testing.assert_allclose(found.squared[:2], force / length / 2.0, rtol=1e-9)
    np.testing.assert_allclose(found.squared[2:4], 3 * force / length / 2.0, rtol=1e-9)
    assert (np.asarray(found.shape)[:, 4] == 0).all() and float(found.total_mass[2]) == 4.0


@pytest.mark.filterwarnings("ignore:.*ends in an unstable equilibrium")
def test_mechanisms_leave_the_digits_of_other_modes():
    """Two masses joined by a bar that nothing holds: ``2 EA / (l m)``, and five zeros."""
    bar = jc.Bars([[0, 1]], axial_stiffness=2e6)
    structure = jc.Structure([[0.0, 0, 0], [1.2, 1.6, 0]], bar, supports=jc.pinned([0]))
    solution = converged(jc.solve(structure, jc.Phase()))
    free = np.zeros((2, 3), bool)
    found = converged(modes(structure, solution, masses=3.0, fixed=free))
    assert float(found.squared[5]) == pytest.approx(2 * 2e6 / 2.0 / 3.0, rel=1e-9)
    assert np.abs(found.squared[:5]).max() < 1e-9 * found.squared[5]
    assert list(found.repeated) == [True] * 5 + [False]
