"""Does a motion in time agree with OpenSees step by step, and what does it cost?

Question   A prestressed net of bars with lumped masses, thrown and loaded all of a sudden, 300 and
           7 500 unknowns: how far are the displacements of each step from those of OpenSees with
           the same elements (`corotTruss`) and the same scheme (average acceleration, Newmark)?
           How long does a step take?
Reference  OpenSees, unbalanced force up to 1e-8 N.
Error      Largest difference of a displacement in any step, m.
Command    OPENSEES_PYTHON=... python experiments/opensees_motion.py
           (an interpreter with openseespy; writes experiments/results/opensees_motion.txt; 2
           minutes)

Times are wall seconds of all steps: of jaxcable the least of five calls after the first, compiled;
of OpenSees of its steps without reading displacements. Both have one core.
"""

import os
import tempfile
from pathlib import Path

os.environ |= {"NPROC": "1", "OPENBLAS_NUM_THREADS": "1"}

import numpy as np
from benchmarks.measure import Peer, timed
from record import Record

import jaxcable as jc

CASES = (10, 400), (50, 40)
"""Free nodes along a side, and steps."""
DT = 2e-3  # s


def net(n):
    """Nodes, links, which nodes are held, and unstressed lengths of a net of n x n free nodes."""
    side = n + 2
    x, y = (a.ravel() for a in np.meshgrid(np.arange(side), np.arange(side), indexing="ij"))
    nodes = np.column_stack([x, y, 0.3 * np.sin(0.7 * x) * np.cos(0.5 * y)]).astype(float)
    inner = (x > 0) & (x < side - 1) & (y > 0) & (y < side - 1)
    pairs = [(k, k + side) for k in range(side * (side - 1))]
    pairs += [(k, k + 1) for k in range(side**2 - 1) if y[k] < side - 1]
    links = np.array([pair for pair in pairs if inner[list(pair)].any()])
    used = np.unique(links)
    number = np.full(side**2, -1)
    number[used] = np.arange(len(used))
    nodes, links = nodes[used], number[links]
    length = np.linalg.norm(nodes[links[:, 1]] - nodes[links[:, 0]], axis=1)
    return nodes, links, np.flatnonzero(~inner[used]), length * (1 - 2e-3)


def problem(n, steps):
    """Numbers of a case, a dict for both programs."""
    nodes, links, fixed, rest = net(n)
    free = np.setdiff1d(np.arange(len(nodes)), fixed)
    loads, velocity, masses = np.zeros_like(nodes), np.zeros_like(nodes), np.zeros(len(nodes))
    loads[free], velocity[free], masses[free] = [3.0, 0.0, -20.0], [0.2, 0.1, -0.5], 2.0
    stiffness = np.full(len(links), 1e5)
    chord = nodes[links[:, 1]] - nodes[links[:, 0]]
    length = np.linalg.norm(chord, axis=1)
    pull = (stiffness * (length - rest) / rest / length)[:, None] * chord
    force = loads.copy()
    np.add.at(force, links[:, 0], pull)
    np.add.at(force, links[:, 1], -pull)
    acceleration = np.zeros_like(nodes)
    acceleration[free] = force[free] / masses[free, None]
    return {
        "nodes": nodes,
        "links": links,
        "fixed": fixed,
        "rest_length": rest,
        "stiffness": stiffness,
        "loads": loads,
        "velocity": velocity,
        "masses": masses,
        "acceleration": acceleration,
        "dt": DT,
        "steps": steps,
        "tol": 1e-8,
    }


def motion(data):
    """The motion by jaxcable: displacements, [steps + 1, n_node, 3], m, and status."""
    bars = jc.Bars(
        data["links"], axial_stiffness=data["stiffness"], rest_length=data["rest_length"]
    )
    structure = jc.Structure(data["nodes"], bars, supports=jc.pinned(data["fixed"]))
    load = jc.NodalLoads(np.arange(len(data["nodes"])), data["loads"])
    moved = jc.dynamics.transient(
        *(structure, load),
        dt=DT,
        steps=data["steps"],
        masses=data["masses"],
        velocity=data["velocity"],
        histories=["displacement"],
    )
    return moved.displacement, moved.status


def main():
    record = Record("opensees_motion")
    peer = Peer("OPENSEES_PYTHON", "opensees_motion.py")
    record("unknowns  steps  difference   of       jaxcable    OpenSees   ratio   first call")
    with tempfile.TemporaryDirectory() as folder, jc.evaluation("xla"):
        for n, steps in CASES:
            data, name = problem(n, steps), str(Path(folder) / f"{n}.npz")
            np.savez(name, **data)
            answer = peer.ask(file=name)
            assert answer["steps"] == steps, answer
            (moved, status), first, times = timed(motion, data)
            assert int(status) == 0
            apart = np.abs(np.asarray(moved)[1:] - np.load(f"{name}.out.npy")).max()
            size, theirs = np.abs(moved).max(), answer["seconds"]
            record(
                f"{3 * n * n:8d} {steps:6d}  {apart:.1e} m  {size:.3f} m  {times[0]:7.3f} s  "
                f"{theirs:7.3f} s  {times[0] / theirs:5.2f}  {first:7.1f} s"
            )
            assert apart < 1e-8
    record(f"OpenSees {answer['version']}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    peer.close()
    record.close()


if __name__ == "__main__":
    main()
