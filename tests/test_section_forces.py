"""Section forces along beams, axial strain and neutral axes: an independent stiffness method."""

import numpy as np
import pytest
import stiffness_method as oracle

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
