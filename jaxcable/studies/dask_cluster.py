"""Compute chunks of a study on the workers of a Dask cluster.

A plugin brings the function of the study to every worker, also to those that join later or are
started again: a task is then no more than the number of its chunk. Chunks whose workers have died
several times are tried once more when all others are done.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import pickle
import queue
import threading
import time
from collections.abc import Generator, Sequence
from typing import Any

import cloudpickle
import jax
from distributed import KilledWorker, WorkerPlugin, get_worker

from .cases import Block, Cases
from .errors import ClusterLostError
from .task import ChunkTask, Done, Settings, summarize_error
from .threads import SECONDS_TO_STOP, Outcome, Stop, outcome_of

_MOST_SUBMITTED = 20_000  # chunks that the scheduler knows of at a time, some kilobytes each
_MOST_BYTES = 1 << 28  # of cases that are sent with the chunks submitted at a time
_SECONDS_TO_FETCH = 10.0  # some bytes from a worker, which may have died
_SECONDS_WITHOUT_NEWS = 30.0  # after which the scheduler is asked whether it is there
_SECONDS_TO_ANSWER = 30.0
_MOST_KILLED = 20  # chunks whose workers have died: then it is an error of all of them
_AGAIN = "-again"  # end of the key of a chunk whose workers have died

_LOST = (
    "the scheduler of the cluster is gone, or has been told to cancel tasks; chunks that were "
    "computed are in the store: call jc.study again, with a new client, to compute the others"
)


def compute_on_cluster(
    client: Any,
    task: ChunkTask,
    cases: Cases,
    numbers: Sequence[int],
    stop: Stop,
    settings: Settings,
    name: str,
    patience: float,
) -> Generator[Outcome]:
    """Compute chunks on the workers of a cluster, and yield what has become of each.

    Args:
        client: `distributed.Client`.
        task: what computes a chunk; its store has to be visible from all workers.
        cases: all cases; those of a chunk are sent with it if workers cannot make them.
        numbers: numbers of chunks.
        stop: tells whether to begin no further chunk.
        settings: of jax, for workers.
        name: prefix of the names of tasks; another study has another one.
        patience: seconds to wait while there is no worker.

    Raises:
        ClusterLostError: the scheduler is gone, or no worker comes.
    """
    waiting, known = iter(numbers), {}
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    killed: list[tuple[int, Exception]] = []  # chunks whose workers have died, several times
    lost: list[Any] = []  # futures whose results died with their workers; Dask computes them again
    n_bytes = 0 if task.cases is not None else _bytes_of_chunk(cases, task)

    def submit(k, again=""):
        block = cases.block(task.grid.numbers(k)) if task.cases is None else None
        key = f"{name}-chunk-{k}{again}"
        future = client.submit(compute_chunk, name, k, block, key=key, pure=False)
        known[key] = k, future
        future.add_done_callback(ended.put)

    def submit_more():
        for k in itertools.islice(waiting, max(0, _n_submitted(client, n_bytes) - len(known))):
            submit(k)
            if stop():
                return

    watch = _Watch(client, patience)
    try:
        client.register_plugin(StudyPlugin(name, _as_bytes(task), settings))
        submit_more()
        while (known or killed) and not stop():
            if len(killed) >= _MOST_KILLED:
                yield from killed
                killed.clear()
            if not known:  # one alone: which of them has killed the workers?
                submit(killed.pop(0)[0], again=_AGAIN)
            try:
                future = ended.get(timeout=SECONDS_TO_STOP)
            except queue.Empty:
                watch.require_cluster()
                while lost:
                    ended.put(lost.pop())
                continue
            if future.status == "cancelled":
                raise ClusterLostError(_LOST)
            k, _ = known[future.key]
            outcome = _outcome_unless_lost(k, future)
            if outcome is None:
                lost.append(future)
                continue
            watch.note_news()
            del known[future.key]
            if _has_killed(outcome) and not future.key.endswith(_AGAIN):
                killed.append(outcome)
            else:
                yield outcome
            future.release()
            submit_more()
    finally:
        _call_within(_SECONDS_TO_ANSWER, _cancel_and_unregister, client, known, name)


def _as_bytes(task):
    """Return a task as bytes; ValueError if its function cannot be sent."""
    try:
        return cloudpickle.dumps(task)
    except Exception as error:  # of objects that cannot be pickled there are many kinds
        raise ValueError(
            "function: it, or what it uses, cannot be sent to the workers of a cluster "
            f"({summarize_error(error)}); keep files, locks and connections out of it"
        ) from None


class _Watch:
    """Whether a cluster is still there: asked now and then while there is no news of chunks.

    Args:
        client: `distributed.Client`.
        patience: seconds that a study waits while the cluster has no workers.
    """

    def __init__(self, client: Any, patience: float):
        self.client, self.patience = client, patience
        self.note_news()

    def note_news(self) -> None:
        """Note that a worker has just been there."""
        self.last_answer = self.last_worker = time.monotonic()

    def require_cluster(self) -> None:
        """Raise ClusterLostError if the scheduler is gone, or there was no worker for too long."""
        if self.client.status in ("closing", "closed"):
            raise ClusterLostError(_LOST)
        if time.monotonic() - self.last_answer < min(_SECONDS_WITHOUT_NEWS, self.patience):
            return
        workers: list[Any] = []
        if not _call_within(_SECONDS_TO_ANSWER, lambda: workers.append(self.client.nthreads())):
            raise ClusterLostError(_LOST)
        self.last_answer = time.monotonic()
        if workers[0]:
            self.last_worker = self.last_answer
        elif self.last_answer - self.last_worker > self.patience:
            raise ClusterLostError(
                f"the cluster has had no worker for {self.patience:.0f} s; chunks that were "
                "computed are in the store: start workers and call jc.study again, or give a "
                "longer patience where they wait in a queue"
            )


def _call_within(seconds, function, *arguments):
    """Call a function that may wait for ever for a cluster; return whether it has ended in time."""
    ended = threading.Event()

    def call():
        with contextlib.suppress(Exception):  # of a cluster that is gone
            function(*arguments)
            ended.set()

    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    thread.join(seconds)
    return ended.is_set()


def _cancel_and_unregister(client, known, name):
    """Remove all that a cluster still has of a study."""
    client.cancel([future for _, future in known.values()], force=True)
    client.unregister_worker_plugin(name)


def _outcome_unless_lost(k, future):
    """Return the outcome of chunk `k`; None if it has to be computed again, or is not known yet."""
    if future.status == "error":
        return outcome_of(k, future)
    if future.status != "finished":
        return None
    try:
        return future.result(_SECONDS_TO_FETCH)
    except (TimeoutError, OSError):  # its worker, or the scheduler, has died
        return None
    except asyncio.CancelledError:
        raise ClusterLostError(_LOST) from None
    except Exception as error:  # an outcome that cannot be read is one of this chunk: it is told
        return k, error


def _has_killed(outcome):
    """Tell whether the workers that have computed a chunk have died."""
    return not isinstance(outcome, Done) and isinstance(outcome[1], KilledWorker)


def _bytes_of_chunk(cases, task):
    """Return the bytes of the cases of a chunk, which are sent with it."""
    return sum(leaf.nbytes for leaf in jax.tree.leaves(cases.block(task.grid.numbers(0))))


def _n_submitted(client, n_bytes):
    """Return how many chunks to submit at a time, so that no worker waits for the next one.

    `n_bytes` are sent with each.
    """
    if n_bytes == 0:
        return _MOST_SUBMITTED
    fitting = max(1, _MOST_BYTES // n_bytes)
    return min(_MOST_SUBMITTED, max(fitting, 2 * sum(client.nthreads().values())))


class StudyPlugin(WorkerPlugin):
    """What every worker gets of a study, when it starts or when the study begins.

    Args:
        name: of the study.
        content: its `ChunkTask`, as bytes.
        settings: of jax.
    """

    def __init__(self, name: str, content: bytes, settings: Settings):
        self.name, self.content, self.settings = name, content, settings
        self.task: ChunkTask | None = None

    def setup(self, worker: Any) -> None:
        """Prepare for the tasks that follow."""
        self.n_thread = worker.state.nthreads
        self.lock = threading.Lock()

    def compute(self, k: int, block: Block | None) -> Done:
        """Compute a chunk; the first call makes the function, and checks that it is the same."""
        with self.lock:
            if self.task is None:
                self.settings.apply(self.n_thread)  # before the task is made: its arrays start jax
                with jax.enable_x64(self.settings.x64):
                    task = pickle.loads(self.content)
                    task.require_same_study(block)
                self.task = task
            task = self.task
        with contextlib.nullcontext() if self.settings.fused else _one_at_a_time:
            return task(k, block)


_one_at_a_time = threading.Lock()


def compute_chunk(name: str, k: int, block: Block | None) -> Done:
    """Compute chunk `k` of a study on a worker; its cases are `block` if they are given."""
    plugin: Any = get_worker().plugins[name]
    return plugin.compute(k, block)
