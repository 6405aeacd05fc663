"""Where XLA fuses loops, an analysis of a net is one function, and a batch goes case by case.

Most of this file needs XLA's option: `make test` runs it a second time with FUSED_LOOPS=1.
"""

import os
import re
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.net_bank import drawn
from conftest import FUSED

import jaxcable as jc
from jaxcable.analysis.preparation import prepare

fused = pytest.mark.skipif(not FUSED, reason="needs FUSED_LOOPS=1, see `make test`")
NETS = {
    "saddle": lambda: jc.scenes.saddle(4, 4),
    "flat_net": jc.scenes.flat_net,
    "hypar_net": jc.scenes.hypar_net,
    "isolated_cable": jc.scenes.isolated_cable,
}

SCRIPT = """
import jaxcable as jc
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


def test_the_option_reaches_xla():
    assert printed() == ("True", "")
    other = "--xla_backend_extra_options=xla_cpu_disable_loop_unrolling=true"
    assert printed(flags=f"--xla_cpu_multi_thread_eigen=true {other}") == ("True", "")


def test_too_late_is_said():
    out, warning = printed("import jax.numpy; jax.numpy.ones(3)")
    if jax.__version_info__ < (0, 11):  # jax 0.12 fuses loops of this size without being asked
        assert out == "False"
    assert "RuntimeWarning: fuse_loops: jax has computed already" in warning


def test_importing_changes_nothing():
    text = "import os; a = dict(os.environ); import jaxcable; assert a == dict(os.environ)"
    subprocess.run([sys.executable, "-c", text], check=True)


def loops_and_functions(function, *arguments):
    """Numbers of loops of a program outside of single functions, and of such functions."""
    text = jax.jit(function).lower(*arguments).compile().as_text()
    entry = text[text.index("\nENTRY") :]
    return len(re.findall(r" while\(", entry)), entry.count('xla_cpu_small_call="true"')


@fused
@pytest.mark.parametrize("name", NETS)
def test_an_analysis_is_one_function(name):
    structure, phases = NETS[name]()[:2]

    def analyse(nodes):
        solution = jc.solve(jc.replace(structure, nodes=nodes), phases)
        return solution.status, solution.displacement, solution.tension

    found = loops_and_functions(analyse, structure.nodes)
    if name == "isolated_cable" and jax.__version_info__ >= (0, 11):
        # self-weight is scattered; jax 0.10 without fusion emitters makes a loop of that, jax 0.12
        # has no such option
        assert found == (1, 0)
        return
    assert found == (0, 1)
    assert loops_and_functions(jax.vmap(analyse), structure.nodes[None] * np.ones((3, 1, 1))) == (
        0,
        1,
    )


@fused
@pytest.mark.filterwarnings("ignore:elements.weight. no phase has SelfWeight")  # of a cut scene
@pytest.mark.parametrize("name", NETS)
def test_a_gradient_is_two_functions(name):
    structure, phases = NETS[name]()[:2]

    def height(pretension):
        solution = jc.solve(structure, [jc.Phase(pretension=pretension), *phases[1:]])
        return jnp.sum(solution.displacement[:, 2]) + jnp.sum(solution.tension)

    pretension = np.full(len(structure.elements.links), 1e4)
    assert loops_and_functions(jax.value_and_grad(height), pretension) == (0, 2)
    assert loops_and_functions(jax.vmap(jax.grad(height)), pretension[None] * np.ones((3, 1))) == (
        0,
        2,
    )


@fused
def test_only_nets_are_solved_so():
    def solver(scene, to_end=True):
        schedule = prepare(*scene, None, None, to_end=to_end).thawed[3]
        return schedule.freedoms.pattern.solver.name

    assert [solver(make()[:2]) for make in NETS.values()] == ["rolling"] * len(NETS)
    assert solver(jc.scenes.saddle(4, 4), to_end=False) == "dense"  # a path may become unstable
    assert solver(jc.scenes.geiger_dome()[:2]) == "dense"  # has struts
    assert solver(jc.scenes.saddle(20, 20)) in ("superlu", "pardiso")  # of too large a bandwidth


@fused
@pytest.mark.parametrize("name", NETS)
def test_other_solvers_find_the_same(name):
    structure, phases = NETS[name]()[:2]

    def analyse(nodes, solver):
        solution = jc.solve(
            jc.replace(structure, nodes=nodes), phases, jc.Newton(linear_solver=solver)
        )
        return jnp.sum(solution.displacement[:, 2] ** 2), solution

    both = [
        jax.value_and_grad(analyse, has_aux=True)(structure.nodes, solver)
        for solver in (None, "dense")
    ]
    ((own, solution), slope), ((other, there), other_slope) = both
    assert int(solution.status) == int(there.status) == jc.status.OK
    assert abs(own - other) < 1e-9 * abs(other)
    # as close as the tolerance of the iteration, 1e-10 of the forces, leaves them
    assert np.abs(slope - other_slope).max() < 1e-7 * np.abs(other_slope).max()
    for one, two in zip(solution.phases, there.phases, strict=True):
        np.testing.assert_array_equal(one.path.iterations, two.path.iterations)


@fused
@pytest.mark.parametrize("kind", ["net", "cut net", "rope", "released", "jacks", "catenaries"])
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
