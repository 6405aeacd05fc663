"""What does an envelope over all results of 200 load cases cost, and is it that of single analyses?

Question   200 cases of a guyed mast, a suspension footbridge and a wheel (`jaxcable.scenes`): the
           loads of the last phase, each times a random factor. `design.solve_cases` and
           `design.envelope` beside a loop over `solve`, one case each: are all extremes of all
           results the same? Milliseconds a case, second calls.
Reference  The loop, and NumPy's minimum and maximum over its results.
Error      Largest difference of an extreme, over the largest value of all results of its unit.
Command    python experiments/envelopes.py
           (writes experiments/results/envelopes.txt; some minutes)
"""

import time

import jax
import numpy as np
from record import Record

import jaxcable as jc

COUNT = 200
SCENES = {
    "guyed mast": jc.scenes.guyed_mast,
    "footbridge": jc.scenes.suspension_footbridge,
    "wheel": jc.scenes.roof_ring,
}


def seconds(function):
    """Seconds of a call, and what it returns, computed."""
    begin = time.perf_counter()
    found = jax.block_until_ready(function())
    return time.perf_counter() - begin, found


def results(structure, solution):
    """Results of one case by the public calls, lists of arrays by name."""
    found = {
        "tension": solution.peak_tension,
        "displacement": solution.displacement,
        "reactions": solution.reactions,
    }
    if solution.reaction_moments is not None:
        found["rotation"] = jc.results.rotation_vectors(structure, solution)
        forces = jax.tree.leaves(jc.section_forces(structure, solution))
        for k, name in enumerate(("N", "Vy", "Vz", "T", "My", "Mz")):
            found[name] = [force[..., k] for force in forces]
    return {name: [np.asarray(x) for x in jax.tree.leaves(v)] for name, v in found.items()}


UNITS = {
    "displacement": "m",
    "rotation": "rad",
    **dict.fromkeys(("tension", "reactions", "N", "Vy", "Vz"), "N"),
    **dict.fromkeys(("T", "My", "Mz"), "N m"),
}


def largest_by_unit(cases):
    """Largest value of all results of a unit, by the unit."""
    found = {}
    for one in cases:
        for key, values in one.items():
            own = max(float(np.max(np.abs(value))) for value in values)
            found[UNITS[key]] = max(found.get(UNITS[key], 0.0), own)
    return found


def difference(envelope, key, values, size):
    """Largest difference of the extremes of a result from NumPy's, over `size`."""
    worst = 0.0
    sides = (jax.tree.leaves(side[key]) for side in (envelope.low, envelope.high))
    for own, low, high in zip(zip(*values, strict=True), *sides, strict=True):
        for extreme, expected in ((low, np.min(own, axis=0)), (high, np.max(own, axis=0))):
            worst = max(worst, float(np.max(np.abs(extreme - expected))) / size)
    return worst


def compare(record, name, scene):
    structure, phases = scene()
    *before, last = phases
    loads = last.loads if isinstance(last.loads, list | tuple) else [last.loads]
    factors = np.random.default_rng(0).uniform(0.2, 1.2, (COUNT, len(loads)))

    def case(k):
        return jc.replace(last, loads=jc.combine(loads, factors[k]))

    first = jc.solve(structure, before)
    jc.raise_if_failed(first)
    cases = [case(k) for k in range(COUNT)]

    def batch():
        return jc.design.solve_cases(structure, before, cases)

    def loop():
        return [jc.solve(structure, own, start=first) for own in cases]

    compiled, _ = seconds(batch)
    solving, solutions = seconds(batch)
    _, _ = seconds(lambda: jc.design.envelope(structure, solutions))
    taking, envelope = seconds(lambda: jc.design.envelope(structure, solutions))
    jc.solve(structure, cases[0], start=first)
    looping, each = seconds(loop)
    assert len(envelope.failed) == sum(int(one.status) != 0 for one in each)
    good = [results(structure, one) for one in each if int(one.status) == 0]
    sizes = largest_by_unit(good)
    worst = max(
        difference(envelope, key, [one[key] for one in good], sizes[UNITS[key]]) for key in good[0]
    )
    record(
        f"{name:<12}{3 * structure.n_node:>7}{len(envelope.failed):>8}{1e3 * solving / COUNT:>9.2f}"
        f"{1e3 * taking / COUNT:>10.2f}{1e3 * looping / COUNT:>9.2f}{compiled:>8.1f}{worst:>10.1e}"
    )
    return sorted(envelope.high)


def main():
    record = Record("envelopes")
    record(f"\n{COUNT} cases; ms a case: solve_cases, envelope, a loop over solve; first call, s\n")
    record("scene         coords  failed    cases  envelope     loop   first     error")
    found = {name: compare(record, name, scene) for name, scene in SCENES.items()}
    record("")
    for name, results_of in found.items():
        record(f"{name}: {', '.join(results_of)}")
    record.close()


if __name__ == "__main__":
    main()
