"""What is gained by evaluating programs with NumPy first, and what is lost?

Question   Seconds of first calls outside of `jax.jit`, by default and, for some, compiled; and of
           1 to 100 calls by default, by NumPy and by XLA alone.
Reference  A bare analysis of a net of 48 unknowns in the same run (`bare.py`): its first call is
           the unit Y.
Error      None: `tests/programs` compares the results.
Results    evaluation.txt and .json

Every measurement runs in a separate process, other nodes in each call, and the import does not
count. Many calls by one way alone are the first ones and the median of the later ones.
"""

import json
import statistics

import record

from .measure import HERE, apart, bare

KINDS = "plain", "after", "hessian", "batch"


def run(cases, _):
    say = record.Record("evaluation")
    say("\nFirst calls outside of jit, s (in Y, the first call of the bare analysis), and programs")
    say("that XLA compiles; the last rows: where everything is compiled\n")
    say(f"{'':28}{'Y, s':>6}" + "".join(f"{kind:>22}" for kind in KINDS))
    rows = {}
    ways = [(scene, "auto") for scene in cases.evaluated]
    ways += [(scene, "xla") for scene in cases.compiled]
    for scene, way in ways:
        unit, found = [bare()], {}
        for kind in KINDS if scene in cases.evaluated[:1] else KINDS[:2]:
            found[kind] = calls(scene, kind, way, 1)
        unit = statistics.mean([*unit, bare()])
        cells = [
            f"{own['s'][0]:9.2f} ({own['s'][0] / unit:5.2f}) {own['compiled']:4d}"
            for own in found.values()
        ]
        label = scene if way == "auto" else f"{scene}, compiled"
        say(f"{label:28}{unit:6.2f}" + "".join(cells))
        rows[label] = {"unit": unit} | {kind: own["s"][0] for kind, own in found.items()}
    say("\nSeconds of so many calls: by default / NumPy alone / XLA alone; over the better one\n")
    say(f"{'':28}" + "".join(f"{count:>27}" for count in cases.evaluated_calls))
    for scene, kind in cases.called:
        most = cases.evaluated_calls[-1]
        alone = {way: calls(scene, kind, way, 6)["s"] for way in ("numpy", "xla")}
        default = calls(scene, kind, "auto", most)["s"]
        cells = []
        for count in cases.evaluated_calls:
            own = [sum(default[:count])] + [total(alone[way], count) for way in ("numpy", "xla")]
            ratio = own[0] / min(own[1:])
            cells.append(f"{own[0]:9.1f}/{own[1]:6.1f}/{own[2]:5.1f} {ratio:4.2f}")
        say(f"{scene + ' ' + kind:28}" + "".join(cells))
        rows[f"calls of {scene} {kind}"] = {**alone, "auto": default}
    say.close()
    record.write(record.RESULTS / "evaluation.json", json.dumps(rows, indent=1) + "\n")


def total(times, count):
    """Seconds of `count` calls, of which the first ones are known."""
    return sum(times[:count]) + max(count - len(times), 0) * statistics.median(times[2:])


def calls(scene, kind, way, count):
    """Answer of `one_evaluation.py`; SystemExit if it has none."""
    case = {"scene": scene, "kind": kind, "way": way, "calls": count}
    answer = apart(HERE / "one_evaluation.py", case)
    if "error" in answer:
        raise SystemExit(f"{case}: {answer['error']}")
    return answer
