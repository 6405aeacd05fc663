"""OpenSees' side of the study of stages: a frame with stays, one of which is removed.

Run by an interpreter that has openseespy, with one case on stdin as a line of JSON:

    nodes, clamped, guided   positions, m; nodes held in all, and in y and z, freedoms
    beams                    rows of i, j, E, A, G, J, Iy, Iz and the vector in the plane of x and z
    stays                    rows of i, j, EA (N), strain of the initial chord
    loads                    N, on every node
    removed                  number of the stay that is removed
    steps, repeats           increments of the load; analyses with the model rebuilt

and an answer: `ok`, displacements of all nodes before and after, m; forces in the stays, N;
`build_s`, `analyze_s`, medians of both analyses together.
"""

import json
import statistics
import sys
import time

from opensees_cantilever import import_opensees


def build(ops, case):
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    for k, place in enumerate(case["nodes"], 1):
        ops.node(k, *place)
    for k in case["clamped"]:
        ops.fix(k + 1, *[1] * 6)
    for k in case["guided"]:
        ops.fix(k + 1, 0, 1, 1, 0, 0, 0)
    for k, (i, j, *numbers) in enumerate(case["beams"], 1):
        e, area, g, torsion, i_y, i_z, *plane = numbers
        ops.geomTransf("Corotational", k, *plane)
        ops.element("elasticBeamColumn", k, i + 1, j + 1, area, e, g, torsion, i_y, i_z, k)
    first = len(case["beams"]) + 1
    for k, (i, j, stiffness, strain) in enumerate(case["stays"], first):
        ops.uniaxialMaterial("Elastic", 1000 + k, stiffness)
        ops.uniaxialMaterial("InitStrainMaterial", k, 1000 + k, strain)
        ops.element("corotTruss", k, i + 1, j + 1, 1.0, k)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    for k, load in enumerate(case["loads"], 1):
        if any(load):
            ops.load(k, *load, 0.0, 0.0, 0.0)
    return first


def prepared(ops, steps):
    ops.wipeAnalysis()
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system("BandGeneral")
    ops.test("NormUnbalance", 1e-3, 100, 0)  # N, of 300 kN a node
    ops.algorithm("Newton")
    ops.integrator("LoadControl", steps)
    ops.analysis("Static")


def state(ops, case, first):
    nodes = range(1, len(case["nodes"]) + 1)
    alive = set(ops.getEleTags())
    tags = range(first, first + len(case["stays"]))
    forces = [ops.basicForce(tag)[0] if tag in alive else 0.0 for tag in tags]
    return [[ops.nodeDisp(k, axis) for axis in (1, 2, 3)] for k in nodes], forces


def main():
    case = json.loads(sys.stdin.readline())
    ops, _ = import_opensees()
    builds, runs = [], []
    for _ in range(case["repeats"]):
        begin = time.perf_counter()
        first = build(ops, case)
        builds.append(time.perf_counter() - begin)
        prepared(ops, 1.0 / case["steps"])
        begin = time.perf_counter()
        ok = ops.analyze(case["steps"]) == 0
        spent = time.perf_counter() - begin
        before = state(ops, case, first)
        ops.remove("element", first + case["removed"])
        prepared(ops, 0.0)
        begin = time.perf_counter()
        ok = ops.analyze(1) == 0 and ok
        runs.append(spent + time.perf_counter() - begin)
        after = state(ops, case, first)
    answer = {"ok": ok, "before": before, "after": after, "version": ops.version()}
    answer |= {"build_s": statistics.median(builds), "analyze_s": statistics.median(runs)}
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
