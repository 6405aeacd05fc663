"""Programs in which parts might wait for each other: batches, threads and gradients on two cores.

    python tests/banks/waiting_programs.py frames --calls 50

runs one of them, with other numbers in every call, and prints how many calls ended. Whoever starts
it sets a time limit: `test_waiting.py`, `experiments/benchmark.py waiting`.
"""

import argparse
import os
import threading

import jax
import jax.numpy as jnp
import numpy as np

import jaxcable as jc

PROGRAMS = {}


def program(make):
    PROGRAMS[make.__name__] = make
    return make


def frame(n=6):
    section = jc.Section.box(0.2, 0.2, 0.008, jc.Elastic(210e9))
    beams = jc.Beams([[k, k + 1] for k in range(n)], section=section)
    ends = jc.clamped([0]) + jc.pinned([n])
    return jc.Structure(np.linspace([0, 0, 0], [10, 0, 0], n + 1), beams, supports=ends)


def net(n, tension=1000.0):
    structure, _ = jc.scenes.saddle(n, n)
    middle = len(structure.nodes) // 2

    def sag(force):
        loading = jc.Phase(loads=jc.NodalLoads([middle], force))
        solution = jc.solve(structure, [jc.Phase(pretension=tension), loading])
        return solution.displacement[middle, 2]

    return sag


def bent(force):
    return jc.solve(frame(), jc.Phase(loads=jc.NodalLoads([3], force))).displacement[3, 2]


def in_threads(call, count):
    """Call a function of the number of a thread in as many threads at the same time."""
    threads = [threading.Thread(target=call, args=(n,)) for n in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def forces(k, n=32):
    return 1e3 * (1 + 0.01 * k) * np.random.default_rng(0).normal(size=(n, 3))


@program
def frames():
    """LU and Cholesky in one batch: both branches of a conditional."""
    run = jax.jit(jax.vmap(bent))
    return lambda k: run(forces(k))


@program
def frames_in_chunks():
    run = jc.batched(bent, chunk=8)
    return lambda k: run(forces(k))


@program
def frames_gradient():
    run = jax.jit(jax.vmap(jax.grad(bent)))
    return lambda k: run(forces(k))


@program
def frames_in_threads():
    """The same program in four threads at the same time."""
    run = jax.jit(jax.vmap(bent))

    return lambda k: in_threads(lambda _: jax.block_until_ready(run(forces(k))), 4)


@program
def nets():
    """A dense solver inside of the program, or, where loops are fused, one of small bandwidth."""
    run = jc.batched(net(3))
    return lambda k: run(forces(k, 256))


@program
def nets_on_the_host():
    """NumPy functions that the program calls, with gradients."""
    run = jc.batched(jax.value_and_grad(net(8)), chunk=8)
    return lambda k: run(forces(k))


@program
def forms():
    structure, _ = jc.scenes.saddle(6, 6)
    run = jc.batched(lambda q: jc.force_density(structure, q)[:, 2].sum())
    return lambda k: run(jnp.linspace(500.0, 900.0 + k, 100))


@program
def forms_gradient():
    structure, _ = jc.scenes.saddle(5, 5)
    run = jax.jit(
        jax.vmap(jax.value_and_grad(lambda q: jc.force_density(structure, q)[:, 2].sum()))
    )
    return lambda k: run(jnp.linspace(500.0, 900.0 + k, 64))


@program
def frequencies():
    """Cholesky, triangular solves and eigenvalues, beside the analysis."""
    nodes = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, 0]])
    cables = jc.Cables([[0, 4], [1, 4], [2, 4], [3, 4]], axial_stiffness=1e5, weight=1.0)
    structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 1, 2, 3]))

    def slowest(tension):
        solution = jc.solve(structure, jc.Phase(pretension=tension))
        return jc.dynamics.modes(structure, solution, n=1).frequency[0]

    run = jax.jit(jax.vmap(jax.value_and_grad(slowest)))
    return lambda k: run(jnp.linspace(500.0, 900.0 + k, 64))


@program
def listeners():
    """A listener that is told of every increment, from two threads."""
    heard = []
    structure, phases = jc.scenes.flat_net()

    def solve(tension):
        prestress = jc.Phase(pretension=tension, increments=5)
        jc.solve(structure, [prestress, *phases[1:]], progress=heard.append)

    return lambda k: in_threads(lambda n: solve(200.0 + k + n), 2)


def run_indices(margin, mean):
    """Return a function that searches for design points in a compiled program, in two threads."""
    quantities = {"x": jc.reliability.Normal(mean, 100.0)}

    def index(shift):
        found = jc.reliability.first_order(lambda v: margin(v["x"]) + shift, quantities, points=1)
        return found.beta

    run = jax.jit(jax.vmap(jax.value_and_grad(index)))
    shifts = 1e-4 * np.arange(3.0)
    return lambda k: in_threads(lambda n: jax.block_until_ready(run((k + n) * shifts)), 2)


@program
def searches():
    """Searches in Python that a compiled program calls, with gradients."""
    return run_indices(lambda x: 300.0 - x[0] - 1e-3 * x[1] ** 2, np.zeros(2))


@program
def searches_by_analyses():
    sag = net(3)
    return run_indices(lambda force: sag(force) + 0.04, np.array([0.0, 0.0, -1e3]))


@program
def fits():
    """Searches in Python that a compiled program calls while it computes, in two threads."""
    structure, _ = jc.scenes.saddle(3, 3)

    def fitted(height):
        def misfit(q):
            return jc.force_density(structure, q)[:, 2].sum() - height

        return jc.fit(misfit, 600.0, steps=5).misfit

    def busy(x):
        return jnp.tanh(jnp.outer(x, jnp.arange(2000.0)) @ jnp.ones((2000, 200))).sum()

    run = jax.jit(lambda x: (jax.vmap(fitted)(x), busy(x)))
    heights = jnp.linspace(1.0, 2.0, 4)
    return lambda k: in_threads(lambda n: jax.block_until_ready(run(heights + k + n)), 2)


@program
def control():
    """Batched calls of LAPACK as jax makes them: on jaxlib 0.10 these wait for ever."""
    run = jax.jit(lambda a: [jnp.linalg.cholesky(a + k) for k in range(4)])
    a = np.random.default_rng(0).normal(size=(64, 40, 40))
    matrices = a @ a.transpose(0, 2, 1) + np.eye(40)
    return lambda k: run(matrices * (1 + k))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("name")
    parser.add_argument("--calls", type=int, default=50)
    parser.add_argument("--fused", action="store_true")
    given = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):  # before jax counts them
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])
    jax.config.update("jax_enable_x64", True)
    if given.fused:
        jc.fuse_loops()
    run = PROGRAMS[given.name]()
    for k in range(given.calls):
        jax.block_until_ready(run(k))
    print(given.calls, "calls ended", flush=True)
