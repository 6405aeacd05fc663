"""How long does a displacement to a given error take, by catenaries and by straight elements?

Question   The isolated cable (`scenes.isolated_cable`) with one elastic catenary a span,
           and with 1 to 256 straight elements a span: time against error.
Reference  Both spans as catenaries by Irvine's integrals, solved in 40 digits with mpmath,
           independently of the package; beside it the published displacement (Jayaraman and
           Knudson 1981).
Error      Distance of the loaded node's displacement in phase 2 from the reference, m.
Command    python experiments/isolated_cable.py   (writes experiments/results/isolated_cable.txt
           and .png; two minutes)

Times are wall milliseconds of jitted functions through both phases: medians and quartiles of
alternating calls in one process, each with a new load and blocked on completion. Compile: the first
call.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import mpmath as mp
import numpy as np
import scenes
from benchmarks.measure import by_turns, clock
from record import Record
from scenes.cables import FOOT, POUND

import jaxcable as jc

ELEMENTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
REPEATS = 15
LOAD = 8000 * POUND
PUBLISHED = np.array([-0.859, -5.626])  # m; Jayaraman and Knudson (1981)

mp.mp.dps = 40


def place(load):
    """Position of the loaded point, m, from H and the vertical force in the middle of span 1."""
    ea, w = mp.mpf(0.85 * 19e6 * POUND), mp.mpf(3.16 * POUND / FOOT)
    lengths = [mp.mpf(412.8837 * FOOT), mp.mpf(613.0422 * FOOT)]

    def chord(h, v, length):
        low, high = v - w * length / 2, v + w * length / 2
        arc = (mp.asinh(high / h) - mp.asinh(low / h)) / w
        rise = (mp.hypot(h, high) - mp.hypot(h, low)) / w
        return h * (length / ea + arc), v * length / ea + rise

    def both(h, v):
        further = v + w * sum(lengths) / 2 + load
        return chord(h, v, lengths[0]), chord(h, further, lengths[1])

    def mismatch(h, v):
        (x1, z1), (x2, z2) = both(h, v)
        return x1 + x2 - mp.mpf(1000 * FOOT), z1 + z2

    start = (9e4, -2e4) if load else (2e4, -5e3)
    h, v = mp.findroot(mismatch, start)
    return both(h, v)[0]


def reference():
    before, after = place(mp.mpf(0)), place(mp.mpf(LOAD))
    return np.array([float(after[k] - before[k]) for k in (0, 1)])


def analysis(n, tol):
    """Compiled function of the load: displacement of the loaded node in phase 2, and status."""
    structure, phases = scenes.isolated_cable(n)
    node = phases[1].loads.nodes.array[0]

    @jax.jit
    def run(load):
        forces = load * jnp.array([0.0, 0.0, -1.0])
        loading = jc.replace(phases[1], loads=jc.replace(phases[1].loads, forces=forces))
        solution = jc.solve(structure, [phases[0], loading], jc.Newton(tol=tol))
        return solution.phases[1].displacement_in_phase[node], solution.status

    return run


def main():
    record = Record("isolated_cable")
    exact = reference()
    record(f"reference: {exact[0]:.12f} m along, {exact[1]:.12f} m down")
    record(f"           {exact[0] / FOOT:.9f} ft, {exact[1] / FOOT:.9f} ft")
    record(f"published: {PUBLISHED[0]} m, {PUBLISHED[1]} m\n")
    cases = [("catenaries", 0, tol) for tol in TOLERANCES]
    cases += [("straight", n, 1e-10) for n in ELEMENTS]
    runs, compile_time = [], []
    for _, n, tol in cases:
        runs.append(analysis(n, tol))
        compile_time.append(clock(runs[-1], 1.01 * LOAD)[0])
    rng = np.random.default_rng(0)
    times = by_turns(runs, REPEATS, lambda _: jnp.asarray(LOAD * (1 + 0.01 * rng.random())))
    record("kind         elements      tol    error, m   time, ms (quartiles)      compile, s")
    errors, middle = [], np.median(times, axis=0)
    for k, (kind, n, tol) in enumerate(cases):
        moved, status = runs[k](jnp.asarray(LOAD))
        assert int(status) == 0, jc.describe(status)
        errors.append(np.linalg.norm(np.asarray(moved)[[0, 2]] - exact))
        low, high = np.percentile(times[:, k], [25, 75])
        record(
            f"{kind:12s} {2 * max(n, 1):8d} {tol:8.0e} {errors[-1]:11.2e}   "
            f"{middle[k]:6.3f} ({low:.3f} to {high:.3f})   {compile_time[k]:8.1f}"
        )
    errors = np.array(errors)
    straight = np.array([kind == "straight" for kind, *_ in cases])
    orders = np.log2(errors[straight][:-1] / errors[straight][1:])
    record("\norders of the straight elements: " + ", ".join(f"{o:.3f}" for o in orders))
    best = middle[~straight][np.argmin(errors[~straight])]
    quick = errors[straight][middle[straight] <= best]
    record(
        f"catenaries: {errors[~straight].min():.0e} m in {best:.2f} ms; straight elements in that "
        f"time: {quick.min():.2g} m"
    )
    record.close(draw(cases, errors, middle, straight))


def draw(cases, errors, middle, straight):
    figure, axes = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
    left, right = axes
    for chosen, label, marker in (
        (~straight, "one catenary a span", "o"),
        (straight, "straight", "s"),
    ):
        left.loglog(errors[chosen], middle[chosen], marker + "-", label=label)
        for k in np.flatnonzero(chosen):
            _, n, tol = cases[k]
            text = f"tol {tol:.0e}" if n == 0 else f"{n} a span"
            place = (4, 5) if n else (-10, (-13, 7)[k % 2])
            left.annotate(text, (errors[k], middle[k]), place, textcoords="offset points", size=7)
    left.set(
        xlabel="error of the displacement (m)",
        ylabel="time of both phases (ms)",
        title="Time against error",
    )
    left.margins(0.12)
    left.grid(alpha=0.3)
    left.legend()
    structure, phases = scenes.isolated_cable()
    for count, style, label in ((1, "--", "self-weight"), (2, "-", "and 8 kip")):
        solution = jc.solve(structure, phases[:count])
        curves = np.asarray(jc.forms.catenary_curves(structure, solution, 41))
        line = np.concatenate(curves)
        right.plot(line[:, 0], line[:, 2], style, color="C0", label=label)
        right.plot(*np.asarray(solution.positions)[1, ::2], "ko", markersize=4)
    right.plot([0, 1000 * FOOT], [0, 0], "k^", label="support")
    right.set(xlabel="x (m)", ylabel="z (m)", title="Two catenaries", aspect="equal")
    right.legend(loc="upper center", ncols=3, frameon=False, bbox_to_anchor=(0.5, -0.75))
    return figure


if __name__ == "__main__":
    main()
