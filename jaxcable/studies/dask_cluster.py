"""Compute chunks of a study on the workers of a Dask cluster.

The study is a task of its own, whose result all chunks need: Dask brings it once to every worker,
also to those that join later, and computes it again where the workers that had it have died. Chunks
whose workers have died several times are tried once more, alone, when all others are done: it shows
which of them have killed their workers.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import pickle
import threading
from collections.abc import Sequence
from typing import Any

import cloudpickle
import dask
import jax
from distributed import KilledWorker, get_worker

from .cases import Block, Cases
from .errors import ClusterLostError
from .submission import Ended, Stop, run_chunks
from .task import ChunkTask, summarize_error

_LARGE_CASES = 1 << 20  # bytes of stated cases that no worker needs all of
_CHUNKS_OF_THREAD = 4  # submitted for each thread of a worker, so that none waits for the next one
_SECONDS_TO_ANSWER = 30.0
_MOST_KILLED = 20  # chunks whose workers have died: then it is an error of all of them

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
    patience: float,
) -> Ended:
    """Compute chunks on the workers of a cluster; yield each when it has ended.

    Args:
        client: `distributed.Client`.
        task: what computes a chunk; its store has to be visible from all workers.
        cases: all cases; those of a chunk are sent with it if workers cannot make them.
        numbers: indices of chunks.
        stop: tells whether to begin no further chunk.
        patience: seconds to wait while there is no worker.

    Raises:
        ClusterLostError: the scheduler is gone, or no worker comes.
    """
    if sum(leaf.nbytes for leaf in jax.tree.leaves(cases.stated)) > _LARGE_CASES:
        task = dataclasses.replace(task, cases=None)
    with dask.config.set({"distributed.admin.large-graph-warning-threshold": 1 << 60}):
        content = client.submit(bytes, _serialize_task(task), pure=False)

    def submit(k):
        block = cases.block(task.grid.numbers(k)) if task.cases is None else None
        return client.submit(compute_chunk, content, k, block, pure=False)

    def n_ahead():
        try:
            threads = client.nthreads(callback_timeout=_SECONDS_TO_ANSWER)
        except Exception:  # of a scheduler that is gone there are many kinds
            raise ClusterLostError(_LOST) from None
        return _CHUNKS_OF_THREAD * sum(threads.values())

    def compute(numbers):
        for k, future in run_chunks(submit, numbers, stop, n_ahead, patience):
            if future.status == "cancelled":
                raise ClusterLostError(_LOST)
            # a result that has died with its worker has no exception: the chunk is in the store
            yield k, future.exception() if future.status == "error" else None

    killed: list[int] = []
    try:
        for k, error in compute(numbers):
            if isinstance(error, KilledWorker) and len(killed) < _MOST_KILLED:
                killed.append(k)
            else:
                yield k, error
        for k in killed:  # one alone: which of them has killed the workers?
            yield from compute([k])
    finally:
        with contextlib.suppress(Exception):  # of a cluster that is gone
            content.cancel(force=True)  # and with it all chunks that are not computed


def _serialize_task(task):
    """Return a task, with its settings, as bytes; ValueError if its function cannot be pickled."""
    try:  # (a copy, without what was traced here)
        return pickle.dumps((task.settings, cloudpickle.dumps(dataclasses.replace(task))))
    except Exception as error:  # of objects that cannot be pickled there are many kinds
        raise ValueError(
            "function: it, or what it uses, cannot be sent to the workers of a cluster "
            f"({summarize_error(error)}); keep files, locks and connections out of it"
        ) from None


_making_task, _one_at_a_time = threading.Lock(), threading.Lock()


@functools.lru_cache(maxsize=4)
def _deserialize_task(content):
    """Return the task of a study from its bytes; RuntimeError if it is another one here."""
    settings, as_bytes = pickle.loads(content)
    settings.apply(get_worker().state.nthreads)  # before the task is made: its arrays start jax
    with jax.enable_x64(settings.x64):
        task = pickle.loads(as_bytes)
        task.require_same_study()
    return task


def compute_chunk(content: bytes, k: int, block: Block | None) -> None:
    """Compute chunk `k` of a study on a worker.

    Args:
        content: the study, as bytes.
        k: number of the chunk.
        block: its cases, if they are given.
    """
    with _making_task:
        task = _deserialize_task(content)
    with contextlib.nullcontext() if task.settings.fused else _one_at_a_time:
        task(k, block)
