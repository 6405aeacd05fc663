"""One chunk of a study as a task: make its cases, compute them, write their results.

A task does the same in a thread of this process and on a worker of a cluster. There it is sent as
bytes, which are made to an object again once; the settings of jax are those of the process that has
begun the study.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import re
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..analysis.batches import batched
from ..common import digest, status
from ..common.fusion import are_loops_fused, request_fused_loops
from ..common.jax_internals import has_xla_started
from ..common.kept_programs import keep_programs, kept_programs_folder
from ..common.types import PyTree
from ..programs.traced_function import TracedFunction, evaluate_traced, trace_function
from .cases import Block, Cases
from .grid import ChunkGrid
from .store import CAUSE, STATUS, ResultStore, fill_value

_CHUNK_IN_CACHE = 256  # cases: their data stay in cache
_LONGEST_CAUSE = 1000  # characters
_MOST_ERRORS = 16  # cases of a chunk that may raise; more of them are an error of the function


@dataclasses.dataclass(frozen=True)
class Settings:
    """Settings of jax that decide what a function computes, and how fast.

    Attributes:
        x64: whether numbers are in double precision.
        fused: whether loops are fused (`fuse_loops`).
        programs: folder in which compiled programs are kept, or None.
        versions: of jaxcable and jax, and the backend of jax.
    """

    x64: bool
    fused: bool
    programs: str | None
    versions: tuple[str, str, str]

    @classmethod
    def of_this_process(cls, programs: str | os.PathLike[str] | None) -> Settings:
        """Return the settings of this process; `programs` is another folder, or None."""
        folder = (
            kept_programs_folder() if programs is None else Path(programs).expanduser().absolute()
        )
        return cls(
            jax.dtypes.canonicalize_dtype(np.float64) == np.float64,
            are_loops_fused(),
            None if folder is None else str(folder),
            versions_in_use(),
        )

    def apply(self, n_thread: int) -> None:
        """Make these the settings of this process, a worker.

        Args:
            n_thread: number of chunks that the worker computes at once, each by one core where
                loops are fused: XLA gets as many threads, since those of several workers would
                disturb each other.

        Raises:
            RuntimeError: jax has already computed with loops fused or not, unlike here; other
                versions, or another backend.
        """
        if self.fused and not are_loops_fused():
            request_fused_loops()
        if self.fused and not has_xla_started():
            os.environ["NPROC"] = str(n_thread)  # what XLA asks for the size of its pool
        if are_loops_fused() != self.fused:
            raise RuntimeError(
                "jax has already computed on this worker, with other settings of `fuse_loops` than "
                "the study has; restart the workers (client.restart())"
            )
        if self.programs is not None and str(kept_programs_folder()) != self.programs:
            keep_programs(self.programs)
        if versions_in_use() != self.versions:
            raise RuntimeError(
                f"this worker has {versions_in_use()}, and the study {self.versions} (versions of "
                "jaxcable and jax, backend)"
            )


def versions_in_use() -> tuple[str, str, str]:
    """Return the versions of jaxcable and jax, and the backend of jax."""
    return package_version("jaxcable"), jax.__version__, jax.default_backend()


def package_version(name: str) -> str:
    """Return the version of an installed package, "unknown" if it is not installed."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "unknown"


@dataclasses.dataclass(frozen=True)
class Done:
    """What the process that has begun the study is told of a chunk.

    Attributes:
        k: number of the chunk.
        n_case, n_failed: number of its cases, and of those that have failed.
        seconds: time of computing, and of writing.
    """

    k: int
    n_case: int
    n_failed: int
    seconds: tuple[float, float]


def summarize_error(error: Exception) -> str:
    """Return the kind and the text of an exception in one line.

    What a function on the host raises is at the end of a traceback in the text of jax's exception.
    """
    lines = [line.strip() for line in str(error).splitlines() if line.strip()] or [""]
    first, last = lines[0], lines[-1]
    inner = re.fullmatch(r"[\w.]*(Error|Exception|Warning): .*", last)
    return (last if inner else f"{type(error).__name__}: {first}")[:_LONGEST_CAUSE]


def map_over_chunk(
    function: Callable[[Any], dict[str, Any]], grid: ChunkGrid
) -> Callable[[Block], dict[str, Any]]:
    """Return the function of a chunk of cases, for that of one case."""
    return batched(function, min(_CHUNK_IN_CACHE, grid.chunk_size))


def chunk_shapes(block: Block, grid: ChunkGrid) -> PyTree[jax.ShapeDtypeStruct]:
    """Return shapes and dtypes of a chunk of cases, from those of some cases."""
    return jax.tree.map(
        lambda leaf: jax.ShapeDtypeStruct(
            (grid.chunk_size, *leaf.shape[1:]), jax.dtypes.canonicalize_dtype(leaf.dtype)
        ),
        block,
    )


class ChunkTask:
    """Function that computes a chunk of a study, and writes its results.

    Args:
        function: of one case, to a dict of arrays.
        cases: makes the cases; None if they are given to every call.
        grid: chunks.
        path: folder of the store.
        x64: whether numbers are in double precision.
    """

    def __init__(
        self,
        function: Callable[[Any], dict[str, Any]],
        cases: Cases | None,
        grid: ChunkGrid,
        path: Path,
        x64: bool,
    ):
        self.function, self.cases, self.grid, self.path = function, cases, grid, path
        self.x64 = x64
        self._traced: TracedFunction | None = None

    def __reduce__(self):
        return ChunkTask, (self.function, self.cases, self.grid, self.path, self.x64)

    def trace(self, block: Block) -> TracedFunction:
        """Return the function of a chunk of cases, traced at the first call, for all chunks.

        It takes no threads beside the calling one.
        """
        if self._traced is None:
            function = map_over_chunk(self.function, self.grid)
            self._traced = trace_function(function, chunk_shapes(block, self.grid))
        return self._traced

    def require_same_study(self, block: Block | None) -> None:
        """Raise RuntimeError if this process has another function, or draws other cases.

        A worker imports functions of modules by their names, and may have other files. What runs on
        the host is not compared: its digest depends on which script has been started.
        """
        about = self._store.about
        if block is None:
            block = self.cases.block(np.array([0]))
            self._require_equal("cases", self.cases.digests()["cases"], about["cases"])
        traced = self.trace(block)
        if "callback" not in str(traced.equations.jaxpr):
            text = digest.of_function(traced, chunk_shapes(block, self.grid))
            self._require_equal("function", text, about["function"])

    def _require_equal(self, name, here, there):
        if here != there:
            raise RuntimeError(
                f"this worker has another {name} (digest {here}) than the study ({there}): its "
                "modules are not those of the script; restart the workers (client.restart())"
            )

    @functools.cached_property
    def _store(self):
        return ResultStore(self.path)

    def __call__(self, k: int, block: Block | None = None) -> Done:
        """Compute chunk `k`, whose cases are `block` if they are given, and write its results."""
        with jax.enable_x64(self.x64):  # of this thread
            return self._compute_and_write(k, block)

    def _compute_and_write(self, k, block):
        begin = time.perf_counter()
        if self._store.is_complete(k):  # by a worker that has died before it could say so
            causes = self._store.read_chunk(CAUSE, k).ravel()
            return Done(k, len(causes), int((causes != "").sum()), (0.0, 0.0))
        if block is None:
            block = self.cases.block(self.grid.numbers(k))
        results, causes = self._compute_all(block)
        middle = time.perf_counter()
        self._store.write(k, results, causes)
        spent = middle - begin, time.perf_counter() - middle
        return Done(k, len(causes), int((causes != "").sum()), spent)

    def _compute_all(self, block):
        """Return results of all cases of a block, and causes of failure, [n] texts.

        A case for which the function raises an exception has NaN, like one that fails.
        """
        count = len(jax.tree.leaves(block)[0])
        causes = np.full(count, "", object)
        parts, errors = [], {}
        for numbers, results in self._compute_without_errors(block, np.arange(count), errors):
            parts.append((numbers, results))
        if not parts:
            raise next(iter(errors.values()))
        results = {
            name: np.full((count, *value.shape[1:]), fill_value(value.dtype), value.dtype)
            for name, value in parts[0][1].items()
        }
        for numbers, found in parts:
            for name, value in found.items():
                results[name][numbers] = value
        if STATUS in results:
            for code in np.unique(results[STATUS][[*set(range(count)) - set(errors)]]):
                if code != status.OK:
                    known = int(code) in status.NAMES
                    text = status.describe(int(code)) if known else f"status {code}"
                    causes[results[STATUS] == code] = text
        for number, error in errors.items():  # (which have no status)
            causes[number] = summarize_error(error)
        return results, causes

    def _compute_without_errors(self, block, numbers, errors):
        """Yield (numbers, results) of those cases of a block that raise nothing.

        A block for which the function raises is halved until the cases that do it are alone; they
        go to `errors`, by their number. One program serves all: parts are filled up.
        """
        size = self.grid.chunk_size
        filled = numbers[np.minimum(np.arange(size), len(numbers) - 1)]
        try:
            found = evaluate_traced(
                self.trace(block), jax.tree.map(lambda leaf: leaf[filled], block)
            )
            yield (
                numbers,
                {name: np.asarray(value)[: len(numbers)] for name, value in found.items()},
            )
            return
        except Exception as error:  # whatever a user's function raises: it becomes the case's cause
            if len(numbers) == 1:
                errors[int(numbers[0])] = error
                if len(errors) > _MOST_ERRORS:
                    raise
                return
        for half in np.array_split(numbers, 2):
            yield from self._compute_without_errors(block, half, errors)
