"""The table of a bank of random scenes: a row for every kind of scene, and one for all of them."""

import sys

import numpy as np
from benchmarks.measure import clock
from record import Record

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
            with jc.evaluation("xla"):  # the first call compiles
                if not results:
                    clock(jc.solve, one.structure, one.phases)
                took, solution = clock(jc.solve, one.structure, one.phases)
            seconds += took
            results.append(judged(one, solution))
        say(_row(form, kind, results, seconds, counts, converged))
        everything, time_of_all = everything + results, time_of_all + seconds
    say(_row(form, "all", everything, time_of_all, counts, converged))


def report_bank(name, kinds, drawn, judged):
    """Write the table of a bank whose scenes have failed, or are wrong; return the open `Record`.

    Args:
        name: of the result file.
        kinds, judged: as of `fill`.
        drawn: function of a kind and a seed that generates a scene; the command line has the number
            of scenes of a kind and the first seed.
    """
    count, first = (int(word) for word in (sys.argv[1:] + ["200", "0"][len(sys.argv) - 1 :]))
    say, form = Record(name), "{:<9}{:>7}{:>7}{:>6}"
    say(f"{count} scenes of a kind, seeds from {first}\n")
    say((form + COLUMNS).format("kind", "scenes", "failed", "wrong", *HEADS))

    def converged(one):
        return one.code == jc.status.OK

    counts = [lambda one: not converged(one), lambda one: one.wrong]
    seeds = range(first, first + count)
    fill(say, form, kinds, lambda kind: (drawn(kind, k) for k in seeds), judged, counts, converged)
    say(
        "\nSteps are of an increment; factorisations (factors) and ms (time without compilation) of"
    )
    say("an analysis, means of the kind.")
    return say


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
