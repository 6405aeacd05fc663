"""Run the chunks of a study that are missing: progress, signals, and what could not be done."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from ..common.progress import as_listener
from .cases import Cases
from .errors import StudyError
from .store import CAUSE, ResultStore
from .submission import compute_in_threads
from .task import ChunkTask, summarize_error

_MOST_FAILURES = 20  # chunks that may fail before the study is given up


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


def compute_missing_chunks(
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
    with _collect_signals() as signals:

        def stop():
            return bool(signals) or len(failures) >= _MOST_FAILURES

        if client is None or not missing:
            ended = compute_in_threads(task, missing, stop)
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


@contextlib.contextmanager
def _collect_signals() -> Iterator[list[int]]:
    """Collect SIGINT and SIGTERM in a list, the value of the context, instead of obeying the first.

    A second one is obeyed.
    """
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
