"""Does a study of many cases survive the loss of a process, and how long does a case take?

Question   100 000 load cases of a net of 300 unknowns, results in files (`jc.streamed`), by two
           processes of one machine: cases per second beside one process. If one of the two is
           killed and started again: is every case there once, and how many were computed twice?
Reference  The same study by one process without disturbance.
Error      Number of cases that are missing or whose displacements differ in any bit.
Results    many_cases.txt; three minutes

By hand, on any machines with a common folder, with any tool that starts processes there (an array
job of a queue, GNU parallel, Dask, Ray): `python experiments/benchmarks/many_cases.py FOLDER CASES
CHUNK RANK PROCESSES`, and the same command again for a process that was killed.

Each process uses one core. The displacements of the loaded nodes are saved, 2.4 kB a case.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SIDE = 10


def share(folder, count, chunk, rank, processes):
    """The share of this process."""
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {cores[rank % len(cores)]})
    import jax

    import jaxcable as jc

    jc.fuse_loops()
    jc.keep_programs()
    jax.config.update("jax_enable_x64", True)
    import numpy as np

    structure, phases = jc.scenes.saddle(SIDE, SIDE)
    loaded = phases[1].loads.nodes.array

    def cases(numbers):
        """Forces on the nodes, from the number of a case alone."""
        return np.stack(
            [np.random.default_rng(k).uniform(-500.0, 500.0, (len(loaded), 3)) for k in numbers]
        )

    def analyse(forces):
        load = jc.Phase(loads=jc.NodalLoads(loaded, forces))
        solution = jc.solve(structure, [phases[0], load])
        return {"displacement": solution.displacement[loaded], "status": solution.status}

    begin = time.perf_counter()
    study = jc.streamed(analyse, cases, folder, chunk, n_case=count, share=(rank, processes))
    print(time.perf_counter() - begin, len(study.missing), flush=True)


def started(*words):
    """The process of a share."""
    command = [sys.executable, __file__, *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def seconds(process):
    out, _ = process.communicate()
    assert process.returncode == 0
    return float(out.split()[0])


def chunks(folder):
    return {f.name: f.stat().st_mtime_ns for f in Path(folder).glob("chunk-*.npz")}


def run(cases, _):
    import numpy as np
    from record import Record

    import jaxcable as jc

    record, (count, chunk) = Record("many_cases"), cases.study
    record(f"\n{count} load cases of {3 * SIDE**2} unknowns, in chunks of {chunk}\n")
    with tempfile.TemporaryDirectory() as alone, tempfile.TemporaryDirectory() as pair:
        seconds(
            started(tempfile.mkdtemp(dir=alone), chunk, chunk, 0, 1)
        )  # the program is on disk now
        one = seconds(started(f"{alone}/study", count, chunk, 0, 1))
        both = [started(f"{pair}/study", count, chunk, rank, 2) for rank in range(2)]
        two = max(seconds(process) for process in both)
        record(f"one process   {one:8.1f} s  {count / one:9.0f} cases a second")
        record(f"two processes {two:8.1f} s  {count / two:9.0f} cases a second")
        record(f"rate of two over one: {one / two:.2f}")
        us = 1e6 * one / count
        record(
            f"a case: {us:.0f} us of a core; 1 000 000 cases: {us / 3600:.2f} hours of a core, on "
            f"1 000 cores {us / 1000:.1f} s and their start"
        )
        killed = f"{pair}/killed"
        both = [started(killed, count, chunk, rank, 2) for rank in range(2)]
        while len(chunks(killed)) < count // chunk // 2:
            time.sleep(0.05)
        both[1].send_signal(signal.SIGKILL)
        both[1].wait()
        seconds(both[0])
        before = chunks(killed)
        seconds(started(killed, count, chunk, 1, 2))
        after = chunks(killed)
        again = sum(after[name] != stamp for name, stamp in before.items())
        whole, study = (jc.results.Study(Path(f), count, chunk) for f in (f"{alone}/study", killed))
        differ = numbers = 0
        for (own, a), (_, b) in zip(whole.chunks(), study.chunks(), strict=True):
            numbers += len(own)
            differ += int((a["displacement"] != b["displacement"]).any(axis=(1, 2)).sum())
            assert not a["status"].any() and np.isfinite(a["displacement"]).all()
        record(
            f"\none of two killed at half of the study; {len(before)} of {len(after)} chunks were "
            f"there when the\nother was done. Started again: {numbers} cases, {again} chunks "
            f"written twice, {len(study.missing)} missing,\n{differ} cases that differ from the "
            "undisturbed study"
        )
    record.close()


if __name__ == "__main__":
    share(sys.argv[1], *(int(word) for word in sys.argv[2:]))
