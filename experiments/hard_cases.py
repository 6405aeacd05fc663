"""How do difficult analyses end, and does any wrong result have the status OK?

Question   The bank of hard cases (`tests/banks/hard_cases.py`) at full size, in both precisions:
           status, error, time. Is there a silent failure?
Reference  For each case its own: a closed form, digits by mpmath, a symmetry; for every equilibrium
           the residual by `tests/oracles/independent.py`, in NumPy, independently of the package.
Error      As each case defines it, with its limit; the residual over the tolerance of `Newton`.
Command    python experiments/hard_cases.py   (writes experiments/results/hard_cases.txt; two
           minutes)

A silent failure is a status OK with a residual above the tolerance of the method (plus the rounding
of the state), with a number that is not finite, or with an error beyond its limit. Times are wall
milliseconds of all calls of a case (for a hundred cycles, of all of them), medians of five runs
after the first; compile time is the excess of the first run. The 34 programs are compiled without
most of XLA's optimizations, so that the study takes two minutes.
"""

import os
import sys
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import jax
import numpy as np
from banks.hard_cases import CASES
from benchmarks.measure import clock
from record import Record

from jaxcable.common import status

jax.config.update("jax_disable_most_optimizations", True)

REPEATS = 5


def run(case, dtype):
    """Run a case: a row of the table, whether the status is an expected one, silent failures."""
    problem = case.build(True, dtype)
    first, solution = clock(problem.solve)
    long = first > 5  # whole cycles: once more will do
    times = [clock(problem.solve)[0] for _ in range(1 if long else REPEATS)]
    code = int(solution.status)
    silent, residual, error = [], "", ""
    if code == status.OK:
        judged = problem.verdict(solution)
        if judged is not None:
            residual = f"{judged.ratio:.1e}"
            if not judged.passed:
                silent.append(f"residual {judged.excess:.2g} times what is promised {judged.wrong}")
        shown = [getattr(solution, name, 0.0) for name in ("displacement", "tension", "reactions")]
        if hasattr(solution, "phases") and not all(
            np.isfinite(np.asarray(x)).all() for x in jax.tree.leaves(shown)
        ):
            silent.append("not finite")
    if problem.figure is not None and code != status.NOT_CONVERGED:
        found, limit = problem.figure(solution)
        error = f"{found:.1e} ({limit:.0e})"
        if not found <= limit:
            silent.append(f"figure {found:.3g} beyond {limit:.3g}")
    steps = "-"
    if hasattr(solution, "phases"):
        steps = max(int(np.asarray(p.path.iterations).max()) for p in solution.phases)
    warm = float(np.median(times))
    row = (
        f"{case.name:36s} {dtype:8s} {_names(code):16s} {_names(*case.allowed(dtype)):16s} "
        f"{error:18s} {residual:9s} {steps!s:>5s} {1e3 * warm:10.2f} {max(first - warm, 0):8.1f}"
    )
    return row, code in case.allowed(dtype), silent


def _names(*codes):
    return " or ".join(status.NAMES[c] for c in codes)


def main():
    record = Record("hard_cases")
    record(
        f"{'case':36s} {'dtype':8s} {'outcome':16s} {'expected':16s} {'error (limit)':18s} "
        f"{'residual':9s} {'steps':>5s} {'warm, ms':>10s} {'compile, s':>8s}"
    )
    unexpected, failures = [], []
    for dtype in ("float64", "float32"):
        for case in CASES:
            row, expected, silent = run(case, dtype)
            record(row)
            failures += [f"{case.name}, {dtype}: {text}" for text in silent]
            if not expected:
                unexpected.append(f"{case.name}, {dtype}")
        jax.clear_caches()
    record("\nresidual: over what the method promises. What is hard about them:")
    for case in CASES:
        record(f"  {case.name}: {case.reason}")
    for text in failures:
        record(f"SILENT: {text}")
    record(f"\noutcomes that were not expected: {', '.join(unexpected) or 'none'}")
    record(f"silent failures: {len(failures)}")
    record.close()
    return len(failures)


if __name__ == "__main__":
    sys.exit(main() > 0)
