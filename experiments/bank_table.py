"""The table of a bank of random scenes: a row for every kind of scene, and one for all of them."""

import numpy as np
from benchmarks.measure import clock

import jaxcable as jc

COLUMNS = "  {:>6}{:>6}{:>6}  {:>8}{:>9}"
HEADS = "median", "99%", "max", "factors", "ms"


def fill(say, form, kinds, drawn, judged, counts, converged):
    """Analyse all scenes and write the rows of the table.

    Args:
        say: function that writes a line.
        form: format of the first columns (kind and counts), before `COLUMNS`.
        kinds: names of the kinds; the scenes of a kind share a program.
        drawn: function of a kind that generates its scenes.
        judged: function of a scene and its solution that returns a record, with the `steps` of all
            increments and `factorizations`.
        counts: functions of such a record that say whether it counts in a column, a list.
        converged: function of such a record that says whether its steps count.
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
