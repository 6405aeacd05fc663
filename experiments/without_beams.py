"""Do beams, sections and laws given by points cost a scene that has none of them anything?

Question   Is the program of a scene of cables and linear bars the same as before beams came in, and
           does a net of 300 unknowns take the same time?
Reference  Revision ab1c109, the last one before laws given by points, fibre sections and beams,
           beside b95432b, the first one with all of them (sparse matrices came after it, and
           changed the programs).
Error      Programs are compared equation by equation as text: jaxprs of six analyses. Times are
           medians of alternating pairs of processes, with the range of their ratios.
Command    python experiments/without_beams.py   (writes experiments/results/without_beams.txt;
           needs the history of the repository)

The net: saddle of 10 x 10 free nodes, phases of 5 and 10 increments, Newton. One process imports
one revision, compiles, and reports the median of 15 warm calls.
"""

import contextlib
import hashlib
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from record import write

ROOT = Path(__file__).parent.parent
RESULT = Path(__file__).parent / "results" / "without_beams.txt"
BEFORE, AFTER = "ab1c109", "b95432b"
PAIRS = 7


def programs():
    """Names and texts of the programs of six analyses."""
    import re

    import jax
    import numpy as np

    import jaxcable as jc

    def text(function, structure):
        jaxpr = jax.make_jaxpr(function)(structure)
        return re.sub(r"0x[0-9a-f]+", "0x", str(jaxpr))  # addresses of functions

    net, phases = jc.scenes.flat_net()
    hypar, hypar_phases = jc.scenes.hypar_net()
    nodes = np.array([[0.0, 0, 0], [1, 0, 1], [2, 0, 0], [1, 1, 0]])
    group = jc.Bars([[0, 1], [1, 2], [1, 3]], area=1e-3, law=jc.Elastic(1e9), weight=2.0)
    bars = jc.Structure(nodes, group, jc.pinned([0, 2, 3]))
    load = jc.NodalLoads([1], (1.0, 0.0, -5.0))
    bar_phases = [
        jc.Phase(pretension=5.0, loads=jc.SelfWeight()),
        jc.Phase(loads=load, supports=jc.pinned([0, 2])),
    ]

    def deflection(s):
        return jc.solve(s, phases).displacement[3, 2]

    return {
        "flat net": text(lambda s: jc.solve(s, phases).displacement, net),
        "flat net, gradient": text(jax.grad(deflection), net),
        "flat net, incremental": text(
            lambda s: jc.solve(s, phases, jc.Incremental(1)).displacement, net
        ),
        "flat net, secant": text(
            lambda s: jc.solve(s, phases, jc.Incremental(0, "secant")).displacement, net
        ),
        "hypar net": text(lambda s: jc.solve(s, hypar_phases).tension, hypar),
        "bars": text(lambda s: jc.solve(s, bar_phases).displacement, bars),
    }


def seconds():
    """Median warm seconds of the net of 300 unknowns, and a deflection."""
    import time

    import jax

    import jaxcable as jc

    structure, phases = jc.scenes.saddle(10, 10, increments=(5, 10))
    solve = jax.jit(lambda s: jc.solve(s, phases))
    solution = jax.block_until_ready(solve(structure))
    jc.raise_if_failed(solution)
    runs = []
    for _ in range(15):
        begin = time.perf_counter()
        jax.block_until_ready(solve(structure))
        runs.append(time.perf_counter() - begin)
    return statistics.median(runs), float(solution.displacement[60, 2])


def child(task):
    """What a process of one revision does."""
    import jax

    import jaxcable

    assert Path(jaxcable.__file__).is_relative_to(os.environ["PYTHONPATH"])
    jax.config.update("jax_enable_x64", True)
    if task == "seconds":
        return seconds()
    return {
        name: [hashlib.sha256(text.encode()).hexdigest(), text.count(" = ")]
        for name, text in programs().items()
    }


def ask(folder, task):
    """Run `child` with the package in `folder`."""
    run = subprocess.run(
        [sys.executable, __file__, task],
        env={**os.environ, "PYTHONPATH": str(folder), "PYTHONSAFEPATH": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(run.stdout.splitlines()[-1])


@contextlib.contextmanager
def revision(name):
    """A checkout of an earlier revision in a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "before"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--detach", str(tree), name], check=True, capture_output=True)
        try:
            yield tree
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


def main():
    import jax

    with revision(BEFORE) as tree, revision(AFTER) as later:
        before, now = ask(tree, "programs"), ask(later, "programs")
        ask(later, "seconds")  # the first process warms the file cache
        pairs = []
        for k in range(PAIRS):
            order = (tree, later) if k % 2 == 0 else (later, tree)
            times = {folder: ask(folder, "seconds") for folder in order}
            pairs.append((*times[tree], *times[later]))
    lines = [
        f"{platform.machine()}, {os.cpu_count()} cores; Python {platform.python_version()}, "
        f"jax {jax.__version__}; before: {BEFORE}, now: {AFTER}",
        "",
        f"{'program':26}{'equations before':>18}{'now':>8}   text",
    ]
    for name, (digest, count) in before.items():
        same = "the same" if now[name][0] == digest else "DIFFERENT"
        lines.append(f"{name:26}{count:18d}{now[name][1]:8d}   {same}")
    ratios = sorted(b / a for a, _, b, _ in pairs)
    lines += [
        "",
        "saddle net, 300 unknowns, 5 + 10 increments, warm",
        f"before    median {1e3 * statistics.median(p[0] for p in pairs):.1f} ms",
        f"now       median {1e3 * statistics.median(p[2] for p in pairs):.1f} ms",
        f"ratio     median {statistics.median(ratios):.3f}, "
        f"range {ratios[0]:.3f} - {ratios[-1]:.3f} in {PAIRS} pairs",
        f"largest difference of a deflection {max(abs(p[1] - p[3]) for p in pairs):.1e} m",
    ]
    write(RESULT, "\n".join(lines) + "\n")
    print(RESULT.read_text(), end="")


if __name__ == "__main__":
    print(json.dumps(child(sys.argv[1]))) if len(sys.argv) > 1 else main()
