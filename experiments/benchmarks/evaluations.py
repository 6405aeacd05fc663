"""What is gained by evaluating programs with NumPy first, and what is lost?

Question   Seconds of first calls outside of `jax.jit`, by default, compiled, and compiled where
           jax's cache on disk has the programs of another process; with another version of jax,
           too, if the environment variable OTHER_JAX_PYTHON names an interpreter that has one; and
           of 1 to 1 000 calls by default, by NumPy and by XLA alone.
Reference  A bare analysis of a net of 48 unknowns in the same run (`bare.py`): its first call is
           the unit Y.
Error      None: `tests/programs` and `numpy_and_xla.py` compare the results.
Results    evaluation.txt and .json

Every measurement runs in a separate process, other nodes in each call, and the import does not
count. With two versions of jax each scene is measured by turns with both, and each version has its
own unit. Many calls by one way alone are the first ones and the median of the later ones.
"""

import json
import os
import statistics
import tempfile

import record

from .measure import HERE, apart, bare

KINDS = "plain", "after", "gradient"
OF_THE_FIRST = "hessian", "batch", "modes", "fit", "tune"
WIDTH = 20


def run(cases, _):
    say = record.Record("evaluation")
    rows = {}
    say("\nSeconds of first calls outside of jit (in Y, the first call of the bare analysis), and")
    say("programs that XLA compiles. plain: `solve`; after: the gradient after it; gradient:")
    say("without it; kept: where jax's cache on disk has the programs of another process\n")
    say(f"{'':32}{'Y, s':>6}" + "".join(f"{kind:>{WIDTH}}" for kind in KINDS))
    ways = [(scene, "auto", "") for scene in cases.evaluated]
    ways += [(scene, "xla", how) for scene in cases.compiled for how in (", compiled", ", kept")]
    for scene, way, how in ways:
        with tempfile.TemporaryDirectory() as folder:
            kept = folder if how == ", kept" else ""
            first_calls(say, rows, scene + how, scene, KINDS, way=way, kept=kept)
    for kind in OF_THE_FIRST if len(cases.evaluated) > 1 else OF_THE_FIRST[:1]:
        label = "footbridge, tune" if kind == "tune" else f"{cases.evaluated[0]}, {kind}"
        first_calls(say, rows, label, cases.evaluated[0], [kind], way="auto")
    if other := os.environ.get("OTHER_JAX_PYTHON"):
        of_other_version(say, rows, cases.evaluated, other)
    of_many_calls(say, rows, cases)
    say.close()
    record.write(record.RESULTS / "evaluation.json", json.dumps(rows, indent=1) + "\n")


def first_calls(say, rows, label, scene, kinds, *, kept="", interpreter=None, **options):
    """Measure first calls of a scene; say and note seconds by kind, the unit, programs."""
    # the other interpreter may have another copy of the package: this one is measured with both
    path = os.pathsep.join(filter(None, (str(record.ROOT), os.environ.get("PYTHONPATH"))))
    process = {"flags": {"PYTHONPATH": path}} | (
        {"interpreter": interpreter} if interpreter else {}
    )
    units, found = [bare(**process)], {}
    for kind in kinds:
        for _ in range(2 if kept else 1):  # the first process keeps its programs
            found[kind] = calls(scene, kind, 1, process, kept=kept, **options)
    unit = statistics.mean([*units, bare(**process)])
    cells = [
        f"{own['s'][0]:9.2f} ({own['s'][0] / unit:5.2f}){own['compiled']:3d}".rjust(WIDTH)
        for own in found.values()
    ]
    say(f"{label:32}{unit:6.2f}" + "".join(cells))
    rows[label] = {"unit": unit} | {kind: own["s"][0] for kind, own in found.items()}
    return next(iter(found.values()))["jax"]


def of_other_version(say, rows, scenes, interpreter):
    """Say and note first calls with another version of jax."""
    say("\nWith another version of jax, in its own Y\n")
    for scene in scenes:
        label = f"{scene}, other jax"
        version = first_calls(
            say, rows, label, scene, KINDS[:2], way="auto", interpreter=interpreter
        )
        ratios = [rows[label][kind] / rows[scene][kind] for kind in KINDS[:2]]
        say(f"{'':32}over the first version, seconds: {ratios[0]:.2f} {ratios[1]:.2f}")
    say(f"that version is {version}")


def of_many_calls(say, rows, cases):
    """Say and note seconds of 1, 3, ... calls by default beside NumPy and XLA alone."""
    say("\nSeconds of so many calls: by default / NumPy alone / XLA alone; over the better one\n")
    say(f"{'':18}" + "".join(f"{count:>26}" for count in cases.evaluated_calls))
    for scene, kind in cases.called:
        alone = {way: calls(scene, kind, 6, {}, way=way)["s"] for way in ("numpy", "xla")}
        default = calls(scene, kind, cases.evaluated_calls[-1], {}, way="auto")["s"]
        cells = []
        for count in cases.evaluated_calls:
            own = [sum(default[:count])] + [total(alone[way], count) for way in ("numpy", "xla")]
            ratio = own[0] / min(own[1:])
            cells.append(f"{own[0]:8.1f}/{own[1]:6.1f}/{own[2]:5.1f} {ratio:4.2f}")
        say(f"{scene + ' ' + kind:18}" + "".join(cells))
        rows[f"calls of {scene} {kind}"] = {**alone, "auto": default}


def total(times, count):
    """Seconds of `count` calls, of which the first ones are known."""
    return sum(times[:count]) + max(count - len(times), 0) * statistics.median(times[2:])


def calls(scene, kind, count, process, **case):
    """Answer of `one_evaluation.py`; SystemExit if it has none."""
    case |= {"scene": scene, "kind": kind, "calls": count}
    answer = apart(HERE / "one_evaluation.py", case, **process)
    if "error" in answer:
        raise SystemExit(f"{case}: {answer['error']}")
    return answer
