"""What holds tensegrities, cable domes and cable trusses up?

Question   How many states of self-stress and mechanisms have the simplex, a Geiger dome, a Levy
           dome and a cable truss, what does their prestress look like, how stiff does it make them,
           and how far do they move under load? Up to which load is the Geiger dome stable, and what
           do errors of 1 mm in the lengths of its elements change?
Reference  The unbalanced force of the stated prestress from positions alone (NumPy). Maxwell's rule
           m - s = n_free - n_elem. At low prestress the lowest eigenvalue of the tangent stiffness
           (autodiff, at a solved state) is that of the mechanisms' own stiffness, which comes from
           the equilibrium matrix and the force densities without any analysis.
Error      Unbalanced force over the largest tension, -. Lowest eigenvalue over the mechanisms' own,
           less one, %.
Command    python experiments/domes.py   (writes experiments/results/domes.txt and .png)
"""

import jax
import jax.numpy as jnp
import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from record import Record

import jaxcable as jc
from jaxcable import forms

jax.config.update("jax_enable_x64", True)
matplotlib.use("Agg")

SCENES = {
    "simplex": jc.scenes.simplex(),
    "Geiger dome": jc.scenes.geiger_dome(),
    "Levy dome": jc.scenes.levy_dome(),
    "cable truss": jc.scenes.cable_truss(loaded="half"),
}
LEVELS = np.array([0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 2.0])  # of the scene's prestress
LOADS = np.arange(0.0, 1000.0, 75.0)  # on the Geiger dome, N/m2
COMPRESSED = "firebrick"


def rows(structure, per_group):
    parts = zip(jax.tree.leaves(per_group), structure.groups, strict=True)
    return np.concatenate([np.broadcast_to(p, len(group.links)) for p, group in parts])


def stated(structure, phase):
    """Force densities that a phase states, of all elements, N/m, and their links."""
    links = np.concatenate([group.links.array for group in structure.groups])
    ends = np.asarray(structure.nodes)[links]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    if phase.pretension is not None:
        return rows(structure, phase.pretension) / length, links
    return rows(structure, phase.force_density), links


def unbalanced(structure, density, links):
    """Largest force left at a free freedom over the largest tension."""
    nodes = np.asarray(structure.nodes)
    chord = nodes[links[:, 1]] - nodes[links[:, 0]]
    pull = density[:, None] * chord
    left = np.zeros_like(nodes)
    np.add.at(left, links[:, 0], pull)
    np.add.at(left, links[:, 1], -pull)
    free = ~structure.held()
    return np.abs(left[free]).max() / np.linalg.norm(pull, axis=1).max()


def scaled(phase, level):
    """A prestress phase at another level."""
    name = "pretension" if phase.pretension is not None else "force_density"
    return jc.replace(phase, **{name: jax.tree.map(lambda v: level * v, getattr(phase, name))})


def study(structure, phases, say):
    """Analyse a scene; solution, eigenvalue at every level of prestress, the mechanisms' own."""
    found = forms.self_stress(structure)
    density, links = stated(structure, phases[0])
    n_free = int((~structure.held()).sum())
    assert found.m - found.s == n_free - len(links)
    tension = density * np.concatenate(jax.tree.leaves(found.length))
    solution = jc.solve(structure, phases)
    jc.raise_if_failed(solution)

    @jax.jit
    def prestressed(level):
        state = jc.solve(structure, [scaled(phases[0], level)])
        return jnp.linalg.eigvalsh(jc.stiffness.tangent_of(structure, state))[0], state.status

    values, codes = zip(*(prestressed(jnp.asarray(level)) for level in LEVELS), strict=True)
    assert not any(int(code) for code in codes)
    own = found.mechanism_stiffness(tension)[0] if found.m else None
    moved = np.asarray(solution.displacement - solution.phases[0].displacement)
    loaded = jc.stiffness.modes(structure, solution, n=1).stiffness[0]
    say(f"free freedoms {n_free}, elements {len(links)}; {found.describe()}")
    above, below = found.gap
    rest = f"{below:.0e} the largest that does not" if below else "no others"
    say(f"singular values over the largest: {above:.1e} the least that counts, {rest}")
    say(f"prestress as stated: unbalanced {unbalanced(structure, density, links):.0e} (-)")
    for kind, group in structure.elements.items():
        first, last = (np.asarray(p.tension[kind]) / 1e3 for p in solution.phases)
        say(
            f"  {kind:12}{len(group.links):4d}  prestressed {spread(first):>24} kN, "
            f"loaded {spread(last):>24} kN"
        )
    say(
        f"lowest eigenvalue: {values[LEVELS.tolist().index(1.0)] / 1e3:.3f} kN/m prestressed, "
        f"{loaded / 1e3:.3f} kN/m loaded"
    )
    if own is not None:
        gaps = [
            f"{100 * (v / (level * own) - 1):.2f}" for v, level in zip(values, LEVELS, strict=True)
        ]
        say(f"the mechanisms' own {own / 1e3:.3f} kN/m; eigenvalue over it, less one (%), at")
        say("  " + ", ".join(f"{level:g}: {gap}" for level, gap in zip(LEVELS, gaps, strict=True)))
    load = -float(solution.load[:, 2].sum()) / 1e3
    say(
        f"load {load:.4g} kN: sinks by {-1e3 * moved[:, 2].min():.1f} mm at most, rises by "
        f"{1e3 * max(moved[:, 2].max(), 0.0):.1f} mm; slack cables "
        f"{int(solution.phases[-1].path.n_slack[-1])}\n"
    )
    return solution, np.array(values), own


def stability(say):
    """The Geiger dome under more and more load: lowest eigenvalue, N/m, and largest twist, m.

    For the perfect dome, and for one whose elements have errors of length of 1 mm. The twist is the
    displacement of nodes around the axis, which the perfect dome has none of by symmetry.
    """
    structure, (prestress, loading) = SCENES["Geiger dome"]
    rng = np.random.default_rng(4)
    errors = {k: 1e-3 * rng.normal(size=len(g.links)) for k, g in structure.elements.items()}
    plan = np.asarray(structure.nodes)[:, :2]
    around = np.column_stack([-plan[:, 1], plan[:, 0]])
    radius = np.linalg.norm(plan, axis=1)

    @jax.jit
    def at(load, factor):
        """Load, N/m2, and factor on the errors of length."""
        wrong = jax.tree.map(lambda e: factor * e, errors)
        forces = load / 300.0 * jnp.asarray(loading.loads.forces)  # 300 N/m2 in the scene
        solution = jc.solve(
            structure,
            [
                jc.replace(prestress, shortening=wrong),
                jc.replace(loading, loads=jc.replace(loading.loads, forces=forces)),
            ],
        )
        lowest = jnp.linalg.eigvalsh(jc.stiffness.tangent_of(structure, solution))[0]
        moved = solution.displacement - solution.phases[0].displacement
        return lowest, jnp.sum(moved[:, :2] * around, axis=1), moved[:, 2].min(), solution.status

    say("Geiger dome, perfect and with errors of 1 mm in its lengths")
    say(f"{'N/m2':>6}{'lowest eigenvalue (kN/m)':>28}{'largest twist (mm)':>24}{'sinks (mm)':>22}")
    result = {0.0: [], 1.0: []}
    for load in LOADS:
        line = []
        for factor, kept in result.items():
            lowest, turned, sunk, code = at(load, factor)
            ok = int(code) == 0
            twist = np.abs(np.asarray(turned)[radius > 0] / radius[radius > 0]).max()
            kept.append((float(lowest) if ok else np.nan, twist, float(sunk)))
            line.append((f"{lowest / 1e3:.2f}" if ok else f"status {int(code)}", twist, sunk))
        (low, twist, sunk), (low_other, twist_other, sunk_other) = line
        say(
            f"{load:6.0f}{low:>16}{low_other:>12}{1e3 * twist:14.1f}{1e3 * twist_other:10.1f}"
            f"{-1e3 * sunk:12.0f}{-1e3 * sunk_other:10.0f}"
        )
    say("Beyond the branch point the perfect dome is left on the unstable path (status OK), until")
    say("rounding happens to break its symmetry.")
    return {factor: np.array(kept) for factor, kept in result.items()}


def spread(values):
    """Different values in words: all of three or fewer, else the range."""
    different = np.unique([f"{v:.4g}" for v in values])
    different = sorted(different, key=float)
    return ", ".join(different) if len(different) <= 3 else f"{different[0]} to {different[-1]}"


def draw(axes, structure, solution, zoom):
    """The prestressed structure: cables coloured by tension, struts thick and red."""
    first = solution.phases[0]
    nodes = np.asarray(first.positions)
    plane = not hasattr(axes, "get_zlim")
    seen = nodes[:, [0, 2]] if plane else nodes
    links = np.concatenate([group.links.array for group in structure.groups])
    tension = rows(structure, first.tension) / 1e3
    strut = tension < 0
    collection = LineCollection if plane else Line3DCollection
    cables = collection(seen[links[~strut]], array=tension[~strut], cmap="viridis", linewidths=1.7)
    axes.add_collection(cables)
    if strut.any():
        axes.add_collection(
            collection(seen[links[strut]], colors=COMPRESSED, linewidths=3.2, zorder=3)
        )
        low, high = tension[strut].min(), tension[strut].max()
        span = f"{low:.3g}" if high - low < 1e-6 * -low else f"{low:.3g} to {high:.3g}"
        axes.plot(
            *[[]] * seen.shape[1], color=COMPRESSED, linewidth=3.2, label=f"struts, {span} kN"
        )
    held = structure.held()
    held = held[:, [0, 2]].all(1) if plane else held.any(1)
    marks = {"marker": "^", "linestyle": "none", "color": "black", "markersize": 5}
    axes.plot(*seen[held].T, **marks, label="support")
    low, size = seen.min(0), np.ptp(seen, axis=0)
    margin = 0.04 * size.max()
    for name, start, extent in zip("xy" if plane else "xyz", low, size, strict=True):
        axes.set(**{f"{name}lim": (start - margin, start + extent + margin)})
    if plane:
        axes.set(xlabel="x (m)", ylabel="z (m)", aspect="equal")
        moved = solution.displacement - first.displacement
        after = (nodes + 10 * np.asarray(moved))[:, [0, 2]]
        axes.add_collection(LineCollection(after[links], colors="0.6", linewidths=0.9, zorder=0))
        axes.plot([], [], color="0.6", linewidth=0.9, label="half loaded, displacement x 10")
    else:
        axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
        axes.set_box_aspect(size + 2 * margin, zoom=zoom)
        axes.view_init(elev=28, azim=-62)
        axes.locator_params(axis="z", nbins=3)
        for name in "xy":
            axes.locator_params(axis=name, nbins=4)
    return cables


def main():
    say = Record("domes")
    done = {}
    for title, (structure, phases) in SCENES.items():
        say(f"\n{title}")
        done[title] = study(structure, phases, say)

    growing = stability(say)

    figure = plt.figure(figsize=(18.0, 10.5))

    def place(title, box, low, zoom=1.0):
        """Axes of a scene: left, bottom, width, height in the figure; its key from `low` on."""
        plane = title == "cable truss"
        axes = figure.add_axes(box, projection=None if plane else "3d")
        cables = draw(axes, SCENES[title].structure, done[title][0], zoom)
        middle = box[0] + 0.5 * box[2]
        figure.text(middle, box[1] + box[3], title, ha="center", va="bottom", fontsize=12)
        bar = figure.add_axes((middle - 0.1, low, 0.2, 0.013))
        figure.colorbar(cables, cax=bar, label="tension of cables (kN)", orientation="horizontal")
        key = {"loc": "lower center", "bbox_to_anchor": (middle, low + 0.015)}
        figure.legend(*axes.get_legend_handles_labels(), frameon=False, fontsize=8, ncols=2, **key)

    place("Geiger dome", (0.06, 0.54, 0.36, 0.41), 0.505, 1.3)
    place("Levy dome", (0.54, 0.54, 0.36, 0.41), 0.505, 1.3)
    place("simplex", (0.01, 0.12, 0.2, 0.29), 0.065, 0.92)
    place("cable truss", (0.255, 0.2, 0.26, 0.2), 0.065)
    axes = figure.add_axes((0.575, 0.075, 0.17, 0.32))
    for k, (title, (_, values, own)) in enumerate(done.items()):
        axes.loglog(LEVELS, values / 1e3, "o-", color=f"C{k}", markersize=4, label=title)
        if own is not None:
            axes.loglog(LEVELS, LEVELS * own / 1e3, "--", color="0.2", linewidth=3, zorder=0)
    axes.loglog([], [], "--", color="0.2", linewidth=3, label="mechanisms alone")
    axes.set(
        xlabel="prestress over that of the scene (-)",
        ylabel="lowest eigenvalue (kN/m)",
        title="tangent stiffness, not loaded",
        ylim=(5e-5, 2e3),
    )
    axes.legend(frameon=False, fontsize=8, ncols=2, loc="lower right")
    axes = figure.add_axes((0.815, 0.075, 0.17, 0.32))
    names = {0.0: ("perfect", "o"), 1.0: ("1 mm errors of length", "s--")}
    for factor, (name, style) in names.items():
        lowest = growing[factor][:, 0] / 1e3
        axes.plot(LOADS, lowest, style, markersize=5 - factor, label=name, zorder=3 - factor)
    axes.axhline(0.0, color="0.3", linewidth=0.8)
    axes.set(
        xlabel="load (N/m2)",
        ylabel="lowest eigenvalue (kN/m)",
        title="Geiger dome, loaded",
    )
    axes.legend(frameon=False, fontsize=8)
    say.close(figure)


if __name__ == "__main__":
    main()
