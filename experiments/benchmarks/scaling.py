"""How fast are large nets and many cases, beside OpenSees and beside a bare direct solver?

Question   Time, memory and gradient of a two-phase analysis against the number of unknowns; cost of
           a load case in a batch; a net with slack cables.
Reference  OpenSees (corotTruss, InitStressMaterial, the fastest of its systems and algorithms);
           the bare solver, one factorisation and solve of the same matrix. Deflections of the
           middle by both programs differ by less than 1e-9 m.
Error      Relative residual at most 1e-8 in both programs, measured in both as the largest
           unbalanced force over the largest sum of forces at a node.
Results    scaling.json, and scaling.txt and scaling.png made of it

The nets: `jaxcable.scenes.saddle`, n x n free nodes, spacing 1 m, EA 16 MN, pretension 20 kN, load
5 kN / (n + 1) on each free node, so that no cable goes slack; 2 phases of one increment, which is
the fastest in both programs. Every case runs in a separate process. Times are medians of warm calls
with new numbers; the first call (analysis of the pattern, compilation, run) is listed separately.
OpenSees cannot change numbers without building the model again; its table has times with and
without building, the ratio refers to its analysis alone. Both programs may use all cores.
"""

import json
import math
import statistics
import time

import record

from .cases import HARD, SYSTEMS
from .measure import analysis, opensees, table

PARTS = "nets", "hard", "batches"


def of_jaxcable(n, load, solver, repeats, fused=False):
    """Measure a saddle by jaxcable; returns the figures that are saved."""
    case = {"scene": f"saddle {n}" + " fused" * fused, "load": load, "solver": solver, "tol": 1e-8}
    case |= {"of": "pretension", "kinds": ["jitted", "gradient"], "repeats": repeats}
    found = analysis({**case, "pieces": solver is not None})
    value, gradient = found.pop("jitted"), found.pop("gradient")
    found |= {"first_s": value["first_s"], "value_ms": value["ms"], "gradient_ms": gradient["ms"]}
    return found | {"peak_rss_MB": found.pop("peak_MB")}


def of_opensees(n, load, system, numberer, algorithm, repeats=3, tol=1e-8, **more):
    """The same by OpenSees."""
    case = {"n": n, "spacing": 1.0, "rise": 0.1, "axial_stiffness": 16e6, "pretension": 20e3}
    case |= {"load": load, "system": system, "numberer": numberer, "algorithm": algorithm}
    case |= {"steps": [1, 1], "tol": tol, "max_iterations": 50, "repeats": repeats, **more}
    return opensees("opensees_scaling.py", case)


def nets(cases):
    """Sizes, solvers and programs by turns."""
    found = {}
    for n in cases.sides:
        load, repeats = 5000.0 / (n + 1), 30 if n <= 50 else 7 if n <= 200 else 2
        own = {}
        for solver in [
            *([None] if n <= 10 else []),
            *(name for name, most in cases.solvers.items() if n <= most),
        ]:
            own[str(solver)] = of_jaxcable(n, load, solver, repeats)
        if n <= 20:
            own["fused"] = of_jaxcable(n, load, None, repeats, fused=True)
        count = 9 if n <= 20 else 3 if n < 200 else 1
        rows = {
            " ".join(choice): of_opensees(n, load, *choice, repeats=count)
            for *choice, sides in SYSTEMS
            if n in sides
        }
        found[str(n)] = {"jaxcable": own, "opensees": rows}
        print(n, *(f"{k} {middle(v['value_ms']):.2f}" for k, v in own.items()), flush=True)
    return found


def hard(cases):
    """A saddle under 500 N a node: many cables of 100 x 100 go slack."""
    found = {"jaxcable": of_jaxcable(cases.hard, 500.0, None, 3)}
    for name, more in HARD.items():
        numberer = {"system": "Mumps", "numberer": "Plain", "repeats": 1}
        found[name] = of_opensees(cases.hard, 500.0, **numberer, **more)
    return found


def batches(cases):
    """Load cases of the net of 48 unknowns."""
    case, found = {"scene": "saddle 4", "tol": 1e-8, "repeats": 9, "chunk": 128}, {}
    for devices in (1, 2):
        for count in cases.batches[:3]:
            found[f"{count} on {devices}"] = analysis({**case, "cases": count, "devices": devices})
    case |= {"scene": "saddle 4 fused", "chunk": None}
    for count in cases.batches:
        found[f"{count} fused"] = analysis({**case, "cases": count})
    found["opensees"] = {
        " ".join(choice): of_opensees(4, 1000.0, *choice, repeats=200)
        for *choice, sides in SYSTEMS[:4]
    }
    return found


def machine():
    """Describe the machine that the figures belong to."""
    return f"{time.strftime('%Y-%m-%d')}, {record.machine()}"


def run(cases, parts):
    """Measure the named parts, by default all; "draw" only writes tables and picture again."""
    store = record.RESULTS / "scaling.json"
    kept = json.loads(store.read_text()) if store.exists() else {}
    for name in parts or PARTS:
        if name != "draw":
            kept[name] = {"machine": machine(), "found": globals()[name](cases)}
            record.write(store, json.dumps(kept, indent=1) + "\n")
    text = "\n\n".join(
        part
        for name in PARTS
        if name in kept
        for part in (f"=== {name}: {kept[name]['machine']}", *TABLES[name](kept[name]["found"]))
    )
    print(text)
    record.write(record.RESULTS / "scaling.txt", text + "\n")
    if {"nets", "batches"} <= set(kept):
        picture = draw(kept["nets"]["found"], kept["batches"]["found"])
        record.write(record.RESULTS / "scaling.png", picture)


# --- tables


def middle(values):
    """Median, or None of an answer that has none."""
    return statistics.median(values) if values else None


def shown(value, form=".2f"):
    return "-" if value is None else format(value, form)


def over(value, by):
    return None if value is None else value / by


def best(rows):
    """Return name and answer of the fastest successful setting of OpenSees, or None and {}."""
    good = {name: row for name, row in rows.items() if row.get("ok")}
    name = min(good, key=lambda k: good[k]["analyze_s"], default=None)
    return name, good.get(name, {})


def milliseconds(peer):
    """Return times of OpenSees, ms: analysis alone, and with building the model; or None, None."""
    if not peer:
        return None, None
    return 1e3 * peer["analyze_s"], 1e3 * (peer["analyze_s"] + peer["build_s"])


def net_tables(nets):
    speed, cost, memory, systems = [], [], [], []
    for n, found in nets.items():
        unknowns = str(3 * int(n) ** 2)
        name, peer = best(found["opensees"])
        alone, built = milliseconds(peer)
        for solver, own in found["jaxcable"].items():
            value, gradient = middle(own["value_ms"]), middle(own["gradient_ms"])
            times = value, min(own["value_ms"]), alone, built, over(alone, value)
            times = *times, over(built, value), gradient / value
            counts = str(own["iterations"]), str(own["factorizations"]), f"{own['residual']:.0e}"
            label = solver.replace("None", "default")
            speed.append([unknowns, label, *map(shown, times), *counts])
            peaks = own["first_s"], *(peak / 1e3 for peak in own["peak_rss_MB"])
            peaks = *peaks, over(peer.get("peak_rss_MB"), 1e3)
            memory.append([unknowns, solver, *map(shown, peaks)])
            if "factor_ms" in own:
                pieces = [middle(own[f"{k}_ms"]) for k in ("assembly", "factor", "solve")]
                step = value / own["iterations"]
                ratios = step / (pieces[1] + pieces[2]), pieces[0] / pieces[1]
                cost.append([unknowns, solver, *map(shown, (step, *pieces, *ratios))])
        for choice, row in found["opensees"].items():
            text = shown(1e3 * row["analyze_s"]) if row.get("ok") else row.get("error", "failed")
            mark = " *" if name and choice == next(iter(found["opensees"])) else ""
            systems.append([unknowns + mark, choice, text, str(row.get("iterations", "-"))])
    yield (
        "Time, ms, beside the fastest OpenSees (analysis alone; with model building), their ratios;"
        "\nvalue and gradient over value\n"
    ) + table(
        "unknowns solver value least OpenSees built ratio built gradient steps factors "
        "residual".split(),
        speed,
    )
    yield (
        "One Newton step (time over steps), assembly (residual and tangent), bare factorisation and"
        " solve, ms\n"
    ) + table(
        [*"unknowns solver step assembly factor solve".split(), "step / (f + s)", "assembly / f"],
        cost,
    )
    yield (
        "First call (analysis of the pattern, compilation, run), s; peak memory, GB: one analysis,"
        "\nwith gradients, OpenSees\n"
    ) + table("unknowns solver first value gradient OpenSees".split(), memory)
    yield "OpenSees' choices: analysis, ms, and iterations\n" + table(
        ["unknowns", "system, numberer, algorithm", "analysis", "iterations"], systems
    )
    few, many = (nets.get(n, {}).get("jaxcable", {}).get("pardiso") for n in ("50", "200"))
    if few and many:
        power = math.log(middle(many["value_ms"]) / middle(few["value_ms"])) / math.log(16)
        yield f"Growth of time between 7 500 and 120 000 unknowns: exponent {power:.2f}"


def hard_tables(found):
    rows = []
    for name, row in found.items():
        ok = row.get("ok", row.get("status") == 0)
        ms = middle(row["value_ms"]) if "value_ms" in row else milliseconds(row if ok else {})[0]
        counts = (str(row.get(k, "-")) for k in ("iterations", "factorizations", "slack"))
        place = shown(row["z_middle"], ".10f") if ok else "-"
        error = "" if ok else str(row.get("error", ""))[:40]
        rows.append([name, "yes" if ok else "no", shown(ms if ok else None), *counts, place, error])
    yield "The hard case: saddle(100, 100), 500 N on every node\n" + table(
        [*"program converged ms steps factors slack".split(), "z of the middle, m", ""], rows
    )


BATCH_HEADS = "with building", "gradient, us", "first, s", "steps", "failed"


def batch_tables(found):
    rows, (name, peer) = [], best(found["opensees"])
    alone, both = (over(ms, 1e-3) for ms in milliseconds(peer))
    for key, row in found.items():
        if key != "opensees":
            own = middle(row["us_a_case"])
            count, kind = key.split(" ", 1)
            kind = "fused loops" if kind == "fused" else f"devices: {kind[3:]}"
            ratios = own, row["cores_case"], over(alone, own), over(both, own)
            figures = *ratios, middle(row["us_a_gradient"]), row["first_case_s"]
            counts = str(row["iterations"]), str(row["failed"])
            rows.append([f"{count} cases, {kind}", *map(shown, figures), *counts])
    built = both - alone if peer else None
    yield (
        "Load cases of 48 unknowns, chunks of 128 (with fused loops of 256, in threads), us a\n"
        f"case; OpenSees ({name}, one core):\n"
        f"{shown(alone, '.0f')} us analysis, {shown(built, '.0f')} us building the model; ratios "
        "without and with\n"
    ) + table([*"batch us cores ratio".split(), *BATCH_HEADS], rows)


TABLES = {"nets": net_tables, "hard": hard_tables, "batches": batch_tables}


# --- picture


def draw(nets, cases):
    """Time against unknowns; cost of a case against the number of cases."""
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")

    def line(style, label, time, **options):
        points = [(3 * int(n) ** 2, time(found)) for n, found in nets.items()]
        points = [point for point in points if point[1] is not None]
        if points:
            left.loglog(*zip(*points, strict=True), style, label=label, **options)

    def own(solver, key):
        return lambda found: middle(found["jaxcable"].get(solver, {}).get(key))

    for solver, label, style in (
        ("pardiso", "jaxcable, PARDISO", "C0o-"),
        ("cholmod", "jaxcable, CHOLMOD", "C5P-"),
        ("superlu", "jaxcable, SuperLU", "C2s-"),
        ("None", "jaxcable, default (dense, banded)", "C4^-"),
        ("fused", "jaxcable, fused loops", "C1v-"),
    ):
        line(style, label, own(solver, "value_ms"))
    line("C0o:", "jaxcable, PARDISO, with gradient", own("pardiso", "gradient_ms"), mfc="w")
    line(
        "C3D-",
        "OpenSees, best, analysis alone",
        lambda found: milliseconds(best(found["opensees"])[1])[0],
    )

    def bare(found):
        factor, solve = (own("pardiso", key)(found) for key in ("factor_ms", "solve_ms"))
        return None if factor is None else factor + solve

    line("k--", "PARDISO: one factor and solve", bare, lw=1)
    left.set(xlabel="unknowns", ylabel="two-phase analysis, ms", title="Saddle nets")
    left.grid(True, which="major", alpha=0.3)
    left.legend(fontsize=8)
    for end, style, label in (
        (" on 1", "C0o-", "jaxcable, 1 device"),
        (" on 2", "C1s-", "jaxcable, 2 devices"),
        (" fused", "C2v-", "jaxcable, fused loops, threads"),
    ):
        rows = {key: row for key, row in cases.items() if key.endswith(end)}
        points = [(int(key.split()[0]), middle(row["us_a_case"])) for key, row in rows.items()]
        right.semilogx(*zip(*points, strict=True), style, label=label)
    alone, both = milliseconds(best(cases["opensees"])[1])
    if alone is not None:
        right.axhline(1e3 * alone, color="C3", label="OpenSees, analysis alone")
        right.axhline(1e3 * both, color="C3", ls="--", label="OpenSees, with building the model")
    right.set(xlabel="load cases", ylabel="time a case, μs")
    right.set(title="Load cases of a net of 48 unknowns", ylim=(0, None))
    right.grid(True, alpha=0.3)
    right.legend(fontsize=8, loc="center right", bbox_to_anchor=(1.0, 0.36))
    return figure
