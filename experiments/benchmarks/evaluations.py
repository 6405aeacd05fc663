"""What is gained by evaluating programs with NumPy first, and what is lost?

Question   Seconds of first calls outside of `jax.jit`, by default and where everything is compiled;
           seconds of 1, 3, 10, 100 and 1 000 calls by default, by NumPy and by XLA alone.
Reference  A bare analysis of a net of 48 unknowns in the same run (`bare.py`): its first call is
           the unit Y.
Error      None: `tests/evaluation` compares the results.
Results    evaluation.txt and .json

Every measurement runs in a separate process, other nodes in each call, and the import does not
count. Many calls by one way alone are the first ones and the median of the later ones.
"""

import json
import statistics

import record

from .measure import HERE, apart, bare

KINDS = "plain", "after", "gradient", "hessian", "batch"


def run(cases, _):
    say = record.Record("evaluation")
    say("\nFirst calls outside of jit in Y, the first call of the bare analysis: by default, and")
    say("where everything is compiled (in parentheses); programs that XLA compiles by default\n")
    say(f"{'':20}{'Y, s':>6}" + "".join(f"{kind:>22}" for kind in KINDS))
    rows = {}
    for scene in cases.evaluated:
        units, cells, rows[scene] = [bare()], [], {}
        for kind in KINDS if scene in cases.evaluated_in_all_kinds else KINDS[:3]:
            ours, theirs = (calls(scene, kind, way, 1) for way in ("auto", "xla"))
            units.append(bare())
            rows[scene][kind] = ours, theirs
        unit = rows[scene]["unit"] = statistics.mean(units)
        for ours, theirs in (rows[scene][kind] for kind in KINDS if kind in rows[scene]):
            own = f"{ours['s'][0] / unit:.2f} ({theirs['s'][0] / unit:.1f})"
            cells.append(f"{own:>17} {ours['compiled']:4d}")
        say(f"{scene:20}{unit:6.2f}" + "".join(cells))
    say("\nSeconds of so many calls: by default / NumPy alone / XLA alone; over the better one\n")
    say(f"{'':28}" + "".join(f"{count:>27}" for count in cases.evaluated_calls))
    for scene, kind in (("flat_net", "plain"), ("guyed_mast", "plain"), ("flat_net", "batch")):
        most = cases.evaluated_calls[-1]
        alone = {way: calls(scene, kind, way, 12)["s"] for way in ("numpy", "xla")}
        default = calls(scene, kind, "auto", most)["s"]
        cells = []
        for count in cases.evaluated_calls:
            own = [sum(default[:count])] + [total(alone[way], count) for way in ("numpy", "xla")]
            ratio = own[0] / min(own[1:])
            cells.append(f"{own[0]:9.1f}/{own[1]:6.1f}/{own[2]:5.1f} {ratio:4.2f}")
        say(f"{scene + ' ' + kind:28}" + "".join(cells))
        rows[f"{scene} {kind}"] = {**alone, "auto": default}
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
