"""What is the equilibrium path of the flat net to its ultimate load (Figures 10 and 11)?

Question   The flat net of 3 x 3 cells under 150 N on every free node: load factor F/F0 against
           deflection, by full Newton and by the incremental scheme in its tangent and secant forms;
           forces and displacements at 12.5 % of the load, 18.75 N.
Reference  tests/reference/flat_net.json: an independent NumPy computation to 1e-13 of the load
           (not published values); along the path a NumPy solution of the same equations, which by
           symmetry have two unknowns.
Error      Largest difference of a displacement of a free node, mm, and of a tension, N.
Command    python experiments/flat_net_path.py
           (writes experiments/results/flat_net_path.txt and .png)

The text of the paper has no numbers of these figures, so none are compared.
"""

import jax
import matplotlib.pyplot as plt
import numpy as np
from record import Record, reference

import jaxcable as jc

jax.config.update("jax_disable_most_optimizations", True)  # compilation is most of the time

REFERENCE = reference("flat_net")
FREE = np.array(REFERENCE["free_nodes"])
LOAD = 150.0  # N
SHARE = 0.125  # of it, where the paper compares
INCREMENTS = (40, 200)  # 12.5 % is one of them
METHODS = {
    "full Newton": jc.Newton(tol=1e-13),
    "tangent, 0 corrections": jc.Incremental(0),
    "tangent, 1 correction": jc.Incremental(1),
    "secant, 1 solve (paper)": jc.Incremental(0, "secant"),
}


def symmetric(load, cell=0.4):
    """Deflection w and outward movement u of a free node, m, and both tensions, N, by NumPy.

    All free nodes are alike: each moves down by w and outward by u along both axes. From a node an
    outer link leads to (cell - u, u, w), an inner one to (cell + 2 u, 0, 0). Newton's method with a
    matrix from differences.
    """
    stiffness, pretension = REFERENCE["EA_N"], REFERENCE["pretension_N"]
    rest = cell / (1 + pretension / stiffness)

    def links(w, u):
        outer = np.sqrt((cell - u) ** 2 + u**2 + w**2)
        # changes of length without a subtraction of lengths
        changes = np.array([(2 * u**2 + w**2 - 2 * cell * u) / (outer + cell), 2 * u])
        return stiffness * (changes + cell - rest) / rest, outer

    def unbalanced(v):
        w, u = v
        (outer, inner), length = links(w, u)
        return np.array([2 * outer * w / length - load, outer * (cell - 2 * u) / length - inner])

    v, h = np.array([0.04, 0.0]), 1e-6
    for _ in range(50):
        ends = [(unbalanced(v + h * d) - unbalanced(v - h * d)) / (2 * h) for d in np.eye(2)]
        v = v - np.linalg.solve(np.stack(ends, axis=1), unbalanced(v))
    return v[0], v[1], links(*v)[0]


def path_of(method, increments):
    """Return the path of phase 2 whatever its residual, and which increments meet the criterion."""
    scene = jc.scenes.flat_net(LOAD, (1, increments))
    solution = jc.solve(*scene, method)
    good = int((np.asarray(solution.phases[1].path.status) == 0).sum())
    if good < increments:
        solution = jc.solve(*scene, jc.replace(method, tol=np.inf))
    return solution.phases[1].path, good, solution


def main(increments=INCREMENTS):
    say = Record("flat_net_path")
    runs = {
        (name, n): path_of(method, n)
        for n in increments
        for name, method in METHODS.items()
        if n == increments[0] or "Newton" not in name  # which does not depend on them
    }
    exact = {n: np.array([symmetric(LOAD * k / n)[0] for k in range(1, n + 1)]) for n in increments}
    gaps = {
        key: 1e3 * (-np.asarray(run[0].displacement)[:, FREE[0], 2] - exact[key[1]])
        for key, run in runs.items()
    }
    n = increments[0]
    say(f"\nEquilibrium path in {n} increments to F0 = {LOAD:.0f} N: deflection of a free node by")
    say("NumPy, mm, and what the methods differ from it, mm")
    say(f"{'F/F0':>7}{'NumPy':>10}" + "".join(f"{name:>25}" for name in METHODS))
    for k in sorted({0, *range(n // 8 - 1, n, n // 8)}):
        row = "".join(f"{gaps[name, n][k]:+25.2e}" for name in METHODS)
        say(f"{(k + 1) / n:7.3f}{1e3 * exact[n][k]:10.4f}{row}")
    say(f"\n{'':26}{'increments':>11}{'solves':>8}{'largest':>10}{'at F0':>10}   criterion 5 %")
    say(f"{'':45}{'mm':>10}{'mm':>10}")
    for (name, count), (path, good, _) in runs.items():
        gap = np.abs(gaps[name, count])
        text = "converged" if good == count else f"DRIFTED after {good} increments"
        say(
            f"{name:26}{count:11d}{int(np.asarray(path.iterations).sum()):8d}"
            f"{gap.max():10.1e}{gap[-1]:10.1e}   {text}"
        )
    for (name, count), gap in gaps.items():
        before = gap[: max(count // 2, 1)]
        far = np.abs(gap) > 10 * np.abs(before).max()
        if far.any():
            at = (np.argmax(far) + 1) / count
            say(f"{name}, {count} increments ({100 / count:.2g} %): diverges at F/F0 = {at:.3f}")

    case = next(c for c in REFERENCE["cases"] if c["load_per_free_node_N"] == SHARE * LOAD)
    moved = 1e3 * np.array([case["displacement_m"][str(n)] for n in FREE])
    tension = np.array(case["tension_N"])
    w, u, both = symmetric(SHARE * LOAD)
    say(f"\nAt {SHARE:.1%} of the load, {SHARE * LOAD} N (all free nodes are alike); right:")
    say("the largest deviations over all nodes and links from the reference")

    def line(name, moved, force, off=None):
        text = f"{name:40}{-moved[2]:12.7f}{-moved[0]:11.7f}{force[0]:12.6f}{force[1]:12.6f}"
        say(text if off is None else f"{text}{off[0]:9.0e} mm{off[1]:9.0e} N")

    say(f"{'':40}{'down':>12}{'outward':>11}{'outer link':>12}{'inner link':>12}")
    say(f"{'':40}{'mm':>12}{'mm':>11}{'N':>12}{'N':>12}")
    line("reference", moved[0], tension)
    off = abs(1e3 * w + moved[0, 2]), np.abs(both - tension[:2]).max()
    line("NumPy, two unknowns", 1e3 * np.array([-u, -u, -w]), both, off)
    deviations = {}
    for (name, count), (path, _, _) in runs.items():
        k = round(SHARE * count) - 1
        ours, force = 1e3 * np.asarray(path.displacement)[k, FREE], np.asarray(path.tension)[k]
        off = deviations[name, count] = np.abs(ours - moved).max(), np.abs(force - tension).max()
        line(f"{name}, {count} increments", ours[0], force, off)
    say("""
Deviations, with their cause:
- Full Newton: rounding of both computations.
- Tangent form: the error of finite increments, largest at the start, where the net is flat, its
  stiffness that of the pretension alone, and grows with the square of the deflection.
- Drifted: the first linear step moves the flat net down only, and so leaves the growth of tension
  in its outer links unbalanced along the net, which is more than 5 % of the small first load. Shown
  is what the runs come to without the criterion.
- Secant form: first order, and unstable with small increments, see `accession_curves.py`: beyond
  a certain load every step alternates more than the one before.
Published forces and displacements stood in figures and cannot be compared.""")
    say.close(draw(exact, runs, gaps, n))
    return runs, gaps, deviations


def draw(exact, runs, gaps, n):
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(14, 4.6), layout="constrained")
    factors = np.arange(1, n + 1) / n
    left.plot(np.append(0, 1e3 * exact[n]), np.append(0, factors), "k-", label="NumPy reference")
    names = list(METHODS)
    for (name, count), gap in gaps.items():
        k = names.index(name)
        error = np.maximum(np.abs(gap), 1e-14)
        style = "-" if count == n else "--"
        label = f"{name}, {count} increments"
        x = np.arange(1, count + 1) / count
        middle.semilogy(x, error, style, color=f"C{k}", linewidth=1.2, label=label)
        if count == n:
            w = -1e3 * np.asarray(runs[name, n][0].displacement)[:, FREE[0], 2]
            left.plot(w, factors, "ox+^"[k], color=f"C{k}", markersize=5, fillstyle="none")
    left.axhline(SHARE, color="0.5", linewidth=0.8, linestyle=":")
    left.set(
        xlabel="deflection of a free node (mm)",
        ylabel="load factor F/F0",
        title=f"Equilibrium path, F0 = {LOAD:.0f} N; dotted: {SHARE:.1%}",
    )
    left.legend(fontsize=8, loc="upper left")
    middle.set(
        xlabel="load factor F/F0",
        ylabel="difference from the NumPy path (mm)",
        title="Error along the path",
    )
    for axis in (left, middle):
        axis.grid(alpha=0.3)
    handles, labels = middle.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    path, _, solution = runs[names[0], n]
    row = round(SHARE * n) - 1
    places = np.asarray(solution.phases[0].positions)
    force, moved = np.asarray(path.tension)[row], 1e3 * np.asarray(path.displacement)[row]
    for link, value in zip(REFERENCE["links"], force, strict=True):
        ends = places[link]
        right.plot(*ends[:, :2].T, color="0.6", linewidth=1.5, zorder=1)
        right.annotate(
            f"{value:.2f}", ends[:, :2].mean(axis=0), ha="center", va="center", fontsize=7,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
        )  # fmt: skip
    right.plot(*np.delete(places, FREE, axis=0)[:, :2].T, "ks", markersize=5)
    right.plot(*places[FREE, :2].T, "ko", markersize=5)
    for n in FREE:
        right.annotate(
            f"{-moved[n, 2]:.3f} mm", places[n, :2], (4, 9), textcoords="offset points", fontsize=7
        )
    right.set(
        xlabel="x (m)",
        ylabel="y (m)",
        title=f"Tensions (N) and deflections at {SHARE * LOAD} N",
        aspect="equal",
    )
    return figure


if __name__ == "__main__":
    main()
