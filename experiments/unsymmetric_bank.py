"""Does Newton's method converge where the tangent is not symmetric?

Question   Strings and ropes in a current, a chain on a floor with friction, thrusts and pressure
           that follow, moments at the nodes of beams; what is not symmetric is from small to thirty
           times the rest: how many end without equilibrium, in how many Newton steps?
Reference  Forces of all elements in NumPy, apart from the package; of beams the balance of the
           whole structure in its deflected shape.
Error      failed: no equilibrium, whatever the status says; wrong: status OK and not in balance.
Command    python experiments/unsymmetric_bank.py [scenes of a kind] [first seed]   (default 200 0;
           writes experiments/results/unsymmetric_bank.txt; two minutes)
"""

import os
import sys
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from bank_table import COLUMNS, HEADS, fill
from banks.unsymmetric_bank import KINDS, drawn, judged
from record import Record

import jaxcable as jc

FORM = "{:<9}{:>7}{:>7}{:>6}"


def converged(one):
    return one.code == jc.status.OK


def main():
    count, first = (int(word) for word in (sys.argv[1:] + ["200", "0"][len(sys.argv) - 1 :]))
    say = Record("unsymmetric_bank")
    say(f"{count} scenes of a kind, seeds from {first}\n")
    say((FORM + COLUMNS).format("kind", "scenes", "failed", "wrong", *HEADS))
    fill(
        say,
        FORM,
        KINDS,
        lambda kind: (drawn(kind, seed) for seed in range(first, first + count)),
        judged,
        [lambda one: not converged(one), lambda one: one.wrong],
        converged,
    )
    say(
        "\nSteps are of an increment; factorisations (factors) and ms (time without compilation) of"
    )
    say("an analysis, means of the kind.")
    say.close()


if __name__ == "__main__":
    main()
