"""To which unstressed lengths must the flat net be cut to have a given shape under load?

Question   Unstressed lengths of the twelve links, for which the four loaded nodes hang exactly
           12 mm below the supports, and exactly at their positions in plan, under 15 N each.
Reference  Closed form: one state of prestress is free for this shape (more force along x, less
           along y). In the even state every cable has the horizontal force H = P a / (2 f), with
           load P, spacing a = 0.4 m and sag f; ``L0 = l / (1 + N / EA)``.
Error      Largest distance of a node from its target, mm, by another analysis with the lengths of
           the printed list (also rounded to 0.01 mm); largest difference of a length from the
           closed form, mm.
Command    python experiments/cutting_list.py
           (writes experiments/results/cutting_list.txt and .png)
"""

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from record import Record

import jaxcable as jc
from jaxcable import design

LOAD, SAG, SPACING, EA = 15.0, 0.012, 0.4, 97.97e3
STRUCTURE, (_, LOADING) = jc.scenes.flat_net(load=LOAD, increments=(1, 1))
FREE = np.asarray(LOADING.loads.nodes)
LINKS = np.asarray(STRUCTURE.elements.links)
TARGET = np.asarray(STRUCTURE.nodes).copy()
TARGET[FREE, 2] = -SAG
EVEN = 1e-4  # weight of uneven tension against a millimetre: decides between equal shapes
TIGHT = jc.Newton(tol=1e-13)


def solve(rest_length):
    return jc.solve(STRUCTURE, [jc.Phase(rest_length=rest_length), LOADING], TIGHT)


def residuals(rest_length):
    """Distances from the shape, mm, and how uneven the tensions are, -; the solution."""
    solution = solve(rest_length)
    gap = 1e3 * (solution.positions[FREE] - TARGET[FREE])
    uneven = solution.tension / jnp.mean(solution.tension) - 1
    return (gap, EVEN * uneven), solution


def closed_form():
    chord = TARGET[LINKS[:, 1]] - TARGET[LINKS[:, 0]]
    length = np.linalg.norm(chord, axis=1)
    force = LOAD * SPACING / (2 * SAG) * length / np.linalg.norm(chord[:, :2], axis=1)
    return length / (1 + force / EA)


def off(rest_length):
    solution = solve(rest_length)
    jc.raise_if_failed(solution)
    return 1e3 * np.linalg.norm(np.asarray(solution.positions) - TARGET, axis=1).max(), solution


def main():
    say = Record("cutting_list")
    start = jnp.full(12, SPACING / (1 + 200.0 / EA))  # 200 N in the flat net
    gap, _ = off(start)
    say(f"\nstart, 200 N in the flat net: {gap:.3f} mm from the shape")
    found = design.fit(residuals, start, (0.39, 0.41))
    jc.raise_if_failed(found)
    length = closed_form()
    gap, solution = off(found.params)
    say(f"found in {int(found.steps)} steps: {gap:.1e} mm from the shape")
    worst = 1e3 * np.abs(np.asarray(found.params) - length).max()
    say(f"lengths against the closed form: {worst:.1e} mm at most")
    cut = np.round(1e3 * np.asarray(found.params), 2)
    gap, _ = off(jnp.asarray(cut / 1e3))
    say(f"cut to 0.01 mm: {gap:.3f} mm from the shape")
    again = jc.influence(STRUCTURE, [jc.Phase(rest_length=found.params), LOADING], "positions")
    per = 1e3 * np.asarray(design.propagate_tolerances(again, jnp.full(12, 1e-4))[0])
    say(f"cut with errors of 0.1 mm: at worst {per.max():.2f} mm from the shape (first order)")

    say(
        f"\nCutting list\n{'link':>5}{'nodes':>9}{'unstressed':>13}{'tension':>10}"
        f"{'closed form':>14}"
    )
    say(f"{'':>5}{'':>9}{'mm':>13}{'N':>10}{'mm':>14}")
    for k in range(12):
        ends = f"{LINKS[k, 0]}-{LINKS[k, 1]}"
        say(
            f"{k:5d}{ends:>9}{1e3 * float(found.params[k]):13.3f}"
            f"{float(solution.tension[k]):10.2f}{1e3 * length[k]:14.3f}"
        )

    # the state of prestress that is free: another weight on evenness does not move the shape
    tilted = jnp.where(jnp.arange(12) < 6, 1.3, 0.7)

    def uneven(rest_length):
        solution = solve(rest_length)
        gap = 1e3 * (solution.positions[FREE] - TARGET[FREE])
        aim = tilted * jnp.mean(solution.tension)
        return (gap, EVEN * (solution.tension / aim - 1)), solution

    other = design.fit(uneven, found.params, (0.39, 0.41))
    jc.raise_if_failed(other)
    gap, second = off(other.params)
    tensions = np.asarray(second.tension)
    say(f"\nanother prestress of the same shape: {tensions[:6].mean():.0f} N along x and")
    say(f"{tensions[6:].mean():.0f} N along y, {gap:.1e} mm from the shape")

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
    for axes, state, title in ((left, solution, "as even as it can be"), (right, second, "uneven")):
        for k, (a, b) in enumerate(LINKS):
            ends = TARGET[[a, b], :2]
            tension = float(state.tension[k])
            axes.plot(*ends.T, color=plt.get_cmap("viridis")((tension - 150) / 200), linewidth=3)
            x, y = ends.mean(0)
            text = f"{1e3 * float(state.rest_length[k]):.2f}\n{tension:.0f} N"
            axes.annotate(
                text,
                (x, y),
                ha="center",
                va="center",
                fontsize=8,
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 1},
            )
        axes.plot(*TARGET[FREE, :2].T, "ko")
        axes.set(
            aspect="equal",
            xlabel="x (m)",
            ylabel="y (m)",
            title=f"Unstressed length (mm) and tension, {title}",
        )
    say.close(figure)


if __name__ == "__main__":
    main()
