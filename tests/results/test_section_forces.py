"""Section forces along beams, axial strain and neutral axes: an independent stiffness method."""

import numpy as np
import pytest
from oracles import stiffness_method as oracle

import jaxcable as jc

LAW = jc.Elastic(210e9)
BOX = jc.Section.rectangle(0.05, 0.1, LAW)
GJ = float(BOX.torsional_stiffness())
STIFFNESS = np.asarray(BOX.stiffness())
PLACES = np.linspace(0.0, 1.0, 9)


def chain(n):
    return np.column_stack([np.arange(n), np.arange(1, n + 1)])


def beam(n, end, supports, section=BOX, **options):
    """A straight beam from the origin to `end` in n elements."""
    nodes = np.linspace(np.zeros(3), np.asarray(end, float), n + 1)
    options = {"torsional_stiffness": GJ, "up": (0.0, 0.3, 1.0), **options}
    return jc.Structure(nodes, jc.Beams(chain(n), section=section, **options), supports)


def of_oracle(structure, held, load, loads=None, stiffness=STIFFNESS, hinges=None):
    """The same by the stiffness method: solution and section forces [n_elem, n, 6]."""
    links = structure.elements.links.array
    hinges = np.zeros((len(links), 2, 3), bool) if hinges is None else hinges
    members = [
        oracle.Member(
            *pair,
            D=stiffness,
            GJ=GJ,
            up=(0.0, 0.3, 1.0),
            load=load,
            joints=np.where(hinges[k], 0.0, np.inf),
        )
        for k, pair in enumerate(links.tolist())
    ]
    nodal = np.zeros((structure.n_node, 6)) if loads is None else loads
    found = oracle.solve_frame(structure.nodes, members, held, nodal)
    return found, np.stack([found.internal(k, PLACES) for k in range(len(links))])


def hold(node, along="", about=""):
    """Supports as the oracle states them."""
    axes = dict(zip("xyz", np.eye(3), strict=True))
    return [(node, axes[a], "translation") for a in along] + [
        (node, axes[a], "rotation") for a in about
    ]


ENDS = {
    "cantilever": ("xyz", "xyz", "", ""),
    "propped": ("xyz", "xyz", "yz", ""),
    "clamped": ("xyz", "xyz", "xyz", "xyz"),
    "forks": ("xyz", "x", "yz", "x"),
    "pin and torsion": ("xyz", "xz", "yz", "z"),
}


FIRST = [("cantilever", 1), ("forks", 2)]  # the others take as long to compile


# all in linear theory: loads so small that second-order effects are below 1e-10 of the first
@pytest.mark.parametrize(
    ("name", "n"),
    [
        pytest.param(name, n, marks=[pytest.mark.slow] if (name, n) not in FIRST else [])
        for name in ENDS
        for n in (1, 2, 8)
    ],
)
def test_forces_along_a_beam_in_linear_theory(name, n):
    along, about, along_end, about_end = ENDS[name]
    end = np.array([6.0, 0.0, 0.0])
    supports = jc.restrained([0], along, about)
    held = hold(0, along, about)
    if along_end:
        supports = supports + jc.restrained([n], along_end, about_end)
        held = held + hold(n, along_end, about_end)
    structure = beam(n, end, supports)
    q = 1e-6 * np.array([0.4, 0.7, -1.0])
    solution = jc.solve(structure, jc.Phase(loads=jc.LineLoads(q)))
    assert int(solution.status) == 0
    forces = np.asarray(jc.section_forces(structure, solution, PLACES))
    _, exact = of_oracle(structure, held, q)
    size = np.linalg.norm(q) * 36.0  # q L^2
    assert np.abs(forces - exact).max() < 1e-9 * size


def test_the_root_of_a_cantilever_in_one_element():
    """6 m under 1 kN/m: 18 kN m at the root, 0 at the tip, and the stress of its fibres."""
    section = jc.Section.rectangle(0.1, 0.2, LAW, (1, 20))
    structure = jc.Structure(
        [[0.0, 0, 0], [6.0, 0, 0]], jc.Beams([[0, 1]], section=section), jc.clamped([0])
    )
    load = jc.LineLoads((0.0, 0.0, -1.0))  # N/m: linear
    solution = jc.solve(structure, jc.Phase(loads=load))
    assert int(solution.status) == 0
    forces = np.asarray(solution.section_forces)[0]
    exact = np.array([[-6.0, 18.0], [-3.0, 4.5], [0.0, 0.0]])  # Vz, My
    # second-order effects of a deflection of 1e-5 m are 1e-10 of q L^2
    assert np.abs(forces[:, [2, 4]] - exact).max() < 1e-8
    stress = np.asarray(jc.fibre_stress(structure, solution.phases[0]))[-1, 0, 0]
    inertia = 0.1 * 0.2**3 / 12
    # the bent axis is shorter, to second order: 2e-8 of the bending stress
    apart = stress - 18.0 * np.asarray(section.z) / inertia
    assert np.abs(apart).max() < 1e-7 * 1.8 / inertia


@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 2])
def test_forces_of_its_own_weight_along_a_leaning_column(n):
    """N with its wL/2, and what of the weight acts across."""
    end = np.array([1.0, 0.5, 6.0])
    weight = 1e-5
    structure = beam(n, end, jc.clamped([0]), weight=weight, up=(1.0, 0.0, 0.0))
    solution = jc.solve(structure, jc.Phase(loads=jc.SelfWeight()))
    assert int(solution.status) == 0
    forces = np.asarray(jc.section_forces(structure, solution, PLACES))
    members = [
        oracle.Member(k, k + 1, D=STIFFNESS, GJ=GJ, up=(1.0, 0.0, 0.0), load=(0, 0, -weight))
        for k in range(n)
    ]
    held = hold(0, "xyz", "xyz")
    found = oracle.solve_frame(structure.nodes, members, held, np.zeros((n + 1, 6)))
    exact = np.stack([found.internal(k, PLACES) for k in range(n)])
    assert np.abs(forces - exact).max() < 1e-9 * weight * 36.0
    assert np.abs(np.asarray(solution.peak_tension) - exact[:, 0, 0]).max() < 1e-9 * weight * 6.0


@pytest.mark.slow
def test_a_continuous_beam_on_cables():
    """Four spans on hangers and rigid ends, a hinge in the last span: an independent solution."""
    n, load = 4, np.array([0.0, 1e-4, -1e-3])
    nodes = np.zeros((n + 1, 3))
    nodes[:, 0] = [0.0, 3.0, 7.0, 10.0, 12.0]
    tops = nodes[1:-1] + np.array([[0.0, 0.0, 5.0]])
    hangers = np.column_stack([np.arange(1, n), n + 1 + np.arange(n - 1)])
    hinges = np.zeros((n, 2, 3), bool)
    hinges[3, 0, 1:] = True  # bending released, torsion kept
    held = jc.restrained([0], "xyz", "x") + jc.restrained([n], "yz", "x")
    held = held + jc.restrained(np.arange(1, n), "y") + jc.pinned(n + 1 + np.arange(n - 1))
    structure = jc.Structure(
        np.vstack([nodes, tops]),
        {
            "girder": jc.Beams(chain(n), section=BOX, torsional_stiffness=GJ, hinges=hinges),
            "hangers": jc.Cables(hangers, axial_stiffness=4e6),
        },
        held,
    )
    # enough that the hangers do not go slack, too little to matter to second order
    phases = [jc.Phase(loads=jc.LineLoads(load, on="girder"))]
    solution = jc.solve(structure, phases)
    assert int(solution.status) == 0
    forces = np.asarray(jc.section_forces(structure, solution, PLACES)["girder"])
    members = [
        oracle.Member(
            k, k + 1, D=STIFFNESS, GJ=GJ, load=load, joints=np.where(hinges[k], 0.0, np.inf)
        )
        for k in range(n)
    ]
    members += [
        oracle.Member(*pair, EA=4e6, axial=True, up=(1.0, 0.0, 0.0)) for pair in hangers.tolist()
    ]
    supports = hold(0, "xyz", "x") + hold(n, "yz", "x")
    for k in range(1, n):
        supports += hold(k, "y") + hold(n + k, "xyz")
    found = oracle.solve_frame(structure.nodes, members, supports, np.zeros((2 * n, 6)))
    exact = np.stack([found.internal(k, PLACES) for k in range(n)])
    # second order: deflections of 2e-6 m on 4 m
    assert np.abs(forces - exact).max() < 1e-5 * 1e-3 * 16.0
    assert np.abs(forces[3, 0, 4]) < 1e-9 * 1e-3 * 16.0  # at the hinge
    tension = np.asarray(solution.tension["hangers"])
    assert np.abs(tension - [-found.end_forces[n + k, 0] for k in range(n - 1)]).max() < 1e-8


def test_a_column_of_an_unsymmetric_section_under_force_and_moment():
    """An angle whose axis is at a corner: N, My and Mz couple, and the strains say what they do."""
    corners = [[0, 0], [0.1, 0], [0.1, 0.01], [0.01, 0.01], [0.01, 0.15], [0, 0.15]]
    angle = jc.Section.polygon(corners, None, LAW, 0.01).shifted(0.02, -0.03)
    stiffness = np.asarray(angle.stiffness())
    structure = beam(1, (0.0, 0.0, 4.0), jc.clamped([0]), section=angle, up=(1.0, 0.0, 0.0))
    load = np.array([2e-3, 1e-3, -5e-3])
    moment = np.array([1e-3, -2e-3, 0.0])
    solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([1], load, moment)))
    assert int(solution.status) == 0
    members = [oracle.Member(0, 1, D=stiffness, GJ=GJ, up=(1.0, 0.0, 0.0))]
    loads = np.zeros((2, 6))
    loads[1] = *load, *moment
    found = oracle.solve_frame(structure.nodes, members, hold(0, "xyz", "xyz"), loads)
    moved = np.asarray(solution.displacement)[1]
    # second order: deflections of 1e-7 m on 4 m
    assert np.abs(moved - found.displacements[1, :3]).max() < 1e-6 * np.abs(moved).max()
    forces = np.asarray(jc.section_forces(structure, solution, PLACES))[0]
    exact = found.internal(0, PLACES)
    assert np.abs(forces - exact).max() < 1e-6 * np.abs(exact).max()
    strain = np.asarray(solution.phases[0].path.strain)[-1, 0]  # at 0, 1/2, 1
    assert np.abs(strain @ stiffness - exact[::4][:, [0, 4, 5]]).max() < 1e-6 * np.abs(exact).max()


# --- neutral axes off the axis of the nodes


@pytest.mark.parametrize("n", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_cantilever_with_its_axis_at_the_edge(n):
    """Before there was a linear axial strain: 0.81, 0.95, 0.99 of it with 1, 2, 4 elements."""
    b, h, E, length = 0.1, 0.2, 30e9, 2.0
    section = jc.Section.rectangle(b, h, jc.Elastic(E)).shifted(z=h / 2)
    structure = beam(n, (length, 0, 0), jc.clamped([0]), section=section)
    structure = beam(n, (length, 0, 0), jc.clamped([0]), section=section, up=(0.0, 0.0, 1.0))
    solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([n], (0.0, 0.0, -1.0))))
    assert int(solution.status) == 0
    found = float(solution.displacement[n, 2])
    exact = oracle.offset_cantilever(-1.0, 0.0, length, E * b * h, E * b * h**3 / 12, h / 2)[1]
    # second order in a deflection of 1e-7 m, and the rounding of lengths of 2 m
    assert found == pytest.approx(exact, rel=1e-7)


CRACKED = oracle.CrackedSection(0.2, 0.4, 30e9, 200e9, 6e-4, 0.16)


def cracked(n, force):
    """Tip deflection of a reinforced cantilever, 3 m, 20 kN at its tip, in the x-z plane."""
    layers = 400
    concrete = jc.Polygonal([-0.1, 0.0, 1e-8, 0.1], [-3e9, 0.0, 300.0, 300.0])
    z = (np.arange(layers) + 0.5) / layers * 0.4 - 0.2
    section = jc.Section(
        np.zeros(layers + 2),
        np.append(z, [0.16, -0.16]),
        np.append(np.full(layers, 0.2 * 0.4 / layers), [6e-4, 6e-4]),
        (concrete, jc.Elastic(200e9)),
        (layers, 2),
    )
    supports = jc.clamped([0]) + jc.restrained(np.arange(1, n + 1), "y", "xz")
    nodes = np.linspace([0.0, 0, 0], [3.0, 0, 0], n + 1)
    group = jc.Beams(chain(n), section=section, torsional_stiffness=1e6)
    structure = jc.Structure(nodes, group, supports)
    solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([n], (force, 0.0, -20e3))))
    assert int(solution.status) == 0
    return float(solution.displacement[n, 2])


def bent_by(force, tip, length, n=201):
    """Deflection of the tip under axial force and tip load, in the deflected shape, apart from it.

    Curvatures by the independent section at the moments of the deflected axis, integrated twice,
    until they agree.
    """
    x = np.linspace(0.0, length, n)
    deflection = np.zeros(n)
    for _ in range(30):
        moment = tip * (length - x) - force * (deflection[-1] - deflection)
        curvature = np.array([CRACKED.strains(force, m)[1] for m in moment])
        slope = np.append(0.0, np.cumsum(np.diff(x) * 0.5 * (curvature[1:] + curvature[:-1])))
        new = np.append(0.0, np.cumsum(np.diff(x) * 0.5 * (slope[1:] + slope[:-1])))
        change, deflection = np.abs(new - deflection).max(), new
        if change < 1e-9 * np.abs(new).max():
            return deflection[-1]
    raise AssertionError("no equilibrium")


# 400 layers, one of which the crack ends in: 1e-3. Between the Lobatto points of one element the
# crack begins somewhere: its curvature has a kink that P2 does not follow.
@pytest.mark.parametrize(
    ("force", "n", "error"),
    [
        (0.0, 1, 2e-3),
        pytest.param(0.0, 2, 2e-3, marks=pytest.mark.slow),
        pytest.param(-200e3, 1, 3e-2, marks=pytest.mark.slow),
        pytest.param(-200e3, 2, 1e-2, marks=pytest.mark.slow),
        pytest.param(-200e3, 4, 5e-3, marks=pytest.mark.slow),
    ],
)
def test_a_cracked_cantilever(force, n, error):
    """Before: 11, 3 % too stiff with 1, 2 elements without axial force, 19 % in one with it."""
    exact = CRACKED.tip_deflection(20e3, 0.0, 3.0) if force == 0 else bent_by(force, 20e3, 3.0)
    assert cracked(n, force) == pytest.approx(-exact, rel=error)


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
    for n in (2, 4, 8):
        structure = beam(n, (length, 0, 0), jc.clamped([0]), up=(0.0, 0.0, 1.0))
        load = jc.LineLoads((0.0, 0.0, -q))
        solution = jc.solve(structure, jc.Phase(loads=load, increments=4))
        assert int(solution.status) == 0
        forces = np.asarray(jc.section_forces(structure, solution, PLACES))
        at = (np.arange(n)[:, None] + PLACES) * length / n
        slope, curvature = rod.sol(at.ravel())[:2]
        pull = -q * (length - at.ravel())  # of what is beyond, along z
        exact = np.stack([pull * np.sin(slope), pull * np.cos(slope), -EI * curvature], axis=1)
        scale = np.array([q * length, q * length, q * length**2])
        apart = (forces.reshape(-1, 6)[:, [0, 2, 4]] - exact) / scale
        errors.append(np.abs(apart).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 2e-3 and (rates > 1.8).all(), (errors, rates)
