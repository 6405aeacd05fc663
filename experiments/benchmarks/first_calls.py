"""How long does the first call of an analysis take, and how much memory do its programs need?

Question   first_call: seconds to trace, to lower and to compile, and lines of StableHLO, of the
           analysis of ready scenes, by itself and as value with gradient, and with the number of
           phases; and first calls with another version of jax, if the environment variable
           OTHER_JAX_PYTHON names an interpreter that has one. kept_programs: memory of a process
           that analyses 500 nets of different shape.
Reference  A bare analysis of a net of 48 unknowns in the same run (`bare.py`): its first call is
           the unit Y.
Error      None: the results are those of the tests. Lines do not depend on the machine.
Results    first_call.txt and .json; kept_programs_many.txt

Every first call runs in a separate process, and the import does not count. The unit is the mean of
measurements before and after each scene, since the speed of the machine varies. "plain" is a
call of `solve` as it is, with all its results; "jitted" the sum of the squares of the displacements
inside `jax.jit`, as a function of the nodes; "gradient" its value and gradient; "after" these
outside of `jax.jit`, where the plain analysis has been called before. Run: median of 15 further
calls, other nodes in each. "fused": after `jaxcable.fuse_loops`. With two versions of jax each
scene is measured by turns with both, and each version has its own unit.
"""

import gc
import json
import os
import re
import statistics
from pathlib import Path

import record

from .measure import analysis, bare

KINDS = "plain", "jitted", "gradient", "after"


OTHER_KINDS = "plain", "after"
"""Kinds that are measured with the other version of jax, too."""


def first_call(cases, _):
    say = record.Record("first_call")
    say("\nY: first call of the bare analysis. plain, jitted, gradient, after: first calls in Y.")
    say("Then of jitted | gradient: seconds to trace, lower, compile; StableHLO lines; a run, ms.")
    say("g/j: gradient over jitted; a/p: after over plain, two programs that share the analysis\n")
    head = f"{'':22}{'Y, s':>6}{'plain':>7}{'jitted':>8}{'gradient':>9}{'after':>7}"
    say(f"{head}   g/j   a/p")
    rows = {}
    for label, scene in cases.first_calls.items():
        found = rows[label] = first_calls_of(scene)
        firsts = [found[kind]["first"] / found["unit"] for kind in KINDS]
        text = "  ".join(
            " ".join(f"{s:.1f}" for s in found[kind]["stages"])
            + f" s{found[kind]['lines']:7d}{found[kind]['run']:8.2f}"
            for kind in KINDS[1:3]
        )
        say(
            f"{label:22}{found['unit']:6.2f}{firsts[0]:7.2f}{firsts[1]:8.2f}{firsts[2]:9.2f}"
            f"{firsts[3]:7.2f}{firsts[2] / firsts[1]:6.2f}{firsts[3] / firsts[0]:6.2f}   {text}"
        )
    say_versions(say, rows)
    say.close()
    record.write(record.RESULTS / "first_call.json", json.dumps(rows, indent=1) + "\n")


def first_calls_of(scene):
    """First and further calls of a scene by kind, and the unit; "other": those of another jax."""
    interpreter = os.environ.get("OTHER_JAX_PYTHON")
    # the other interpreter may have another copy of the package: this one is measured with both
    path = os.pathsep.join(filter(None, (str(record.ROOT), os.environ.get("PYTHONPATH"))))
    ways = [({"flags": {"PYTHONPATH": path}}, KINDS)]
    if interpreter:
        ways.append((ways[0][0] | {"interpreter": interpreter}, OTHER_KINDS))
    rows = [{"units": [bare(**options)]} for options, _ in ways]
    for kind in KINDS:
        for row, (options, kinds) in zip(rows, ways, strict=True):
            if kind not in kinds:
                continue
            own = analysis({"scene": scene, "kinds": [kind], "repeats": 15}, **options)
            first, run = own[kind].pop("first_s"), statistics.median(own[kind].pop("ms"))
            row[kind] = {"first": first, "run": run, "status": own["status"], **own[kind]}
            row["units"].append(bare(**options))
            row["jax"] = own["jax"]
    for row in rows:
        row["unit"] = statistics.mean(row.pop("units"))
    return rows[0] | ({"other": rows[1]} if interpreter else {})


def say_versions(say, rows):
    """Write the table of first calls with two versions of jax, if there are two."""
    pairs = {label: (row, row["other"]) for label, row in rows.items() if "other" in row}
    if not pairs:
        return
    first, second = (row["jax"] for row in next(iter(pairs.values())))
    say(f"\n=== jax {first} | jax {second}\n")
    say("Seconds (in Y of that version): plain; after, the gradient after it. Then the second")
    say("version over the first one, of seconds: plain, after\n")
    head = f"{'Y, s':>6}{'plain':>16}{'after':>16}"
    say(f"{'':22}{head} |{head} |{'plain':>6}{'after':>7}")
    for label, pair in pairs.items():
        cells = [
            f"{row['unit']:6.2f}"
            + "".join(
                f"{row[kind]['first']:8.2f} ({row[kind]['first'] / row['unit']:5.2f})"
                for kind in OTHER_KINDS
            )
            for row in pair
        ]
        over = [pair[1][kind]["first"] / pair[0][kind]["first"] for kind in OTHER_KINDS]
        say(f"{label:22}{cells[0]} |{cells[1]} |{over[0]:6.2f}{over[1]:7.2f}")


def resident():
    """Memory of this process, MB, and number of its memory maps."""
    size = re.search(
        r"VmRSS:\s+(\d+)", Path("/proc/self/status").read_text(encoding="utf-8")
    ).group(1)
    return int(size) / 1e3, len(Path("/proc/self/maps").read_text(encoding="utf-8").splitlines())


def kept_programs(cases, _):
    import jax

    import jaxcable as jc
    from jaxcable.programs.known import MOST_PROGRAMS

    jax.config.update("jax_enable_x64", True)
    say = record.Record("kept_programs_many")
    say(
        f"\n{cases.nets} nets of different shape, each analysed once by jc.solve; "
        f"{MOST_PROGRAMS} programs"
    )
    say("are known at a time. Memory of the process, and its memory maps (65 530 are allowed)\n")
    say(f"{'nets':>6}{'MB':>8}{'maps':>8}")
    for k in range(cases.nets + 1):
        if k:
            net = jc.scenes.saddle(3 + (k - 1) % 25, 3 + (k - 1) // 25, load=100.0)
            assert int(jc.solve(*net).status) == 0
        if k in (0, 1, 10, MOST_PROGRAMS) or k % 100 == 0:
            say("{:6}{:8.0f}{:8}".format(k, *resident()))
    jc.forget_programs()
    gc.collect()
    say("\nafter jc.forget_programs(): {:.0f} MB, {} maps".format(*resident()))
    say.close()
