"""Analyses with sparse matrices beside the same with dense ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.problems import CHOLMOD, PARDISO, unbalanced
from extensions.own_solver import NUMPY

import jaxcable as jc
from jaxcable.linear import host

SPARSE = [
    "superlu",
    pytest.param(NUMPY, marks=pytest.mark.slow),
    CHOLMOD,
    PARDISO,
]
HEAVY = ["superlu", pytest.param("pardiso", marks=[pytest.mark.slow, *PARDISO.marks])]


def both(structure, phases, solver, method=jc.Newton, **options):
    return [
        jc.solve(structure, phases, method(linear_solver=name, **options))
        for name in ("dense", solver)
    ]


def assert_same(dense, sparse, size):
    """Equal ends within `size`, m, and 1e-6 of the largest tension."""
    assert int(dense.status) == int(sparse.status) == 0
    assert jnp.abs(dense.displacement - sparse.displacement).max() < size
    scale = max(float(jnp.abs(t).max()) for t in jax.tree.leaves(dense.tension))
    for a, b in zip(jax.tree.leaves(dense.tension), jax.tree.leaves(sparse.tension), strict=True):
        assert jnp.abs(a - b).max() < 1e-6 * scale


@pytest.mark.slow
@pytest.mark.parametrize("solver", SPARSE)
def test_a_slack_saddle_in_increments(solver):
    """More slack cables with every increment; balance checked by lengths alone, in NumPy."""
    structure, phases = jc.scenes.saddle(12, 12, load=10000.0, increments=(1, 3))
    dense, sparse = both(structure, phases, solver)
    assert_same(dense, sparse, 1e-9)
    path = sparse.phases[1].path
    assert int(path.n_slack[-1]) > 20
    assert np.array_equal(path.n_slack, dense.phases[1].path.n_slack)
    assert np.sum(path.factorizations) < np.sum(path.iterations)
    assert np.array_equal(dense.phases[1].path.factorizations, dense.phases[1].path.iterations)
    links = structure.elements.links.array
    out, force = unbalanced(
        np.asarray(structure.nodes),
        links,
        np.asarray(structure.elements.axial_stiffness),
        np.asarray(sparse.rest_length),
        np.asarray(sparse.positions),
        np.asarray(sparse.load),
    )
    free = phases[1].loads.nodes.array
    assert np.abs(out[free]).max() < 1e-9 * force.max()
    assert np.abs(force - np.asarray(sparse.tension)).max() < 1e-7 * force.max()


@pytest.mark.slow
@pytest.mark.parametrize("solver", HEAVY)
@pytest.mark.parametrize("stiffness", ["tangent", "secant"])
def test_incremental_forms(solver, stiffness):
    structure, phases = jc.scenes.saddle(4, 3, load=1000.0, increments=(3, 4))

    def middle(pretension, name, stiffness):
        method = jc.Incremental(linear_solver=name, stiffness=stiffness)
        first = jc.Phase(pretension=pretension, increments=3)
        solution = jc.solve(structure, [first, phases[1]], method)
        return solution.displacement[9, 2], solution

    ends = [
        jax.value_and_grad(middle, has_aux=True)(2e4, name, stiffness) for name in ("dense", solver)
    ]
    (_, dense), slope = ends[0]
    (_, sparse), other = ends[1]
    assert_same(dense, sparse, 1e-12)
    assert float(other) == pytest.approx(float(slope), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("solver", HEAVY)
def test_an_unsymmetric_tangent(solver):
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
    (_, dense), slope = jax.value_and_grad(height, has_aux=True)(moment, "dense")
    (_, sparse), other = jax.value_and_grad(height, has_aux=True)(moment, solver)
    assert_same(dense, sparse, 1e-9)
    assert float(jnp.abs(dense.displacement[6]).max()) > 0.1  # turned far enough to matter
    assert jnp.abs(other - slope).max() < 1e-9 * jnp.abs(slope).max()


@pytest.mark.slow
@pytest.mark.parametrize("solver", HEAVY)
def test_a_gradient_by_taylor_with_slack_cables_and_changed_supports(solver):
    structure, _ = jc.scenes.saddle(8, 8)
    free = np.setdiff1d(np.arange(structure.n_node), structure.supports.nodes.array)
    held = jc.pinned(np.append(structure.supports.nodes.array, free[27]))
    direction = np.random.default_rng(0).normal(size=len(structure.elements.links))

    def f(s):
        phases = [
            jc.Phase(pretension=20e3 * (1 + s * direction / 20)),
            jc.Phase(supports=held, loads=jc.NodalLoads(free, (0, 0, -30000.0)), increments=2),
        ]
        solution = jc.solve(structure, phases, jc.Newton(linear_solver=solver))
        weights = jnp.cos(jnp.arange(structure.n_node))
        slack = solution.phases[1].path.n_slack[-1]
        return weights @ solution.displacement[:, 2], slack + 1000 * solution.status

    value, slope = jax.value_and_grad(f, has_aux=True)(0.0)
    assert 10 < int(value[1]) < 1000  # slack cables, and status OK
    steps = np.array([1e-2, 5e-3, 2.5e-3])
    off = np.array([float(f(s)[0]) for s in steps]) - float(value[0])
    rest = np.abs(off - float(slope) * steps)
    wrong = np.abs(off - 1.01 * float(slope) * steps)
    rate = np.diff(np.log(rest)) / np.diff(np.log(steps))
    assert np.abs(rate - 2).max() < 0.1
    assert (np.diff(np.log(wrong)) / np.diff(np.log(steps))).max() < 1.5


def failing():
    """Analyses that fail, each with its status."""
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0]])
    line = jc.Structure(nodes[:3], jc.Cables([[0, 1]], axial_stiffness=1e4), jc.pinned([0, 2]))
    sideways = jc.Phase(loads=jc.NodalLoads([1], (0.0, 5.0, -1.0)))
    yield (
        "mechanism",
        jc.Structure(
            nodes[:3],
            jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e4),
            jc.Supports(mask=np.array([[0, 1, 1], [0, 0, 0], [0, 1, 1]], bool)),
        ),
        [jc.Phase(loads=jc.NodalLoads([2], (5.0, 0, 0)))],
        jc.Newton,
        {},
    )
    yield "steps", line, [sideways], jc.Newton, {"max_steps": 2}
    yield "nan", line, [jc.Phase(loads=jc.NodalLoads([1], (np.nan, 0, 0)))], jc.Newton, {}
    bars = jc.Structure(
        nodes[:3], jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e4), jc.pinned([0, 2])
    )
    yield "drift", bars, [jc.Phase(pretension=1.0), sideways], jc.Incremental, {"tol": 1e-6}


@pytest.mark.slow
@pytest.mark.parametrize("solver", HEAVY)
@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case[0], marks=pytest.mark.slow if case[0] == "drift" else [])
        for case in failing()
    ],
)
def test_failures_have_the_same_status_and_nan_gradients(case, solver):
    _, structure, phases, method, options = case

    def end(nodes, name):
        changed = jc.replace(structure, nodes=nodes)
        solution = jc.solve(changed, phases, method(linear_solver=name, **options))
        return jnp.sum(solution.displacement), solution.status

    codes = []
    for name in ("dense", solver):
        (value, code), gradient = jax.value_and_grad(end, has_aux=True)(structure.nodes, name)
        codes.append(int(code))
        assert np.isnan(value) and np.isnan(gradient).any()
    assert codes[0] == codes[1] != 0


@pytest.mark.slow
@pytest.mark.parametrize("solver", SPARSE)
def test_loose_nodes_have_no_derivative_and_leave_others_theirs(solver):
    """A cable hangs from a taut net into the air, without load: its end is anywhere."""
    structure, _ = jc.scenes.flat_net()
    nodes = np.vstack([structure.nodes, np.asarray(structure.nodes)[3] + [0, 0, -0.1]])
    links = np.vstack([structure.elements.links.array, [3, 12]])
    rest = np.append(np.full(12, 0.399), 0.2)
    hung = jc.Structure(
        nodes,
        jc.Cables(links, axial_stiffness=97.97e3, rest_length=rest),
        jc.pinned([0, 1, 2, 5, 6, 9, 10, 11]),
    )

    def positions(stiffness, name):
        elements = jc.replace(hung.elements, axial_stiffness=stiffness)
        phase = jc.Phase(loads=jc.NodalLoads([3, 4], (0.0, 0.0, -15.0)))
        changed = jc.replace(hung, elements=elements)
        solution = jc.solve(changed, [phase], jc.Newton(linear_solver=name))
        return solution.positions, solution.phases[0].path.n_loose[-1] + 100 * solution.status

    derivative = [
        jax.jacfwd(positions, has_aux=True)(jnp.array(97.97e3), n) for n in ("dense", solver)
    ]
    for slope, code in derivative:
        assert int(code) == 1
        assert np.isnan(slope[12]).all() and np.isfinite(slope[:12]).all()
    assert jnp.abs(derivative[0][0][:12] - derivative[1][0][:12]).max() < 1e-14
    back = jax.grad(lambda s: positions(s, solver)[0][3, 2])(97.97e3)
    assert float(back) == pytest.approx(float(derivative[0][0][3, 2]), rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("solver", SPARSE)
def test_one_analysis_of_the_pattern_serves_all_changes_of_numbers(solver, monkeypatch):
    made = []
    original = host.Analysed.__init__

    def counted(self, *args):
        made.append(1)
        original(self, *args)

    monkeypatch.setattr(host.Analysed, "__init__", counted)
    structure, phases = jc.scenes.saddle(5, 4, load=1000.0)
    count = 0
    for scale in (1.0, 1.1, 1.2):
        nodes = structure.nodes * scale
        solution = jc.solve(
            jc.replace(structure, nodes=nodes), phases, jc.Newton(linear_solver=solver)
        )
        assert int(solution.status) == 0
        count += int(sum(phase.path.factorizations.sum() for phase in solution.phases))
    assert len(made) == 1
    assert count <= 4  # the second phase goes on with the factor of the first


@pytest.mark.slow
@pytest.mark.parametrize("solver", HEAVY)
def test_the_hard_case(solver):
    """saddle(100, 100): 124 cables go slack, as in OpenSees with bars that take no compression."""
    solution = jc.solve(*jc.scenes.saddle(100, 100), jc.Newton(linear_solver=solver))
    assert int(solution.status) == 0
    path = solution.phases[1].path
    assert int(path.n_slack[-1]) == 124
    assert int(jnp.sum(solution.tension == 0)) == 124 and float(solution.tension.min()) == 0
    assert int(path.iterations[-1]) <= 45


@pytest.mark.slow
@pytest.mark.parametrize("solver", HEAVY)
def test_no_deadlock_at_120_000_unknowns(solver):
    structure, phases = jc.scenes.saddle(200, 200, load=5000 / 201)

    def deflection(pretension):
        solution = jc.solve(
            structure,
            [jc.Phase(pretension=pretension), phases[1]],
            jc.Newton(linear_solver=solver),
        )
        return solution.displacement[20000, 2], solution.status

    for _ in range(5):
        (_, code), slope = jax.value_and_grad(deflection, has_aux=True)(20e3)
        assert int(code) == 0 and np.isfinite(slope)
