"""Compute chunks of a study in threads of this process."""

from __future__ import annotations

import concurrent.futures
from collections.abc import Callable, Generator, Sequence
from typing import Any, TypeAlias

from ..common.fusion import are_loops_fused, usable_cores
from .task import ChunkTask, Done

Outcome: TypeAlias = "Done | tuple[int, Exception]"
"""What has become of a chunk: written, or its number and why not."""
Stop: TypeAlias = Callable[[], bool]
"""Tells whether no further chunk shall begin."""

SECONDS_TO_STOP = 0.2
"""Seconds after which it is asked again whether to stop."""


def compute_in_threads(task: ChunkTask, numbers: Sequence[int], stop: Stop) -> Generator[Outcome]:
    """Compute chunks in threads of this process, and yield what has become of each.

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
            ended, _ = concurrent.futures.wait(
                running, SECONDS_TO_STOP, concurrent.futures.FIRST_COMPLETED
            )
            for future in ended:
                wanted = _n_thread()
                yield outcome_of(running.pop(future), future)


def outcome_of(k: int, future: Any) -> Outcome:
    """Return the outcome of chunk `k` from its finished future, of threads or of Dask."""
    error = future.exception()
    if error is None:
        return future.result()
    if not isinstance(error, Exception):
        raise error
    return k, error


def _n_thread():
    """Return how many chunks are computed at once in this process."""
    return usable_cores() if are_loops_fused() else 1
