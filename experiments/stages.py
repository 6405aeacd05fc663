"""Which jacking forces make a cable-stayed bridge level that is erected in stages?

Question   A bridge erected by free cantilevering (`scenes.cable_stayed_bridge`): does the search
           for jacking forces at which the paved deck is level succeed from 20 random guesses? Does
           dismantling lead back through the same states? Are derivatives through all stages exact?
           What is the effect of errors of 5 mm in the lengths of stays (1 000 samples)? How long do
           40 stages take beside 2? What happens when a stay is lost?
Reference  Dismantling: the paved bridge, stressed at once with the unstressed lengths of the
           erection, taken down in the reverse order. Differences of fourth order. OpenSees with
           `remove`.
Error      m and N, as named.
Command    OPENSEES_PYTHON=... python experiments/stages.py
           (writes experiments/results/stages.txt and .png; some minutes)
"""

import json
import sys
import time

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import scenes
from benchmarks.measure import apart, extent, opensees, timed
from record import Record

import jaxcable as jc

N = 6  # segments on either side
M = N - 1  # stays
BASE = M + 3  # number of the first node of the deck
STRUCTURE, PHASES = scenes.cable_stayed_bridge(N)
LEVEL = jc.design.Target("positions", 0.0, at=np.s_[BASE : BASE + 2 * M, 2], within=1e-4)
PLANNED = np.array([float(PHASES[k].jacking["stays"].values) for k in range(M)])  # N


def staged(forces):
    """The phases with these forces of the jacks, [M, 2], N."""
    found = list(PHASES)
    for k in range(M):
        jacks = {**PHASES[k].jacking, "stays": jc.only([2 * k, 2 * k + 1], forces[k])}
        found[k] = jc.replace(PHASES[k], jacking=jacks)
    return found


def tuned(forces):
    """Tune the forces by `design.tune`, from these as a start; returns arrays, for vmap."""
    found = jc.design.tune(
        STRUCTURE, staged(forces), [(k, "jacking") for k in range(M)], LEVEL, bounds=(1e3, None)
    )
    values = jnp.stack([value["stays"].values for value in found.values])
    return values, found.deviation[0], found.status, found.steps


def guesses(record):
    begin = time.perf_counter()
    factors = np.random.default_rng(2).uniform(0.3, 2.0, (20, M, 2))
    run = jax.jit(tuned)
    found = [run(start) for start in factors * PLANNED[:, None]]
    forces, deviation, codes, steps = (np.stack(parts) for parts in zip(*found, strict=True))
    assert not codes.any()
    record(f"\nfrom 20 random guesses, 0.3 to 2 times the planned forces: {len(codes)} converge,")
    apart = np.abs(deviation).max()
    record(f"in {steps.min()} to {steps.max()} steps; deck level within {apart:.1e} m")
    record(f"forces found differ by {np.ptp(forces, axis=0).max():.1e} N among them")
    record(f"of the jacks, kN: {', '.join(f'{f:.1f}' for f in forces[0, :, 1] / 1e3)}")
    record(f"{time.perf_counter() - begin:.0f} s, compilation included")
    return forces[0]


def backward(record, forces):
    """Analyse the dismantling of the paved bridge, with the unstressed lengths of the erection."""
    erected = jc.solve(STRUCTURE, staged(forces), jc.Newton(tol=1e-13))
    assert int(erected.status) == 0
    rest = erected.rest_length
    # the deck was joined with kinks: as drawn it would be another bridge. So take down what stands
    down = [jc.Phase(loads=jc.NodalLoads(p.loads.nodes, -p.loads.forces)) for p in PHASES[-1:]]
    last = PHASES[M]
    down.append(jc.Phase(removes=last.adds, supports=STRUCTURE.supports))
    for k in reversed(range(1, M)):
        down.append(jc.Phase(removes=PHASES[k].adds))
    solution = jc.solve(STRUCTURE, down, jc.Newton(tol=1e-13), start=erected)
    assert int(solution.status) == 0
    worst = force = 0.0
    for j, phase in enumerate(solution.phases):
        k = M - j  # the same state on the way up
        there = np.asarray(erected.phases[k].positions[BASE : BASE + 2 * min(k + 1, N)])
        found = np.asarray(phase.positions[BASE : BASE + 2 * min(k + 1, N)])
        worst = max(worst, np.abs(found - there).max())
        pair = np.asarray(phase.tension["stays"]) - np.asarray(erected.phases[k].tension["stays"])
        force = max(force, np.abs(pair).max())
    record("\ntaken down again, stage by stage: every stage is that of the erection within")
    record(f"{worst:.1e} m and {force:.1e} N, of {float(np.max(erected.tension['stays'])):.0f} N")
    return erected, rest


def derivatives(record, forces):
    def level(forces):
        solution = jc.solve(STRUCTURE, staged(forces), jc.Newton(tol=1e-13))
        return solution.positions[BASE + 1 : BASE + 2 * M : 2, 2], solution.status

    forces = jnp.asarray(forces)
    exact = jax.jit(jax.jacfwd(lambda f: level(f)[0]))(forces)
    run, worst = jax.jit(level), 0.0
    for k in range(M):
        for side in (0, 1):
            step = jnp.zeros_like(forces).at[k, side].set(2e3)
            values = {s: run(forces + s * step) for s in (-2, -1, 1, 2)}
            assert not any(int(code) for _, code in values.values())
            f = {s: value for s, (value, _) in values.items()}
            slope = (8 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12 * 2e3)
            worst = max(worst, float(jnp.abs(slope - exact[:, k, side]).max()))
    size = float(jnp.abs(exact).max())
    record(f"\nderivatives of the level by the force of every jack: up to {1e3 * size:.2e} mm/N;")
    record(f"differences of fourth order differ by {worst / size:.1e} of that")


def tolerances(record, forces):
    """Analyse 1 000 bridges whose stays are up to 5 mm too long or too short, uncorrected."""
    errors = np.random.default_rng(3).uniform(-5e-3, 5e-3, (1000, M, 2))
    phases = staged(forces)

    def built(error):
        found = list(phases)
        for k in range(M):  # after the jack is anchored
            pair = jc.only([2 * k, 2 * k + 1], error[k])
            nothing = {"pylon": None, "deck": None}
            found[k + 1] = jc.replace(found[k + 1], shortening={**nothing, "stays": pair})
        solution = jc.solve(STRUCTURE, found)
        return solution.positions[BASE + 1 : BASE + 2 * M : 2, 2], solution.status

    run = jax.jit(lambda all_: jax.lax.map(built, all_))  # one by one: frames gain nothing by vmap
    begin = time.perf_counter()
    run = run.lower(errors).compile()
    first = time.perf_counter() - begin
    begin = time.perf_counter()
    levels, codes = jax.block_until_ready(run(errors))
    spent = time.perf_counter() - begin
    assert not codes.any()
    worst = np.abs(np.asarray(levels)).max(axis=1)
    record("\n1 000 bridges with stays of -5 to 5 mm: largest deviation of the deck from level,")
    most = 1e3 * np.quantile(worst, 0.95)
    record(f"median {1e3 * np.median(worst):.1f} mm, 95 of 100 below {most:.1f} mm")
    record(f"one program, compiled in {first:.1f} s; 1 000 in {spent:.1f} s, {spent:.1f} ms each")
    return worst


def costs(record):
    """Measure first calls of a cantilever in 2 and in 40 stages, each in a separate process."""
    record("\na cantilever built segment by segment, first call with compilation")
    for n in (2, 10, 40):
        first, again, lines = apart(__file__, n, "--cantilever")
        record(f"{n:4} stages  {first:6.2f} s  {lines} lines of StableHLO; again {again:.1f} ms")


def cantilever(n):
    section = jc.Section.rectangle(0.1, 0.3, jc.Elastic(200e9))
    nodes = np.linspace([0, 0, 0], [40.0, 0, 0], 41)  # of the same size whatever its stages
    beam = jc.Beams([[k, k + 1] for k in range(40)], section=section, weight=50.0)
    structure = jc.Structure(nodes, beam, supports=jc.clamped([0]))
    parts = np.array_split(np.arange(40), n)
    stages = [
        jc.Phase(adds=jc.only(part), placed="attached", loads=jc.SelfWeight() if k == 0 else None)
        for k, part in enumerate(parts)
    ]

    def tip(nodes):
        solution = jc.solve(jc.replace(structure, nodes=nodes), stages)
        return solution.displacement[-1, 2], solution.status

    begin = time.perf_counter()
    jitted = jax.jit(tip)
    lines = jitted.lower(nodes).as_text().count("\n")
    (_, code), _, warm = timed(jitted, nodes, calls=9)
    assert int(code) == 0
    print(json.dumps([time.perf_counter() - begin - sum(warm), 1e3 * np.median(warm), lines]))


def lost(record):
    """Compare the loss of a stay of the finished bridge with OpenSees."""
    structure, _ = scenes.cable_stayed_bridge(N, stages=False)
    groups = {name: jc.replace(group, weight=None) for name, group in structure.elements.items()}
    structure = jc.replace(structure, elements=groups)
    forces = np.zeros((structure.n_node, 3))
    forces[BASE : BASE + 2 * M, 2] = -300e3
    loads = jc.NodalLoads(np.arange(structure.n_node), forces)
    stressed = {"pylon": None, "deck": None, "stays": np.repeat(PLANNED, 2)}
    removed = 2 * M - 1
    gone = {"pylon": None, "deck": None, "stays": jc.only([removed])}
    phases = [jc.Phase(pretension=stressed, loads=loads), jc.Phase(removes=gone)]
    method = jc.Newton(tol=1e-12)
    solution = jc.solve(structure, phases, method)
    assert int(solution.status) == 0

    def loaded(forces):
        load = jc.replace(loads, forces=forces)
        return jc.solve(structure, [jc.replace(phases[0], loads=load), phases[1]], method)

    times = timed(jax.jit(lambda f: loaded(f).displacement), forces, calls=15)[2]
    beams = []
    for name in ("pylon", "deck"):
        group = groups[name]
        stiffness = np.asarray(group.section.stiffness())
        axes = np.asarray(group.element_axes(structure.nodes))
        torsion = float(np.asarray(group.torsional_stiffness)[0])
        for (i, j), axis in zip(group.links.array.tolist(), axes, strict=True):
            numbers = [1.0, stiffness[0, 0], 1.0, torsion, stiffness[1, 1], stiffness[2, 2]]
            beams.append([i, j, *numbers, *axis[2].tolist()])
    stays = groups["stays"]
    strain = np.repeat(PLANNED, 2) / np.asarray(stays.axial_stiffness)
    case = {
        "nodes": np.asarray(structure.nodes).tolist(),
        "clamped": [0],
        "guided": [BASE + 2 * M, BASE + 2 * M + 1],
        "beams": beams,
        "stays": [
            # OpenSees has strains of the initial chord, and its stiffness is per that
            [i, j, float(ea) * (1 + e), e / (1 + e)]
            for (i, j), ea, e in zip(
                stays.links.array.tolist(), np.asarray(stays.axial_stiffness), strain, strict=True
            )
        ],
        "loads": forces.tolist(),
        "removed": removed,
        "steps": 5,
        "repeats": 15,
    }
    answer = opensees("opensees_removed.py", case)
    if "error" in answer:
        record(f"\nOpenSees: no answer ({answer['error']})")
        return
    assert answer["ok"]
    record(f"\nthe last stay on the right is lost; beside OpenSees {answer['version']}")
    for name, phase in zip(("before", "after"), solution.phases, strict=True):
        places, tensions = (np.array(part) for part in answer[name])
        moved = np.asarray(phase.positions) - structure.nodes
        own = np.asarray(phase.tension["stays"])
        apart, force = np.abs(moved - places).max(), np.abs(own - tensions).max()
        record(
            f"{name:7} deflection {1e3 * np.abs(moved).max():8.2f} mm, differs by "
            f"{1e3 * apart:.4f} mm; stays up to {own.max():.0f} N, differ by {force:.1f} N"
        )
    spread = f"{extent(1e3 * np.array(times)).replace(' (', ' ms (')}"
    peer = f"{1e3 * answer['analyze_s']:.2f} ms and {1e3 * answer['build_s']:.2f} ms to build"
    record(f"both analyses: {spread}, OpenSees {peer}")


def draw(erected, worst):
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), width_ratios=(3, 1))
    for k, phase in enumerate(erected.phases):
        z = 1e3 * np.asarray(phase.positions)[BASE + 1 :: 2, 2]
        x = np.asarray(phase.positions)[BASE + 1 :: 2, 0]
        there = slice(0, min(k + 1, N))
        name = f"segment {k + 1}" if k < N else "paved"
        left.plot(np.append(0, x[there]), np.append(0, z[there]), "o-", ms=3, label=name)
    left.set(xlabel="from the pylon, m", ylabel="level of the deck, mm")
    left.set_title("Erected with the forces found: level at the end")
    left.legend(fontsize=8)
    right.hist(1e3 * worst, bins=30, color="C0")
    right.set(xlabel="largest deviation, mm", ylabel="bridges of 1 000")
    right.set_title("Stays up to 5 mm off")
    figure.tight_layout()
    return figure


def main():
    record = Record("stages")
    forces = guesses(record)
    erected, _ = backward(record, forces)
    derivatives(record, forces)
    worst = tolerances(record, forces)
    costs(record)
    lost(record)
    record.close(draw(erected, worst))


if __name__ == "__main__":
    cantilever(int(sys.stdin.readline())) if "--cantilever" in sys.argv else main()
