"""One chunk of a study as a task: make its cases, compute them, write their results.

A task does the same in a thread of this process and on a worker of a cluster, which gets it as
bytes, and with it the settings of jax in the process that has begun the study.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import re
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
from ..common.types import PyTree
from ..programs.traced_function import TracedFunction, evaluate_traced, trace_function
from .cases import Block, Cases
from .grid import ChunkGrid
from .store import STATUS, ResultStore, fill_value

_CHUNK_IN_CACHE = 256  # cases: their data stay in cache
_LONGEST_CAUSE = 1000  # characters
_MOST_ERRORS = 16  # cases of a chunk that may raise; more of them are an error of the function


@dataclasses.dataclass(frozen=True)
class Settings:
    """Settings of jax that decide what a function computes, and how fast.

    Attributes:
        x64: whether numbers are in double precision.
        fused: whether loops are fused (`fuse_loops`).
        versions: of jaxcable and jax, and the backend of jax.
    """

    x64: bool
    fused: bool
    versions: tuple[str, str, str]

    @classmethod
    def of_current_process(cls) -> Settings:
        """Return the `Settings` that jax has in this process."""
        return cls(
            jax.dtypes.canonicalize_dtype(np.float64) == np.float64,
            are_loops_fused(),
            (package_version("jaxcable"), jax.__version__, jax.default_backend()),
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
        here = Settings.of_current_process()
        if (here.fused, here.versions) != (self.fused, self.versions):
            raise RuntimeError(
                f"this worker has {here.versions}, `fuse_loops` {here.fused}, and the study "
                f"{self.versions}, {self.fused} (versions of jaxcable and jax, backend); if they "
                "are the same, jax has already computed: restart the workers (client.restart())"
            )


def package_version(name: str) -> str:
    """Return the version of an installed package, "unknown" if it is not installed."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "unknown"


def summarize_error(error: BaseException) -> str:
    """Return the kind and the text of an exception in one line.

    What a function on the host raises is at the end of a traceback in the text of jax's exception.
    """
    lines = [line.strip() for line in str(error).splitlines() if line.strip()] or [""]
    first, last = lines[0], lines[-1]
    inner = re.fullmatch(r"[\w.]*(Error|Exception|Warning): .*", last)
    return (last if inner else f"{type(error).__name__}: {first}")[:_LONGEST_CAUSE]


def chunk_input_shapes(block: Block, grid: ChunkGrid) -> PyTree[jax.ShapeDtypeStruct]:
    """Return shapes and dtypes of the inputs of a whole chunk, for cases as in `block`."""
    return jax.tree.map(
        lambda leaf: jax.ShapeDtypeStruct(
            (grid.chunk_size, *leaf.shape[1:]), jax.dtypes.canonicalize_dtype(leaf.dtype)
        ),
        block,
    )


@dataclasses.dataclass(eq=False)
class ChunkTask:
    """Function that computes a chunk of a study, and writes its results.

    Attributes:
        function: of one case, to a dict of arrays.
        cases: makes the cases; None if they are given to every call.
        grid: chunks.
        shapes: of the cases of a whole chunk, as in `chunk_input_shapes`.
        path: folder of the store.
        settings: of jax.
    """

    function: Callable[[Any], dict[str, Any]]
    cases: Cases | None
    grid: ChunkGrid
    shapes: PyTree[jax.ShapeDtypeStruct]
    path: Path
    settings: Settings

    @functools.cached_property
    def traced(self) -> TracedFunction:
        """The function of a chunk of cases, traced once for all chunks, in one thread."""
        function = batched(self.function, min(_CHUNK_IN_CACHE, self.grid.chunk_size))
        return trace_function(function, self.shapes)

    @functools.cached_property
    def _store(self):
        """The store of the study, opened once as a `ResultStore`."""
        return ResultStore(self.path)

    def digest(self) -> str:
        """Return a digest of what the function computes, with all values that it captures."""
        return digest.function_digest(self.traced, self.shapes)

    def require_same_study(self) -> None:
        """Raise RuntimeError if this process has another function, or draws other cases.

        A worker imports functions of modules by their names, and may have other files. What runs on
        the host is not compared: its digest depends on which script has been started.
        """
        here = {} if self.cases is None else {"cases": self.cases.digest()}
        if "callback" not in str(self.traced.equations.jaxpr):
            here["function"] = self.digest()
        for name, text in here.items():
            if text != self._store.about[name]:
                raise RuntimeError(
                    f"this worker has another {name} (digest {text}) than the study "
                    f"({self._store.about[name]}): its modules are not those of the script; "
                    "restart the workers (client.restart())"
                )

    def __call__(self, k: int, block: Block | None = None) -> None:
        """Compute chunk `k`, whose cases are `block` if they are given, and write its results."""
        if block is None:
            assert self.cases is not None
            block = self.cases.block(self.grid.numbers(k))
        with jax.enable_x64(self.settings.x64):  # of this thread
            results, causes = self._compute_block(block)
        self._store.write(k, results, causes)

    def _compute_block(self, block):
        """Return results of all cases of a block, and causes of failure, [n] texts.

        A block for which the function raises is halved until the cases that do it are alone: they
        have NaN, like cases that fail. One program serves all: parts are filled up.
        """
        if jax.tree.flatten(chunk_input_shapes(block, self.grid)) != jax.tree.flatten(self.shapes):
            here = [str(leaf.dtype) for leaf in jax.tree.leaves(block)]
            there = [str(leaf.dtype) for leaf in jax.tree.leaves(self.shapes)]
            raise ValueError(f"cases: these are {here}, and others {there}, or have other shapes")
        count = len(jax.tree.leaves(block)[0])
        results = {
            name: np.full((count, *one.shape[1:]), fill_value(one.dtype), one.dtype)
            for name, one in self.traced.result.items()
        }
        parts, errors = [np.arange(count)], {}
        while parts:
            part = parts.pop()
            filled = np.resize(part, self.grid.chunk_size)
            try:
                found = evaluate_traced(self.traced, jax.tree.map(lambda x, k=filled: x[k], block))
                for name, values in found.items():
                    results[name][part] = np.asarray(values)[: len(part)]
            except Exception as error:  # whatever a user's function raises
                if len(part) > 1:
                    parts += np.array_split(part, 2)[::-1]
                    continue
                errors[int(part[0])] = error
                if len(errors) > min(_MOST_ERRORS, count - 1):
                    raise next(iter(errors.values())) from None
        causes = np.full(count, "", object)
        for code in np.unique(results.get(STATUS, status.OK)):
            if code != status.OK:
                known = int(code) in status.NAMES
                text = status.describe(int(code)) if known else f"status {code}"
                causes[results[STATUS] == code] = text
        for number, raised in errors.items():
            causes[number] = summarize_error(raised)
        return results, causes
