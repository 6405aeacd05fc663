"""Studies on clusters of processes of this machine, some of which are killed.

    python tests/banks/clusters.py NAME FOLDER

runs one scene of `SCENES` in a folder, and prints what it has found as JSON. The folder is empty,
or has the undisturbed study of `living_workers` as "local", with which a scene compares its own.
"""

import contextlib
import importlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import dask
import jax
import numpy as np
from distributed import Client, LocalCluster

import jaxcable as jc
from jaxcable.studies import dask_cluster

jax.config.update("jax_enable_x64", True)
# on a machine with other work workers start for longer than the seconds after which a cluster of
# this machine takes a killed one for lost
dask.config.set({"distributed.deploy.lost-worker-timeout": "300 s"})
N_CASE, CHUNK = 400, 10
STRUCTURE, (PRESTRESS, LOADING) = jc.scenes.flat_net()
PAUSE = 0.05  # seconds that a chunk takes at least, so that there is time to kill


def draw(numbers):
    if "SLOW" in os.environ:
        time.sleep(PAUSE)
    draws = [np.random.default_rng(k).uniform(-9.0, 9.0, (4, 3)) for k in numbers]
    forces = np.stack(draws)
    forces[numbers == 123] = np.nan  # a bad case
    return forces


def draw_deadly(numbers):
    """Draw cases; the worker that draws case 200 dies."""
    if 200 in numbers and len(numbers) == CHUNK:
        time.sleep(2.0)  # until what has started the worker knows that it runs
        os._exit(1)
    return draw(numbers)


def analyse(forces):
    load = jc.NodalLoads(LOADING.loads.nodes, forces)
    solution = jc.solve(STRUCTURE, [PRESTRESS, jc.Phase(loads=load)])
    return {"tension": solution.tension, "status": solution.status}


CASES = jc.studies.samples(draw, N_CASE)


def run(store, client=None, cases=CASES, **options):
    return jc.study(analyse, cases, store, client, chunk=CHUNK, **options)


@contextlib.contextmanager
def cluster(**options):
    """Two workers of one thread each, and the client of their scheduler."""
    workers = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None} | options
    with LocalCluster(**workers) as found, Client(found) as client:
        yield client


def comparison(store, reference):
    """Whether every case is there once, and equal to the undisturbed study."""
    one, other = jc.studies.Study(store), jc.studies.Study(reference)
    a, b = one.load(), other.load()
    return {
        "equal": all(np.array_equal(a[name], b[name], equal_nan=True) for name in b),
        "failures": list(one.failures.items()) == list(other.failures.items()),
        "failed": [*one.failures],
        "missing": one.missing,
    }


def living_workers(folder):
    """Scenes in which no worker dies, on the same workers: their results by name."""
    scenes = undisturbed, two_precisions, other_module
    places = {scene: folder / scene.__name__ for scene in scenes}
    for place in places.values():
        place.mkdir()
    # workers, too, import modules from there
    sys.path.insert(0, str(places[other_module]))
    before = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = f"{places[other_module]}:{before}"
    with cluster() as client:
        return {scene.__name__: scene(place, client) for scene, place in places.items()}


def undisturbed(folder, client):
    run(folder / "local")
    run(folder / "samples", client)
    table = jc.studies.table(draw(np.arange(N_CASE)))
    large = dask_cluster._LARGE_CASES
    dask_cluster._LARGE_CASES = 0  # rows are sent with their chunks
    run(folder / "table", client, table)
    dask_cluster._LARGE_CASES = large
    return {name: comparison(folder / name, folder / "local") for name in ("samples", "table")}


def after(n_chunk, action, reports, store):
    """Call `action` in a thread when a store has so many chunks."""

    def wait():
        while len(list((store / "completed").rglob("[0-9]*"))) < n_chunk:
            time.sleep(0.01)
        reports.append(action())

    thread = threading.Thread(target=wait)
    thread.start()
    return thread


def workers_killed(folder):
    os.environ["SLOW"] = "1"
    killed = []
    with cluster() as client:

        def kill():
            count = 0
            while count < 3:
                for pid in [*client.run(os.getpid).values()][:1]:  # of no worker just now, perhaps
                    os.kill(pid, signal.SIGKILL)
                    count += 1
                time.sleep(1.0)
            return count

        thread = after(3, kill, killed, folder / "a")
        run(folder / "a", client)
        thread.join()
    return comparison(folder / "a", folder / "local") | {"killed": killed}


def scheduler_killed(folder):
    os.environ["SLOW"] = "1"
    python = [sys.executable, "-m"]
    scheduler_file = folder / "scheduler.json"
    words = [*python, "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard"]
    words += ["--scheduler-file", str(scheduler_file), "--host", "127.0.0.1"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    scheduler = subprocess.Popen(words, **quiet)
    words = [*python, "distributed.cli.dask_worker", "--nthreads", "1", "--no-dashboard"]
    words += ["--scheduler-file", str(scheduler_file), "--death-timeout", "20"]
    worker = subprocess.Popen(words, **quiet)
    client = Client(scheduler_file=str(scheduler_file), timeout=60)
    thread = after(3, scheduler.kill, [], folder / "a")
    begin, said = time.monotonic(), None
    try:
        run(folder / "a", client)
    except jc.studies.ClusterLostError as error:
        said = str(error)
    seconds = time.monotonic() - begin
    thread.join()
    n_missing = len(jc.studies.Study(folder / "a").missing)
    worker.kill()
    for process in (worker, scheduler):
        process.wait()
    with contextlib.suppress(Exception):
        client.close(timeout=1)
    with cluster() as client:
        run(folder / "a", client)
    found = comparison(folder / "a", folder / "local")
    return found | {"said": said, "seconds": seconds, "n_missing": n_missing}


def deadly_case(folder):
    cases = jc.studies.samples(draw_deadly, N_CASE)
    said = None
    dask.config.set({"distributed.scheduler.allowed-failures": 1})  # workers start for seconds
    with cluster() as client:
        try:
            run(folder / "a", client, cases)
        except jc.studies.StudyError as error:
            said = str(error)
    return {"said": said, "missing": jc.studies.Study(folder / "a").missing}


def interrupted(folder):
    os.environ["SLOW"] = "1"
    with cluster() as client:
        thread = after(3, lambda: os.kill(os.getpid(), signal.SIGINT), [], folder / "a")
        try:
            run(folder / "a", client)
            stopped = False
        except KeyboardInterrupt:
            stopped = True
        thread.join()
        n_missing = len(jc.studies.Study(folder / "a").missing)
        run(folder / "a", client)
    found = comparison(folder / "a", folder / "local")
    return found | {"stopped": stopped, "n_missing": n_missing}


def other_module(folder, client):
    """The script has changed a module that a worker has already imported."""
    place, said = folder / "own_law.py", None
    text = "def function(x):\n    return {'y': 1.0 * x}\n"
    place.write_text(text, encoding="utf-8")
    import own_law

    client.run(importlib.import_module, "own_law")  # on all: one alone may compute every chunk
    jc.study(own_law.function, np.arange(40.0), folder / "a", client, chunk=10)
    place.write_text(text.replace("1.0", "22.0"), encoding="utf-8")
    importlib.reload(own_law)
    try:
        jc.study(own_law.function, np.arange(40.0), folder / "b", client, chunk=10)
    except jc.studies.StudyError as error:
        said = str(error)
    return {"said": said, "missing": jc.studies.Study(folder / "b").missing}


def two_precisions(folder, client):
    """Studies in single and double precision, by turns, on the same workers."""
    kinds = []
    for name, double in (("a", True), ("b", False), ("c", True)):
        with jax.enable_x64(double):
            study = jc.study(lambda x: {"y": x / 3}, np.arange(40.0), folder / name, client)
        y = study.load()["y"]
        kind = np.float64 if double else np.float32
        rounding = 2 * np.finfo(kind).eps  # of a factor 1/3, and of a product
        right = np.allclose(y, np.arange(40) / 3, rtol=rounding, atol=0.0)
        kinds.append(right and str(y.dtype))
    return kinds


def without_workers(folder):
    begin, said = time.monotonic(), None
    with cluster(n_workers=0) as client:
        try:
            run(folder / "a", client, patience=2.0)
        except jc.studies.ClusterLostError as error:
            said = str(error)
    return {"said": said, "seconds": time.monotonic() - begin}


SCENES = {
    scene.__name__: scene
    for scene in (
        *(living_workers, workers_killed, scheduler_killed),
        *(deadly_case, interrupted, without_workers),
    )
}

if __name__ == "__main__":
    print(json.dumps(SCENES[sys.argv[1]](Path(sys.argv[2]).resolve())))
