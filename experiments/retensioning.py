"""How does a site crew retension a net whose cables were cut to wrong lengths?

Question   A saddle net of 60 cables, cut with random errors of 1 mm in a metre, is measured under
           its dead load. Which turnbuckle adjustments bring its tensions back to the design values:
           one step with the influence matrix of the design; repeated steps with that matrix; one
           step after the errors are identified; steps at the 20 cables of the edge only? What is
           the effect of measurement errors?
Reference  The net as built is another analysis, with the errors as shortenings. The crew does not
           know them; it knows the design, its influence matrix and the measured tensions. Converged
           adjustments must cancel the errors.
Error      Largest deviation of a tension from its target, % of the target.
Command    python experiments/retensioning.py
           (writes experiments/results/retensioning.txt and .png)
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from record import Record

import jaxcable as jc
from jaxcable import design

STRUCTURE, (PRESTRESS, LOAD) = jc.scenes.saddle(5, 5)  # EA 16 MN, 20 kN, 500 N a node
PHASES = [PRESTRESS, LOAD]
N = len(STRUCTURE.elements.links)
EDGE = np.flatnonzero(
    STRUCTURE.held_displacements()[np.asarray(STRUCTURE.elements.links), 0].any(axis=1)
)
ERRORS = 1e-3 * np.random.default_rng(5).normal(size=N)  # m, too long where positive


@jax.jit
def site(turned):
    """Analyse the net as built, with the turnbuckles shortened by given amounts, m."""
    cut = jc.Phase(shortening=turned - ERRORS)
    return jc.solve(STRUCTURE, [PRESTRESS, cut, LOAD])


def deviation(tension, target):
    return 100 * np.abs(np.asarray(tension / target) - 1).max()


def retension(matrix, target, steps, cables=None, error=0.0, rcond=1e-10):
    """Measure and adjust repeatedly; return deviations (%) and adjustments (m) at each step.

    `cables` have turnbuckles (default all); `error` is the standard error of a measurement over
    the tension measured; the crew measures again before each step.
    """
    cables = np.arange(N) if cables is None else cables
    noise = error * np.random.default_rng(7).normal(size=(steps, N))
    turned, rows = jnp.zeros(N), []
    for step in range(steps + 1):
        solution = site(turned)
        jc.raise_if_failed(solution)
        rows.append((deviation(solution.tension, target), turned))
        if step < steps:
            gap = target - solution.tension * (1 + noise[step])
            more = design.adjustment(
                matrix[:, cables], gap, like=jnp.zeros(len(cables)), rcond=rcond
            )
            turned = turned.at[cables].add(more)
    return rows


def misfit(errors, measured):
    """Tensions of the crew's model with errors of length (mm), less those measured, N."""
    cut = jc.Phase(shortening=-1e-3 * errors)
    solution = jc.solve(STRUCTURE, [PRESTRESS, cut, LOAD])
    return solution.tension - measured, solution


def main():
    say = Record("retensioning")
    solution = jc.solve(STRUCTURE, PHASES)
    jc.raise_if_failed(solution)
    target, built = solution.tension, site(jnp.zeros(N))
    jc.raise_if_failed(built)
    matrix = jc.influence(STRUCTURE, PHASES)
    values = np.linalg.svd(np.asarray(matrix), compute_uv=False)
    say(
        f"\n{N} cables, {len(EDGE)} of them at the edge; targets "
        f"{float(target.min()) / 1e3:.1f} to {float(target.max()) / 1e3:.1f} kN"
    )
    say(f"influence matrix: singular values {values[0] / 1e6:.1f} to {values[-1] / 1e6:.4f} kN/mm")
    say(
        f"as built: errors of length up to {1e3 * np.abs(ERRORS).max():.1f} mm, tensions off by up "
        f"to {deviation(built.tension, target):.1f} %"
    )

    say(f"\n{'':44}{'step':>5}{'off by (%)':>12}{'largest turn (mm)':>19}")
    histories = {}

    def table(name, rows):
        histories[name] = [row[0] for row in rows]
        for step, (off, turned) in enumerate(rows):
            if step:
                largest = 1e3 * float(jnp.abs(turned).max())
                say(f"{name if step == 1 else '':44}{step:5d}{off:12.2g}{largest:19.3f}")

    every = retension(matrix, target, 4)
    table("all cables, matrix of the design", every)
    undone = 1e3 * np.abs(np.asarray(every[-1][1]) - ERRORS).max()

    found = design.fit(misfit, jnp.zeros(N), args=(built.tension,), steps=50)
    jc.raise_if_failed(found)
    after = site(1e-3 * found.params)
    jc.raise_if_failed(after)
    start = (deviation(built.tension, target), None)
    table(
        f"all cables, errors identified ({int(found.steps)} LM steps)",
        [start, (deviation(after.tension, target), 1e-3 * found.params)],
    )
    table("edge cables only", retension(matrix, target, 3, EDGE))
    say(f"\nthe last turns of all cables undo the errors of length to {undone:.1e} mm")

    say("\nwith errors of measurement of 1 % (new ones before each of 3 steps), all cables;")
    say("singular values below rcond times the largest one left out:")
    say(f"{'rcond':>10}{'kept':>6}{'off by (%)':>12}{'largest turn (mm)':>19}")
    for rcond in (1e-10, 1e-3, 1e-2, 1e-1):
        off, turned = retension(matrix, target, 3, error=0.01, rcond=rcond)[-1]
        kept = int((values > rcond * values[0]).sum())
        largest = 1e3 * float(jnp.abs(turned).max())
        say(f"{rcond:10.0e}{kept:6d}{off:12.2g}{largest:19.2f}")

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
    for name, offs in histories.items():
        left.semilogy(range(len(offs)), np.maximum(offs, 1e-13), "o-", label=name)
    left.axhline(0.1, color="0.4", linestyle=":", label="0.1 %")
    left.set(
        xlabel="retensioning step",
        ylabel="largest deviation of a tension (%)",
        title="Tensions against the design",
        xticks=range(5),
    )
    left.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)
    order = np.argsort(np.asarray(built.tension / target))
    for name, state, marker in (
        ("as built", built, "o"),
        ("one step, all cables", site(every[1][1]), "s"),
        ("edge cables only", site(retension(matrix, target, 3, EDGE)[-1][1]), "^"),
    ):
        percent = 100 * (np.asarray(state.tension / target) - 1)
        right.plot(range(N), percent[order], marker, markersize=4, label=name)
    right.set(
        xlabel="cable, in the order of its deviation as built",
        ylabel="tension less target (% of the target)",
        title="Every cable",
    )
    right.legend(fontsize=8)
    say.close(figure)


if __name__ == "__main__":
    main()
