"""Tables and picture of `scaling.py` from its kept figures."""

import statistics

import matplotlib
from record import write

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def middle(values):
    """Median, or None of an answer that has none."""
    return statistics.median(values) if values else None


def shown(value, form="{:.2f}"):
    return "-" if value is None else form.format(value)


def best(rows):
    """Name and answer of the fastest of OpenSees' choices that ended well, or None twice."""
    good = {name: row for name, row in rows.items() if row.get("ok")}
    if not good:
        return None, None
    name = min(good, key=lambda k: good[k]["analyze_s"])
    return name, good[name]


def table(head, rows):
    """Text with columns as wide as they need to be."""
    cells = [head, *rows]
    widths = [max(len(row[k]) for row in cells) for k in range(len(head))]
    lines = ["  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in cells]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])


def nets(kept):
    speed, cost, memory, systems = [], [], [], []
    for n, found in kept["nets"]["found"].items():
        unknowns = 3 * int(n) ** 2
        name, peer = best(found["opensees"])
        analysis = 1e3 * peer["analyze_s"] if peer else None
        built = 1e3 * (peer["analyze_s"] + peer["build_s"]) if peer else None
        for solver, own in found["jaxcable"].items():
            if "error" in own:
                speed.append([str(unknowns), solver, own["error"], *["-"] * 8])
                continue
            value, gradient = middle(own["value_ms"]), middle(own["gradient_ms"])
            speed.append(
                [
                    *(
                        str(unknowns),
                        solver.replace("None", "default"),
                        shown(value),
                        shown(min(own["value_ms"])),
                    ),
                    *(shown(analysis), shown(built)),
                    shown(analysis / value if analysis else None),
                    shown(built / value if built else None),
                    *(shown(gradient / value), str(own["iterations"])),
                    *(str(own["factorizations"]), f"{own['residual']:.0e}"),
                ]
            )
            memory.append(
                [
                    *(str(unknowns), solver, shown(own["first_s"])),
                    *(shown(peak / 1e3) for peak in own["peak_rss_MB"]),
                    shown(peer["peak_rss_MB"] / 1e3 if peer else None),
                ]
            )
            if "factor_ms" in own:
                assembly, factor, solve = (
                    middle(own[k]) for k in ("assembly_ms", "factor_ms", "solve_ms")
                )
                step = value / own["iterations"]
                cost.append(
                    [
                        *(str(unknowns), solver, shown(step), shown(assembly)),
                        *(shown(factor), shown(solve), shown(step / (factor + solve))),
                        shown(assembly / factor),
                    ]
                )
        for choice, row in found["opensees"].items():
            text = shown(1e3 * row["analyze_s"]) if row.get("ok") else row.get("error", "failed")
            systems.append([str(unknowns), choice, text, str(row.get("iterations", "-"))])
        if name:
            systems[-len(found["opensees"])][0] += " *"
    yield (
        "Time, ms, beside the fastest OpenSees (analysis alone; with model building), their ratios;"
        "\nvalue and gradient over value\n"
        + table(
            [
                "unknowns",
                "solver",
                "value",
                "least",
                "OpenSees",
                "built",
                "ratio",
                "built",
                "gradient",
                "steps",
                "factors",
                "residual",
            ],
            speed,
        )
    )
    yield (
        "One Newton step (time over steps), assembly (residual and tangent), bare factorisation and"
        " solve, ms\n"
        + table(
            [
                "unknowns",
                "solver",
                "step",
                "assembly",
                "factor",
                "solve",
                "step / (f + s)",
                "assembly / f",
            ],
            cost,
        )
    )
    yield (
        "First call (analysis of the pattern, compilation, run), s; peak memory, GB: one analysis,"
        "\nwith gradients, OpenSees\n"
        + table(["unknowns", "solver", "first", "value", "gradient", "OpenSees"], memory)
    )
    yield "OpenSees' choices: analysis, ms, and iterations\n" + table(
        ["unknowns", "system, numberer, algorithm", "analysis", "iterations"], systems
    )
    times = {
        n: middle(found["jaxcable"]["pardiso"]["value_ms"])
        for n, found in kept["nets"]["found"].items()
        if "value_ms" in found["jaxcable"].get("pardiso", {})
    }
    if "50" in times and "200" in times:
        from math import log

        power = log(times["200"] / times["50"]) / log(16)
        yield f"Growth of time between 7 500 and 120 000 unknowns: exponent {power:.2f}"


def variants(kept):
    rows = []
    for name, row in kept["variants"]["found"].items():
        if "error" in row:
            rows.append([name, row["error"], "-", "-", "-"])
            continue
        figures = (str(row[k]) for k in ("iterations", "factorizations", "status"))
        rows.append([name, shown(middle(row["value_ms"])), *figures])
    yield "What saves factorisations: 30 000 unknowns\n" + table(
        ["variant, scene, solver", "ms", "steps", "factors", "status"], rows
    )


def hard(kept):
    rows = []
    for name, row in kept["hard"]["found"].items():
        ok = row.get("ok", row.get("status") == 0)
        own = name == "jaxcable"
        time = middle(row["value_ms"]) if own else row.get("analyze_s", 0) * 1e3
        rows.append(
            [
                *(name, "yes" if ok else "no", shown(time) if ok else "-"),
                *(str(row.get("iterations", "-")), str(row.get("factorizations", "-"))),
                *(
                    str(row.get("slack", "-")),
                    shown(row.get("z_middle") if ok else None, "{:.10f}"),
                ),
                "" if ok else str(row.get("error", ""))[:40],
            ]
        )
    yield "The hard case: saddle(100, 100), 500 N on every node\n" + table(
        ["program", "converged", "ms", "steps", "factors", "slack", "z of the middle, m", ""], rows
    )


def batches(kept):
    found, rows = kept["batches"]["found"], []
    name, peer = best(found["opensees"])
    analysis, built = (1e6 * peer[k] for k in ("analyze_s", "build_s"))
    for key, row in found.items():
        if key == "opensees":
            continue
        own = middle(row["us_a_case"])
        rows.append(
            [
                key.replace(" on ", " cases, devices: ").replace(" fused", " cases, fused loops"),
                *(shown(own), shown(row["cores_case"])),
                *(shown(analysis / own), shown((analysis + built) / own)),
                *(shown(middle(row["us_a_gradient"])), shown(row["first_case_s"])),
                *(str(row["iterations"]), str(row["failed"])),
            ]
        )
    yield (
        "Load cases of 48 unknowns, chunks of 128 (with fused loops of 256, in threads), us a\n"
        f"case; OpenSees ({name}, one core):\n"
        f"{analysis:.0f} us analysis, {built:.0f} us building the model; ratios without and with\n"
        + table(
            [
                "batch",
                "us",
                "cores",
                "ratio",
                "with building",
                "gradient, us",
                "first, s",
                "steps",
                "failed",
            ],
            rows,
        )
    )


def cache(kept):
    rows = [
        [str(3 * int(n) ** 2), *(shown(second) for second in pair)]
        for n, pair in kept["cache"]["found"].items()
    ]
    yield (
        "First call, s, with the persistent compilation cache empty and filled (programs that call"
        "\nthe host are not stored by jax)\n" + table(["unknowns", "empty", "filled"], rows)
    )


def tables(kept):
    """All tables that there are figures for, as text."""
    parts = []
    for name, part in (
        ("nets", nets),
        ("variants", variants),
        ("hard", hard),
        ("batches", batches),
        ("cache", cache),
    ):
        if name in kept:
            parts.append(f"=== {name}: {kept[name]['machine']}")
            parts += list(part(kept))
    return "\n\n".join(parts) + "\n"


def draw(kept, path):
    """Time against unknowns; cost of a case against the number of cases."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    found = kept["nets"]["found"]
    sizes = {n: 3 * int(n) ** 2 for n in found}
    for solver, label, style in (
        ("pardiso", "jaxcable, PARDISO", "C0o-"),
        ("cholmod", "jaxcable, CHOLMOD", "C5P-"),
        ("superlu", "jaxcable, SuperLU", "C2s-"),
        ("None", "jaxcable, default (dense, banded)", "C4^-"),
        ("fused", "jaxcable, fused loops", "C1v-"),
    ):
        points = [
            (sizes[n], middle(f["jaxcable"][solver]["value_ms"]))
            for n, f in found.items()
            if "value_ms" in f["jaxcable"].get(solver, {})
        ]
        left.loglog(*zip(*points, strict=True), style, label=label)
    points = [
        (sizes[n], middle(f["jaxcable"]["pardiso"]["gradient_ms"]))
        for n, f in found.items()
        if f["jaxcable"].get("pardiso", {}).get("gradient_ms")
    ]
    left.loglog(
        *zip(*points, strict=True), "C0o:", mfc="w", label="jaxcable, PARDISO, with gradient"
    )
    points = [
        (sizes[n], 1e3 * best(f["opensees"])[1]["analyze_s"])
        for n, f in found.items()
        if best(f["opensees"])[0]
    ]
    left.loglog(*zip(*points, strict=True), "C3D-", label="OpenSees, best, analysis alone")
    points = [
        (sizes[n], middle(f["jaxcable"]["pardiso"]["factor_ms"]) + middle(row))
        for n, f in found.items()
        if (row := f["jaxcable"].get("pardiso", {}).get("solve_ms"))
    ]
    left.loglog(*zip(*points, strict=True), "k--", lw=1, label="PARDISO: one factor and solve")
    left.set(xlabel="unknowns", ylabel="two-phase analysis, ms", title="Saddle nets")
    left.grid(True, which="major", alpha=0.3)
    left.legend(fontsize=8)

    cases = kept["batches"]["found"]
    for devices, style in ((1, "C0o-"), (2, "C1s-")):
        points = [
            (int(key.split()[0]), middle(row["us_a_case"]))
            for key, row in cases.items()
            if key.endswith(f"on {devices}")
        ]
        label = f"jaxcable, {devices} device{'s' if devices > 1 else ''}"
        right.semilogx(*zip(*points, strict=True), style, label=label)
    points = [
        (int(key.split()[0]), middle(row["us_a_case"]))
        for key, row in cases.items()
        if key.endswith("fused")
    ]
    right.semilogx(*zip(*points, strict=True), "C2v-", label="jaxcable, fused loops, threads")
    _, peer = best(cases["opensees"])
    right.axhline(1e6 * peer["analyze_s"], color="C3", label="OpenSees, analysis alone")
    both = 1e6 * (peer["analyze_s"] + peer["build_s"])
    right.axhline(both, color="C3", ls="--", label="OpenSees, with building the model")
    right.set(xlabel="load cases", ylabel="time a case, µs", ylim=(0, 1.15 * both))
    right.set(title="Load cases of a net of 48 unknowns")
    right.grid(True, alpha=0.3)
    right.legend(fontsize=8, loc="center right", bbox_to_anchor=(1.0, 0.36))
    write(path, figure, dpi=130)
    plt.close(figure)
