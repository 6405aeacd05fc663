"""Do the steps of a cable net grow with its slack regions?

Question   Square grids of cables, held at the corners, a load at one node in twenty across their
           plane; cables of one half, of a third at random, of the fields of a chessboard or all of
           them 15 % too long: how many steps from the plane grid to equilibrium, for EA over a
           quarter of the load from 1e2 to 1e6?
Reference  `tests/test_slack_nets.py` compares tensions of 20 x 20 nodes with those of least energy,
           found by a barrier method in NumPy.
Error      Largest unbalanced force at a node, N, as the analysis reports it; loads are 1 N.
Command    python experiments/slack_regions.py [n ...]   (default 20 40 60 100; writes
           experiments/results/slack_regions.txt; three minutes)
"""

import os
import sys
import time
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import jax
import numpy as np
from record import Record
from slack_nets import scene

import jaxcable as jc

jax.config.update("jax_enable_x64", True)

CASES = [("half", None), *((k, r) for k in ("third", "patches", "hung") for r in (1e2, 1e4, 1e6))]
COLUMNS = "{:>5}  {:<9}{:>9}  {:>6}{:>9}{:>7}{:>9}  {}"


def row(n, kind, ratio):
    """The table's line of a scene."""
    structure, phase = scene(kind, n, ratio)
    begun = time.perf_counter()
    solution = jc.solve(structure, phase)
    solution.displacement.block_until_ready()
    seconds, path = time.perf_counter() - begun, solution.phases[0].path
    ok = int(solution.status) == jc.status.OK
    slack = f"{100 * np.mean(np.asarray(solution.tension) == 0):.0f}" if ok else "-"
    error = f"{float(path.residual[0]):.0e}" if ok else jc.describe(solution.status)
    ratio = "EA 1e5" if ratio is None else f"{ratio:.0e}"
    counts = int(path.iterations[0]), int(path.factorizations[0])
    return COLUMNS.format(n, kind, ratio, *counts, slack, f"{seconds:.1f}", error)


def main():
    sizes = [int(word) for word in sys.argv[1:]] or [20, 40, 60, 100]
    say = Record("slack_regions")
    say(COLUMNS.format("n", "too long", "EA/load", "steps", "factors", "slack%", "seconds", "N"))
    for n in sizes:
        for kind, ratio in CASES:
            say(row(n, kind, ratio))
    say("\nslack: cables without tension at the end. Seconds: the first scene of a size compiles.")
    say("N: largest unbalanced force; loads are 1 N.")
    say.close()


if __name__ == "__main__":
    main()
