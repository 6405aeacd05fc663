"""How fast are large nets and many cases, beside OpenSees and beside a bare direct solver?

Question   Time, memory and gradient of a two-phase analysis against the number of unknowns; cost of
           a load case in a batch; what saves factorisations.
Reference  OpenSees (corotTruss, InitStressMaterial, the fastest of its systems and algorithms);
           the bare PARDISO, one factorisation and solve of the same matrix; and for the answers
           each other: deflections of the middle differ by less than 1e-9 m.
Error      Relative residual at most 1e-8 in both programs, measured in both as the largest
           unbalanced force over the largest sum of forces at a node.
Command    python experiments/scaling.py [nets] [variants] [hard] [batches] [cache]
           [draw]
           OPENSEES_PYTHON names an interpreter with openseespy (default: this one); figures are
           kept in experiments/results/scaling.json, tables and picture made of them.

The nets: `jaxcable.scenes.saddle`, n x n free nodes, spacing 1 m, EA 16 MN, pretension 20 kN, load
5 kN / (n + 1) on each free node, so that no cable goes slack; 2 phases of one increment, which is
the fastest in both programs. Every case has a process of its own. Times are medians of warm calls
with new numbers; the first call (analysis of the pattern, compilation, run) stands apart. OpenSees
cannot change numbers without building the model again; its table gives both, the ratio is to its
analysis alone. Both programs may use all cores.
"""

import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from record import commit, write

HERE = Path(__file__).parent
RESULTS = HERE / "results"
SIDES = (4, 10, 20, 50, 100, 200, 577)
SMALL = [
    ("BandSPD", "RCM", "Newton"),
    ("ProfileSPD", "RCM", "Newton"),
    ("SparseSYM", "Plain", "Newton"),
    ("SparseSYM", "Plain", "ModifiedNewton"),
    ("BandSPD", "RCM", "ModifiedNewton"),
    ("UmfPack", "Plain", "Newton"),
]
LARGE = [
    ("SparseSYM", "Plain", "Newton"),
    ("SparseSYM", "Plain", "ModifiedNewton"),
    ("UmfPack", "Plain", "Newton"),
    ("Mumps", "Plain", "ModifiedNewton"),
]


def ask(script, case, interpreter=sys.executable, flags=None, limit=900):
    """The answer of a peer script to a case; a failed process is an answer, too."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", **(flags or {})}
    try:
        run = subprocess.run(
            [interpreter, str(HERE / "peers" / script)],
            input=json.dumps(case) + "\n",
            capture_output=True,
            text=True,
            env=environment,
            timeout=limit,
        )
    except subprocess.TimeoutExpired:
        return {"error": f"no answer in {limit} s"}
    lines = run.stdout.strip().splitlines()
    if not lines:
        return {"error": f"died ({run.returncode}): {run.stderr.strip()[-200:]}"}
    return json.loads(lines[-1])


def opensees(n, load, system, numberer, algorithm, repeats=3, **more):
    case = {
        **{"n": n, "spacing": 1.0, "rise": 0.1, "axial_stiffness": 16e6, "pretension": 20e3},
        **{"load": load, "system": system, "numberer": numberer, "algorithm": algorithm},
        **{"steps": [1, 1], "tol": 1e-8, "max_iterations": 50, "repeats": repeats, **more},
    }
    return ask("opensees_scaling.py", case, os.environ.get("OPENSEES_PYTHON", sys.executable))


def nets():
    """Sizes, solvers and programs by turns."""
    found = {}
    for n in SIDES:
        load = 5000.0 / (n + 1)
        repeats = 30 if n <= 50 else 7 if n <= 200 else 2
        own, rows = {}, {}
        solvers = ["pardiso", "cholmod", "superlu"] if n <= 200 else ["pardiso"]
        for solver in [*([None] if n <= 10 else []), *solvers]:
            case = {"n": n, "load": load, "solver": solver, "repeats": repeats, "gradient": True}
            own[str(solver)] = ask("scaling_child.py", {**case, "pieces": solver is not None})
            print(n, solver, brief(own[str(solver)]), flush=True)
        if n <= 20:
            case = {"n": n, "load": load, "solver": None, "repeats": repeats, "gradient": True}
            own["fused"] = ask("scaling_child.py", {**case, "pieces": False, "fused": True})
            print(n, "fused", brief(own["fused"]), flush=True)
        candidates = SMALL if n <= 20 else LARGE if n <= 200 else []
        for choice in candidates:
            rows[" ".join(choice)] = opensees(
                n, load, *choice, repeats=9 if n <= 20 else 3 if n < 200 else 1
            )
            print(n, choice, rows[" ".join(choice)], flush=True)
        found[n] = {"jaxcable": own, "opensees": rows}
    return found


def brief(answer):
    return {
        key: round(statistics.median(value), 3) if isinstance(value, list) and value else value
        for key, value in answer.items()
    }


def variants():
    """What saves factorisations, on 30 000 unknowns and on the hard case."""
    found = {}
    for name, change in {
        "as it is": {},
        "every step factorised": {"plain": True},
        "line search from the start": {"searched": True},
        "2 increments": {"increments": 2},
        "5 increments": {"increments": 5},
    }.items():
        for scene, load, repeats in (("taut", 5000 / 101, 5), ("slack", 500.0, 1)):
            if scene == "slack" and "increments" in name:
                continue
            for solver in (
                ("pardiso", "superlu") if "plain" in change or not change else ("pardiso",)
            ):
                case = {"n": 100, "load": load, "solver": solver, "repeats": repeats}
                case |= {"gradient": False, "pieces": False, **change}
                answer = ask("scaling_child.py", case)
                found[f"{name}, {scene}, {solver}"] = answer
                print(name, scene, solver, brief(answer), flush=True)
    return found


def hard():
    """saddle(100, 100) under 500 N a node: many cables go slack."""
    case = {"n": 100, "load": 500.0, "solver": None, "repeats": 3, "gradient": True}
    found = {"jaxcable": ask("scaling_child.py", {**case, "pieces": False})}
    for name, more in {
        "corotTruss, Newton": {"algorithm": "Newton"},
        "corotTruss, NewtonLineSearch": {"algorithm": "NewtonLineSearch"},
        "corotTruss without compression, Newton": {"algorithm": "Newton", "compression": 0.0},
    }.items():
        found[name] = opensees(100, 500.0, "Mumps", "Plain", repeats=1, **more)
    for name, answer in found.items():
        print(name, brief(answer), flush=True)
    return found


def batches():
    """Load cases of the net of 48 unknowns."""
    found = {}
    for devices in (1, 2):
        for cases in (100, 1000, 10000):
            answer = ask("batch_child.py", {"cases": cases, "devices": devices, "chunk": 128})
            found[f"{cases} on {devices}"] = answer
            print(cases, devices, answer, flush=True)
    for cases in (100, 1000, 10000, 100000):
        case = {"cases": cases, "devices": 1, "chunk": None, "fused": True}
        found[f"{cases} fused"] = ask("batch_child.py", case)
        print(cases, "fused", found[f"{cases} fused"], flush=True)
    rows = {}
    for choice in SMALL[:4]:
        rows[" ".join(choice)] = opensees(4, 1000.0, *choice, repeats=200)
        print(choice, rows[" ".join(choice)], flush=True)
    found["opensees"] = rows
    return found


def cache():
    """First calls with jax's persistent compilation cache, before and after it is filled."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        flags = {
            "JAX_COMPILATION_CACHE_DIR": folder,
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        }
        for n in (4, 50):
            case = {"n": n, "load": 5000 / (n + 1), "solver": None, "repeats": 3}
            case |= {"gradient": False, "pieces": False}
            answers = [ask("scaling_child.py", case, flags=flags) for _ in range(2)]
            found[n] = [answer.get("first_s") for answer in answers]
            print(n, found[n], flush=True)
    return found


def machine():
    """What the figures belong to."""
    import jax
    import scipy

    model = [
        line.split(":")[1].strip()
        for line in Path("/proc/cpuinfo").read_text().splitlines()
        if line.startswith("model name")
    ]
    return (
        f"{time.strftime('%Y-%m-%d')}, {model[0]}, {os.cpu_count()} cores, Python "
        f"{platform.python_version()}, jax {jax.__version__}, scipy {scipy.__version__}, "
        f"commit {commit()}"
    )


def main():
    parts = {
        **{"nets": nets, "variants": variants, "hard": hard, "batches": batches},
        "cache": cache,
    }
    asked = sys.argv[1:] or [*parts, "draw"]
    store = RESULTS / "scaling.json"
    kept = json.loads(store.read_text()) if store.exists() else {}
    for name in asked:
        if name in parts:
            kept[name] = {"machine": machine(), "found": parts[name]()}
            write(store, json.dumps(kept, indent=1) + "\n")
    if "draw" in asked:
        from scaling_report import draw, tables

        write(RESULTS / "scaling.txt", tables(kept))
        print(tables(kept))
        draw(kept, RESULTS / "scaling.png")


if __name__ == "__main__":
    main()
