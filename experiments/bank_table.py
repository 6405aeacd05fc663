"""What the banks of random scenes share: a table with a row for every kind, and one for all."""

import numpy as np
from benchmarks.measure import clock

import jaxcable as jc

COLUMNS = "  {:>6}{:>6}{:>6}  {:>8}{:>9}"
HEADS = "median", "99%", "max", "factors", "ms"


def fill(say, form, kinds, drawn, judged, counts, converged):
    """Write the rows.

    Args:
        say: function that takes lines.
        form: of the kind and of what is counted, before `COLUMNS`.
        kinds: their names; the scenes of a kind share a program.
        drawn: function of a kind that gives its scenes, one after the other.
        judged: function of a scene and its solution: `steps` of all increments, `factorizations`.
        counts: what is counted of these, a list of functions.
        converged: whether its steps count, another one.
    """
    everything, time_of_all = [], 0.0
    for kind in kinds:
        results, seconds = [], 0.0
        for one in drawn(kind):
            if not results:  # the first call compiles
                clock(jc.solve, one.structure, one.phases)
            took, solution = clock(jc.solve, one.structure, one.phases)
            seconds += took
            results.append(judged(one, solution))
        say(_row(form, kind, results, seconds, counts, converged))
        everything, time_of_all = everything + results, time_of_all + seconds
    say(_row(form, "all", everything, time_of_all, counts, converged))


def _row(form, kind, results, seconds, counts, converged):
    steps = np.concatenate([one.steps for one in results if converged(one)])
    numbers = [sum(map(count, results)) for count in counts]
    return (form + COLUMNS).format(
        kind,
        len(results),
        *numbers,
        f"{np.median(steps):.0f}",
        f"{np.percentile(steps, 99):.0f}",
        steps.max(),
        f"{np.mean([one.factorizations for one in results]):.1f}",
        f"{1e3 * seconds / len(results):.2f}",
    )
