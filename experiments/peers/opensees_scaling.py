"""OpenSees' side of the scaling benchmark: a saddle net, prestressed and then loaded.

Run by an interpreter that has openseespy and NumPy, with one case on stdin as a line of JSON, and
answers with one line; a process for each case, since OpenSees crashes when systems of equations
change (then there is no answer). The net is that of `jaxcable.scenes.saddle`, made here from the
numbers of the case, whose keys are

    n                           free nodes a side; 2 n (n + 1) bars
    spacing, rise               m; height of the edge over the middle as a part of the span
    axial_stiffness, pretension N; of the bar's unstressed length, and in the initial position
    load                        N, down on each free node
    system, numberer, algorithm names in OpenSees, or lists of a name and its arguments
    steps                       of the prestress phase, where all but the first have nothing to do,
                                and of the load phase
    tol                         greatest relative residual at the end of a phase
    max_iterations              in a step
    repeats                     with the model rebuilt
    compression                 modulus in compression as a part of that in tension; optional, 1

and an answer

    ok                          every step converged and both phases ended within `tol`
    version                     of OpenSees
    build_s, analyze_s          wall seconds of making the model and of `analyze` in both phases,
                                medians over the repeats
    iterations                  of both phases together, as OpenSees counts them (BFGS and Broyden
                                report less than they do); of the phase that failed
    residual, residuals         relative, measured here from the displacements; the last, of both
    slack                       number of bars in compression
    z_middle                    displacement in z of the free node (n // 2, n // 2), m, from the
                                initial position
    peak_rss_MB                 the process's greatest resident memory
    error, phase, time          where not ok: the reason (what OpenSees says of it is on stderr),
                                its phase and the part of the load reached

The residual is the largest component of the unbalanced force at a free node, divided by the
largest sum over a node's bars of their forces plus its load.
"""

import json
import os
import resource
import statistics
import sys
import time
from pathlib import Path

import numpy as np
from opensees_cantilever import import_opensees

ALGORITHMS = (  # OpenSees passes over other names and takes one of its own
    "Newton",
    "NewtonLineSearch",
    "ModifiedNewton",
    "KrylovNewton",
    "BFGS",
    "Broyden",
)


class PhaseError(Exception):
    """A phase that did not converge."""

    def __init__(self, reason, phase, reached, iterations):
        super().__init__(reason)
        self.details = {"phase": phase, "time": reached, "iterations": iterations}


def saddle(case):
    """Coordinates, links and numbers of the free nodes, row by row, of the net."""
    n, m = case["n"], case["n"] + 2
    number = np.full((m, m), -1)  # [row, column]
    inside = np.ones((m, m), bool)
    inside[:: m - 1, :: m - 1] = False  # no corners
    number[inside] = np.arange(m * m - 4)
    rows = np.stack([number[1:-1, :-1], number[1:-1, 1:]], axis=-1)
    columns = np.stack([number[:-1, 1:-1].T, number[1:, 1:-1].T], axis=-1)
    links = np.concatenate([rows.reshape(-1, 2), columns.reshape(-1, 2)])
    row, column = np.nonzero(inside)
    span = case["spacing"] * (n + 1)
    x, y = case["spacing"] * column, case["spacing"] * row
    z = case["rise"] * span * ((2 * x / span - 1) ** 2 - (2 * y / span - 1) ** 2)
    return np.column_stack([x, y, z]), links, number[1:-1, 1:-1].ravel()


def words(setting):
    """A setting of OpenSees as the arguments of its command."""
    return (setting,) if isinstance(setting, str) else tuple(setting)


def build(ops, case, nodes, links, free):
    """The model and its analysis; tags are one above the numbers."""
    EA, T0 = case["axial_stiffness"], case["pretension"]
    algorithm = words(case["algorithm"])
    if algorithm[0] not in ALGORITHMS:
        raise ValueError(f"algorithm = {algorithm[0]!r}: not one of {', '.join(ALGORITHMS)}")
    ops.model("basic", "-ndm", 3, "-ndf", 3)
    for k, place in enumerate(nodes.tolist(), 1):
        ops.node(k, *place)
    for k in (np.setdiff1d(np.arange(len(nodes)), free) + 1).tolist():
        ops.fix(k, 1, 1, 1)
    # A = 1; strain is of the initial chord, hence a modulus per unstressed length
    E = EA + T0
    ops.uniaxialMaterial("Elastic", 1, E, 0.0, E * case.get("compression", 1.0))
    ops.uniaxialMaterial("InitStressMaterial", 2, 1, T0)
    for k, (i, j) in enumerate((links + 1).tolist(), 1):
        ops.element("corotTruss", k, i, j, 1.0, 2)
    ops.timeSeries("Linear", 1)  # there from the start, so that the load phase renumbers nothing
    ops.pattern("Plain", 1, 1)
    for k in (free + 1).tolist():
        ops.load(k, 0.0, 0.0, -case["load"])
    ops.constraints("Plain")
    ops.numberer(*words(case["numberer"]))
    ops.system(*words(case["system"]))
    # At least four bars pull at a free node. Were all components at the limit, the 2-norm would be
    # sqrt(3) n times as large; a tenth of that usually meets it, and `analyse` goes on otherwise.
    limit = case["tol"] * 4 * T0 * max(1.0, 0.1 * 3**0.5 * case["n"])
    ops.test("NormUnbalance", limit, case["max_iterations"], 0)
    ops.algorithm(*algorithm)


def analyse(ops, case, net, phase):
    """A phase: its wall seconds and iterations, and where it ended: `equilibrium`'s answer."""
    steps, load = case["steps"][phase - 1], case["load"] * (phase - 1)
    ops.integrator("LoadControl", (phase - 1) / steps)
    if phase == 1:
        ops.analysis("Static")
    seconds, iterations = 0.0, 0
    for k in range(steps + case["max_iterations"]):
        if k == steps:  # above `tol` yet: steps at the same load, an iteration each
            ops.integrator("LoadControl", 0.0)
        begin = time.perf_counter()
        code = ops.analyze(1)
        seconds += time.perf_counter() - begin
        iterations += ops.testIter()
        if code != 0:
            reason = f"analyze returned {code} in phase {phase} at {ops.getTime():g} of the load"
            raise PhaseError(reason, phase, ops.getTime(), iterations)
        if k + 1 >= steps:
            end = equilibrium(ops, case, *net, load)
            if end[0] <= case["tol"]:
                return seconds, iterations, end
    reason = f"a residual of {end[0]:.1e} in phase {phase}, {end[0] / case['tol']:.1e} times `tol`"
    raise PhaseError(reason, phase, ops.getTime(), iterations)


def equilibrium(ops, case, nodes, links, free, load):
    """Relative residual, bars in compression and displacements of the model as it stands."""
    moved = np.array([ops.nodeDisp(k) for k in range(1, len(nodes) + 1)])
    EA, T0 = case["axial_stiffness"], case["pretension"]
    chord, bar = (x[links[:, 1]] - x[links[:, 0]] for x in (nodes, nodes + moved))
    length = np.linalg.norm(bar, axis=1)
    unstressed = np.linalg.norm(chord, axis=1) / (1 + T0 / EA)
    tension = EA * (length - unstressed) / unstressed
    slack = int(np.sum(tension < 0))
    tension = np.where(tension < 0, case.get("compression", 1.0), 1.0) * tension
    pull = (tension / length)[:, None] * bar
    unbalance, size = np.zeros_like(nodes), np.zeros(len(nodes))
    for end, sign in ((0, 1), (1, -1)):
        np.add.at(unbalance, links[:, end], sign * pull)
        np.add.at(size, links[:, end], np.abs(tension))
    unbalance[free, 2] -= load
    size[free] += load
    return float(np.abs(unbalance[free]).max() / size.max()), slack, moved


def answer(ops, case):
    """Build and analyse the case, as often as it says."""
    net = saddle(case)
    built, analysed = [], []
    for _ in range(case["repeats"]):
        ops.wipe()
        begin = time.perf_counter()
        build(ops, case, *net)
        built.append(time.perf_counter() - begin)
        prestress, loaded = (analyse(ops, case, net, phase) for phase in (1, 2))
        analysed.append(prestress[0] + loaded[0])
    residual, slack, moved = loaded[2]
    n = case["n"]
    return {
        "ok": True,
        "build_s": statistics.median(built),
        "analyze_s": statistics.median(analysed),
        "iterations": prestress[1] + loaded[1],
        "residual": residual,
        "residuals": [prestress[2][0], residual],
        "slack": slack,
        "z_middle": float(moved[net[2][n // 2 * n + n // 2], 2]),
    }


def peak_rss():
    """Greatest resident memory, MB."""
    status = Path("/proc/self/status")  # on Linux `getrusage` has the parent's from before exec
    if status.exists():
        line = next(
            x for x in status.read_text(encoding="utf-8").splitlines() if x.startswith("VmHWM")
        )
        return int(line.split()[1]) * 1024 / 1e6
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def main():
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what OpenSees prints must not get into the answer
    ops, version = import_opensees()
    if ops is None:
        print(json.dumps({"ok": False, "error": version}), file=out, flush=True)
        sys.exit(1)
    try:
        found = answer(ops, json.loads(sys.stdin.readline()))
    except PhaseError as error:
        found = {"ok": False, "error": str(error), **error.details}
    except Exception as error:  # whatever it is, the caller is to know
        found = {"ok": False, "error": f"{type(error).__name__}: {error}"}
    found |= {"version": version, "peak_rss_MB": peak_rss()}
    print(json.dumps(found), file=out, flush=True)


if __name__ == "__main__":
    main()
