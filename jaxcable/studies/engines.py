"""Who computes the chunks of a study: threads of this process, or the workers of a Dask cluster.

An engine computes chunks in any order and yields a `Done` for each. A chunk that fails is yielded
as a pair (number, exception), and the others go on.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import itertools
import os
import pickle
import queue
import threading
from collections.abc import Callable, Generator, Sequence
from typing import Any, TypeAlias

import jax

from ..common.fusion import are_loops_fused
from .cases import Block, Cases
from .task import ChunkTask, Done, Settings

Outcome: TypeAlias = "Done | tuple[int, Exception]"
Stop: TypeAlias = Callable[[], bool]
"""Tells whether no further chunk shall begin."""

_MOST_SUBMITTED = 20_000  # chunks that the scheduler knows of at a time, some kilobytes each
_MOST_BYTES = 1 << 28  # of cases that are sent with the chunks submitted at a time
_LOOK = 0.2  # seconds after which it is asked again whether to stop


class ClusterLostError(RuntimeError):
    """The scheduler of a cluster, or the connection to it, was lost during a study."""


def in_threads(task: ChunkTask, numbers: Sequence[int], stop: Stop) -> Generator[Outcome]:
    """Compute chunks in threads of this process.

    There is one thread for each core where loops are fused (`fuse_loops`), since a program keeps
    one core busy then. Otherwise there is one: XLA shares a program out to all cores.
    """
    waiting, wanted = iter(numbers), 1  # the first chunk compiles for all
    running: dict[concurrent.futures.Future[Done], int] = {}
    with concurrent.futures.ThreadPoolExecutor(_n_thread()) as pool:
        while True:
            while len(running) < wanted and not stop():
                k = next(waiting, None)
                if k is None:
                    break
                running[pool.submit(task, k)] = k
            if not running:
                return
            ended, _ = concurrent.futures.wait(running, _LOOK, concurrent.futures.FIRST_COMPLETED)
            for future in ended:
                wanted = _n_thread()
                yield _outcome(running.pop(future), future.exception(), future)


def _n_thread():
    """Return how many chunks are computed at once in this process."""
    if jax.default_backend() != "cpu" or not are_loops_fused():
        return 1
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _outcome(k, error, future):
    """Return the result of a future, or (number, exception) if it has failed."""
    if error is None:
        return future.result()
    if not isinstance(error, Exception):
        raise error
    return k, error


def on_cluster(
    client: Any,
    task: ChunkTask,
    cases: Cases,
    numbers: Sequence[int],
    stop: Stop,
    settings: Settings,
    name: str,
) -> Generator[Outcome]:
    """Compute chunks on the workers of a Dask cluster.

    Args:
        client: `distributed.Client`.
        task: what computes a chunk; its store has to be visible from all workers.
        cases: all cases; those of a chunk are sent with it if workers cannot make them.
        numbers: numbers of chunks.
        stop: tells whether to begin no further chunk.
        settings: of jax, for workers.
        name: prefix of the names of tasks; another study has another one.

    Raises:
        ClusterLostError: the scheduler is gone.
    """
    import cloudpickle

    content = cloudpickle.dumps(task)
    # a task, not scattered data: it is made again if the worker that holds it is lost
    shared = client.submit(_return_all, name, content, settings, key=f"{name}-task", pure=False)
    waiting, known = iter(numbers), {}
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def submit(count):
        for k in itertools.islice(waiting, count):
            block = cases.block(task.grid.numbers(k)) if task.cases is None else None
            key = f"{name}-chunk-{k}"
            future = client.submit(compute_chunk, shared, k, block, key=key, pure=False)
            known[key] = k, future
            future.add_done_callback(ended.put)

    try:
        submit(_n_submitted(client, task, cases))
        while known and not stop():
            try:
                future = ended.get(timeout=_LOOK)
            except queue.Empty:
                if client.status in ("closing", "closed"):
                    raise ClusterLostError(_LOST) from None
                continue
            if future.status in ("cancelled", "lost"):
                raise ClusterLostError(_LOST)
            k, _ = known.pop(future.key)
            yield _outcome(k, future.exception(), future)
            future.release()
            submit(1)
    finally:
        with contextlib.suppress(Exception):  # of a cluster that is gone
            client.cancel([shared, *(future for _, future in known.values())], force=True)


_LOST = (
    "the scheduler of the cluster is gone; chunks that were computed are in the store: call "
    "jc.study again, with a new client, to compute the others"
)


def _n_submitted(client, task, cases):
    """Return how many chunks to submit at a time, so that no worker waits for the next one."""
    if task.cases is not None:
        return _MOST_SUBMITTED
    n_bytes = sum(leaf.nbytes for leaf in jax.tree.leaves(cases.block(task.grid.numbers(0))))
    fitting = max(1, _MOST_BYTES // max(1, n_bytes))
    return min(_MOST_SUBMITTED, max(fitting, 2 * sum(client.nthreads().values())))


def _return_all(*parts):
    """Return the parts of a task, so that each worker gets them from another one."""
    return parts


_tasks: dict[str, ChunkTask] = {}  # the one that this worker has computed last, by name of study
_task_lock = threading.Lock()
_one_at_a_time = threading.Lock()


def compute_chunk(shared: tuple[str, bytes, Settings], k: int, block: Block | None) -> Done:
    """Compute chunk `k` on a worker of a cluster.

    Args:
        shared: name of the study, its `ChunkTask` as bytes, and settings of jax.
        k: number of the chunk.
        block: its cases, or None.
    """
    name, content, settings = shared
    with _task_lock:
        if name not in _tasks:
            settings.apply()  # before the task is made: its arrays start jax
            _tasks.clear()
            _tasks[name] = pickle.loads(content)
        task = _tasks[name]
    with contextlib.nullcontext() if settings.fused else _one_at_a_time:
        return task(k, block)
