"""What does a new process wait for, once and again; and what does a process keep of many nets?

Question   Seconds of the first call of `solve` in a new process, without the import: with nothing
           on disk, and with programs kept there by an earlier process (`jc.keep_programs`); the
           same inside of `jax.jit`, where the analysis is traced and only its compilation is kept.
           Memory of a process that analyses 500 nets of different shape, one after the other.
Reference  A bare analysis of 48 unknowns in the same run (`first_call.bare`): its first call is Y.
Error      None: results from disk are equal to the last bit (tests/common/test_keeping.py).
Command    python experiments/kept_programs.py [first] [many]
           (writes experiments/results/kept_programs_first.txt and kept_programs_many.txt; ten
           minutes, and half an hour)

Medians, and in brackets least and largest, of five processes; the first call of all is one process.
Memory is that of the whole process (resident), with Python, jax and all libraries.
"""

import gc
import json
import os
import re
import subprocess
import sys
import tempfile
import time

SCENES = {
    "hypar": ("hypar_net", None),
    "Geiger dome": ("geiger_dome", None),
    "guyed mast": ("guyed_mast", None),
    "48 unknowns": ("saddle 4", None),
    "48 unknowns, fused loops": ("saddle 4 fused", None),
    "1 200 unknowns, PARDISO": ("saddle 20", "pardiso"),
    "1 200 unknowns, CHOLMOD": ("saddle 20", "cholmod"),
    "7 500 unknowns, PARDISO": ("saddle 50", "pardiso"),
    "7 500 unknowns, CHOLMOD": ("saddle 50", "cholmod"),
}
AGAIN = 5
NETS = 500


def first(name, solver, kind, folder):
    """Seconds of the first call in this process."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp

    import jaxcable as jc

    words = name.split()
    if "fused" in words:
        jc.fuse_loops()
    jc.keep_programs(folder)
    if words[0] == "saddle":
        n = int(words[1])
        structure, phases = jc.scenes.saddle(n, n, load=5000 / (n + 1))
    else:
        structure, phases = getattr(jc.scenes, words[0])()[:2]
    method = jc.Newton(linear_solver=solver)
    jax.block_until_ready(jnp.zeros(3) + 1.0)  # jax has started

    def moved(nodes):
        solution = jc.solve(jc.replace(structure, nodes=nodes), phases, method)
        return jnp.sum(solution.displacement**2), solution.status

    begin = time.perf_counter()
    if kind == "plain":
        status = jax.block_until_ready(jc.solve(structure, phases, method)).status
    else:
        _, status = jax.block_until_ready(jax.jit(moved)(jnp.asarray(structure.nodes)))
    spent = time.perf_counter() - begin
    return {"seconds": spent, "status": int(status)}


def apart(*words):
    """The answer of a process of its own."""
    clean = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    command = [sys.executable, __file__, "--one", json.dumps(words)]
    run = subprocess.run(command, capture_output=True, text=True, env=clean)
    if run.returncode != 0:
        raise SystemExit(run.stderr)
    return json.loads(run.stdout.splitlines()[-1])


def firsts():
    from first_call import apart as bare
    from record import Record

    record = Record("kept_programs_first")
    units = [bare("", "bare")["first"]]
    record("\nFirst calls, s, without the import. plain: jc.solve; jitted: inside of jax.jit\n")
    record(f"{'':26}{'plain, once':>12}{'again, from disk':>22}{'jitted, once':>15}{'again':>22}")
    for label, (name, solver) in SCENES.items():
        cells = []
        for kind in ("plain", "jitted"):
            with tempfile.TemporaryDirectory() as folder:
                runs = [apart(name, solver, kind, folder) for _ in range(1 + AGAIN)]
            assert all(run["status"] == 0 for run in runs), label
            once, *again = (run["seconds"] for run in runs)
            again.sort()
            spread = f"{again[AGAIN // 2]:.2f} ({again[0]:.2f} to {again[-1]:.2f})"
            cells += [f"{once:.2f}", spread]
        record(f"{label:26}{cells[0]:>12}{cells[1]:>22}{cells[2]:>15}{cells[3]:>22}")
        units.append(bare("", "bare")["first"])
    units.sort()
    record(f"\nY, s: {units[len(units) // 2]:.2f} ({units[0]:.2f} to {units[-1]:.2f})")
    record.close()


def resident():
    """Memory of this process, MB, and number of its memory maps."""
    with open("/proc/self/status") as file:
        size = int(re.search(r"VmRSS:\s+(\d+)", file.read()).group(1)) / 1e3
    with open("/proc/self/maps") as file:
        return size, len(file.readlines())


def many():
    import jax

    jax.config.update("jax_enable_x64", True)
    from record import Record

    import jaxcable as jc
    from jaxcable.common.compilation import MOST

    record = Record("kept_programs_many")
    record(f"\n{NETS} nets of different shape, each analysed once by jc.solve; {MOST} programs are")
    record("known at a time. Memory of the process, and its memory maps (65 530 are allowed)\n")
    record(f"{'nets':>6}{'MB':>8}{'maps':>8}")
    record(f"{0:6}{resident()[0]:8.0f}{resident()[1]:8}")
    for k in range(NETS):
        solution = jc.solve(*jc.scenes.saddle(3 + k % 25, 3 + k // 25, load=100.0))
        assert int(solution.status) == 0
        if k + 1 in (1, 10, MOST, 100, 200, 300, 400, 500):
            size, maps = resident()
            record(f"{k + 1:6}{size:8.0f}{maps:8}")
    jc.forget_programs()
    gc.collect()
    size, maps = resident()
    record(f"\nafter jc.forget_programs(): {size:.0f} MB, {maps} maps")
    record.close()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(first(*json.loads(sys.argv[2]))))
    else:
        parts = {"first": firsts, "many": many}
        for part in sys.argv[1:] or parts:
            parts[part]()
