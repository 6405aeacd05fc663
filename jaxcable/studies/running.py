"""Run the chunks of a study that are missing: progress, signals, and what could not be done."""

from __future__ import annotations

import contextlib
import secrets
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from ..common.progress import as_listener
from .cases import Cases
from .errors import StudyError
from .store import ResultStore
from .task import ChunkTask, Done, Settings, summarize_error
from .threads import compute_in_threads

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


def compute_missing(
    store: ResultStore,
    task: ChunkTask,
    cases: Cases,
    client: Any,
    settings: Settings,
    progress: bool | Callable[[Any], object] | None,
    patience: float,
) -> None:
    """Compute all chunks that the store lacks, in this process or on the cluster of a client.

    Raises:
        StudyError: chunks have failed.
        KeyboardInterrupt, SystemExit: the process has got a signal.
    """
    missing, listen = store.missing(), as_listener(progress)
    if not missing:
        return
    failures: dict[int, Exception] = {}
    n_done = n_case = n_failed = 0
    begin = time.monotonic()
    with _note_signals() as signals:

        def stop():
            return bool(signals) or len(failures) >= _MOST_FAILURES

        if client is None:
            outcomes = compute_in_threads(task, missing, stop)
        else:
            from .dask_cluster import compute_on_cluster

            name = f"jaxcable-{store.digest}-{secrets.token_hex(4)}"
            outcomes = compute_on_cluster(
                client, task, cases, missing, stop, settings, name, patience
            )
        with contextlib.closing(outcomes):
            for outcome in outcomes:
                if not isinstance(outcome, Done):
                    failures.update([outcome])
                    continue
                n_done, n_case = n_done + 1, n_case + outcome.n_case
                n_failed += outcome.n_failed
                if listen is not None:
                    rate = n_case / max(time.monotonic() - begin, 1e-9)
                    left = (len(missing) - n_done) * task.grid.chunk_size / rate
                    number = task.grid.n_chunk - len(missing) + n_done
                    listen(ChunkReport(number, task.grid.n_chunk, n_failed, rate, left))
    if signals == [signal.SIGINT]:
        raise KeyboardInterrupt
    if signals:
        raise SystemExit(128 + signals[0])
    if failures:
        first = next(iter(failures.values()))
        raise StudyError(_failure_text(store, failures, len(missing) - n_done)) from first


def _failure_text(store, failures, n_left):
    """Return the text of a StudyError: which chunks have failed, why, and what to do."""
    k, error = next(iter(failures.items()))
    where = ", ".join(f"{s.start} to {s.stop - 1}" for s in store.grid.slices(k))
    more = f" ({len(failures)} chunks have failed so)" if len(failures) > 1 else ""
    return (
        f"{store.path}: chunk {k} (cases {where}): {summarize_error(error)}{more}; missing "
        f"chunks: {n_left}; call jc.study again to compute them"
    )


@contextlib.contextmanager
def _note_signals() -> Iterator[list[int]]:
    """Note the first signal to end, instead of obeying it; a second one is obeyed."""
    noted: list[int] = []
    before: dict[int, Any] = {}

    def note(number, _):
        noted.append(number)
        for own, handler in before.items():
            signal.signal(own, handler)

    if threading.current_thread() is threading.main_thread():
        for own in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(own) not in (None, signal.SIG_IGN):  # None: not set by Python
                before[own] = signal.signal(own, note)
    try:
        yield noted
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
