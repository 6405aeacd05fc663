"""Closed forms: two links, their order of convergence, and the bank of shapes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks import shapes
from banks.problems import assert_balanced, two_links, two_links_exact
from oracles.convergence import converged

import jaxcable as jc


def solve_two_links(ratio, angle, dtype, method=None):
    """Two links, prestressed from no stiffness by 1 N, and pulled across by 0.2 N."""
    structure, normal = two_links(ratio, 1.0, 0.2, angle)
    structure = jc.replace(structure, nodes=jnp.asarray(structure.nodes, dtype))
    load = jc.NodalLoads([1], 0.2 * normal)
    phases = [jc.Phase(pretension=1.0, increments=5), jc.Phase(loads=load, increments=3)]
    solution = converged(jc.solve(structure, phases, method))
    # the coordinates as they are rounded, so that the error is that of the analysis
    half_span = np.linalg.norm(np.asarray(structure.nodes[2], float))
    w, force = two_links_exact(ratio, 1.0, 0.2, half_span)
    moved = np.asarray(solution.displacement[1], float) @ normal
    tension = np.asarray(solution.tension, float)
    return solution, max(abs(moved / w - 1), np.abs(tension / force - 1).max())


@pytest.mark.slow_cases("100.0-0.0")
@pytest.mark.parametrize("angle", [0.0, 0.5])
@pytest.mark.parametrize("ratio", [1e2, 1e4, 1e6, 1e8])
def test_two_links_keep_their_digits_at_any_stiffness(ratio, angle):
    """From no stiffness at all (unstressed, in line) up to T with EA/T = ratio."""
    solution, error = solve_two_links(ratio, angle, float, jc.Newton(tol=1e-13))
    assert_balanced(solution)
    assert error <= 1e-11


@pytest.mark.parametrize("angle", [0.0, 0.5])
@pytest.mark.parametrize("ratio", [1e2, 1e3, 1e5])
def test_two_links_in_single_precision(ratio, angle):
    solution, error = solve_two_links(ratio, angle, np.float32)
    assert error <= 1e-5
    floats = [x for x in jax.tree.leaves(solution) if jnp.issubdtype(x.dtype, jnp.floating)]
    assert {x.dtype for x in floats} == {jnp.dtype("float32")}


def solve_string_in_parts(method, pieces, parts):
    """Relative error at 10 N of two links under 10 N of prestress, in parts of so many increments.

    Every part is an analysis that starts where the last one ended, so that all share a program.
    """
    structure, normal = two_links(100.0, 10.0, 10.0)
    solution = jc.solve(structure, jc.Phase(pretension=10.0), jc.Newton())
    load = jc.NodalLoads([1], 10.0 / parts * normal)
    for _ in range(parts):
        phase = jc.Phase(loads=load, increments=pieces)
        solution = jc.solve(structure, phase, method, start=solution)
    jc.raise_if_failed(solution)
    w, _ = two_links_exact(100.0, 10.0, 10.0)
    return abs(float((solution.positions[1] - structure.nodes[1]) @ normal) - w) / w


@pytest.mark.slow_cases("0-4-2")
@pytest.mark.parametrize(("corrections", "parts", "order"), [(0, 4, 2), (1, 4, 4), (2, 1, 8)])
def test_order_of_the_incremental_scheme(corrections, parts, order):
    method = jc.Incremental(corrections, tol=np.inf)
    errors = [solve_string_in_parts(method, 8 if order == 8 else 10, n) for n in (parts, 2 * parts)]
    rate = np.log2(errors[0] / errors[1])
    # 10 percent: at these increments the rate has come down to 2.007, 4.04 and 8.40
    assert abs(rate - order) < 0.1 * order, (errors, rate)


def test_secant_scheme_has_the_known_errors():
    """2.5 % and 0.25 % at 10 and 100 increments on two links: of first order."""
    method = jc.Incremental(stiffness="secant", tol=np.inf)
    for increments, expected in ((10, 0.025), (100, 0.0025)):
        assert abs(solve_string_in_parts(method, increments, 1) - expected) < 0.1 * expected


def test_first_increment_of_an_unstressed_mechanism_is_solved_to_equilibrium():
    structure, normal = two_links(100.0, 0.0, 1.0)
    phase = jc.Phase(loads=jc.NodalLoads([1], normal), increments=20)
    solution = converged(jc.solve(structure, [phase], jc.Incremental(corrections=1)))
    path = solution.phases[0].path
    assert path.equilibrated.tolist() == [True] + [False] * 19
    w, _ = two_links_exact(100.0, 0.0, 1.0)
    assert abs(float(solution.displacement[1] @ normal) - w) < 1e-4 * w


SHAPES = {
    "cross": (shapes.cross(pretension=200.0), 150.0, 1e-10),
    "cross without tension": (shapes.cross(), 150.0, 1e-10),
    "six cables": (shapes.spokes(6, pretension=50.0), 1500.0, 1e-10),
    "tripod": (shapes.tripod(height=0.5), 2000.0, 1e-10),
    "chain": (shapes.chain(weight=2.0), 40.0, 1e-9),
    "chain of bars": (shapes.chain(group=jc.Bars), 40.0, 1e-9),
    "cantilever": (shapes.cantilever(), 0.01, 1e-4),  # the fibres are points
}


@pytest.mark.slow_cases("cantilever", "six cables", "chain of bars")
@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_has_its_known_solution(name):
    shape, force, error = SHAPES[name]
    loads = [shape.load(force)]
    weight = 0.0
    if name == "chain":
        loads, weight = [*loads, jc.SelfWeight()], 3 * 2.0
    solution = converged(jc.solve(shape.structure, jc.Phase(loads=loads)))
    drop, forces = shape.known(force)
    assert -solution.displacement[shape.node, 2] == pytest.approx(drop, rel=error)
    if name != "cantilever":
        np.testing.assert_allclose(solution.tension, forces, rtol=error, atol=1e-9)
        assert np.all(np.abs(forces) > 10.0)
        assert_balanced(solution)
    assert float(solution.reactions[:, 2].sum()) == pytest.approx(force + weight, rel=1e-9)
