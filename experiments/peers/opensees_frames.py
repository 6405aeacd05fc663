"""OpenSees' side of the benchmark of frames in batches: load cases of one frame, one after another.

Run by an interpreter that has openseespy, with one case on stdin as a line of JSON, and answers
with one line. Keys of a case, SI units:

    nodes, free, up            positions; numbers of the nodes that are not clamped; a vector in the
                               plane of each element's axis and its section's z. Element k joins the
                               nodes k and k + 1
    width, height, E, torsion  of the section, along its y and z; torsion is GJ
    fibres                     their number along width and height, for dispBeamColumn with
                               `points` Gauss-Lobatto points and Steel01 of `yield_stress` and
                               `hardening`; None for elasticBeamColumn
    increments                 of the load
    forces                     of each load case on the free nodes, [n_case, n_free, 3]

and an answer: version, build_us and analyze_us (medians of a case), failed (their number),
displacements (of the first 20 cases, [20, n_node, 3]).
"""

import json
import os
import statistics
import sys
import time

from opensees_cantilever import import_opensees

SHOWN = 20


def build(ops, case, forces):
    """The model of a load case, and its analysis."""
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 6)
    for k, place in enumerate(case["nodes"]):
        ops.node(k + 1, *place)
        if k not in case["free"]:
            ops.fix(k + 1, *6 * (1,))
    b, h, E = case["width"], case["height"], case["E"]
    ops.geomTransf("Corotational", 1, *case["up"])
    if case["fibres"] is None:
        section = b * h, E, E / 2.6, case["torsion"] / (E / 2.6), b * h**3 / 12, h * b**3 / 12
    else:
        ops.uniaxialMaterial("Steel01", 1, case["yield_stress"], E, case["hardening"])
        ops.section("Fiber", 1, "-GJ", case["torsion"])
        ops.patch("rect", 1, *case["fibres"], -b / 2, -h / 2, b / 2, h / 2)
        ops.beamIntegration("Lobatto", 1, 1, case["points"])
    for k in range(1, len(case["nodes"])):
        if case["fibres"] is None:
            ops.element("elasticBeamColumn", k, k, k + 1, *section, 1)
        else:
            ops.element("dispBeamColumn", k, k, k + 1, 1, 1)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    for k, force in zip(case["free"], forces, strict=True):
        ops.load(k + 1, *force, 0.0, 0.0, 0.0)
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system("BandGeneral")
    ops.test("NormUnbalance", 1e-9 * max(abs(x) for force in forces for x in force), 50, 0)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 1.0 / case["increments"])
    ops.analysis("Static")


def answer(ops, case):
    """All load cases, with the model built anew for each."""
    built, analysed, failed, moved = [], [], 0, []
    for forces in case["forces"]:
        begin = time.perf_counter()
        build(ops, case, forces)
        halfway = time.perf_counter()
        failed += ops.analyze(case["increments"]) != 0
        analysed.append(time.perf_counter() - halfway)
        built.append(halfway - begin)
        if len(moved) < SHOWN:
            places = range(1, len(case["nodes"]) + 1)
            moved.append([ops.nodeDisp(k)[:3] for k in places])
    medians = (1e6 * statistics.median(times) for times in (built, analysed))
    return dict(zip(("build_us", "analyze_us"), medians, strict=True)) | {
        "failed": failed,
        "displacements": moved,
    }


def main():
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what OpenSees prints must not get into the answer
    ops, version = import_opensees()
    found = {"error": version} if ops is None else answer(ops, json.loads(sys.stdin.readline()))
    print(json.dumps({"version": version, **found}), file=out, flush=True)


if __name__ == "__main__":
    main()
