"""What is compiled: nothing twice, nothing that a scene lacks, no freedom that is held."""

import gc
import json
import re
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.analysis import phase_loop
from jaxcable.common import compilation

EXPERIMENTS = Path(__file__).parents[2] / "experiments"
STRUCTURE, (PRESTRESS, LOADING) = jc.scenes.flat_net()


def compilations():
    return len(phase_loop.analyse.known)


def program(structure, phases, method=None):
    """Text of the program of an analysis, and its number of equations at all depths."""
    text = str(jax.make_jaxpr(lambda s: jc.solve(s, phases, method).displacement)(structure))
    return text, len(re.findall(r" = ", text))


@pytest.mark.slow
def test_changing_a_number_does_not_recompile():
    jc.solve(STRUCTURE, [PRESTRESS, LOADING])
    before = compilations()
    elements = STRUCTURE.elements
    load = jc.Phase(loads=jc.NodalLoads([3, 4, 7, 8], (1.0, 2.0, -3.0)), increments=10)
    changed = [
        (jc.replace(STRUCTURE, nodes=np.asarray(STRUCTURE.nodes) * 1.1), [PRESTRESS, LOADING]),
        (
            jc.replace(STRUCTURE, elements=jc.replace(elements, axial_stiffness=1e5)),
            [PRESTRESS, LOADING],
        ),
        (STRUCTURE, [jc.Phase(pretension=np.linspace(100, 200, 12)), LOADING]),
        (STRUCTURE, [jc.Phase(pretension=np.float64(150.0)), load]),
    ]
    for structure, phases in changed:
        jc.raise_if_failed(jc.solve(structure, phases))
    assert compilations() == before
    jc.solve(STRUCTURE, [PRESTRESS, LOADING], jc.Newton(tol=1e-9, max_steps=50))
    after = compilations()  # a stated tolerance is another program than the default one
    jc.solve(STRUCTURE, [PRESTRESS, LOADING], jc.Newton(tol=1e-8, max_steps=60))
    assert compilations() == after


def test_nets_of_equal_shape_share_a_compilation():
    jc.solve(STRUCTURE, [PRESTRESS, LOADING])
    before = compilations()
    order = np.random.default_rng(0).permutation(12)  # the same net, its nodes renumbered
    back = np.argsort(order)
    renumbered = jc.Structure(
        np.asarray(STRUCTURE.nodes)[order],
        jc.Cables(back[STRUCTURE.elements.links.array], axial_stiffness=97.97e3),
        jc.pinned(back[np.setdiff1d(np.arange(12), [3, 4, 7, 8])]),
    )
    loads = jc.NodalLoads(back[[3, 4, 7, 8]], (0.0, 0.0, -150.0))
    solution = converged(jc.solve(renumbered, [PRESTRESS, jc.Phase(loads=loads, increments=10)]))
    assert compilations() == before
    plain = jc.solve(STRUCTURE, [PRESTRESS, LOADING])
    same = np.asarray(solution.displacement)[back] - np.asarray(plain.displacement)
    assert np.abs(same).max() < 1e-10


@pytest.mark.slow
def test_the_number_of_increments_does_not_enter_the_size_of_the_program():
    sizes = {program(STRUCTURE, [jc.Phase(pretension=200.0, increments=n)])[1] for n in (2, 7, 300)}
    assert len(sizes) == 1
    for sizes in ((3, 6), (9, 12)):  # dense and sparse
        small, large = (program(*jc.scenes.saddle(n, n))[1] for n in sizes)
        assert small == large


# Lines of StableHLO of an analysis, a tenth above those when it was written: they do not depend on
# the machine, and what makes a program grow is seen here before it is felt.
LINES = {
    # some 500 for tensions as unknowns (`tension_unknowns`), and 300 for exact elongations
    # (`elements.fine`), of which derivatives make 600 more; 900 for derivatives beside loose nodes
    "flat_net": (2500, 5800),
    # some 500 for interior-point steps of cables beside other elements (`partial_net`)
    # 30 to hold loose nodes where stability is judged
    # a dozen for derivatives of loose nodes that are NaN in reverse mode, too
    "geiger_dome": (2900, 5820),
    # some 500 for kernels as functions, which are traced once
    "isolated_cable": (4700, 10400),
    "strung_arch": (6100, 13130),
    # nothing is free: the gradient of displacements has no laws in it
    "suspended_cable": (8300, 8500),
}

COUNTED = """
import json, sys
import jax, numpy as np
before = dict(jax.config.values)
import jaxcable as jc

assert dict(jax.config.values) == before  # importing changes nothing
sys.path.append(sys.argv.pop(1))
import scenes
jax.config.update("jax_enable_x64", True)
counts = {}
for name in sys.argv[1:]:
    structure, phases = scenes.EVERY[name]()[:2]

    def sum_of(nodes):
        return jc.solve(jc.replace(structure, nodes=nodes), phases).displacement.sum()

    both = sum_of, jax.value_and_grad(sum_of)
    texts = [jax.jit(f).lower(np.asarray(structure.nodes)).as_text() for f in both]
    counts[name] = [text.count("\\n") for text in texts]
print(json.dumps(counts))
"""


def line_counts(name):
    """Lines of the programs of a scene of `LINES`: of an analysis, and of its value with gradient.

    Lowered in a process of its own: what a process has traced before changes them by some lines.
    """
    command = [sys.executable, "-c", COUNTED, str(EXPERIMENTS), name]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", LINES)
def test_programs_have_not_grown(name):
    for count, most in zip(line_counts(name), LINES[name], strict=True):
        assert 0.5 * most < count < most  # halved: tighten the bound


def test_only_free_freedoms_are_solved_for():
    text, _ = program(STRUCTURE, [PRESTRESS])
    factored = set(re.findall(r"f64\[(\d+),(\d+)\] = (?:cholesky|lu)", text))
    factored |= set(re.findall(r":f64\[(\d+),(\d+)\][^=\n]*= (?:cholesky|lu)\b", text))
    assert factored == {("12", "12")}  # 4 free nodes of 12


def test_garbage_collection_is_paused_and_left_as_it_was():
    """Also after errors, and where its owner has turned it off."""
    with pytest.raises(ZeroDivisionError), compilation.without_garbage_collection():
        assert not gc.isenabled()
        raise ZeroDivisionError
    assert gc.isenabled()
    gc.disable()
    try:
        with compilation.without_garbage_collection():
            pass
        assert not gc.isenabled()  # as its owner wants it
    finally:
        gc.enable()
