"""Outside of `jit`, nets first run a program without fallbacks, with the same result."""

import jax
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.analysis import outside_jit, phase_loop


def programs(structure, phases, method=None):
    """The solution, and how many programs `solve` has compiled for it."""
    before = len(phase_loop.analyse.known)
    solution = jc.solve(structure, phases, method)
    return solution, len(phase_loop.analyse.known) - before


def check_same(structure, phases, method=None):
    """`solve` outside of `jit` has the results of the program with fallbacks, in as many steps.

    Both for the exact sizes: nodes between slack cables stay where rounding leads them.
    """
    solution = jc.solve(structure, phases, method, exact_sizes=True)
    inside = jax.jit(lambda s: jc.solve(s, phases, method))(structure)
    assert int(solution.status) == int(inside.status) != jc.status.NEEDS_FALLBACKS
    for one, other in zip(solution.phases, inside.phases, strict=True):
        np.testing.assert_array_equal(one.path.iterations, other.path.iterations)
        # other kernels of XLA round otherwise: some eps of the structure's size (metres)
        np.testing.assert_allclose(one.displacement, other.displacement, rtol=0, atol=1e-13)
    return solution


def test_a_prestressed_net_needs_one_program():
    jc.forget_programs()
    structure, phases = jc.scenes.flat_net(load=15.0)
    solution, count = programs(structure, phases)
    assert int(solution.status) == 0 and count == 1 and not outside_jit._fell_back
    check_same(structure, phases)


def test_a_net_that_needs_fallbacks_gets_them():
    """Once: the next analysis of the same shapes begins with them."""
    jc.forget_programs()
    scene = jc.scenes.accuracy_cable()[:2]
    solution, count = programs(*scene)
    assert int(solution.status) == 0 and count == 2 and len(outside_jit._fell_back) == 1
    structure, phases = scene
    moved = jc.replace(structure, nodes=np.asarray(structure.nodes) * 1.001)
    solution, count = programs(moved, phases)
    assert int(solution.status) == 0 and count == 0 and len(outside_jit._fell_back) == 1
    check_same(*scene)
    jc.forget_programs()
    assert not outside_jit._fell_back


def test_a_failure_is_that_with_fallbacks():
    """A slack chain, drawn straight by its free end, needs more than three steps."""
    jc.forget_programs()
    nodes = [[0.0, 0, 0], [1, 0, 0], [0.5, 0, 0.2]]
    structure = jc.Structure(nodes, jc.Cables([[0, 2], [2, 1]], 1e5), jc.pinned([0]))
    pull = jc.Phase(loads=jc.NodalLoads([1], (1.0, 0.0, 0.0)))
    assert int(check_same(structure, pull).status) == 0
    assert int(check_same(structure, pull, jc.Newton(max_steps=3)).status) == 1
    assert len(outside_jit._fell_back) == 1  # other numbers, the same program


@pytest.mark.parametrize("seed", range(4))
def test_random_nets_with_slack_cables(seed):
    """Half of the cables too long: some of these nets fall back, and none shows it."""
    rng = np.random.default_rng(seed)
    structure, _ = jc.scenes.saddle(4, 4)
    count = len(structure.elements.links)
    lengths = np.linalg.norm(
        np.diff(np.asarray(structure.nodes)[structure.elements.links.array], axis=1), axis=2
    )
    rest = lengths[:, 0] * (1.01 + 0.03 * rng.normal(size=count))
    phases = [jc.Phase(rest_length=rest, loads=jc.NodalLoads([5, 6], (0.0, 30.0, -300.0)))]
    solution = check_same(structure, phases)
    assert int(solution.status) == 0 and int(solution.phases[0].path.n_slack[-1]) > 0
