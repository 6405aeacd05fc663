"""Submit chunks of a study ahead, and learn which have ended; in threads of this process."""

from __future__ import annotations

import concurrent.futures
import contextlib
import itertools
import math
import queue
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from typing import Any, TypeAlias

from ..common.fusion import are_loops_fused, usable_cores
from .errors import ClusterLostError
from .task import ChunkTask

_SECONDS_TO_STOP = 0.2  # after which it is asked again whether to stop
_SECONDS_TO_LOOK = 1.0  # after which it is asked again how many workers there are

Ended: TypeAlias = "Generator[tuple[int, BaseException | None], None, None]"
"""Indices of chunks that have ended, and the exceptions of those that are not written."""
Stop: TypeAlias = Callable[[], bool]
"""Tells whether no further chunk shall begin."""


def compute_in_threads(task: ChunkTask, numbers: Sequence[int], stop: Stop) -> Ended:
    """Compute chunks in threads of this process; yield each when it has ended.

    There is one thread for each core where loops are fused (`fuse_loops`), since a program keeps
    one core busy then. Otherwise there is one: XLA shares a program out to all cores.
    """
    n_thread = usable_cores() if are_loops_fused() else 1
    with concurrent.futures.ThreadPoolExecutor(n_thread) as pool:
        for part in numbers[:1], numbers[1:]:  # the first chunk compiles for all
            for k, done in run_chunks(lambda k: pool.submit(task, k), part, stop, lambda: n_thread):
                yield k, done.exception()


def run_chunks(
    submit: Callable[[int], Any],
    numbers: Iterable[int],
    stop: Stop,
    n_ahead: Callable[[], int],
    patience: float = math.inf,
) -> Iterator[tuple[int, Any]]:
    """Submit chunks, some of them ahead, and yield each with its future when it has ended.

    Args:
        submit: submits a chunk, and returns its future.
        numbers: indices of chunks.
        stop: tells whether to begin no further chunk.
        n_ahead: returns how many chunks to submit before they have ended, 0 while there is no
            worker; called every second.
        patience: seconds to wait while there is no worker.

    Raises:
        ClusterLostError: there was no worker for too long.
    """
    waiting, n_submitted = iter(numbers), 0
    running: dict[int, Any] = {}
    ended: queue.SimpleQueue[int] = queue.SimpleQueue()
    looked, worked = -math.inf, time.monotonic()  # when workers were looked for, and found
    while not stop():
        if time.monotonic() > looked + _SECONDS_TO_LOOK:
            n_submitted, looked = n_ahead(), time.monotonic()
            worked = looked if n_submitted else worked
            if looked > worked + patience:
                raise ClusterLostError(
                    f"the cluster has had no worker for {patience:.0f} s; chunks that were "
                    "computed are in the store: start workers and call jc.study again, or give a "
                    "longer patience where they wait in a queue"
                )
        for k in itertools.islice(waiting, max(0, max(1, n_submitted) - len(running))):
            running[k] = submit(k)
            running[k].add_done_callback(lambda _, k=k: ended.put(k))
        if not running:
            return
        with contextlib.suppress(queue.Empty):
            k = ended.get(timeout=_SECONDS_TO_STOP)
            yield k, running.pop(k)
