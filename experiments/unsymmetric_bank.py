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

from bank_table import report_bank
from banks.unsymmetric_bank import KINDS, drawn, judged


def main():
    say = report_bank("unsymmetric_bank", KINDS, drawn, judged)
    say.close()


if __name__ == "__main__":
    main()
