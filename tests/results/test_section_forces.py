"""Section forces along beams, axial strain and neutral axes: an independent stiffness method."""

import functools
import operator

import numpy as np
import pytest
from banks import shapes
from oracles import stiffness_method as oracle
from oracles.convergence import converged

import jaxcable as jc

LAW = jc.Elastic(210e9)
BOX = jc.Section.rectangle(0.05, 0.1, LAW)
GJ = float(BOX.torsional_stiffness())
STIFFNESS = np.asarray(BOX.stiffness())
PLACES = np.linspace(0.0, 1.0, 9)


def hold(node, along="", about=""):
    """Supports as the oracle states them."""
    axes = dict(zip("xyz", np.eye(3), strict=True))
    found = [(node, axes[a], "translation") for a in along]
    return found + [(node, axes[a], "rotation") for a in about]


ENDS = {
    "cantilever": ("xyz", "xyz", "", ""),
    "propped": ("xyz", "xyz", "yz", ""),
    "clamped": ("xyz", "xyz", "xyz", "xyz"),
    "forks": ("xyz", "x", "yz", "x"),
    "pin and torsion": ("xyz", "xz", "yz", "z"),
    "hinged": ("xyz", "xyz", "yz", "xyz"),  # in the middle, where it has a node
    "column": ("xyz", "xyz", "", ""),  # leaning, under its own weight
}
CASES = [(name, n) for name in ENDS for n in (1, 2, 8)]


@functools.lru_cache
def linear_frame():
    """All cases side by side in one frame: first elements, package's and independent results.

    Loads are so small that second-order effects are below 1e-10 of the first.
    """
    nodes, links, ups, weights, hinges = [], [], [], [], []
    supports, held, members, firsts = [], [], [], {}
    q, weight = 1e-6 * np.array([0.4, 0.7, -1.0]), 1e-5
    for number, (name, n) in enumerate(CASES):
        along, about, along_end, about_end = ENDS[name]
        leans = name == "column"
        first, firsts[name, n] = len(nodes), len(links)
        start = np.array([0.0, 10.0 * number, 0.0])
        end = start + ([1.0, 0.5, 6.0] if leans else [6.0, 0.0, 0.0])
        nodes += [*np.linspace(start, end, n + 1)]
        supports.append(jc.restrained([first], along, about))
        held += hold(first, along, about)
        if along_end:
            supports.append(jc.restrained([first + n], along_end, about_end))
            held += hold(first + n, along_end, about_end)
        for k in range(n):
            joints = np.zeros((2, 3), bool)
            joints[0, 1:] = name == "hinged" and 2 * k == n  # bending released, torsion kept
            up = (1.0, 0.0, 0.0) if leans else (0.0, 0.3, 1.0)
            load = np.array([0.0, 0.0, -weight]) if leans else q
            pair = first + k, first + k + 1
            joined = np.where(joints, 0.0, np.inf)
            members.append(
                oracle.Member(*pair, D=STIFFNESS, GJ=GJ, up=up, load=load, joints=joined)
            )
            links.append(pair)
            ups.append(up)
            weights.append(weight * leans)
            hinges.append(joints)
    beams = jc.Beams(
        links, section=BOX, torsional_stiffness=GJ, up=ups, weight=weights, hinges=np.array(hinges)
    )
    structure = jc.Structure(nodes, beams, functools.reduce(operator.add, supports))
    lying = jc.only(np.array(weights) == 0)
    phase = jc.Phase(loads=[jc.SelfWeight(), jc.LineLoads(q, elements=lying)])
    solution = converged(jc.solve(structure, phase, jc.Newton(tol=1e-13)))
    exact = oracle.solve_frame(np.array(nodes), members, held, np.zeros((len(nodes), 6)))
    forces = np.asarray(jc.section_forces(structure, solution, PLACES))
    peaks = np.asarray(solution.peak_tension)
    return firsts, forces, peaks, np.stack([exact.internal(k, PLACES) for k in range(len(links))])


@pytest.mark.slow_cases("cantilever-1", "cantilever-2")
@pytest.mark.parametrize(("name", "n"), CASES)
def test_forces_along_a_beam_in_linear_theory(name, n):
    firsts, forces, peaks, exact = linear_frame()
    own = slice(firsts[name, n], firsts[name, n] + n)
    size = 1e-5 if name == "column" else 1.3e-6  # force per length, N/m
    assert np.abs(exact[own]).max() > size
    assert np.abs(forces[own] - exact[own]).max() < 1e-9 * size * 36.0  # q L^2
    if name == "column":  # N with its wL/2, the largest at the lower end
        assert np.abs(peaks[own] - exact[own, 0, 0]).max() < 1e-9 * size * 6.0


# --- neutral axes off the axis of the nodes


@pytest.mark.slow
def test_a_cracked_cantilever():
    """The cracked section of the textbooks: b x^2 / 2 = n As (h - 2 x), x under compression.

    Without an axial strain that follows the neutral axis one element would be 11 % too stiff.
    """
    length, b, h, d, steel, concrete = 3.0, 0.2, 0.4, 0.16, 200e9, 30e9
    layers, area = 400, 6e-4
    law = jc.Polygonal([-0.1, 0.0, 1e-8, 0.1], [-0.1 * concrete, 0.0, 300.0, 300.0])
    z = [*((np.arange(layers) + 0.5) / layers * h - h / 2), d, -d]
    areas = [*np.full(layers, b * h / layers), area, area]
    section = jc.Section(0.0 * np.array(z), z, areas, (law, jc.Elastic(steel)), (layers, 2))
    supports = jc.clamped([0]) + jc.restrained([1], "y", "xz")
    structure = shapes.beam(1, section, length, supports, torsional_stiffness=1e6)
    load = jc.NodalLoads([1], (0.0, 0.0, -20e3))
    solution = converged(jc.solve(structure, jc.Phase(loads=load)))
    share = steel / concrete * area
    x = (-2 * share + np.sqrt(4 * share**2 + 2 * b * share * h)) / b
    bending = concrete * (b * x**3 / 3 + share * ((h / 2 + d - x) ** 2 + (h / 2 - d - x) ** 2))
    # the crack ends in one of 400 layers: 1e-3
    expected = -20e3 * length**3 / 3 / bending
    assert float(solution.displacement[1, 2]) == pytest.approx(expected, rel=2e-3)


# --- large displacements


@pytest.mark.slow
def test_forces_along_converge_at_second_order_or_better_for_large_displacements():
    """A cantilever that a uniform load bends by half of its length, against a rod by shooting."""
    from scipy.integrate import solve_bvp

    length, EI = 2.0, STIFFNESS[1, 1]
    q = 6.0 * EI / length**3

    def rates(s, y):  # slope and curvature of a rod under a dead load -q per unstressed length
        stretched = 1 - q * (length - s) * np.sin(y[0]) / STIFFNESS[0, 0]
        return np.stack([y[1], q * (length - s) * stretched * np.cos(y[0]) / EI])

    s = np.linspace(0, length, 201)
    rod = solve_bvp(
        rates, lambda a, b: np.array([a[0], b[1]]), s, np.zeros((2, 201)), tol=1e-9, max_nodes=20000
    )
    assert rod.success
    errors = []
    for n in (2, 4):
        structure = shapes.beam(n, BOX, length, torsional_stiffness=GJ)
        load = jc.LineLoads((0.0, 0.0, -q))
        solution = converged(jc.solve(structure, jc.Phase(loads=load, increments=4)))
        forces = np.asarray(jc.section_forces(structure, solution, PLACES))
        at = (np.arange(n)[:, None] + PLACES) * length / n
        slope, curvature = rod.sol(at.ravel())[:2]
        pull = -q * (length - at.ravel())  # of what is beyond, along z
        exact = np.stack([pull * np.sin(slope), pull * np.cos(slope), -EI * curvature], axis=1)
        scale = np.array([q * length, q * length, q * length**2])
        apart = (forces.reshape(-1, 6)[:, [0, 2, 4]] - exact) / scale
        errors.append(np.abs(apart).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 8e-3 and (rates > 1.8).all(), (errors, rates)  # 2e-3 of 8 elements, times 4
