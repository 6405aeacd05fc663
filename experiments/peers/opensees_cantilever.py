"""OpenSees' side of `opensees_cantilever.py`: a fibre cantilever loaded at its tip and released.

Run by an interpreter that has openseespy. Writes a line of JSON with its version, or with the
reason why there is none; then reads cases from stdin, a line of JSON each, and answers each with a
line. A case has the keys

    length, width, height, E, yield_stress, hardening, load     SI units; load acts in -z at the tip
    element                     "dispBeamColumn" or "forceBeamColumn"
    n, points                   elements, Gauss-Lobatto points in each
    fibres                      their number along width and height
    dimensions                  2: plane model; 3: space, with `fibres[0] == 1` held in its plane
    increments                  those of loading and of unloading
    stepwise                    True: step by step, with the tip's path and iterations counted

and an answer: ok, build_s, analyze_s (wall seconds), tip (its displacement in z, m, loaded and
released; stepwise after every increment), iterations (stepwise).
"""

import ctypes
import importlib.util
import json
import os
import sys
import time
from pathlib import Path


def import_opensees():
    """OpenSees, or None, and its version or why it is not there."""
    wheel = importlib.util.find_spec("openseespylinux")
    if (
        wheel is not None
    ):  # its liblapack finds the libblas beside it only if that is loaded already
        for name in ("libquadmath.so.0", "libgfortran.so.4", "libblas.so.3"):
            library = Path(wheel.origin).parent / "lib" / name
            if library.exists():
                ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    try:
        import openseespy.opensees as ops
    except Exception as error:  # a wheel for another system raises more than ImportError
        return None, f"{type(error).__name__}: {error}"
    return ops, ops.version()


def build(ops, case):
    """The model and its analysis."""
    length, width, height, n = case["length"], case["width"], case["height"], case["n"]
    plane = case["dimensions"] == 2
    ops.wipe()
    ops.model("basic", "-ndm", case["dimensions"], "-ndf", 3 if plane else 6)
    for k in range(n + 1):
        ops.node(k + 1, length * k / n, *((0.0,) if plane else (0.0, 0.0)))
    ops.fix(1, *(3 * (1,) if plane else 6 * (1,)))
    if not plane and case["fibres"][0] == 1:
        for k in range(1, n + 1):
            ops.fix(k + 1, 0, 1, 0, 1, 0, 1)
    section(ops, case)
    ops.geomTransf("Corotational", 1, *(() if plane else (0.0, 0.0, 1.0)))
    ops.beamIntegration("Lobatto", 1, 1, case["points"])
    inner = ("-iter", 100, 1e-14) if case["element"] == "forceBeamColumn" else ()
    for k in range(1, n + 1):
        ops.element(case["element"], k, k, k + 1, 1, 1, *inner)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    load = (0.0, -case["load"], 0.0) if plane else (0.0, 0.0, -case["load"], 0.0, 0.0, 0.0)
    ops.load(n + 1, *load)
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system("BandGeneral")
    # 1e-9 of the load, or what rounding leaves: EA n + 12 E I / (L/n)^3 times the tip's deflection
    force = case["E"] * width * height * n + 4 * n**3 * case["load"]
    ops.test("NormUnbalance", max(1e-9 * case["load"], 2.2e-15 * force), 50, 0)
    ops.algorithm("Newton")


def section(ops, case):
    """The fibre section; in the plane model its height is along the local y."""
    E, b, h = case["E"], case["width"], case["height"]
    along_y, along_z = case["fibres"]
    ops.uniaxialMaterial("Steel01", 1, case["yield_stress"], E, case["hardening"])
    if case["dimensions"] == 2:
        ops.section("Fiber", 1)
        ops.patch("rect", 1, along_z, along_y, -h / 2, -b / 2, h / 2, b / 2)
        return
    ops.section("Fiber", 1, "-GJ", E / 2.6 * 0.229 * h * b**3)  # of h = 2 b; not twisted here
    ops.patch("rect", 1, along_y, along_z, -b / 2, -h / 2, b / 2, h / 2)
    if along_y == 1:  # no stiffness about z, which forceBeamColumn inverts: two tiny fibres far out
        far = 1e6 * b
        ops.uniaxialMaterial("Elastic", 2, E)
        for y in (-far, far):
            ops.fiber(y, 0.0, h * b**3 / 12 / (2 * far**2), 2)


def advance(ops, case, steps, factor):
    """Increase the load by `factor` in `steps`; return success, path of the tip and iterations."""
    ops.integrator("LoadControl", factor / steps)
    if factor == 1:
        ops.analysis("Static")
    tip, axis = case["n"] + 1, 2 if case["dimensions"] == 2 else 3
    if not case["stepwise"]:
        ok = ops.analyze(steps) == 0
        return ok, [ops.nodeDisp(tip, axis)], None
    path, iterations = [], 0
    for _ in range(steps):
        if ops.analyze(1) != 0:
            return False, path, iterations
        iterations += ops.testIter()
        path.append(ops.nodeDisp(tip, axis))
    return True, path, iterations


def answer(ops, case):
    """Build and analyse one case."""
    begin = time.perf_counter()
    build(ops, case)
    built = time.perf_counter()
    loaded = advance(ops, case, case["increments"][0], 1)
    released = advance(ops, case, case["increments"][1], -1)
    return {
        "ok": loaded[0] and released[0],
        "build_s": built - begin,
        "analyze_s": time.perf_counter() - built,
        "tip": loaded[1] + released[1],
        "iterations": [loaded[2], released[2]],
    }


def main():
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what OpenSees prints must not get between the answers
    ops, version = import_opensees()
    print(json.dumps({"error" if ops is None else "version": version}), file=answers, flush=True)
    if ops is None:
        sys.exit(1)
    for line in sys.stdin:
        print(json.dumps(answer(ops, json.loads(line))), file=answers, flush=True)


if __name__ == "__main__":
    main()
