"""Does an analysis of another size find the program of an earlier one?

Question   similar_sizes: seconds of first calls of `solve`, one structure after the other, in one
           process: ten nets of 60 to 69 cables, six meshes of a saddle, 1 to 40 increments of a
           flat net. Then those of a new process with structures that it has never seen, after
           `jaxcable warm`. And how much longer runs are than with `exact_sizes=True`.
Reference  The first call of each list compiles.
Error      None: `tests/analysis/test_common_sizes.py` compares all results.
Results    similar_sizes.txt

Programs: how many `solve` has compiled for a list. Random nets and masts are made with fixed seeds.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent


def nets(counts, seed=0):
    """Nets on a saddle with so many cables, of which random ones are left out, under loads."""
    import jaxcable as jc

    rng = np.random.default_rng(seed)
    for count in counts:
        sides = next((n, m) for n in range(2, 20) for m in (n, n + 1) if 2 * n * m + n + m >= count)
        structure, _ = jc.scenes.saddle(*sides)
        links = structure.elements.links.array
        while len(links) > count:
            fewer = np.delete(links, rng.integers(len(links)), axis=0)
            if np.bincount(fewer.ravel(), minlength=structure.n_node).min() > 0:
                links = fewer
        structure = jc.replace(structure, elements=jc.Cables(links, axial_stiffness=1e6))
        free = np.flatnonzero(~structure.fixed(structure.supports).array.any(axis=1))
        forces = rng.uniform(-60.0, -20.0, (len(free), 1)) * [[0.0, 0.0, 1.0]]
        loads = jc.NodalLoads(free, forces)
        increments = int(rng.integers(2, 11))
        yield structure, [jc.Phase(pretension=1e3), jc.Phase(loads=loads, increments=increments)]


def masts(count, seed=0):
    """Guyed masts with random heights, levels of guys and wind."""
    import jaxcable as jc

    rng = np.random.default_rng(seed)
    legs = jc.Section([0.3, 0.3, -0.3, -0.3], [0.3, -0.3, 0.3, -0.3], [6e-4] * 4, jc.Elastic(210e9))
    for _ in range(count):
        levels, per_level = int(rng.integers(1, 4)), int(rng.integers(2, 6))
        n = levels * per_level
        mast = np.linspace([0, 0, 0], [0, 0, rng.uniform(4, 7) * n], n + 1)
        ring = [[np.cos(a), np.sin(a), 0] for a in 2 * np.pi / 3 * np.arange(3)]
        nodes = np.concatenate([mast, 3.0 * n * np.array(ring)])
        guys = [[n + 1 + j, per_level * (k + 1)] for k in range(levels) for j in range(3)]
        beams = jc.Beams(
            [[k, k + 1] for k in range(n)], legs, torsional_stiffness=1e6, weight=250.0
        )
        elements = {"mast": beams, "guys": jc.Cables(guys, axial_stiffness=11e6, weight=5.0)}
        supports = jc.clamped([0]) + jc.pinned([n + 1, n + 2, n + 3])
        prestress = jc.Phase(pretension={"mast": None, "guys": 12e3}, loads=jc.SelfWeight())
        wind = [jc.LineLoads((400.0, 0, 0), on="mast"), jc.NodalLoads([n], (900.0, 0, 0))]
        phases = [prestress, jc.Phase(loads=wind, increments=int(rng.integers(2, 9)))]
        yield jc.Structure(nodes, elements, supports=supports), phases


def first_calls(scenes):
    """Milliseconds of `solve` for each scene, and the number of programs that it has compiled."""
    import jax

    import jaxcable as jc
    from jaxcable.analysis import phase_loop

    jc.forget_programs()
    found = []
    for structure, phases in scenes:
        begin = time.perf_counter()
        solution = jax.block_until_ready(jc.solve(structure, phases))
        found.append(1e3 * (time.perf_counter() - begin))
        assert int(solution.status) == 0, jc.describe(solution.status)
    return found, len(phase_loop.analyse.known)


def in_process_that_finds_programs(folder, kind):
    """First calls, ms, of ten unseen structures in a new process with programs in `folder`."""
    words = [sys.executable, __file__, kind, folder]
    run = subprocess.run(words, capture_output=True, text=True, timeout=900, check=True)
    return json.loads(run.stdout.splitlines()[-1])


def run(cases, _):
    import jax
    import record

    import jaxcable as jc

    say = record.Record("similar_sizes")
    sides, most, warmed = cases.similar
    mesh = [jc.scenes.saddle(n, n, load=100.0) for n in sides]
    flat, (prestress, loading) = jc.scenes.flat_net(load=15.0)
    counts = range(1, most + 1)
    lists = {
        "ten nets, 60 to 69 cables": list(nets(range(60, 70))),
        f"saddles of {', '.join(map(str, sides))} nodes a side": mesh,
        f"1 to {counts[-1]} increments": [
            (flat, [prestress, jc.replace(loading, increments=n)]) for n in counts
        ],
    }
    say("\nFirst calls, ms: the first, then median and largest of those that compile nothing\n")
    for name, scenes in lists.items():
        times, programs = first_calls(scenes)
        quick = sorted(times)[: len(times) - programs]
        rest = f"{statistics.median(quick):7.1f}{max(quick):7.1f}" if quick else f"{'-':>7}{'-':>7}"
        say(f"{name:44}{times[0]:8.0f}{rest}   programs: {programs}")

    say("\nAfter `jaxcable warm`: first calls in a new process, ms; median and largest of ten\n")
    with tempfile.TemporaryDirectory() as folder:
        for kind in ("nets", "masts"):
            begin = time.perf_counter()
            words = [sys.executable, "-m", "jaxcable", "warm", kind, "--size", warmed]
            environment = os.environ | {"JAXCABLE_PROGRAMS": folder}
            subprocess.run(words, env=environment, capture_output=True, check=True)
            seconds = time.perf_counter() - begin
            size = sum(path.stat().st_size for path in Path(folder).rglob("*")) / 1e6
            answer = in_process_that_finds_programs(folder, kind)
            times = answer["ms"]
            say(
                f"{kind:8}{statistics.median(times):8.0f}{max(times):8.0f}   compiled: "
                f"{answer['compiled']}   (warm took {seconds:.0f} s, programs take {size:.0f} MB)"
            )

    say("\nRuns, ms: padded to common sizes, exact sizes, ratio of medians of calls by turns\n")
    names = "flat_net", "simplex", "roof_ring", "hypar_net", "guyed_mast", "suspension_footbridge"
    for name in names:
        scene = getattr(jc.scenes, name)()
        times = {False: [], True: []}
        for exact in (False, True) * (cases.repeats + 1):
            begin = time.perf_counter()
            jax.block_until_ready(jc.solve(*scene, exact_sizes=exact))
            times[exact].append(1e3 * (time.perf_counter() - begin))
        padded, exact = (statistics.median(times[key][1:]) for key in (False, True))
        say(f"{name:24}{padded:9.2f}{exact:9.2f}{padded / exact:7.2f}")
    say.close()


if __name__ == "__main__":
    import jax

    import jaxcable as jc

    jax.config.update("jax_enable_x64", True)
    kind, folder = sys.argv[1:]
    jc.keep_programs(folder)
    kept = set(Path(folder).rglob("*.program"))
    sizes = np.random.default_rng(3).integers(12, 100, 10)
    times, _ = first_calls(nets(sizes, seed=3) if kind == "nets" else masts(10, seed=3))
    compiled = set(Path(folder).rglob("*.program")) - kept
    print(json.dumps({"ms": times, "compiled": len(compiled)}))
