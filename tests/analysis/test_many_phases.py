"""Phases are data: as many as there are, one program; and each as if it were analysed by itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged
from oracles.taylor import TIGHT
from oracles.traced import traced

import jaxcable as jc

STRUCTURE, (PRESTRESS, LOADING) = jc.scenes.flat_net(load=15.0)
FREE = [3, 4, 7, 8]


def push(force, nodes=FREE):
    return jc.NodalLoads(nodes, (0.0, 0.0, -force))


def lines(phases):
    """Lines of StableHLO of an analysis of the flat net with its gradient by its nodes."""

    def deflection(nodes):
        return jc.solve(jc.replace(STRUCTURE, nodes=nodes), phases).displacement[3, 2]

    function = jax.jit(jax.value_and_grad(deflection))
    return function.lower(jnp.asarray(STRUCTURE.nodes)).as_text().count("\n")


@pytest.mark.slow
def test_their_number_does_not_enter_the_size_of_the_program():
    # 4 increments: arrays of phases and of increments that are equally long share small functions
    more = jc.Phase(loads=push(1.0), increments=4)
    few, many = (lines([PRESTRESS] + [more] * n) for n in (1, 31))
    assert few == many
    # another kind of load is another piece of program (a dead one: under others it is no net)
    wind = jc.LineLoads((0.0, 1.0, 0.0), per="initial")
    assert lines([PRESTRESS, jc.Phase(loads=[push(1.0), wind], increments=4)]) > few


def carrier():
    """A rope over a mast and cables, and phases of every kind: a building site."""
    nodes = np.array(
        [[-4.0, 0, 3], [0.1, 0, 0], [4.0, 0, 3], [0, 3.0, 2.0], [0.0, -3.0, 2.0], [1.0, 1.0, -3.0]]
    )
    links = [[0, 1], [1, 2], [1, 3], [1, 4], [1, 5]]
    cables = jc.Cables(links, axial_stiffness=1e5, weight=2.0, expansion=1e-5)
    ends = jc.pinned([0, 2, 3, 4, 5])
    structure = jc.Structure(nodes, cables, supports=ends)
    line = jc.LineLoads((0.0, 0.0, -3.0), per="initial")
    return structure, [
        jc.Phase(pretension=500.0, increments=2),
        jc.Phase(loads=[jc.SelfWeight(), push(20.0, [1])], supports=ends + jc.restrained([1], "y")),
        jc.Phase(shortening=jc.only([0, 2], 0.002), loads=line, increments=3),
        jc.Phase(loads=[line, jc.CablePressure(5.0, axis=(0.0, 1.0, 0.0))], supports=ends),
        jc.Phase(jacking=jc.only([4], 700.0), increments=2),
        jc.Phase(temperature=15.0),
        jc.Phase(loads=jc.SupportMovement([5], (0.0, 0.0, -0.01)), supports=ends),
        jc.Phase(
            loads=[push(-5.0, [1]), jc.LineLoads((1.0, 0.0, 0.0))], supports=jc.pinned(range(6))
        ),
    ]


@pytest.mark.parametrize(
    "method", [TIGHT, pytest.param(jc.Incremental(corrections=3), marks=pytest.mark.slow)]
)
def test_all_at_once_is_one_after_the_other(method):
    """Two phases at a time, each analysis from the end of the one before."""
    structure, phases = carrier()
    whole = converged(jc.solve(structure, phases, method))
    step = None
    # equilibrium to 1e-13 of some kN at stiffnesses of 1e4 N/m
    near = {"tension": 1e-8, "reactions": 1e-8, "load": 1e-8}
    near |= dict.fromkeys(("displacement", "rest_length", "positions"), 1e-11)
    for k in range(0, len(phases), 2):
        step = converged(jc.solve(structure, phases[k : k + 2], method, start=step))
        for j, alone in enumerate(step.phases):
            own = whole.phases[k + j]
            assert own.path.load_factor.shape == (phases[k + j].increments,)
            for name, tol in near.items():
                found, expected = getattr(own, name), getattr(alone, name)
                np.testing.assert_allclose(found, expected, atol=tol, err_msg=f"{k + j} {name}")
            np.testing.assert_allclose(own.path.tension, alone.path.tension, atol=1e-8)
    np.testing.assert_allclose(whole.load, step.load, atol=1e-9)
    np.testing.assert_allclose(whole.positions, step.positions, atol=1e-11)


@pytest.mark.slow
def test_results_of_phases_are_a_sequence():
    solution = jc.solve(STRUCTURE, [PRESTRESS, LOADING])
    _, last = solution.phases
    assert len(solution.phases) == 2 and len(solution.phases[1:]) == 1
    np.testing.assert_array_equal(solution.phases[-1].tension, last.tension)
    with pytest.raises(IndexError):
        solution.phases[2]
    assert isinstance(last.tension, jax.Array)
    np.testing.assert_array_equal(last.tension, solution.tension)
    assert last.path.status.dtype == np.int32 and last.path.equilibrated.dtype == bool

    def load(factor):
        phases = [PRESTRESS, jc.Phase(loads=push(factor), increments=3)]
        return jc.solve(STRUCTURE, phases)

    batch, alone = traced(jax.vmap(load))(jnp.array([5.0, 10.0])), traced(load)(10.0)
    own = batch.phases[1]
    assert own.displacement.shape == (2, 12, 3) and own.path.tension.shape == (2, 3, 12)
    assert own.path.load_factor.shape == own.path.status.shape == (2, 3)
    np.testing.assert_allclose(own.path.tension[1], alone.phases[1].path.tension, rtol=1e-9)
    picked = jax.tree.map(lambda x: x[1], batch)
    np.testing.assert_array_equal(picked.phases[1].path.residual, own.path.residual[1])
