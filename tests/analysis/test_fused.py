"""Where XLA fuses loops, an analysis of a net is one function, and a batch goes case by case.

Most of this file needs XLA's option: `make test` runs it a second time with FUSED_LOOPS=1.
"""

import functools
import os
import re
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scenes
from banks.net_bank import drawn
from conftest import FUSED

import jaxcable as jc
from jaxcable.analysis.preparation import prepare

fused = pytest.mark.skipif(not FUSED, reason="needs FUSED_LOOPS=1, see `make test`")
NETS = {
    "saddle": lambda: jc.scenes.saddle(3, 3),
    "hypar_net": jc.scenes.hypar_net,  # with jacks
    "isolated_cable": scenes.isolated_cable,
}

SCRIPT = """
import os
environment = dict(os.environ)
import jaxcable as jc
assert environment == dict(os.environ)
{before}
jc.fuse_loops()
import jax
loop = jax.jit(lambda x: jax.lax.fori_loop(0, 9, lambda k, y: 0.5 * y.sum() + y[::-1], x))
print("small_call" in loop.lower(jax.numpy.ones(4000)).compile().as_text())
"""


def printed(before="", flags=""):
    """What a process prints that asks for fused loops, and its warnings."""
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(before=before)],
        capture_output=True,
        text=True,
        env=os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"},
        check=True,
    )
    return run.stdout.strip(), run.stderr


@pytest.mark.slow
def test_the_option_reaches_xla():
    assert printed() == ("True", "")
    other = "--xla_backend_extra_options=xla_cpu_disable_loop_unrolling=true"
    assert printed(flags=f"--xla_cpu_multi_thread_eigen=true {other}") == ("True", "")


@pytest.mark.slow
def test_too_late_is_said():
    out, warning = printed("import jax.numpy; jax.numpy.ones(3)")
    if jax.__version_info__ < (0, 11):  # jax 0.12 fuses loops of this size without being asked
        assert out == "False"
    assert "RuntimeWarning: fuse_loops: jax has already computed something" in warning


def compiled(function, *arguments):
    """A compiled program; numbers of its loops outside of single functions, and of these."""
    program = jax.jit(function).lower(*arguments).compile()
    text = program.as_text()
    entry = text[text.index("\nENTRY") :]
    found = len(re.findall(r" while\(", entry)), entry.count('xla_cpu_small_call="true"')
    return program, found


def assert_same_steps(one, two):
    assert int(one.status) == int(two.status) == jc.status.OK
    for own, other in zip(one.phases, two.phases, strict=True):
        np.testing.assert_array_equal(own.path.iterations, other.path.iterations)


@fused
@pytest.mark.parametrize("name", NETS)
def test_an_analysis_is_one_function(name):
    structure, phases = NETS[name]()[:2]

    def analyse(nodes, solver=None):
        moved = jc.replace(structure, nodes=nodes)
        return jc.solve(moved, phases, jc.Newton(linear_solver=solver))

    def results(nodes):
        solution = analyse(nodes)
        return solution.status, solution.displacement, solution.tension

    (program, found), other = compiled(results, structure.nodes), analyse(structure.nodes, "dense")
    assert_same_steps(analyse(structure.nodes), other)
    status, *own = program(structure.nodes)
    assert int(status) == jc.status.OK
    for mine, there in zip(own, (other.displacement, other.tension), strict=True):
        assert np.abs(mine - there).max() < 1e-9 * np.abs(there).max()
    if name == "isolated_cable" and jax.__version_info__ >= (0, 11):
        # self-weight is scattered; jax 0.10 without fusion emitters makes a loop of that, jax 0.12
        # has no such option
        assert found == (1, 0)
        return
    assert found == (0, 1)
    assert compiled(jax.vmap(results), np.stack([structure.nodes] * 3))[1] == (0, 1)


@fused
@pytest.mark.filterwarnings("ignore:elements.weight. no phase has SelfWeight")  # of a cut scene
@pytest.mark.parametrize("name", NETS)
def test_a_gradient_is_two_functions(name):
    """And is that of another solver."""
    structure, phases = NETS[name]()[:2]

    def height(pretension, solver=None):
        own = [jc.Phase(pretension=pretension), *phases[1:]]
        solution = jc.solve(structure, own, jc.Newton(linear_solver=solver))
        value = jnp.sum(solution.displacement[:, 2]) + jnp.sum(solution.tension)
        return value, solution.status

    pretension = np.full(len(structure.elements.links), 1e4)
    both = functools.partial(jax.value_and_grad, has_aux=True)
    program, found = compiled(both(height), pretension)
    assert found == (0, 2)
    gradients = jax.vmap(jax.grad(height, has_aux=True))
    assert compiled(gradients, np.stack([pretension] * 3))[1] == (0, 2)
    (own, status), slope = program(pretension)
    (other, other_status), other_slope = both(lambda p: height(p, "dense"))(pretension)
    assert int(status) == int(other_status) == jc.status.OK
    assert abs(own - other) < 1e-9 * abs(other)
    # as close as the tolerance of the iteration, 1e-10 of the forces, leaves them
    assert np.abs(slope - other_slope).max() < 1e-7 * np.abs(other_slope).max()


@fused
def test_only_nets_are_solved_so():
    def solver(scene, to_end=True):
        schedule = prepare(*scene, None, None, to_end=to_end).without_indices[3]
        return schedule.dof_map.pattern.solver.name

    assert [solver(make()[:2]) for make in NETS.values()] == ["rolling"] * len(NETS)
    assert solver(jc.scenes.saddle(3, 3), to_end=False) == "dense"  # a path may become unstable
    assert solver(scenes.geiger_dome()[:2]) == "dense"  # has struts
    assert solver(jc.scenes.saddle(20, 20)) in ("superlu", "pardiso")  # of too large a bandwidth


@fused
@pytest.mark.parametrize("kind", ["net", "released", "jacks", "catenaries"])
def test_a_net_takes_the_same_steps_in_a_batch(kind):
    scenes = [drawn(kind, seed) for seed in range(16)]
    flat = [jax.tree.flatten((one.structure, one.phases)) for one in scenes]
    tree = flat[0][1]

    def run(leaves):
        solution = jc.solve(*jax.tree.unflatten(tree, leaves))
        steps = jnp.concatenate([phase.path.iterations for phase in solution.phases])
        return solution.status, steps

    stacked = [np.stack(arrays) for arrays in zip(*(leaves for leaves, _ in flat), strict=True)]
    codes, steps = jax.vmap(run)(stacked)
    alone = [run(leaves) for leaves, _ in flat]
    np.testing.assert_array_equal(codes, [int(code) for code, _ in alone])
    same = np.all(np.array([own for _, own in alone]) == steps, axis=1)
    # two programs: in 2 of 900 scenes their last digits lead to another number of steps
    assert same.sum() >= len(same) - 1
