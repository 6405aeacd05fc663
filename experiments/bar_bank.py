"""Does every structure with bars or beams converge, however stiff its bars and cables are?

Question   Rotating bars, strings of insulators, crooked chains, strings on nets, strings and ropes
           on beams, tensegrities, masts, trusses, stayed decks, cables under pressure, EA over the
           load from 1e2 to 1e10: how many end without equilibrium, in how many Newton steps and
           factorisations?
Reference  Statics in extended precision, independently of the package: of every node
           (`independent.py`); with beams, of the whole structure in its deflected shape.
Error      failed: no equilibrium, whatever the status says; wrong: status OK, but no equilibrium.
Command    python experiments/bar_bank.py [scenes of a kind] [first seed]   (default 200 0; writes
           experiments/results/bar_bank.txt; two minutes)
"""

import os
import sys
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from bank_table import report_bank
from banks.bar_bank import KINDS, drawn, judged

import jaxcable as jc


def turning():
    """Return the Newton steps of one rotating bar, by EA over the load."""
    found = []
    for ratio in range(2, 13, 2):
        bar = jc.Bars([[0, 1]], axial_stiffness=10.0**ratio)
        nodes = [[0.0, 0, 0], [1.0, 0, 0]]
        structure = jc.Structure(nodes, bar, jc.pinned([0]) + jc.restrained([1], "y"))
        load = jc.NodalLoads([1], (0.1, 0.0, -1.0))
        solution = jc.solve(structure, jc.Phase(loads=load))
        steps = int(solution.phases[0].path.iterations[0])
        found.append(f"1e{ratio}: {steps if int(solution.status) == 0 else 'none'}")
    return ", ".join(found)


def main():
    say = report_bank("bar_bank", KINDS, drawn, judged)
    say(f"\nA bar that turns by a right angle, steps by EA over the load: {turning()}")
    say.close()


if __name__ == "__main__":
    main()
