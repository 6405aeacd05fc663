"""Does the number of Newton steps of a cable net grow with its slack regions?

Question   Square grids of cables, supported at the corners, with transverse loads at one node in
           twenty. Cables are 15 % too long: in one half, a third at random, in the fields of a
           chessboard, or all of them. How many steps lead from the plane grid to equilibrium, for
           EA over a quarter of the load from 1e2 to 1e6?
Reference  `tests/equilibrium/test_slack_nets.py` compares tensions of 12 x 12 nodes with those of
           least energy, found by a cone program in extended precision.
Error      Largest unbalanced force at a node, N, as the analysis reports it; loads are 1 N.
Peer       OpenSees, where OPENSEES_PYTHON names an interpreter with openseespy, up to 40 nodes on a
           side. The fastest of four ways that converges: Newton's method with or without line
           search, slack cables with 1e-2 or 1e-4 of the stiffness of taut ones. Nodes start 0.1 m
           off the plane at random, because the first matrix is singular otherwise.
Command    python experiments/slack_regions.py [n ...]   (default 10 20 40 60 100; writes
           experiments/results/slack_regions.txt; half a minute, with the peer some minutes)
"""

import itertools
import os
import sys
import tempfile
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import numpy as np
from banks.slack_nets import scene
from benchmarks.measure import opensees, timed
from record import Record

import jaxcable as jc

CASES = [("half", None), *((k, r) for k in ("third", "patches", "hung") for r in (1e2, 1e4, 1e6))]
COLUMNS = "{:>5}  {:<9}{:>9}  {:>6}{:>9}{:>7}{:>9}{:>7}{:>10}  {}"


def row(n, kind, ratio):
    """The table's line of a scene."""
    structure, phase = scene(kind, n, ratio)
    solution, _, (seconds,) = timed(jc.solve, structure, phase, calls=1)
    path = solution.phases[0].path
    ok = int(solution.status) == jc.status.OK
    slack = f"{100 * np.mean(np.asarray(solution.tension) == 0):.0f}" if ok else "-"
    error = f"{float(path.residual[0]):.0e}"
    error += "" if ok else f" (status {int(solution.status)})"
    of_peer = peer(n, structure, phase) if n <= 40 and ratio in (None, 1e4) else ("", "")
    ratio = "EA 1e5" if ratio is None else f"{ratio:.0e}"
    counts = int(path.iterations[0]), int(path.factorizations[0])
    return COLUMNS.format(n, kind, ratio, *counts, slack, f"{seconds:.2f}", *of_peer, error)


def peer(n, structure, phase):
    """Steps and seconds of OpenSees as text."""
    if "OPENSEES_PYTHON" not in os.environ:
        return "", ""
    forces = np.zeros((n * n, 3))
    forces[np.asarray(phase.loads.nodes)] = np.asarray(phase.loads.forces)
    cables = structure.elements
    stated = {
        "nodes": structure.nodes,
        "links": cables.links.array,
        "corners": [0, n - 1, n * n - n, n * n - 1],
        "stiffness": np.max(cables.axial_stiffness),
        "rest_length": phase.rest_length,
        "forces": forces,
    }
    answers = []
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "net.npz")
        np.savez(file, **stated)
        for algorithm, pressed in itertools.product(("Newton", "NewtonLineSearch"), (1e-2, 1e-4)):
            case = {"file": file, "algorithm": algorithm, "start": 0.1, "pressed": pressed}
            answers.append(opensees("opensees_slack.py", case))
    good = [a for a in answers if a.get("converged") and a["unbalanced"] < 1e-6]
    if not good:
        return "none", "none"
    best = min(good, key=lambda a: a["seconds"])
    return best["steps"], f"{best['seconds']:.2f}"


def main():
    sizes = [int(word) for word in sys.argv[1:]] or [10, 20, 40, 60, 100]
    say = Record("slack_regions")
    heads = "n", "too long", "EA/load", "steps", "factors", "slack%", "seconds"
    say(COLUMNS.format(*heads, "peer:", "seconds", "N"))
    for n in sizes:
        for kind, ratio in CASES:
            say(row(n, kind, ratio))
    say("\nslack: cables without tension at the end. Seconds: without compilation. peer: steps of")
    say("OpenSees, and seconds. N: largest unbalanced force; loads are 1 N.")
    say.close()


if __name__ == "__main__":
    main()
