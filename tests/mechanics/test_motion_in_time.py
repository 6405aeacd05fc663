"""Motion in time by a `System` with inertia (`extensions/own_motion.py`), against other models.

The solvers of equilibrium bring it to the end of every step as they bring any other system.
"""

import ast
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import pieces
from extensions.own_motion import GRAVITY, at_rest, history, let_go
from numpy.testing import assert_allclose
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.common.tree import copy_with
from jaxcable.spaces.dof_map import make_dof_map

# weights are masses
pytestmark = pytest.mark.filterwarnings("ignore:elements.*no phase has SelfWeight")


def gone(system, start, duration, count, damping=0.0, rho=None):
    """All `InMotion` of a motion whose steps all have converged."""
    found, codes = history(system, start, duration, count, damping, rho)
    assert codes == [0] * count
    return found


def test_solvers_ask_the_system_for_all_forces():
    """Dead loads alone are what a phase adds (`convergence`)."""
    package, found = Path(jc.__file__).parent, set()
    for path in [*package.glob("equilibrium/*.py"), *package.glob("paths/*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and ast.unparse(node) == "system.load":
                found.add(path.stem)
    assert found == {"convergence"}


@pytest.mark.slow
@pytest.mark.slow_cases("paired0")
@pytest.mark.parametrize("paired", [(), (True,)])
def test_a_sparse_tangent_has_places_for_inertia(paired):
    """The links of the elements once more, after all that the pattern has places for.

    A taut string is plucked to half a sine of 10 um.
    """
    n, length = 8, 10.0
    nodes, links = pieces(n, length)
    cables = jc.Cables(links, axial_stiffness=1e5, weight=5.0)
    structure = jc.Structure(nodes, cables, jc.pinned([0, n]))
    solution = converged(jc.solve(structure, jc.Phase(pretension=1000.0)))
    system, x = at_rest(structure, solution)
    assert system.is_net
    x = x.at[:, 2].add(1e-5 * np.sin(np.pi * nodes[:, 0] / length))
    links = structure.elements.links, 3, ()
    fixed = structure.fixed(structure.supports)
    dof_map = make_dof_map(fixed, None, (links, links), "superlu", paired=paired)
    sparse = copy_with(system, space=copy_with(system.space, dof_map=dof_map))
    begun = let_go(system, x, jnp.zeros_like(x))
    ends = [gone(one, begun, 0.02, 1)[-1].motion for one in (system, sparse)]
    assert np.abs(np.asarray(ends[0] - x)).max() > 1e-7
    assert_allclose(ends[1], ends[0], rtol=0, atol=1e-15)


@pytest.mark.parametrize("rho", [None, 0.5])
@pytest.mark.parametrize("damping", [0.0, 3.0])
def test_a_linear_chain(rho, damping):
    """Bars along x: the recurrence of the method for matrices, and its energy."""
    stiffness, weight, n = 3000.0, 200.0, 3
    nodes, links = pieces(n, n)
    bars = jc.Bars(links, axial_stiffness=stiffness, weight=weight)
    supports = jc.pinned([0]) + jc.restrained(range(1, n + 1), "yz")
    structure = jc.Structure(nodes, bars, supports)
    load = np.array([0.0, 0.0, 30.0])
    solution = converged(jc.solve(structure, jc.Phase(loads=jc.NodalLoads([n], (30.0, 0.0, 0.0)))))
    system, x = at_rest(structure, solution)
    system = copy_with(system, load=0.0 * system.load)  # let go

    stiff = stiffness * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    mass = weight / GRAVITY * (5 / 6 * np.eye(n) + (np.eye(n, k=1) + np.eye(n, k=-1)) / 12)
    stiff[-1, -1], mass[-1, -1] = stiffness, mass[-1, -1] / 2
    m, f = (0.0, 0.0) if rho is None else ((2 * rho - 1) / (rho + 1), rho / (rho + 1))
    beta, gamma, h = 0.25 * (1 - m + f) ** 2, 0.5 - m + f, 0.05
    u, v = np.linalg.solve(stiff, load), np.zeros(n)
    a = np.linalg.solve(mass, -stiff @ u)
    found = gone(system, let_go(system, x, jnp.zeros_like(x), damping), h, 30, damping, rho=rho)
    energies = []
    for ended in found[1:]:
        # by the acceleration at the end, as in the paper
        ahead = u + h * v + h**2 * (0.5 - beta) * a
        faster = v + h * (1 - gamma) * a
        whole = (1 - m) * mass + (1 - f) * (h * gamma * damping * mass + h**2 * beta * stiff)
        rest = m * mass @ a + damping * mass @ ((1 - f) * faster + f * v)
        new = np.linalg.solve(whole, -rest - stiff @ ((1 - f) * ahead + f * u))
        u, v, a = ahead + h**2 * beta * new, faster + h * gamma * new, new
        # residuals are up to 1e-10 of the forces, 30 N
        assert_allclose(ended.motion[1:, 0], u, rtol=0, atol=1e-10)
        speed = np.asarray(ended.velocity[1:, 0])
        energies.append(0.5 * (speed @ mass @ speed + u @ stiff @ u))
    if rho is None and damping == 0.0:
        assert_allclose(energies, 0.5 * load @ np.linalg.solve(stiff, load), rtol=1e-8)
    else:
        assert energies[-1] < 0.9 * energies[0]
