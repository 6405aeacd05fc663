"""Run the chunks of a study that are missing: progress, signals, and what could not be done."""

from __future__ import annotations

import concurrent.futures
import contextlib
import itertools
import math
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, TypeAlias

from ..common.fusion import are_loops_fused, usable_cores
from ..common.progress import as_listener
from .cases import Cases
from .errors import ClusterLostError, StudyError
from .store import CAUSE, ResultStore
from .task import ChunkTask, summarize_error

_MOST_FAILURES = 20  # chunks that may fail before the study is given up
_SECONDS_TO_STOP = 0.2  # after which it is asked again whether to stop
_SECONDS_TO_LOOK = 1.0  # after which it is asked again how many workers there are

Ended: TypeAlias = "Iterator[tuple[int, BaseException | None]]"
"""Numbers of chunks that have ended, and the exceptions of those that are not written."""
Stop: TypeAlias = Callable[[], bool]
"""Tells whether no further chunk shall begin."""


class ChunkReport(NamedTuple):
    """Report of a chunk of a study that has just been written.

    Attributes:
        chunk, chunks: number of chunks in the store, and of all.
        n_failed: number of cases that have failed, of those computed by this call.
        rate: cases a second, of this call.
        left: seconds that the others will take at this rate.

    Example:
        >>> print(jc.studies.ChunkReport(chunk=25, chunks=100, n_failed=3, rate=5000.0, left=15.0))
        chunk 25 of 100: 5000 cases a second, 3 failed, 0:15 left
    """

    chunk: int
    chunks: int
    n_failed: int
    rate: float
    left: float

    def __str__(self) -> str:
        failed = f", {self.n_failed} failed" if self.n_failed else ""
        minutes, seconds = divmod(round(self.left), 60)
        hours, minutes = divmod(minutes, 60)
        left = f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"
        return (
            f"chunk {self.chunk} of {self.chunks}: {self.rate:.0f} cases a second{failed}, "
            f"{left} left"
        )

    @property
    def first(self) -> bool:
        """Whether this is the first chunk of the study."""
        return self.chunk == 1


def compute_missing(
    store: ResultStore,
    task: ChunkTask,
    cases: Cases,
    client: Any,
    progress: bool | Callable[[Any], object] | None,
    patience: float,
) -> None:
    """Compute all chunks that the store lacks, in this process or on the cluster of a client.

    Raises:
        StudyError: chunks have failed.
        KeyboardInterrupt, SystemExit: the process has got a signal.
    """
    missing, listen = store.missing(), as_listener(progress)
    n_before, begin = store.grid.n_chunk - len(missing), time.monotonic()
    n_done = n_case = n_failed = 0
    failures: dict[int, Exception] = {}
    with _note_signals() as signals:

        def stop():
            return bool(signals) or len(failures) >= _MOST_FAILURES

        if client is None or not missing:
            ended = _compute_in_threads(task, missing, stop)
        else:
            from .dask_cluster import compute_on_cluster

            ended = compute_on_cluster(client, task, cases, missing, stop, patience)
        with contextlib.closing(ended):
            for k, error in ended:
                if isinstance(error, Exception):
                    failures[k] = error
                elif error is not None:
                    raise error
                elif listen is not None:
                    causes = store.read_chunk(CAUSE, k)
                    n_failed, n_case = n_failed + int((causes != "").sum()), n_case + causes.size
                    n_done, took = n_done + 1, max(time.monotonic() - begin, 1e-9)
                    left = took * (len(missing) - n_done) / n_done
                    number = n_before + n_done
                    listen(ChunkReport(number, store.grid.n_chunk, n_failed, n_case / took, left))
    if signals:
        is_from_keyboard = signals[0] == signal.SIGINT
        raise KeyboardInterrupt if is_from_keyboard else SystemExit(128 + signals[0])
    for k, error in failures.items():
        where = ", ".join(f"{s.start} to {s.stop - 1}" for s in store.grid.slices(k))
        more = f" ({len(failures)} chunks have failed so)" if len(failures) > 1 else ""
        raise StudyError(
            f"{store.path}: chunk {k} (cases {where}): {summarize_error(error)}{more}; missing "
            f"chunks: {len(store.missing())}; call jc.study again to compute them"
        ) from error


def _compute_in_threads(task, numbers, stop):
    """Compute chunks in threads of this process; yield each when it has ended.

    There is one thread for each core where loops are fused (`fuse_loops`), since a program keeps
    one core busy then. Otherwise there is one: XLA shares a program out to all cores.
    """
    n_thread = usable_cores() if are_loops_fused() else 1
    with concurrent.futures.ThreadPoolExecutor(n_thread) as pool:
        for part in numbers[:1], numbers[1:]:  # the first chunk compiles for all
            for k, future in as_ended(lambda k: pool.submit(task, k), part, stop, lambda: n_thread):
                yield k, future.exception()


def as_ended(
    submit: Callable[[int], Any],
    numbers: Iterable[int],
    stop: Stop,
    n_ahead: Callable[[], int],
    patience: float = math.inf,
) -> Iterator[tuple[int, Any]]:
    """Submit chunks, some of them ahead, and yield each with its future when it has ended.

    Args:
        submit: submits a chunk, and returns its future.
        numbers: numbers of chunks.
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


@contextlib.contextmanager
def _note_signals() -> Iterator[list[int]]:
    """Note the first signal to end, instead of obeying it; a second one is obeyed."""
    noted: list[int] = []
    in_main = threading.current_thread() is threading.main_thread()
    handlers = {
        own: handler
        for own in (signal.SIGINT, signal.SIGTERM)
        if in_main and (handler := signal.getsignal(own)) not in (None, signal.SIG_IGN)
    }  # (None: not set by Python)

    def obey_again():
        for own, handler in handlers.items():
            signal.signal(own, handler)

    def note(number, _):
        noted.append(number)
        obey_again()

    for own in handlers:
        signal.signal(own, note)
    try:
        yield noted
    finally:
        obey_again()
