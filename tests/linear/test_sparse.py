"""Analyses with sparse matrices beside the same with dense ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.problems import CHOLMOD, PARDISO, unbalanced
from extensions.own_solver import NUMPY
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.linear import host


def assert_same(dense, sparse, size):
    """Equal ends within `size`, m, and 1e-6 of the largest tension."""
    assert int(dense.status) == int(sparse.status) == 0
    assert jnp.abs(dense.displacement - sparse.displacement).max() < size
    scale = max(float(jnp.abs(t).max()) for t in jax.tree.leaves(dense.tension))
    for a, b in zip(jax.tree.leaves(dense.tension), jax.tree.leaves(sparse.tension), strict=True):
        assert jnp.abs(a - b).max() < 1e-6 * scale


@pytest.mark.slow_cases("cholmod", "superlu")
@pytest.mark.parametrize("solver", ["superlu", NUMPY, CHOLMOD, PARDISO])
def test_a_slack_saddle_in_increments(solver, monkeypatch):
    """Slack cables in every increment; balance checked by lengths alone, in NumPy.

    One analysis of the pattern serves all phases, increments and changes of numbers.
    """
    made, original = [], host.AnalysedPattern.__init__

    def counted(self, *args):
        made.append(1)
        original(self, *args)

    monkeypatch.setattr(host.AnalysedPattern, "__init__", counted)
    host.forget_analyses()
    structure, phases = jc.scenes.saddle(7, 7, load=20000.0, increments=(1, 3))
    for scale in (1.0, 1.1):
        case = jc.replace(structure, nodes=structure.nodes * scale)
        dense, sparse = (
            jc.solve(case, phases, jc.Newton(linear_solver=name)) for name in ("dense", solver)
        )
        assert_same(dense, sparse, 1e-9)
        path, known = sparse.phases[1].path, dense.phases[1].path
        assert int(path.n_slack[-1]) > 10
        assert np.array_equal(path.n_slack, known.n_slack)
        assert np.sum(path.factorizations) < np.sum(path.iterations)
        assert np.array_equal(known.factorizations, known.iterations)
        out, force = unbalanced(
            np.asarray(case.nodes),
            structure.elements.links.array,
            np.asarray(structure.elements.axial_stiffness),
            np.asarray(sparse.rest_length),
            np.asarray(sparse.positions),
            np.asarray(sparse.load),
        )
        free = phases[1].loads.nodes.array
        assert np.abs(out[free]).max() < 1e-9 * force.max()
    assert len(made) == 1


@pytest.mark.slow
def test_an_unsymmetric_tangent():
    """A nodal moment on a bent cantilever has no potential: LU, and its transpose for gradients."""
    nodes = np.column_stack([np.linspace(0, 2, 7), np.zeros((7, 2))])
    section = jc.Section.rectangle(0.02, 0.03, jc.Elastic(2e11), shape=(4, 6))
    beams = jc.Beams([[k, k + 1] for k in range(6)], section=section, up=(0, 1.0, 0.2))
    structure = jc.Structure(nodes, beams, jc.clamped([0]))

    def height(moment, name):
        loads = jc.NodalLoads([6], (100.0, 300.0, 200.0), moments=moment)
        phase = jc.Phase(loads=loads, increments=4)
        solution = jc.solve(structure, [phase], jc.Newton(linear_solver=name))
        return solution.displacement[6, 1], solution

    moment = jnp.array([300.0, 500.0, -400.0])
    ends = [jax.value_and_grad(height, has_aux=True)(moment, name) for name in ("dense", "superlu")]
    ((_, dense), slope), ((_, sparse), other) = ends
    assert_same(dense, sparse, 1e-9)
    assert float(jnp.abs(dense.displacement[6]).max()) > 0.1  # turned far enough to matter
    assert jnp.abs(other - slope).max() < 1e-9 * jnp.abs(slope).max()


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["superlu", PARDISO])
def test_the_hard_case(solver):
    """saddle(100, 100): 124 cables go slack, as in OpenSees with bars that take no compression."""
    solution = converged(jc.solve(*jc.scenes.saddle(100, 100), jc.Newton(linear_solver=solver)))
    path = solution.phases[1].path
    assert int(path.n_slack[-1]) == 124
    assert int(jnp.sum(solution.tension == 0)) == 124 and float(solution.tension.min()) == 0
    assert int(path.iterations[-1]) <= 45


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["superlu", PARDISO])
def test_no_deadlock_at_60_000_unknowns(solver):
    jc.forget_programs()  # of other tests: this one takes most memory
    structure, phases = jc.scenes.saddle(140, 140, load=5000 / 141)

    def deflection(pretension):
        phase = jc.Phase(pretension=pretension)
        solution = jc.solve(structure, [phase, phases[1]], jc.Newton(linear_solver=solver))
        return solution.displacement[10000, 2], solution.status

    for _ in range(3):
        (_, code), slope = jax.value_and_grad(deflection, has_aux=True)(20e3)
        assert int(code) == 0 and np.isfinite(slope)
