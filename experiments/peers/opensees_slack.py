"""Equilibrium of a grid of tension-only cables by OpenSees: one way of an iteration, one JSON line.

The case comes as JSON on standard input: file (NPZ with nodes, links, corners, stiffness,
rest_length, forces), algorithm, start (how far nodes are moved at random across the plane at first,
m), pressed (stiffness of slack cables over that of taut ones: without any, and without the start,
the first matrix is singular).
"""

import json
import sys
import time

import numpy as np
from opensees_cantilever import import_opensees

ops, _ = import_opensees()
TOLERANCE, MOST = 1e-8, 200


def built(case, data):
    """The model without its loads."""
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 3)
    nodes = data["nodes"].copy()
    begun = nodes.copy()
    begun[:, 2] += case["start"] * np.random.default_rng(0).uniform(-1, 1, len(nodes))
    begun[data["corners"]] = nodes[data["corners"]]
    for k, at in enumerate(begun):
        ops.node(k, *map(float, at))
    for k in data["corners"]:
        ops.fix(int(k), 1, 1, 1)
    for k, (i, j) in enumerate(data["links"]):
        length = float(np.linalg.norm(begun[j] - begun[i]))
        rest = float(data["rest_length"][k])
        # strains are over the length between the nodes at first: N = EA (l - L0) / L0
        modulus = float(data["stiffness"]) * length / rest
        ops.uniaxialMaterial("Elastic", 2 * k, modulus, 0.0, case["pressed"] * modulus)
        ops.uniaxialMaterial("InitStrainMaterial", 2 * k + 1, 2 * k, (length - rest) / length)
        ops.element("corotTruss", k, int(i), int(j), 1.0, 2 * k + 1)


def analysed(case, data):
    """Steps, and whether the iteration has converged."""
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    for k, force in enumerate(data["forces"]):
        if np.any(force):
            ops.load(k, *map(float, force))
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system("UmfPack")
    ops.test("NormUnbalance", TOLERANCE, MOST)
    ops.algorithm(case["algorithm"])
    ops.integrator("LoadControl", 1.0)
    ops.analysis("Static")
    converged = ops.analyze(1) == 0
    return ops.testIter(), converged


def unbalanced(data):
    """Largest unbalanced force at a free node, N, by the displaced nodes alone."""
    links, rest = data["links"], data["rest_length"]
    places = np.array(
        [np.add(ops.nodeCoord(k), ops.nodeDisp(k)) for k in range(len(data["nodes"]))]
    )
    vector = places[links[:, 1]] - places[links[:, 0]]
    length = np.linalg.norm(vector, axis=1)
    tension = data["stiffness"] / rest * np.maximum(length - rest, 0)
    force = data["forces"].copy()
    np.add.at(force, links[:, 0], (tension / length)[:, None] * vector)
    np.add.at(force, links[:, 1], -(tension / length)[:, None] * vector)
    force[data["corners"]] = 0
    return float(np.abs(force).max())


def main():
    case = json.loads(sys.stdin.readline())
    data = dict(np.load(case["file"]))
    built(case, data)
    begun = time.perf_counter()
    steps, converged = analysed(case, data)
    seconds = time.perf_counter() - begun
    left = unbalanced(data)
    answer = {"steps": steps, "converged": converged, "seconds": seconds, "unbalanced": left}
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
