"""Analyses with sparse matrices beside the same with dense ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.problems import CHOLMOD, PARDISO, unbalanced
from extensions.own_solver import NUMPY

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
@pytest.mark.parametrize(
    ("solver", "stiffness"),
    [("superlu", "tangent"), pytest.param("pardiso", "secant", marks=PARDISO.marks)],
)
def test_incremental_forms(solver, stiffness):
    structure, phases = jc.scenes.saddle(4, 3, load=1000.0, increments=(3, 4))

    def middle(pretension, name):
        method = jc.Incremental(linear_solver=name, stiffness=stiffness)
        first = jc.Phase(pretension=pretension, increments=3)
        solution = jc.solve(structure, [first, phases[1]], method)
        return solution.displacement[9, 2], solution

    ends = [jax.value_and_grad(middle, has_aux=True)(2e4, name) for name in ("dense", solver)]
    ((_, dense), slope), ((_, sparse), other) = ends
    assert_same(dense, sparse, 1e-12)
    assert float(other) == pytest.approx(float(slope), rel=1e-9)


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


NODES = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
LINKS = [[0, 1], [1, 2]]
HELD = jc.Supports(mask=np.array([[0, 1, 1], [0, 0, 0], [0, 1, 1]], bool))
LINE = jc.Structure(NODES, jc.Cables(LINKS[:1], axial_stiffness=1e4), jc.pinned([0, 2]))
FREE = jc.Structure(NODES, jc.Cables(LINKS, axial_stiffness=1e4), HELD)
BARS = jc.Structure(NODES, jc.Bars(LINKS, axial_stiffness=1e4), jc.pinned([0, 2]))
SIDEWAYS = jc.Phase(loads=jc.NodalLoads([1], (0.0, 5.0, -1.0)))
FAILING = {
    "mechanism": (FREE, [jc.Phase(loads=jc.NodalLoads([2], (5.0, 0, 0)))], jc.Newton, {}),
    "steps": (LINE, [SIDEWAYS], jc.Newton, {"max_steps": 2}),
    "nan": (LINE, [jc.Phase(loads=jc.NodalLoads([1], (np.nan, 0, 0)))], jc.Newton, {}),
    "drift": (BARS, [jc.Phase(pretension=1.0), SIDEWAYS], jc.Incremental, {"tol": 1e-6}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FAILING)
def test_failures_have_the_same_status_and_nan_gradients(name):
    structure, phases, method, options = FAILING[name]

    def end(nodes, solver):
        changed = jc.replace(structure, nodes=nodes)
        solution = jc.solve(changed, phases, method(linear_solver=solver, **options))
        return jnp.sum(solution.displacement), solution.status

    codes = []
    for solver in ("dense", "superlu"):
        (value, code), gradient = jax.value_and_grad(end, has_aux=True)(structure.nodes, solver)
        codes.append(int(code))
        assert np.isnan(value) and np.isnan(gradient).any()
    assert codes[0] == codes[1] != 0


@pytest.mark.slow
def test_loose_nodes_have_no_derivative_and_leave_others_theirs():
    """A cable hangs from a taut net into the air, without load: its end is anywhere."""
    structure, _ = jc.scenes.flat_net()
    nodes = np.vstack([structure.nodes, np.asarray(structure.nodes)[3] + [0, 0, -0.1]])
    links = np.vstack([structure.elements.links.array, [3, 12]])
    rest = np.append(np.full(12, 0.399), 0.2)

    def positions(stiffness, name):
        cables = jc.Cables(links, axial_stiffness=stiffness, rest_length=rest)
        hung = jc.Structure(nodes, cables, jc.pinned([0, 1, 2, 5, 6, 9, 10, 11]))
        phase = jc.Phase(loads=jc.NodalLoads([3, 4], (0.0, 0.0, -15.0)))
        solution = jc.solve(hung, [phase], jc.Newton(linear_solver=name))
        return solution.positions, solution.phases[0].path.n_loose[-1] + 100 * solution.status

    found = [
        jax.jacfwd(positions, has_aux=True)(jnp.array(97.97e3), name)
        for name in ("dense", "superlu")
    ]
    for slope, code in found:
        assert int(code) == 1
        assert np.isnan(slope[12]).all() and np.isfinite(slope[:12]).all()
    (dense, _), (sparse, _) = found
    assert jnp.abs(dense[:12] - sparse[:12]).max() < 1e-14
    back = jax.grad(lambda s: positions(s, "superlu")[0][3, 2])(97.97e3)
    assert float(back) == pytest.approx(float(dense[3, 2]), rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["superlu", PARDISO])
def test_the_hard_case(solver):
    """saddle(100, 100): 124 cables go slack, as in OpenSees with bars that take no compression."""
    solution = jc.solve(*jc.scenes.saddle(100, 100), jc.Newton(linear_solver=solver))
    assert int(solution.status) == 0
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
