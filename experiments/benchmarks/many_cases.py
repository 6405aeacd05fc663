"""How fast is a study of many cases on a cluster, what is its overhead, and what survives?

Question   100 000 load cases of a net of 300 unknowns, results in a Zarr store (`jc.study`): cases
           per second by two workers of Dask beside one, and by threads of one process. Overhead of
           a chunk, in this process and through the scheduler. Memory of a worker over 1 000 chunks.
           Size of a store and speed of writing beside NPZ. If workers are killed three times: is
           every case there once?
Reference  The same study by one worker without disturbance.
Error      Number of cases that are missing or whose displacements differ in any bit.
Results    many_cases.txt; seven minutes

Each worker has one thread. The displacements of the loaded nodes are saved, 2.4 kB a case. Many
cores are simulated by threads that sleep: they show what the scheduler can serve, not what cores
compute; once with files as in a study, and once without, with delayed messages in place of a
network.
"""

import contextlib
import dataclasses
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

SIDE = 10
DELAYING_RELAY = str(Path(__file__).with_name("delaying_relay.py"))


def net_study():
    """The function of a case, and one that draws cases by their numbers."""
    import jaxcable as jc

    structure, phases = jc.scenes.saddle(SIDE, SIDE)
    loaded = phases[1].loads.nodes.array

    def draw(numbers):
        """Forces on the nodes, from the number of a case alone."""
        return np.stack(
            [np.random.default_rng(k).uniform(-500.0, 500.0, (len(loaded), 3)) for k in numbers]
        )

    def analyse(forces):
        load = jc.Phase(loads=jc.NodalLoads(loaded, forces))
        solution = jc.solve(structure, [phases[0], load])
        return {"displacement": solution.displacement[loaded], "status": solution.status}

    return analyse, draw


@contextlib.contextmanager
def cluster(workers, threads=1):
    """The client of a cluster of this machine."""
    import dask
    from distributed import Client, LocalCluster

    # a killed worker may start for longer than the 15 s after which it is taken for lost
    dask.config.set({"distributed.deploy.lost-worker-timeout": "300 s"})
    options = {"dashboard_address": None, "silence_logs": 50}
    with (
        LocalCluster(n_workers=workers, threads_per_worker=threads, **options) as found,
        Client(found) as client,
    ):
        yield client


def seconds_of(function, *arguments, **options):
    """Seconds of a call, and its result."""
    begin = time.perf_counter()
    result = function(*arguments, **options)
    return time.perf_counter() - begin, result


def speeds(record, folder, count, chunk):
    """Time the study by threads, by one worker and by two; return the store of one."""
    import jaxcable as jc

    analyse, draw = net_study()
    cases = jc.studies.samples(draw, count)
    first = jc.studies.samples(draw, 4 * chunk)  # compiles
    jc.study(analyse, first, folder / "threads-first", chunk=chunk)
    took = {}
    took["threads of one process"], _ = seconds_of(
        jc.study, analyse, cases, folder / "threads", chunk=chunk
    )
    for workers, name in ((1, "one worker"), (2, "two workers")):
        with cluster(workers) as client:
            jc.study(analyse, first, folder / f"{workers}-first", client, chunk=chunk)
            took[name], _ = seconds_of(
                jc.study, analyse, cases, folder / str(workers), client, chunk=chunk
            )
    for name, seconds in took.items():
        record(f"{name:24}{seconds:8.1f} s  {count / seconds:9.0f} cases a second")
    record(f"rate of two workers over one: {took['one worker'] / took['two workers']:.2f}")
    us = 1e6 * took["one worker"] / count
    record(f"a case: {us:.0f} us of a core; 1 000 000 cases: {us / 3600:.2f} hours of a core")
    return folder / "1"


def compare(record, store, reference, text):
    """Compare two stores case by case."""
    import jaxcable as jc

    one, other = jc.studies.Study(store), jc.studies.Study(reference)
    a, b = one.load(), other.load()
    differ = int((a["displacement"] != b["displacement"]).any(axis=(1, 2)).sum())
    bad = int((a["status"] != 0).sum())
    record(f"{text}: {one.n_case} cases, {len(one.missing)} chunks missing, {bad} failed,")
    record(f"  {differ} cases that differ from those of one worker without disturbance")


def killed(record, folder, count, chunk, reference):
    """Kill a worker three times while the study runs."""
    import jaxcable as jc

    analyse, draw = net_study()
    store, n_killed = folder / "killed", 0
    done = threading.Event()

    def kill(client):
        nonlocal n_killed
        while n_killed < 3 and not done.wait(2.0):
            for pid in [*client.run(os.getpid).values()][:1]:
                if len(list((store / "completed").rglob("[0-9]*"))):
                    os.kill(pid, signal.SIGKILL)
                    n_killed += 1

    with cluster(2) as client:
        thread = threading.Thread(target=kill, args=(client,), daemon=True)
        thread.start()
        jc.study(analyse, jc.studies.samples(draw, count), store, client, chunk=chunk)
        done.set()
        thread.join(10)
    compare(record, store, reference, f"\na worker killed {n_killed} times")


def overhead(record, folder, n_chunk):
    """Time chunks of one case that cost nothing, and the memory of a worker before and after."""
    import jaxcable as jc

    def double(x):
        return {"double": 2.0 * x}

    def memory(client):
        import psutil

        return max(client.run(lambda: psutil.Process().memory_info().rss / 1e6).values())

    cases, tenth = np.arange(float(n_chunk)), np.arange(float(n_chunk // 10))
    jc.study(double, tenth, folder / "one-first", chunk=1)
    alone, _ = seconds_of(jc.study, double, cases, folder / "one", chunk=1)
    with cluster(2) as client:
        jc.study(double, tenth, folder / "two-first", client, chunk=1)
        before = memory(client)
        through, _ = seconds_of(jc.study, double, cases, folder / "two", client, chunk=1)
        after = memory(client)
        begin = time.perf_counter()
        client.gather(client.map(lambda k: k, range(n_chunk), pure=False))
        bare = time.perf_counter() - begin
    ms = [1e3 * seconds / n_chunk for seconds in (alone, through, bare)]
    record(f"\n{n_chunk} chunks of one case that cost nothing, ms a chunk:")
    record(f"  threads {ms[0]:.1f}, two workers {ms[1]:.1f}, bare tasks of Dask {ms[2]:.1f}")
    record(f"memory of a worker: {before:.0f} MB, and after {n_chunk} more chunks {after:.0f} MB")


@dataclasses.dataclass
class SleepingTask:
    """Stands for the task of a chunk: sleeps in place of computing, and writes nothing."""

    seconds: float
    settings: object
    cases: object = "none are sent"

    def require_same_study(self):
        pass

    def __call__(self, k, block=None):
        time.sleep(self.seconds)


def many_cores(record, folder, n_thread, seconds):
    """Chunks that sleep, on two workers of many threads: the part of the time that is waiting."""
    import jaxcable as jc

    def draw(numbers):
        time.sleep(seconds)
        return numbers.astype(float)

    def double(x):
        return {"double": 2.0 * x}

    rounds = 5
    count = 2 * n_thread * rounds
    with cluster(2, n_thread) as client:
        jc.study(double, np.arange(4.0), folder / "wake", client, chunk=1)
        cases = jc.studies.samples(draw, count)
        took, _ = seconds_of(jc.study, double, cases, folder / "sleep", client, chunk=1)
    text = f"{2 * n_thread} simulated cores, chunks of {seconds:.0f} s:"
    record(
        f"\n{text} busy {100 * rounds * seconds / took:.0f} %, {count / took:.0f} chunks a second"
    )


def scheduler_alone(record, n_thread, seconds, delay):
    """The same through the scheduler only: nothing is computed or written, messages are delayed."""
    import cloudpickle
    from distributed import Client, LocalCluster

    import jaxcable as jc
    from jaxcable.studies.dask_cluster import compute_on_cluster
    from jaxcable.studies.task import Settings

    cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers do not have this file
    rounds = 20
    count = 2 * n_thread * rounds
    with (
        LocalCluster(n_workers=0, dashboard_address=None, silence_logs=50) as scheduler,
        Client(scheduler) as client,
        delaying_workers(scheduler.scheduler_address, 2, n_thread, delay),
    ):
        client.wait_for_workers(2, timeout=60)
        task = SleepingTask(seconds, Settings.of_current_process())
        drawn = jc.studies.samples(np.asarray, count)

        def run(numbers):
            return list(compute_on_cluster(client, task, drawn, numbers, lambda: False, 60.0))

        run(range(2 * n_thread))
        took, done = seconds_of(run, range(count))
    assert sorted(done) == [(k, None) for k in range(count)]  # no errors
    busy, rate = 100 * rounds * seconds / took, count / took
    text = f"{1e3 * delay:2.0f} ms each way, chunks of {seconds:.1f} s"
    record(f"  {text}: busy {busy:.0f} %, {rate:.0f} chunks a second")


@contextlib.contextmanager
def delaying_workers(address, count, n_thread, delay):
    """Workers in processes of their own, whose messages to and from the scheduler take longer."""
    host, port = address.removeprefix("tcp://").split(":")
    relay = [sys.executable, DELAYING_RELAY, host, port, str(delay)]
    with subprocess.Popen(relay, stdout=subprocess.PIPE, text=True) as between:
        workers = []
        try:
            through = f"tcp://127.0.0.1:{between.stdout.readline().strip()}"
            options = ["--nthreads", str(n_thread), "--no-nanny", "--no-dashboard"]
            command = [sys.executable, "-m", "distributed.cli.dask_worker", through, *options]
            quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            workers += [subprocess.Popen(command, **quiet) for _ in range(count)]
            yield
        finally:
            for process in (*workers, between):
                process.kill()
                process.wait(30)


def sizes(record, folder, chunk):
    """Bytes and seconds of one chunk of results, as a part of a store and as NPZ."""
    import jaxcable as jc

    analyse, draw = net_study()
    whole = jc.study(analyse, draw(np.arange(chunk)), folder / "size", chunk=chunk)
    found = whole.load()
    again = jc.studies.store.ResultStore(whole.store)
    causes = np.full(chunk, "", object)
    rounds = range(10)
    zarr = min(seconds_of(again.write, 0, found, causes)[0] for _ in rounds)
    path = folder / "chunk.npz"
    npz = min(seconds_of(np.savez, path, **found)[0] for _ in rounds)
    in_store = sum(part.stat().st_size for part in whole.store.rglob("*") if part.is_file())
    record(
        f"\na chunk of {chunk} cases: store {in_store / 1e6:.2f} MB, {1e3 * zarr:.0f} ms to write; "
        f"NPZ {path.stat().st_size / 1e6:.2f} MB, {1e3 * npz:.0f} ms"
    )


def run(cases, _):
    import jaxcable as jc

    jc.fuse_loops()
    from record import Record

    record, (count, chunk, n_chunk, n_thread) = Record("many_cases"), cases.study
    record(f"\n{count} load cases of {3 * SIDE**2} unknowns, in chunks of {chunk}\n")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        reference = speeds(record, folder, count, chunk)
        killed(record, folder, count, chunk, reference)
        overhead(record, folder, n_chunk)
        many_cores(record, folder, n_thread, 1.0)
        record(f"{2 * n_thread} simulated cores, without files; messages of workers are delayed by")
        for seconds in (1.0, 0.2):
            for delay in (0.0, 0.005):
                scheduler_alone(record, n_thread, seconds, delay)
        sizes(record, folder, chunk)
    record.close()


if __name__ == "__main__":
    sys.exit("run it by: python experiments/benchmark.py many_cases")
