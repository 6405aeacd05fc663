"""Does Newton's method converge for ropes with friction, and are its tensions those of Coulomb?

Question   Ropes of two to six segments over fixed and moving pulleys, saddles and masts, with
           springs, stays and clamps; loads that grow, reverse and grow again; EA from 1e2 to 1e6
           times the tension: how many end without equilibrium, in how many Newton steps?
Reference  A solver of the complementarity conditions in NumPy, at the positions found, and the
           forces of all elements in NumPy; both apart from the package.
Error      failed: no equilibrium, whatever the status says; wrong: status OK, but other tensions,
           or no balance (1e-8 of the largest tension).
Command    python experiments/friction_bank.py [scenes of a kind] [first seed]   (default 334 0;
           2004 scenes; writes experiments/results/friction_bank.txt)
"""

import collections
import os
import sys
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from bank_table import report_bank
from banks.friction_bank import KINDS, drawn, judged

import jaxcable as jc


def main():
    sys.argv[1:] = (sys.argv[1:] + ["334", "0"][len(sys.argv) - 1 :])[:2]
    failures, last = collections.defaultdict(list), []

    def drawn_and_noted(kind, seed):
        last[:] = kind, seed
        return drawn(kind, seed)

    def judged_and_noted(one, solution):
        result = judged(one, solution)
        if result.code != jc.status.OK:
            kind, seed = last
            phase = sum(int(p.path.status[-1]) == jc.status.OK for p in solution.phases)
            failures[kind, result.code].append(f"{seed} ({one.ratio:.0e}, phase {phase + 1})")
        return result

    say = report_bank("friction_bank", KINDS, drawn_and_noted, judged_and_noted)
    say("\nFailures, with their seeds (EA over the tension; phase that failed, 1: pretension):")
    for (kind, code), scenes in failures.items():
        say(f"{kind}, {len(scenes)}: {jc.describe(code).split(',')[0]}\n  {', '.join(scenes)}")
    say.close()


if __name__ == "__main__":
    main()
