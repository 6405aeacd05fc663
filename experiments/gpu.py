"""What is a GPU worth: batches, small dense nets, and single large nets, in float64 and float32?

Question   Time of a two-phase analysis on an accelerator beside the CPU of the same machine: a case
           of a batch of 48 unknowns, nets solved densely, single nets of 30 000 and 120 000
           unknowns (there the matrix is factorised on the host, and only the rest is computed on
           the device).
Reference  The same analysis in float64 on the CPU.
Error      Of displacements, largest over the nodes, over the largest displacement.
Command    python experiments/gpu.py [--quick]   (writes experiments/results/gpu.txt; on a machine
           with a GPU and jax's build for it, `pip install "jax[cuda13]"`; some ten minutes)

Without a GPU it says so and times the CPU alone. With --quick the nets are small, few cases are
computed and nothing is written: to see that it runs. Times are medians of calls with new numbers,
blocked on completion; the first call, with compilation, apart.
"""

import os
import sys
import time

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import jax
import jax.numpy as jnp
import numpy as np
from record import Record

import jaxcable as jc

jax.config.update("jax_enable_x64", True)

QUICK = "--quick" in sys.argv
BATCHES = (10,) if QUICK else (1_000, 10_000, 100_000)
DENSE = (4,) if QUICK else (4, 10, 20)
SINGLE = (12,) if QUICK else (100, 200)
REPEATS = 2 if QUICK else 7
DTYPES = (np.float64, np.float32)


def platforms():
    """Names of the platforms that there are, the CPU first."""
    found = ["cpu"]
    try:
        jax.devices("gpu")
        found.append("gpu")
    except RuntimeError:
        pass
    return found


def net(n, dtype):
    """Structure and loading phase of a saddle of n x n free nodes."""
    structure, (_, loading) = jc.scenes.saddle(n, n, load=5000.0 / (n + 1))
    return jc.replace(structure, nodes=np.asarray(structure.nodes, dtype)), loading


def timed(function, inputs):
    """Seconds of the first call and of later ones, and the result of the last input."""
    begin = time.perf_counter()
    jax.block_until_ready(function(inputs[0]))
    first, seconds = time.perf_counter() - begin, []
    for given in inputs[1:]:
        begin = time.perf_counter()
        result = jax.block_until_ready(function(given))
        seconds.append(time.perf_counter() - begin)
    return first, np.median(seconds), result


def single(n, dtype, solver):
    """One analysis as a function of the pretension."""
    structure, loading = net(n, dtype)
    method = jc.Newton(tol=1e-8 if dtype == np.float64 else None, linear_solver=solver)

    @jax.jit
    def run(pretension):
        solution = jc.solve(structure, [jc.Phase(pretension=pretension), loading], method)
        return solution.displacement, solution.status

    inputs = [jnp.asarray(20e3 * (1 + 1e-3 * k), dtype) for k in range(REPEATS)]
    return timed(run, inputs)


def batch(count, dtype):
    """A batch of random loads on the net of 48 unknowns, by `jax.vmap`."""
    structure, loading = net(4, dtype)
    chosen = loading.loads.nodes.array
    rng = np.random.default_rng(0)
    loads = [rng.uniform(-1e3, 1e3, (count, 16, 3)).astype(dtype) for _ in range(REPEATS)]

    def one(force):
        phases = [jc.Phase(pretension=20e3), jc.Phase(loads=jc.NodalLoads(chosen, force))]
        solution = jc.solve(structure, phases)
        return solution.displacement, solution.status

    return timed(jax.jit(jax.vmap(one)), [jnp.asarray(force) for force in loads])


def work():
    """Pairs of a label, and a function of the dtype that does the work; cases of a batch."""
    for count in BATCHES:
        yield f"{count} cases of 48 unknowns", lambda dtype, c=count: batch(c, dtype), count
    for n in DENSE:
        yield f"{3 * n * n} unknowns, dense", lambda dtype, n=n: single(n, dtype, "dense"), 1
    for n in SINGLE:
        yield f"{3 * n * n} unknowns", lambda dtype, n=n: single(n, dtype, None), 1


def main():
    say = print if QUICK else Record("gpu")
    there = platforms()
    if len(there) == 1:
        say("no GPU: the CPU alone")
    for label, run, cases in work():
        truth = None
        for platform in there:
            for dtype in DTYPES:
                with jax.default_device(jax.devices(platform)[0]):
                    first, seconds, (found, status) = run(dtype)
                found, failed = np.asarray(found, np.float64), int(np.sum(np.asarray(status) != 0))
                truth = found if truth is None else truth
                error = np.nanmax(np.abs(found - truth)) / np.nanmax(np.abs(truth))
                say(
                    f"{label:32s} {platform} {np.dtype(dtype).name}: {1e3 * seconds / cases:10.4f} "
                    f"ms a case, first call {first:6.2f} s, error {error:.0e}, failed {failed}"
                )
    if not QUICK:
        say.close()


if __name__ == "__main__":
    main()
