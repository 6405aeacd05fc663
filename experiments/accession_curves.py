"""How does the error of the displacement decrease with the size of the increments (Figure 7)?

Question   The accuracy cable under 2.0 kN in phase 2, relative increments of 0.5 to 9.5 %, 5 and 10
           elements: error of each scheme, its order, and whether the solution diverges below a
           certain size of the increments, as the paper says of 0.5 %.
Reference  The closed form of `accuracy_cable.py` (NumPy, extended precision), and, for the limit,
           the eigenvalues of one step of the secant form about it, from NumPy matrices of its own.
Error      Largest difference over both components of nodes 2 to 5 from the closed form, in % of
           the largest exact displacement.
Command    python experiments/accession_curves.py
           (writes experiments/results/accession_curves.txt and .png)

A phase has equal increments: a relative increment r means n = round(1/r) increments. Phase 2 starts
from the equilibrium of phase 1, so that all errors arise in phase 2. The first n of N increments
under N/n times the load are the same as n increments of the load; so one program serves all r.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from accuracy_cable import LENGTH, LOADS, PAPER, STIFFNESS, exact, polygon
from record import Record

import jaxcable as jc

jax.config.update("jax_disable_most_optimizations", True)  # compilation is most of the time

LOAD = 1e3 * PAPER["inputs"]["phase_2_load_for_fig_7_kN"]  # N
CRITERION = PAPER["inputs"]["force_norm_criterion"]
FIGURE = np.arange(0.5, 9.51, 0.5)  # %, as in the figure
COARSE = (1, 2, 3, 5, 8)  # for the orders of schemes that are at rounding level in the figure
FINE = (250, 300, 500, 1000, 1500, 2000, 3000, 5000, 10000)  # down to 0.01 %
COUNTS = np.array(sorted({*COARSE, *(round(100 / r) for r in FIGURE), *FINE}))
MOST = {5: 10000, 10: 2000}  # increments, by elements; in single precision 1000
TIGHT = jc.Newton(tol=1e-13)
METHODS = {
    "secant, 1 solve (paper)": jc.Incremental(0, "secant"),
    "secant, 2 solves": jc.Incremental(1, "secant"),
    "tangent, 0 corrections": jc.Incremental(0),
    "tangent, 1 correction": jc.Incremental(1),
    "tangent, 2 corrections": jc.Incremental(2),
    "full Newton": TIGHT,
}
FLOOR = 1e-10  # %: smaller errors are rounding
OFF = 0.1  # %: an error above it, and ten times that of a coarser run, has diverged


def cast(tree, dtype):
    """Convert the floats of a pytree to another precision."""

    def one(value):
        floats = hasattr(value, "dtype") and jnp.issubdtype(value.dtype, jnp.floating)
        return jnp.asarray(value, dtype) if floats else value

    return jax.tree.map(one, tree)


def runs(n_elements, method, counts=COUNTS, dtype=np.float64):
    """Compute phase 2 with every number of increments.

    Returns:
        displacements of nodes 2 to 5, [n_count, 4, 2], mm, whatever the residual is; and with the
        force norm of the paper as criterion: status and number of increments of runs, [n_count].
    """
    structure, phases = cast(jc.scenes.accuracy_cable(n_elements), dtype)
    first = jc.solve(structure, phases[:1], TIGHT if dtype == np.float64 else jc.Newton())
    jc.raise_if_failed(first)
    loaded, total = phases[1].loads.nodes.array, int(max(counts))

    @jax.jit
    def analyse(method, forces):
        def one(force):
            down = force * jnp.array([0.0, 0.0, -1.0], dtype)
            loading = jc.Phase(loads=jc.NodalLoads(loaded, down), increments=total)
            path = jc.solve(structure, [loading], method, start=first).phases[0].path
            return path.displacement_in_phase[:, loaded, ::2], path.status

        return jax.vmap(one)(forces)

    forces, last = jnp.asarray(LOAD * total / np.asarray(counts), dtype), np.asarray(counts) - 1
    rows = np.arange(len(counts))
    if isinstance(method, jc.Newton):
        path, codes = analyse(cast(method, dtype), forces)
        return 1e3 * np.asarray(path)[rows, last], np.asarray(codes)[rows, last], last + 1
    free, paper = (jc.replace(method, tol=dtype(t)) for t in (np.inf, CRITERION))
    path, codes = (np.asarray(v) for v in analyse(paper, forces))
    good = [int((codes[k, :n] == 0).sum()) for k, n in enumerate(counts)]
    if (codes[rows, last] != 0).any():  # what they come to is shown all the same
        path = np.asarray(analyse(free, forces)[0])
    return 1e3 * path[rows, last], codes[rows, last], np.array(good)


def error(moved, true):
    """Return the errors, % of the largest exact displacement, [n_count]."""
    return 100 * np.abs(moved - true).max(axis=(1, 2)) / np.abs(true).max()


def order(counts, errors, floor=FLOOR, most=200):
    """Slope of log error over log increment, and the counts it is fitted to."""
    chosen = (counts <= most) & (errors > floor)
    if chosen.sum() < 3:
        return np.nan, counts[chosen]
    usable = counts[chosen][-8:]  # the smallest increments that are above rounding
    here = np.isin(counts, usable)
    return -np.polyfit(np.log(counts[here]), np.log(errors[here]), 1)[0], usable


def load_factor(moved):
    """Load whose equilibrium has the vertical displacement of node 3, over the applied one."""
    low, high = 0.0, 4.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        deep = exact(middle * LOAD)[1, 1] < moved[1, 1]
        low, high = (low, middle) if deep else (middle, high)
    return middle


def multiplier(n_elements, load):
    """Largest eigenvalue of a step of the secant form about equilibrium, in size.

    A step is ``u -> u0 + K_s(u)^-1 (F - f(u0))``; with ``K_s du = f(u) - f(u0)`` its derivative is
    ``I - K_s^-1 K_t``. NumPy, matrices of the elements in the plane, from the closed form.
    """

    def places(load):
        corners = np.concatenate([[[0.0, 0.0]], polygon(load).astype(float)])
        corners = np.concatenate([corners, [[corners[-1, 0] + corners[1, 0], 0.0]]])
        if n_elements == 5:
            return corners
        between = 0.5 * (corners[1:] + corners[:-1])
        return np.insert(corners, np.arange(1, 6), between, axis=0)

    rest = LENGTH / n_elements
    d0, d = np.diff(places(LOADS[0]), axis=0), np.diff(places(LOADS[0] + load), axis=0)
    l0, l = np.linalg.norm(d0, axis=1), np.linalg.norm(d, axis=1)
    q0, q = STIFFNESS * (l0 - rest) / rest / l0, STIFFNESS * (l - rest) / rest / l
    secant, tangent = np.zeros((2, 2 * n_elements + 2, 2 * n_elements + 2))
    for k in range(n_elements):
        m, t = d0[k] + d[k], d[k] / l[k]
        c = (STIFFNESS / rest - q0[k]) / (l[k] * (l[k] + l0[k]))
        blocks = (
            0.5 * (q0[k] + q[k]) * np.eye(2) + 0.5 * c * np.outer(m, m),
            STIFFNESS / rest * np.outer(t, t) + q[k] * (np.eye(2) - np.outer(t, t)),
        )
        at = slice(2 * k, 2 * k + 4)
        for matrix, block in zip((secant, tangent), blocks, strict=True):
            matrix[at, at] += np.kron([[1, -1], [-1, 1]], block)
    free = slice(2, -2)
    values = 1 - np.linalg.eigvals(np.linalg.solve(secant[free, free], tangent[free, free]))
    return values[np.argmax(np.abs(values))].real


def predicted(n_elements, n_solves=1):
    """Multiplier at the full load, load where it passes -1, and counts at which rounding shows.

    Errors grow by the product of the multipliers beyond -1; counts for a growth of rounding, in
    double and single precision, to a thousandth.
    """
    factors = (np.arange(200) + 0.5) / 200
    sizes = np.array([multiplier(n_elements, f * LOAD) for f in factors])
    rate = n_solves * np.mean(np.maximum(np.log(np.abs(sizes)), 0.0))
    counts = [np.log(1e-3 / np.finfo(t).eps) / rate for t in (np.float64, np.float32)]
    beyond = factors[np.abs(sizes) > 1]
    return sizes[-1], beyond[0] if len(beyond) else np.nan, counts


def limit(counts, errors, codes):
    """Largest number of increments before the solution diverges, and the next one tried, or None.

    Diverged: an error above `OFF` % that is ten times that of a coarser run, or drifted, with 100
    or more increments.
    """
    for k in range(1, len(counts)):
        far = not errors[k] <= max(OFF, 10 * errors[:k].min())
        if counts[k] >= 100 and (far or codes[k]):
            return counts[k - 1], counts[k]
    return counts[-1], None


PAPERS = "secant, 1 solve (paper)"
SINGLE = "secant, 1 solve, float32"


def main(elements=(5, 10), methods=METHODS, counts=COUNTS, single=True):
    say = Record("accession_curves")
    counts, true = np.asarray(counts), exact(LOAD)
    say(f"""
{LOAD / 1e3:.1f} kN added to {LOADS[0]:.0f} N on nodes 2 to 5; exact displacement of node 3
{-true[1, 1]:.6f} mm down; errors in % of it. Of Figure 7 the text tells no numbers but that the
curves of 5 and 10 elements approach each other below 3 % and are some 1 % off at 0.5 %.
Status by the paper's criterion: unbalanced force at most {CRITERION:.0%} of the load.""")
    found = {}  # (elements, method): counts, displacements, codes, good increments
    for n in elements:
        for name, method in methods.items():
            own = counts[counts <= MOST[n]]
            found[n, name] = own, *runs(n, method, own)
        if single:
            own = counts[counts <= 1000]
            found[n, SINGLE] = own, *runs(n, methods[PAPERS], own, np.float32)
    table = {key: error(run[1], true) for key, run in found.items()}
    for n in elements:
        print_table(say, n, found, table)
    if set(elements) == {5, 10}:
        few, many = (table[n, PAPERS][inside(found[n, PAPERS][0])] for n in (5, 10))
        gap = np.abs(few - many).max()
        least = 100 / found[5, PAPERS][0][inside(found[5, PAPERS][0])][-1]
        say(f"""
Deviations from the figure: 5 and 10 elements differ by {gap:.0e} % at most in its range, where
the published curves differ above 3 %: in equilibrium nodes without load change nothing. And the
secant form is {few[-1]:.3f} % off at {least:.1f} %, not about 1 %. Likely causes: phase 2 begins
from equilibrium here; span, start geometry and secant of the figure are unknown.""")
    orders = observed(say, table, found)
    limits = divergence(say, table, found, elements)
    say.close(draw(table, found))
    return table, found, orders, limits


def inside(counts):
    """Rows in the range of the figure."""
    return np.flatnonzero((counts >= 11) & (counts <= 200))


SHORT = {
    PAPERS: "secant 1",
    "secant, 2 solves": "secant 2",
    "tangent, 0 corrections": "tangent 0",
    "tangent, 1 correction": "tangent 1",
    "tangent, 2 corrections": "tangent 2",
    SINGLE: "secant 1 f32",
}


def print_table(say, n, found, table):
    names = [name for own, name in table if own == n]
    say(f"""
{n} elements: error, %. D: drifted beyond the criterion, after the share of the increments that
follows (what the run comes to without it is shown); F: another failure. f: load whose equilibrium
has the displacement of node 3 that the secant form gives, over the load.""")
    titles = " ".join(f"{SHORT.get(name, name):13}" for name in names)
    say(f"{'r, %':>7}{'n':>7}   {titles}{'f':>7}")
    for k, count in enumerate(found[n, names[0]][0]):
        cells = []
        for name in names:
            own, _, codes, good = found[n, name]
            if k >= len(own):
                cells.append(" " * 13)
                continue
            mark = ""
            if codes[k]:
                letter = "D" if codes[k] == jc.status.DRIFTED else "F"
                mark = f"{letter}{good[k] / count:.2f}"
            cells.append(f"{table[n, name][k]:7.1e} {mark:5}")
        f = load_factor(found[n, names[0]][1][k])
        say(f"{100 / count:7.3f}{count:7d}   " + " ".join(cells) + f"{f:9.5f}")


def observed(say, table, found):
    say(f"""
Observed orders: log error over log increment, the up to 8 smallest increments of 0.5 % or more
with an error above {FLOOR:.0e} %""")
    orders = {}
    for (n, name), errors in table.items():
        if name in (SINGLE, "full Newton"):
            continue
        orders[n, name], used = order(found[n, name][0], errors)
        text = f"{orders[n, name]:6.2f}" if np.isfinite(orders[n, name]) else "  none"
        say(f"  {n:2d} elements, {name:26}{text}   n = {', '.join(map(str, used))}")
    return orders


def divergence(say, table, found, elements):
    say(f"""
Is there an increment below which the solution diverges? Diverged: an error above {OFF} % that is
ten times that of a coarser run, or drifted by the criterion, with 100 or more increments.""")
    limits = {}
    for (n, name), errors in table.items():
        counts, _, codes, _ = found[n, name]
        good, bad = limits[n, name] = limit(counts, errors, codes)
        text = f"no, down to {100 / good:.2f} %"
        if bad is not None:
            text = (
                f"yes, between {100 / good:.3g} and {100 / bad:.3g} %; then {errors[-1]:.2g} % off"
            )
        if codes.any():
            text += f"; {(codes != 0).sum()} of {len(counts)} runs drifted"
        say(f"  {n:2d} elements, {name:26}{text}")
    say("\nWhy: a step of the secant form multiplies an error by an eigenvalue of I - K_s^-1 K_t:")
    for n in elements:
        value, factor, (double, short) = predicted(n)
        say(
            f"  {n:2d} elements: {value:.4f} at the full load, beyond -1 from {factor:.2f} of it; "
            f"rounding grows to 1e-3 in n = {double:.0f} (double), {short:.0f} (single)"
        )
    say("""
Each increment of the secant form is one step of a fixed point iteration whose largest eigenvalue is
a little beyond -1 once the load is large beside that of phase 1. Rounding errors alternate and grow
from step to step, the more the smaller the increments, and end in an alternation of some per cent
out of balance, which the criterion need not see. So the paper's remark, that there is a size of the
increment below which the solution diverges, is reproduced for the secant form, and refuted for the
tangent forms and Newton's method, which have no such limit in the range tried. Where the limit is
depends on the precision of the arithmetic: the 0.5 % of the paper are nearest to that of single
precision, of which its text says nothing; on the structure, see flat_net_path.txt; and on the
secant, which need not be that of the paper. A second solve an increment is no gain: it undoes the
first where the eigenvalue is near -1.""")
    return limits


def draw(table, found):
    figure, (left, right) = plt.subplots(1, 2, figsize=(13, 5.4), layout="constrained")
    names = list(dict.fromkeys(name for _, name in table))
    for (n, name), errors in table.items():
        counts, moved, codes, _ = found[n, name]
        size, here, failed = 100 / counts, inside(counts), codes != 0
        look = {"linewidth": 1, "color": f"C{names.index(name)}", "markersize": 4 if n == 5 else 6}
        style = "o-" if n == 5 else "x--"
        right.loglog(size, errors, style, label=f"{name}, {n} elements", **look)
        right.plot(size[failed], errors[failed], "s", color="black", markersize=9, fillstyle="none")
        if name != SINGLE:
            f = [load_factor(moved[k]) for k in here]
            left.plot(size[here], f, style, **look)
    right.plot([], [], "ks", fillstyle="none", markersize=9, label=f"drifted by > {CRITERION:.0%}")
    right.axvline(0.5, color="0.5", linewidth=0.8, linestyle=":")
    left.set(
        xlabel="relative increment (%)",
        ylabel="load of the computed displacement\nover applied load f",
        title="Accession, range of Figure 7",
        xlim=(0, 10),
    )
    right.set(
        xlabel="relative increment (%); dotted: 0.5 %",
        ylabel="error of displacement (%)",
        title="Error, all increments",
        ylim=(1e-14, 1e3),
    )
    for axis in (left, right):
        axis.grid(alpha=0.3)
    handles, labels = right.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure


if __name__ == "__main__":
    main()
