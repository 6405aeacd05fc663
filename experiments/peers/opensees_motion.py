"""OpenSees' side of the study of motion in time: a prestressed net of bars under a sudden load.

Run by an interpreter that has openseespy, with a line of JSON on stdin, `{"file": ...}`, the name
of an .npz with nodes, links, fixed nodes, masses, EA, unstressed lengths, loads, velocities and
accelerations at the start, dt, steps and the tolerance of the unbalanced force, N. Answers with the
seconds of all steps, and writes the displacements after each of them, [steps, n_node, 3], m, to
`file` with the suffix .out.npy.
"""

import json
import sys
import time

import numpy as np
from opensees_cantilever import import_opensees


def build(ops, data):
    nodes, fixed = data["nodes"], set(data["fixed"].tolist())
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 3)
    for k, place in enumerate(nodes.tolist(), 1):
        ops.node(k, *place)
        if k - 1 in fixed:
            ops.fix(k, 1, 1, 1)
        else:
            ops.mass(k, *[float(data["masses"][k - 1])] * 3)
    for k, (i, j) in enumerate(data["links"].tolist(), 1):
        chord, rest = np.linalg.norm(nodes[j] - nodes[i]), float(data["rest_length"][k - 1])
        stiffness = float(data["stiffness"][k - 1] * chord / rest)
        ops.uniaxialMaterial("Elastic", 2 * k, stiffness)
        ops.uniaxialMaterial("InitStrainMaterial", 2 * k + 1, 2 * k, float((chord - rest) / chord))
        ops.element("corotTruss", k, i + 1, j + 1, 1.0, 2 * k + 1)
    ops.timeSeries("Constant", 1)
    ops.pattern("Plain", 1, 1)
    for k in (k for k in range(len(nodes)) if k not in fixed):
        ops.load(k + 1, *data["loads"][k].tolist())
        for axis in range(3):
            ops.setNodeVel(k + 1, axis + 1, float(data["velocity"][k, axis]), "-commit")
            ops.setNodeAccel(k + 1, axis + 1, float(data["acceleration"][k, axis]), "-commit")


def main():
    ops, version = import_opensees()
    for line in sys.stdin:
        name = json.loads(line)["file"]
        data = dict(np.load(name))
        build(ops, data)
        free = 3 * (len(data["nodes"]) - len(data["fixed"]))
        ops.constraints("Plain")
        ops.numberer("RCM")
        ops.system("BandGeneral" if free < 1000 else "UmfPack")
        ops.test("NormUnbalance", float(data["tol"]), 50)
        ops.algorithm("Newton")
        ops.integrator("Newmark", 0.5, 0.25)
        ops.analysis("Transient")
        steps, seconds, found = int(data["steps"]), 0.0, []
        for _ in range(steps):
            begun = time.perf_counter()
            failed = ops.analyze(1, float(data["dt"]))
            seconds += time.perf_counter() - begun
            if failed:
                break
            found.append([ops.nodeDisp(k + 1) for k in range(len(data["nodes"]))])
        np.save(f"{name}.out.npy", np.array(found))
        answer = {"steps": len(found), "seconds": seconds, "version": version}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
