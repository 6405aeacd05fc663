"""Loads within beams, and forces of each element: against a stiffness method with nodes there."""

import functools
import operator

import numpy as np
import pytest
from banks.shapes import beam
from oracles import stiffness_method as oracle
from oracles.convergence import converged
from scipy.integrate import quad

import jaxcable as jc

LAW = jc.Elastic(210e9)
BOX = jc.Section.rectangle(0.05, 0.1, LAW)
OFF = BOX.shifted(0.02, -0.03)  # bending and stretching are coupled
GJ, STIFFNESS = float(BOX.torsional_stiffness()), np.asarray(OFF.stiffness())
LENGTH, AXIS = 6.0, np.array([1.0, 0.0, 0.0])
PLACES = np.array([[0.3, 0.8], [0.5, 0.5], [0.0, 1.0], [0.15, 0.6]])
SIDES = np.array([0.0, 0.1, 0.3 - 1e-9, 0.3 + 1e-9, 0.5 + 1e-9, 0.9, 1.0])
# so small that second-order effects are below 1e-10 of the first
FORCES = 1e-6 * np.array([[0.4, 0.7, -1.0], [-0.8, 0.2, 0.5]])
MOMENTS = 1e-6 * np.array([[0.3, -0.9, 0.6], [0.5, 1.1, -0.2]])
HELD = {  # at the second end, of beams that are clamped at the first one
    "clamped": ("xyz", "xyz"),
    "propped": ("yz", "x"),
    "cantilever": ("", ""),
    "guided": ("x", "yz"),
}
JOINTS = np.array([[np.inf, np.inf, np.inf], [np.inf, 0.0, 2e5]])
"""Of the jointed beams: their second end turns freely about y, and against a spring about z."""


@functools.lru_cache
def linear_frame():
    """Beams of one element side by side, and the oracle, whose beams have nodes at the loads."""
    nodes, links, supports, loads = [], {"whole": [], "jointed": []}, [], []
    points, members, held, pulls = [], [], [], []
    for kind in links:
        for number, (along, about) in enumerate(HELD.values()):
            start = np.array([0.0, 10.0 * number, 100.0 * (kind == "jointed")])
            end = start + LENGTH * AXIS
            first = len(nodes)
            nodes += [start, end]
            links[kind].append((first, first + 1))
            about = "xyz" if kind == "jointed" else about  # the node beyond the joint
            supports.append(jc.clamped([first]))
            if along or about:
                supports.append(jc.restrained([first + 1], along, about))
            at = np.unique([0.0, *PLACES[number], 1.0])
            base = len(points)
            points += [start + s * (end - start) for s in at]
            for k in range(len(at) - 1):
                last = kind == "jointed" and k == len(at) - 2
                joints = JOINTS if last else np.full((2, 3), np.inf)
                members.append(
                    oracle.Member(
                        base + k,
                        base + k + 1,
                        D=STIFFNESS,
                        GJ=GJ,
                        up=(0.0, 0.3, 1.0),
                        joints=joints,
                    )
                )
            axes = dict(zip("xyz", np.eye(3), strict=True))
            for node, ways in ((base, ("xyz", "xyz")), (base + len(at) - 1, (along, about))):
                for name, letters in zip(("translation", "rotation"), ways, strict=True):
                    held += [(node, axes[a], name) for a in letters]
            for j, place in enumerate(PLACES[number]):
                pull = np.r_[FORCES[j], MOMENTS[j] * (kind == "whole")]
                pulls.append((base + int(np.flatnonzero(at == place)[0]), pull))
    for kind in links:
        moments = np.tile(MOMENTS, (4, 1)) if kind == "whole" else None
        loads.append(
            jc.PointLoads(
                np.repeat(range(4), 2), PLACES.ravel(), np.tile(FORCES, (4, 1)), moments, on=kind
            )
        )
    hinges = np.zeros((4, 2, 3), bool)
    hinges[:, 1, 1:] = True
    springs = np.where(np.isfinite(JOINTS), JOINTS, 0.0)
    options = {"section": OFF, "torsional_stiffness": GJ, "up": (0.0, 0.3, 1.0)}
    beams = {
        "whole": jc.Beams(links["whole"], **options),
        "jointed": jc.Beams(links["jointed"], hinges=hinges, springs=springs, **options),
    }
    structure = jc.Structure(nodes, beams, functools.reduce(operator.add, supports))
    solution = converged(jc.solve(structure, jc.Phase(loads=loads), jc.Newton(tol=1e-13)))
    nodal = np.zeros((len(points), 6))
    for node, pull in pulls:
        nodal[node] += pull
    exact = oracle.solve_frame(np.array(points), members, held, nodal)
    return structure, solution, np.array(points), members, exact


def exact_forces(points, members, exact, start, s):
    """Section forces of the oracle at ``start + s L``, from the member that has this place."""
    x = start + s * LENGTH * AXIS
    for k, member in enumerate(members):
        a, b = points[member.first], points[member.second]
        if np.abs(a[1:] - x[1:]).max() < 1e-9 and a[0] <= x[0] <= b[0]:
            return exact.internal(k, (x[0] - a[0]) / (b[0] - a[0]))
    raise AssertionError


def each_beam(kind):
    """Number of each beam, its nodes, and section forces of the oracle as a function of s."""
    structure, _, points, members, exact = linear_frame()
    for number, links in enumerate(structure.elements[kind].links.array):
        start = np.asarray(structure.nodes)[links[0]]
        forces = functools.partial(exact_forces, points, members, exact, start)
        yield number, links, forces


def at_sides(number, forces):
    """Section forces of the oracle at `SIDES`; where loads are at the ends, inside of them."""
    sides = SIDES if number != 2 else np.clip(SIDES, 1e-9, 1 - 1e-9)
    wanted = np.array([forces(s) for s in sides])
    assert np.abs(wanted).max() > 1e-7
    return wanted


KINDS = pytest.mark.parametrize("kind", ["whole", "jointed"])
MOMENT = 1e-9 * 1e-6 * LENGTH  # a part of P L


@KINDS
def test_one_element_moves_exactly_in_linear_theory(kind):
    structure, solution, points, _, exact = linear_frame()
    size = 1e-6 * LENGTH**3 / (LAW.E * 0.1 * 0.05**3 / 12)  # of a cantilever
    for _, links, _ in each_beam(kind):
        end = np.asarray(structure.nodes)[links[1]]
        node = int(np.flatnonzero(np.abs(points - end).max(axis=1) < 1e-9)[0])
        moved = exact.displacements[node, :3]
        assert np.abs(np.asarray(solution.displacement[links[1]]) - moved).max() < 1e-9 * size


@KINDS
def test_forces_on_both_sides_of_loads_are_exact_in_linear_theory(kind):
    structure, solution, *_ = linear_frame()
    found = np.asarray(jc.section_forces(structure, solution, SIDES)[kind])
    recorded = np.asarray(solution.section_forces[kind])  # at 3 points
    for number, _, forces in each_beam(kind):
        assert np.abs(found[number] - at_sides(number, forces)).max() < MOMENT
        if number != 1:  # at the middle of "propped" is a load
            assert np.abs(recorded[number, 1] - forces(0.5)).max() < MOMENT
        along = [forces(s)[0] for s in np.linspace(1e-9, 1 - 1e-9, 41)]
        # a shear force of 1e-6 N has 1e-8 of it along the chord of a beam that turns by so much
        peak = float(solution.peak_tension[kind][number])
        assert abs(abs(peak) - np.abs(along).max()) < 2e-8 * 1e-6


def test_the_end_of_a_phase_interpolates_with_the_jumps_of_the_loads():
    structure, solution, *_ = linear_frame()
    found = jc.section_forces(structure, solution.phases[0], SIDES)
    for kind, own in found.items():
        for number, _, forces in each_beam(kind):
            assert np.abs(np.asarray(own[number]) - at_sides(number, forces)).max() < MOMENT


FRAME = jc.Structure(
    [[0.0, 0.0, 0.0], [2.0, 0.0, 0.5], [4.0, 0.3, 0.0]],
    jc.Beams([[0, 1], [1, 2]], section=BOX, up=(0.0, 0.0, 1.0)),
    jc.clamped([0]) + jc.pinned([2]),
)


@pytest.mark.slow_cases("False")
@pytest.mark.parametrize("flexible", [False, True])
def test_strains_under_a_load_follow_from_the_moments(flexible):
    """A clamped beam of one element: its ends do not turn, its fibres are strained all the same.

    With shear flexibility the moment at the load is ``P L/8``, too, in the middle of the beam.
    """
    section = OFF.with_shear(GAy=2e7, GAz=3e7) if flexible else OFF
    structure = beam(1, section, LENGTH, jc.clamped([0, 1]))
    solution = jc.solve(structure, jc.Phase(loads=jc.PointLoads([0], 0.5, (0.0, 0.0, -1e-6))))
    assert int(solution.status) == 0
    forces = np.asarray(solution.section_forces[0])[:, [0, 4, 5]]
    strain = np.asarray(solution.phases[0].path.strain[-1, 0])
    # rounding of moments of 1e-6 N m, in a frame whose forces are as small
    np.testing.assert_allclose(strain @ np.asarray(section.stiffness()), forces, atol=1e-17)
    assert abs(forces[1, 1]) == pytest.approx(1e-6 * LENGTH / 8, rel=1e-9)


@pytest.mark.slow
def test_an_axle_beyond_the_path_by_rounding_is_on_it():
    """0.3 - (0.1 + 0.2) is -5.6e-17, and a sloping deck of three parts is an ulp too short."""
    ends = np.linspace([0.0, 0.0, 0.0], [40.0, 0.0, 2.0], 4)
    beams = jc.Beams([[0, 1], [1, 2], [2, 3]], section=BOX)
    structure = jc.Structure(ends, beams, jc.clamped([0, 3]))
    length = float(np.linalg.norm(ends[-1]))
    rear = jc.loads.Train([0, 1, 2], 0.3, (0.0, 0.0, -1.0), spacings=[0.1, 0.2])
    front = jc.loads.Train([0, 1, 2], length, (0.0, 0.0, -1.0), spacings=[])
    for train, count in ((rear, 3), (front, 1)):
        solution = converged(jc.solve(structure, jc.Phase(loads=train)))
        assert float(solution.reactions[:, 2].sum()) == pytest.approx(count, rel=1e-9)


@pytest.mark.slow
def test_forces_of_elements_are_those_of_loads_on_each():
    """One load with a force for each chosen element, per any length, against a load on each."""
    structure = jc.replace(FRAME, elements={"legs": FRAME.elements})
    forces, order = np.array([[0.0, 50.0, -200.0], [30.0, 0.0, -100.0]]), [1, 0]
    nodes = np.asarray(FRAME.nodes)
    chords = nodes[[1, 2]] - nodes[[0, 1]]
    lengths = np.linalg.norm(chords, axis=1)
    unit = forces / np.linalg.norm(forces, axis=1)[:, None]
    across = chords[order] - (chords[order] * unit).sum(axis=1)[:, None] * unit
    for per, length in (("initial", lengths[order]), ("projected", np.linalg.norm(across, axis=1))):
        load = jc.LineLoads(forces, "legs", per, factor=[1.0, 3.0], elements=jc.only(order))
        solution = converged(jc.solve(structure, jc.Phase(loads=load)))
        whole = forces * (np.array([1.0, 3.0]) * length)[:, None]
        shares = np.stack([whole[1] / 2, whole.sum(axis=0) / 2, whole[0] / 2])
        assert np.abs(np.asarray(solution.load) - shares).max() < 1e-12 * 200.0


@pytest.mark.slow
def test_a_crowd_on_parts_of_a_path():
    """A simple beam of three elements, one of them backwards, loaded from 1 m to 7.5 m of 9 m.

    Deflections of nodes are those of the integral of Green's function, reactions are statics.
    """
    nodes = [[0.0, 0, 0], [3.0, 0, 0], [6.0, 0, 0], [9.0, 0, 0]]
    ends = jc.restrained([0], "xyz", "x") + jc.restrained([3], "yz")
    structure = jc.Structure(nodes, jc.Beams([[0, 1], [2, 1], [2, 3]], section=BOX), ends)
    crowd = jc.loads.Crowd([0, 1, 2], (0.0, 0.0, -1.0), 1.0, 7.5)
    solution = converged(jc.solve(structure, jc.Phase(loads=crowd), jc.Newton(tol=1e-13)))
    # loads of 1 N/m: second-order effects, such as the way of the roller, are 1e-9 and less
    assert solution.reactions[3, 2] == pytest.approx(6.5 * 4.25 / 9.0, rel=1e-9)
    bending = float(BOX.stiffness()[1, 1])

    def green(x, at):
        a, b = min(x, at), 9.0 - max(x, at)
        return a * b * (81.0 - a * a - b * b) / (6 * 9.0 * bending)

    for node, x in ((1, 3.0), (2, 6.0)):
        drop = quad(lambda at, x=x: green(x, at), 1.0, 7.5, points=[x], epsabs=0, epsrel=1e-12)[0]
        assert solution.displacement[node, 2] == pytest.approx(-drop, rel=1e-8)
