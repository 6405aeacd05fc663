"""Does a study of many cases survive its processes, and what does a case cost?

Question   100 000 load cases of a net of 300 unknowns, results in files (`jc.streamed`), by two
           processes of one machine: cases per second beside one process; and with one of the two
           killed in the middle and started again, whether every case is there once, and what was
           computed twice.
Reference  The same study by one process without disturbance.
Error      Number of cases that are missing or whose displacements differ in any bit.
Command    python experiments/many_cases.py [CASES]
           (writes experiments/results/many_cases.txt; three minutes)

By hand, on any machines with a common folder, with whatever starts processes there (an array job of
a queue, GNU parallel, Dask, Ray): `python experiments/many_cases.py --run FOLDER CASES RANK
PROCESSES`, and the same again for what was killed.

Processes keep one core each. The displacements of the loaded nodes are kept, 2.4 kB a case.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CHUNK = 500
SIDE = 10


def run(folder, count, rank, processes):
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
    study = jc.streamed(analyse, cases, folder, CHUNK, n_case=count, share=(rank, processes))
    print(time.perf_counter() - begin, len(study.missing), flush=True)


def started(folder, count, rank, processes):
    command = [sys.executable, __file__, "--run", folder, str(count), str(rank), str(processes)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def seconds(process):
    out, _ = process.communicate()
    assert process.returncode == 0
    return float(out.split()[0])


def chunks(folder):
    return {f.name: f.stat().st_mtime_ns for f in Path(folder).glob("chunk-*.npz")}


def main(count):
    import numpy as np
    from record import Record

    import jaxcable as jc

    record = Record("many_cases")
    record(f"\n{count} load cases of {3 * SIDE**2} unknowns, in chunks of {CHUNK}\n")
    with tempfile.TemporaryDirectory() as alone, tempfile.TemporaryDirectory() as pair:
        seconds(started(tempfile.mkdtemp(dir=alone), CHUNK, 0, 1))  # the program is on disk now
        one = seconds(started(f"{alone}/study", count, 0, 1))
        both = [started(f"{pair}/study", count, rank, 2) for rank in range(2)]
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
        both = [started(killed, count, rank, 2) for rank in range(2)]
        while len(chunks(killed)) < count // CHUNK // 2:
            time.sleep(0.05)
        both[1].send_signal(signal.SIGKILL)
        both[1].wait()
        seconds(both[0])
        before = chunks(killed)
        seconds(started(killed, count, 1, 2))
        after = chunks(killed)
        again = sum(after[name] != stamp for name, stamp in before.items())
        whole, study = (jc.results.Study(Path(f), count, CHUNK) for f in (f"{alone}/study", killed))
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
    if sys.argv[1:2] == ["--run"]:
        run(sys.argv[2], *(int(word) for word in sys.argv[3:]))
    else:
        main(int(sys.argv[1]) if sys.argv[1:] else 100_000)
