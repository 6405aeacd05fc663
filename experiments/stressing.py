"""In which order are stays stressed, with which forces, and how few are to be stressed again?

Question   The deck of a cable-stayed bridge lies on falsework, which carries compression only. Its
           pairs of stays are stressed one after the other, each once, so that they have the design
           forces after the falsework is removed: how large are the jacking forces and the moments
           of the deck in each of the 120 orders? Then a stay is stressed strand by strand: which
           jacking forces give all strands the same force in the end? And if the stays of the
           finished bridge are up to 20 mm too long or too short: how few of them must be stressed
           again until the deck is level within 3 mm?
Reference  The final state of every order is the same, as nothing is locked in. Strands: the force
           in the others after the last one, by another analysis. Stressing again: linear
           programming over all sets of stays finds no smaller set; the analysis itself checks the
           set that is found.
Error      m and N, as named.
Command    python experiments/stressing.py
           (writes experiments/results/stressing.txt and .png; some minutes)
"""

import itertools
import time

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import scenes
from record import Record
from scipy.optimize import linprog

import jaxcable as jc

N, M = 6, 5  # segments on either side, pairs of stays
BASE = M + 3  # number of the first node of the deck
LOOSE = 0.05  # by which stays are too long before they are stressed, m
DECK = np.s_[BASE : BASE + 2 * M, 2]  # heights of the deck at its stays
NOTHING = {"pylon": None, "deck": None}


def on_falsework():
    """Return the bridge on compression-only props, and the unstressed lengths of its stays."""
    bridge, phases = scenes.cable_stayed_bridge(N, stages=False)
    ends = np.arange(BASE, BASE + 2 * M)
    feet = np.array(bridge.nodes)[ends] - [0.0, 0.0, 20.0]
    pressing = jc.Polygonal([-0.01, 0.0, 0.01], [-21e8, 0.0, 21e2])  # next to nothing in tension
    first = bridge.n_node
    below = np.column_stack([first + np.arange(2 * M), ends])
    props = jc.Bars(below, area=2e-3, law=pressing)
    structure = jc.Structure(
        np.concatenate([bridge.nodes, feet]),
        {**bridge.elements, "props": props},
        supports=bridge.supports + jc.pinned(first + np.arange(2 * M)),
    )
    links = bridge.elements["stays"].links.array
    drawn = np.linalg.norm(np.diff(np.array(bridge.nodes)[links], axis=1)[:, 0], axis=1)
    lying = jc.Phase(
        rest_length={**NOTHING, "stays": drawn + LOOSE, "props": None}, loads=jc.SelfWeight()
    )
    planned = np.asarray(phases[0].pretension["stays"])
    shortened = LOOSE + planned / np.asarray(bridge.elements["stays"].axial_stiffness) * drawn
    return structure, lying, shortened, planned


def orders(record):
    structure, lying, start, planned = on_falsework()
    nothing = {**NOTHING, "props": None}
    begin = time.perf_counter()
    held = jc.design.Target("tension", planned, on="stays", within=10.0)
    pull, strike = jc.Phase(shortening={**nothing, "stays": start}), jc.Phase(removes="props")
    tuned = jc.design.tune(structure, [lying, pull, strike], [(1, "shortening")], held)
    assert int(tuned.status) == 0 and bool(tuned.met[0])
    whole = np.asarray(tuned.values[0]["stays"])
    record(
        f"\nstays shortened by {1e3 * whole.min():.0f} to {1e3 * whole.max():.0f} mm hold "
        f"{planned.min() / 1e3:.0f} to {planned.max() / 1e3:.0f} kN when the falsework is struck,\n"
        f"within {np.abs(tuned.deviation[0]).max():.1e} N; "
        f"found in {time.perf_counter() - begin:.0f} s"
    )

    def stressed(order):
        """Jack forces, largest moment of the deck at every stage, and the end, of one order."""
        pairs = jnp.repeat(jnp.arange(M), 2)
        pulls = [whole * (pairs == pair) for pair in order]
        stages = [jc.Phase(shortening={**nothing, "stays": pull}) for pull in pulls]
        solution = jc.solve(structure, [lying, *stages, strike])
        after = solution.phases[1:-1]
        jacks = jnp.stack(
            [p.tension["stays"][2 * pair + 1] for p, pair in zip(after, order, strict=True)]
        )
        moments = [jnp.abs(p.section_forces["deck"][..., 4]).max() for p in solution.phases[1:]]
        moments, slack = jnp.stack(moments), jnp.stack([p.path.n_slack[-1] for p in after])
        return jacks, moments, slack, solution.positions, solution.status

    every = np.array(list(itertools.permutations(range(M))))
    begin = time.perf_counter()
    run = jax.jit(lambda all_: jax.lax.map(stressed, all_)).lower(every).compile()
    first, begin = time.perf_counter() - begin, time.perf_counter()
    jacks, moments, slack, ends, codes = (np.asarray(x) for x in run(every))
    spent = time.perf_counter() - begin
    assert not codes.any()
    apart = np.abs(ends - ends[:1]).max()
    record(f"{len(every)} orders, one program: {first:.1f} s to compile, {spent:.1f} s to run;")
    record(f"they end within {apart:.1e} m of each other")
    most = moments.max(axis=1)
    best, worst = most.argmin(), most.argmax()
    outward, inward = (np.flatnonzero((every == o).all(axis=1))[0] for o in ORDERS)
    for name, k in (
        ("best", best),
        ("worst", worst),
        ("from the pylon outward", outward),
        ("from the ends inward", inward),
    ):
        record(
            f"{name}: pairs {', '.join(str(p + 1) for p in every[k])}; deck up to "
            f"{most[k] / 1e6:.2f} MN m on the way, {moments[k, -1] / 1e6:.2f} at last;\n  jacks, "
            f"kN: {', '.join(f'{f / 1e3:.0f}' for f in jacks[k])}; stays slack after each: "
            f"{', '.join(map(str, slack[k]))}"
        )
    return every, most, jacks.max(axis=1)


ORDERS = np.arange(M), np.arange(M)[::-1]


def strands(record, count=4):
    """Stress the longest stay on the right strand by strand, each strand once."""
    bridge, phases = scenes.cable_stayed_bridge(N, stages=False)
    stays = bridge.elements["stays"]
    others, last = np.arange(2 * M - 1), 2 * M - 1
    keep = jc.Cables(
        stays.links.array[others],
        axial_stiffness=np.asarray(stays.axial_stiffness)[others],
        weight=np.asarray(stays.weight)[others],
    )
    names = [f"strand {k + 1}" for k in range(count)]
    alone = {
        name: jc.Cables(
            stays.links.array[[last]],
            axial_stiffness=np.asarray(stays.axial_stiffness)[last] / count,
            weight=np.asarray(stays.weight)[last] / count,
        )
        for name in names
    }
    structure = jc.replace(bridge, elements={**bridge.elements, "stays": keep, **alone})
    planned = np.asarray(phases[0].pretension["stays"])
    idle = {**NOTHING, "stays": None, **dict.fromkeys(names)}
    wanted = planned[last] / count
    held = jc.Phase(
        jacking={**idle, "stays": planned[others]}, loads=jc.SelfWeight(), removes=names
    )
    stages = [jc.Phase(adds=name, jacking={**idle, name: wanted}) for name in names]
    targets = [jc.design.Target("tension", wanted, on=name, within=1.0) for name in names]
    unknowns = [(k + 1, "jacking") for k in range(count)]
    begin = time.perf_counter()
    tuned = jc.design.tune(structure, [held, *stages], unknowns, targets)
    assert int(tuned.status) == 0 and all(bool(met) for met in tuned.met)
    forces = [float(value[name]) for value, name in zip(tuned.values, names, strict=True)]
    ends = [float(tuned.solution.tension[name][0]) for name in names]
    record(
        f"\na stay of {count} strands, stressed one by one: jacks at "
        f"{', '.join(f'{f / 1e3:.2f}' for f in forces)} kN leave\n"
        f"{np.mean(ends) / 1e3:.2f} kN in each, within {np.ptp(ends):.1e} N; "
        f"found in {time.perf_counter() - begin:.0f} s"
    )
    same = jc.solve(structure, [held, *stages])
    assert int(same.status) == 0
    left = [float(same.tension[name][0]) / 1e3 for name in names]
    record(
        f"with {wanted / 1e3:.2f} kN at every jack they would hold "
        f"{', '.join(f'{f:.2f}' for f in left)} kN"
    )


def again(record, cases=200, slip=20e-3, within=3e-3):
    """Find the least number of stays to stress again, for bridges with random errors."""
    bridge, phases = scenes.cable_stayed_bridge(N, stages=False)
    planned = np.asarray(phases[0].pretension["stays"])

    def built(change):
        """Levels of the deck with stays shortened by so much, m."""
        stressed = jc.Phase(jacking={**NOTHING, "stays": planned}, loads=jc.SelfWeight())
        later = jc.replace(phases[1], shortening={**NOTHING, "stays": change})
        solution = jc.solve(bridge, [stressed, later])
        return solution.positions[DECK], solution.status

    begin = time.perf_counter()
    run, slopes = jax.jit(built), jax.jit(jax.jacfwd(lambda change: built(change)[0]))
    aim, code = run(jnp.zeros(2 * M))
    assert int(code) == 0
    matrix = np.asarray(slopes(jnp.zeros(2 * M)))
    first = time.perf_counter() - begin
    sets = [s for size in range(2 * M + 1) for s in itertools.combinations(range(2 * M), size)]
    errors = np.random.default_rng(6).uniform(-slip, slip, (cases, 2 * M))
    needed, reached, begin = [], [], time.perf_counter()
    for error in errors:
        off = np.asarray(run(jnp.asarray(error))[0] - aim)
        found = next(s for s in sets if _feasible(matrix, off, s, 0.98 * within) is not None)
        turn = np.zeros(2 * M)
        for _ in range(2):  # the second round mends what is not linear
            left = np.asarray(run(jnp.asarray(error + turn))[0] - aim)
            more = _feasible(matrix, left, found, 0.98 * within)
            turn[list(found)] += 0.0 if more is None else more
        ends, code = run(jnp.asarray(error + turn))
        assert int(code) == 0
        needed.append(len(found))
        reached.append(np.abs(np.asarray(ends - aim)).max())
    counts = np.bincount(needed, minlength=2 * M + 1)
    record(
        f"\n{cases} bridges with stays up to {1e3 * slip:.0f} mm too long or too short; stays to "
        f"stress again until the deck is\nlevel within {1e3 * within:.0f} mm, of {2 * M}: "
        + ", ".join(f"{k} in {n}" for k, n in enumerate(counts) if n)
    )
    record(
        f"checked by the analysis: all within {1e3 * max(reached):.2f} mm; compiled in {first:.0f} "
        f"s, {1e3 * (time.perf_counter() - begin) / cases:.0f} ms a bridge"
    )
    return counts


def _feasible(matrix, off, chosen, within):
    """Changes of the chosen stays that bring all levels within a bound, or None."""
    if not chosen:
        return np.zeros(0) if np.abs(off).max() <= within else None
    part = matrix[:, list(chosen)]
    # least squares first: where even they leave more than the bound on average, nothing helps
    rest = off - part @ np.linalg.lstsq(part, off, rcond=None)[0]
    if np.linalg.norm(rest) > within * np.sqrt(len(off)):
        return None
    if np.abs(rest).max() <= within:
        return np.linalg.lstsq(part, -off, rcond=None)[0]
    answer = linprog(
        np.zeros(len(chosen)),
        A_ub=np.concatenate([part, -part]),
        b_ub=np.concatenate([within - off, within + off]),
        bounds=(None, None),
    )
    return answer.x if answer.status == 0 else None


def draw(every, most, jacks, counts):
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), width_ratios=(3, 2))
    left.plot(jacks / 1e3, most / 1e6, "o", ms=4, color="C0", label="other orders")
    for order, mark, name in zip(ORDERS, "sD", ("outward", "inward"), strict=True):
        k = np.flatnonzero((every == order).all(axis=1))[0]
        left.plot(jacks[k] / 1e3, most[k] / 1e6, mark, ms=8, color="C1", label=name)
    left.set(xlabel="largest force of a jack, kN", ylabel="largest moment of the deck, MN m")
    left.set_title("120 orders of five pairs of stays")
    left.legend()
    left.grid(color="0.9")
    right.bar(np.arange(len(counts)), counts, color="C0")
    right.set(xlabel="stays to stress again", ylabel=f"bridges of {counts.sum()}")
    right.set_title("Stays up to 20 mm off; level within 3 mm")
    right.set_xticks(np.arange(len(counts)))
    figure.tight_layout()
    return figure


def main():
    record = Record("stressing")
    found = orders(record)
    strands(record)
    counts = again(record)
    record.close(draw(*found, counts))


if __name__ == "__main__":
    main()
