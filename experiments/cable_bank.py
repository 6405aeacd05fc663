"""Does every cable net under dead load converge, and as accurately as the method promises?

Question   Random nets that start far from equilibrium, chains, released nets, ropes, jacks and
           catenaries, EA/N from 1e2 to 1e10 (1e5 in float32), loads from none to ten times the
           prestress: for how many is an existing equilibrium not found, and in how many steps?
Reference  `tests/oracles/convex_oracle.py`: equilibrium of the same scenes in extended precision,
           by an interior-point method on the cone program of least energy; it shares no code.
Error      missed: no equilibrium, although the reference finds one, and the status does not say
           that forces are lost in rounding errors; wrong: status OK, but the reference finds a
           residual above the tolerance of the method.
Command    python experiments/cable_bank.py [scenes of a kind] [first seed]   (default 250 0; writes
           experiments/results/cable_bank.txt; five minutes)
"""

import os
import sys
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import numpy as np
from bank_table import COLUMNS, HEADS, fill
from banks.net_bank import KINDS, derivative, drawn, judged, slope
from record import Record

FORM = "{:<11}{:>7}{:>7}{:>7}{:>7}{:>7}"
COUNTED = {
    "missed": lambda one: one.missed,
    "hidden": lambda one: one.hidden,
    "wrong": lambda one: one.wrong,
    "none": lambda one: not one.exists,
}


def slopes(kind, seeds):
    """Compare derivatives by a factor of all loads with differences of the reference; a line."""
    errors, absent = [], 0
    for seed in seeds:
        one = drawn(kind, seed)
        reference = slope(one)
        if reference is None:
            continue
        found, value = derivative(one)
        absent += not np.isfinite(found)
        errors.append(abs(found - reference[0]) / max(abs(reference[0]), abs(value), 1e-30))
    errors = np.array(errors)[np.isfinite(errors)]
    return (
        f"{kind:<11}{len(errors):>9}{absent:>6}  "
        f"{np.median(errors):>8.0e}{np.percentile(errors, 90):>8.0e}{errors.max():>8.0e}"
    )


def main():
    count, first = (int(word) for word in (sys.argv[1:] + ["250", "0"][len(sys.argv) - 1 :]))
    say = Record("cable_bank")
    say(f"{count} scenes of a kind, seeds from {first}")
    seeds = range(first, first + count)
    for dtype in ("float64", "float32"):
        say(f"\n{dtype}")
        say((FORM + COLUMNS).format("kind", "scenes", *COUNTED, *HEADS))
        fill(
            say,
            FORM,
            KINDS,
            lambda kind, dtype=dtype: (drawn(kind, seed, dtype) for seed in seeds),
            lambda one, solution: judged(one, solution, ask=False),
            COUNTED.values(),
            lambda one: one.exists,
        )
    say("\nDerivative of a weighted sum of tensions by a factor of all loads, float64: error over")
    say("the larger of derivative and sum; NaN where a cable is exactly unstressed")
    say(f"{'kind':<11}{'compared':>9}{'NaN':>6}  {'median':>8}{'90%':>8}{'max':>8}")
    for kind in KINDS:
        say(slopes(kind, range(first, first + min(count, 35))))
    say("\nhidden: status AT_ROUNDING, the rounding of the displacements hides the forces.")
    say("none: the reference finds no equilibrium. Steps are of an increment; factorisations")
    say("(factors) and ms (time without compilation) are of an analysis, means of the kind.")
    say.close()


if __name__ == "__main__":
    main()
