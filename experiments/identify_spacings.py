"""Which plan of the hyperbolic paraboloid net follows from the published deflections?

Question   The geometry of the net is only in a figure of the paper. Four spacings along x and five
           along y are identified from the twelve deflections of each column of Table 3, starting
           from the regular net of 0.4 m. How well are they determined, and what cannot be
           identified?
Reference  The columns themselves (Mihanovic, Trogrlic, Zivaljic 2011, Table 3). The Jacobian is
           compared with central differences; the confidence intervals with refits to the computed
           deflections plus random errors.
Error      Largest difference of a computed deflection from the published one, mm.
Command    python experiments/identify_spacings.py
           (writes experiments/results/identify_spacings.txt and .png)

Agreement is no validation: nine numbers are fitted to twelve.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from record import Record

import jaxcable as jc
from jaxcable import design
from jaxcable.scenes import hypar
from jaxcable.scenes.nets import orthogonal_grid

PLACES, LINKS, FREE = orthogonal_grid(3, 4)
SCENE = jc.scenes.hypar_net(disturbed=False, increments=(1, 1))
START = {"x": jnp.full(4, 0.4), "y": jnp.full(5, 0.4)}
BOUNDS = (0.1, 2.5)  # m
NAMES = [f"x{k + 1}" for k in range(4)] + [f"y{k + 1}" for k in range(5)]
TIGHT = jc.Newton(tol=1e-13)


def nodes(spacing):
    """Nodes [26, 3] of a flat plan."""
    x, y = (jnp.concatenate([jnp.zeros(1), jnp.cumsum(spacing[k])]) for k in "xy")
    return jnp.stack([x[PLACES[:, 0]], y[PLACES[:, 1]], jnp.zeros(len(PLACES))], axis=1)


def deflections(spacing, heights=None):
    """Deflections of the free nodes, mm, downward, [12], and the solution.

    `heights` are those of the supports, [14], m; phase 1 finds the form of the net with 200 N.
    """
    places = nodes(spacing)
    if heights is not None:
        places = places.at[np.setdiff1d(np.arange(len(places)), FREE), 2].set(heights)
    structure = jc.replace(SCENE.structure, nodes=places)
    solution = jc.solve(structure, SCENE.phases, TIGHT)
    return -1e3 * solution.phases[1].displacement_in_phase[FREE, 2], solution


def misfit(spacing, published):
    """Residuals, mm, [12], and the solution."""
    found, solution = deflections(spacing)
    return found - published, solution


def misfit_of_saddle(params, published):
    """The same with the height `h` of a saddle, m."""
    around = PLACES[np.setdiff1d(np.arange(len(PLACES)), FREE)]
    sign = jnp.asarray(np.where(np.isin(around[:, 0], (0, 4)), 1.0, -1.0))
    spacing = {k: params[k] for k in "xy"}
    found, solution = deflections(spacing, params["h"] * sign)
    return found - published, solution


def flat(spacing):
    return np.concatenate([np.asarray(spacing["x"]), np.asarray(spacing["y"])])


def shown(values, digits=3):
    return " ".join(f"{v:8.{digits}f}" for v in values)


def main():
    say = Record("identify_spacings")
    say(f"\n{'column':22}{'steps':>6}{'largest':>9}{'rms':>7}  spacings, m, and half width of 95 %")
    say(f"{'':22}{'':>6}{'mm':>9}{'mm':>7}  " + " ".join(f"{n:>8}" for n in NAMES))
    fits = {}
    for name, column in hypar.PUBLISHED.items():
        fits[name] = fit = design.fit(misfit, START, BOUNDS, steps=30, args=(jnp.asarray(column),))
        jc.raise_if_failed(fit)
        interval = design.confidence(fit)
        worst = float(jnp.abs(fit.residual).max())
        rms = float(fit.misfit) / np.sqrt(12)
        say(f"{name:22}{int(fit.steps):6d}{worst:9.3f}{rms:7.3f}  {shown(flat(fit.params))}")
        say(f"{'':44}  {shown(flat(interval.half_width))}")
    plan = {"x": jnp.array([0.4, 0.4, 0.4, 0.795]), "y": jnp.array([0.4] * 4 + [1.084])}
    second = jnp.asarray(hypar.PUBLISHED["Kwan [15] b"])
    gap = np.abs(np.asarray(misfit(plan, second)[0])).max()
    say(f"\nthe plan of scenes.hypar_net has {gap:.3f} mm against the second Kwan column:")
    say(f"{'':44}  {shown(flat(plan))}")

    best = fits["Kwan [15] b"]
    interval = design.confidence(best)
    h = 1e-4
    differences = []
    for k in range(9):
        step = h * jnp.eye(9)[k]
        ends = [
            misfit(jax.tree.map(jnp.add, best.params, {"x": s * step[:4], "y": s * step[4:]}), 0.0)
            for s in (1, -1)
        ]
        differences.append((ends[0][0] - ends[1][0]) / (2 * h))
    error = np.abs(np.stack(differences, 1) - best.jacobian).max() / np.abs(best.jacobian).max()
    say(f"\nsecond Kwan column: Jacobian against central differences of 0.1 mm: {error:.0e}")

    # the intervals, tried: the same fit to its own deflections plus errors of the same deviation
    draws = np.random.default_rng(1).normal(size=(200, 12)) * interval.deviation
    target = deflections(best.params)[0]
    again = jax.vmap(lambda e: design.fit(misfit, best.params, BOUNDS, args=(target + e,)))(draws)
    spread = np.concatenate([np.asarray(again.params[k]) for k in "xy"], axis=1)
    spread = spread[np.asarray(again.status) == 0]
    low, high = np.quantile(spread, [0.16, 0.84], axis=0)
    errors = f"errors of {interval.deviation:.3f} mm"
    say(f"{len(spread)} of 200 refits to these deflections plus {errors}")
    say(f"{'  half of their central 68 %, m':44}  {shown((high - low) / 2)}")
    say(f"{'  standard error by the Jacobian, m':44}  {shown(flat(interval.standard_error))}")

    say("\nWhat is determined: singular values of the Jacobian with columns of length one, and the")
    say("combination of spacings that belongs to the weakest one")
    say(f"  {shown(interval.singular_values)}")
    say(f"  {shown(interval.directions[-1])}   ({' '.join(NAMES)})")
    change = interval.directions[-1] * 0.05
    moved = jax.tree.map(jnp.add, best.params, {"x": change[:4], "y": change[4:]})
    effect = np.abs(np.asarray(deflections(moved)[0] - deflections(best.params)[0])).max()
    say(f"  5 cm of it change the deflections by at most {effect:.3f} mm")

    say("\nHeights: a tenth parameter, supports at the ends of links along x up by h and along y")
    say("down by it, the form found by 200 N in every link; and 14 independent heights")
    for name in ("Kwan [15] a", "Kwan [15] b"):
        start = {**fits[name].params, "h": jnp.asarray(0.0)}
        low, high = ({"x": v, "y": v, "h": h} for v, h in zip(BOUNDS, (-1.0, 1.0), strict=True))
        column = jnp.asarray(hypar.PUBLISHED[name])
        saddle = design.fit(misfit_of_saddle, start, (low, high), args=(column,))
        jc.raise_if_failed(saddle)
        half = design.confidence(saddle).half_width["h"]
        worst = float(jnp.abs(saddle.residual).max())
        flat_worst = float(jnp.abs(fits[name].residual).max())
        say(
            f"  {name}: h = {1e3 * float(saddle.params['h']):.0f} +- {1e3 * float(half):.0f} mm, "
            f"largest misfit {worst:.3f} instead of {flat_worst:.3f} mm"
        )
    slope = jax.jacfwd(lambda z: deflections(best.params, z)[0])(jnp.zeros(14))  # mm per m
    both = np.concatenate([np.asarray(best.jacobian), np.asarray(slope)], axis=1)
    say(f"  9 spacings and 14 heights: rank {np.linalg.matrix_rank(both)}, for 23 unknowns")
    share = flat(interval.half_width) / flat(best.params)
    below = [flat(f.params) - flat(design.confidence(f).half_width) for f in fits.values()]
    longer = (np.array(below) > 0.4).sum(axis=0)
    say(f"""
Plainly: the deflections tell how stiff the net is against load at every node, hence products of
spacings along x and y. They hardly tell the two scales apart: longer spacings along x with shorter
ones along y give nearly the same deflections. By the second Kwan column a spacing alone is known
to {share.min():.0%} at best, {share.max():.0%} at worst.
That the last spacing is longer than 0.4 m is sure at 95 % along x in {longer[3]} of {len(fits)}
columns and along y in {longer[8]}. Supports that rise and fall by some 4 cm in the shape of a
saddle fit as well as a flat plan, and fourteen heights of their own cannot be recovered from
twelve deflections at all.""")

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    for name, fit in fits.items():
        left.plot(range(12), np.asarray(fit.residual), "o-", label=name, markersize=4, linewidth=1)
    left.axhline(0, color="black", linewidth=0.8)
    left.set(
        xticks=range(12),
        xticklabels=hypar.NODE_NAMES,
        xlabel="node",
        ylabel="computed less published deflection (mm)",
        title="Misfit after identification",
    )
    left.legend(fontsize=7, ncols=2)
    for k, fit in enumerate(fits.values()):
        half = np.minimum(flat(design.confidence(fit).half_width), 1.0)
        place = np.arange(9) + 0.09 * (k - 3)
        right.errorbar(place, flat(fit.params), half, fmt="o", markersize=3, linewidth=1)
    right.plot(range(9), flat(plan), "k_", markersize=24, label="plan of scenes.hypar_net")
    right.set(
        xticks=range(9),
        xticklabels=NAMES,
        ylabel="spacing (m)",
        ylim=(0, 2.2),
        title="Spacings with 95 % intervals, colors as on the left",
    )
    right.legend(fontsize=8, loc="upper left")
    say.close(figure)


if __name__ == "__main__":
    main()
