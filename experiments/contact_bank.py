"""Does every structure with contacts converge, if it has an equilibrium?

Question   Bars, cables, contacts and bearings between random nodes, chains between stops,
           tensegrities, masts and cable domes with struts that only press, slack nets with props or
           on uneven ground, EA over the load from 1e2 to 1e8: how many end without equilibrium, in
           how many Newton steps?
Reference  Forces of all elements in NumPy, from positions alone.
Error      failed: no equilibrium, whatever the status says; wrong: status OK and not in balance.
           Of "mixed", nodes that no bar, cable or spring holds have none: these end as MECHANISM.
Command    python experiments/contact_bank.py [scenes of a kind] [first seed]   (default 200 0;
           writes experiments/results/contact_bank.txt; two minutes)
"""

import os
import sys
import warnings
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from bank_table import report_bank
from banks.contact_bank import KINDS, drawn, judged


def main():
    warnings.simplefilter("ignore")  # of parts that move far
    say = report_bank("contact_bank", KINDS, drawn, judged)
    say.close()


if __name__ == "__main__":
    main()
