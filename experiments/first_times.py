"""How long does the hyperbolic paraboloid net take, and its gradient?

Question   Import, compilation and warm time of the analysis (100 + 10 increments, 36 unknowns) and
           of value and gradient of one deflection with respect to all jacking forces; the same for
           the loading phase alone from the prestressed state.
Reference  The gradient is compared with central differences here; the deflections with the
           reference in the tests.
Error      Largest relative difference of gradient and central differences, -.
Command    python experiments/first_times.py   (writes experiments/results/first_times.txt)

Times are wall seconds. Warm: median and range of 30 calls, each blocked on completion. Compile: the
first call less the median warm one, with no compilation cache.
"""

import io
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

from record import write

RESULT = Path(__file__).parent / "results" / "first_times.txt"


def import_seconds(statement):
    """Median import time in a fresh process."""
    code = f"import time; t = time.perf_counter(); {statement}; print(time.perf_counter() - t)"
    runs = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        for _ in range(5)
    ]
    return sorted(float(run.stdout) for run in runs)[2]


def timed(function, *arguments, calls=30):
    """Value, compile seconds, and sorted warm seconds of a function."""
    import jax

    begin = time.perf_counter()
    jax.block_until_ready(function(*arguments))
    first = time.perf_counter() - begin
    warm = []
    for _ in range(calls):
        begin = time.perf_counter()
        value = jax.block_until_ready(function(*arguments))
        warm.append(time.perf_counter() - begin)
    warm.sort()
    return value, first - warm[calls // 2], warm


def main():
    jax_import = import_seconds("import jax, jax.numpy")
    package_import = import_seconds("import jax, jax.numpy, jaxcable")

    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    import numpy as np

    import jaxcable as jc

    structure, (prestress, loading) = jc.scenes.hypar_net()
    force = jnp.full(31, 200.0)

    def solve(force):
        phase = jc.Phase(jacking=force, increments=prestress.increments)
        return jc.solve(structure, [phase, loading])

    def deflection(force):
        return solve(force).phases[1].displacement[10, 2]

    first = jax.block_until_ready(jc.solve(structure, [prestress]))

    def load_only(factor):
        load = jc.NodalLoads(loading.loads.nodes, factor * jnp.array([0.0, 0.0, -15.7]))
        return jc.solve(structure, [jc.Phase(loads=load, increments=10)], start=first)

    rows = []
    solution, *times = timed(jax.jit(solve), force)
    jc.raise_if_failed(solution)
    rows.append(("analysis, jitted", *times))
    _, *times = timed(solve, force)
    rows.append(("analysis, plain call", *times))
    (_, gradient), *times = timed(jax.jit(jax.value_and_grad(deflection)), force)
    rows.append(("value and gradient (31 forces)", *times))
    _, *times = timed(jax.jit(load_only), 1.0)
    rows.append(("loading phase only, from start=", *times))

    h, value = 1e-2, jax.jit(deflection)
    difference = np.array(
        [(float(value(force + h * e)) - float(value(force - h * e))) / (2 * h) for e in np.eye(31)]
    )
    error = np.abs(np.asarray(gradient) - difference).max() / np.abs(difference).max()

    out = io.StringIO()
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
    print(
        f"{platform.machine()}, {os.cpu_count()} cores; Python {platform.python_version()}, "
        f"jax {jax.__version__}, numpy {np.__version__}; commit {commit.stdout.strip()}",
        file=out,
    )
    print(
        f"\nimport    jax {jax_import:.2f} s, jaxcable beyond it "
        f"{package_import - jax_import:.2f} s",
        file=out,
    )
    iterations = [int(phase.path.iterations.sum()) for phase in solution.phases]
    print(f"analysis  {iterations[0]} + {iterations[1]} Newton iterations\n", file=out)
    print(f"{'':32}{'compile (s)':>12}{'warm (ms)':>12}{'range (ms)':>18}{'ratio':>8}", file=out)
    base = rows[0][2][15]
    for name, compile_seconds, warm in rows:
        spread = f"{1e3 * warm[0]:.2f} - {1e3 * warm[-1]:.2f}"
        print(
            f"{name:32}{compile_seconds:12.2f}{1e3 * warm[15]:12.2f}{spread:>18}"
            f"{warm[15] / base:8.2f}",
            file=out,
        )
    print(
        f"\ngradient against central differences: {error:.1e} (relative to the largest entry)",
        file=out,
    )
    write(RESULT, out.getvalue())
    print(out.getvalue(), end="")


if __name__ == "__main__":
    main()
