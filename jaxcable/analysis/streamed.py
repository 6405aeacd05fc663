"""More cases than memory or patience: results in files, chunk by chunk, shared by processes.

Cases do not need each other. So processes that share a study share a folder and nothing else: no
process waits for another, any of them can be killed, and any launcher can start them.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import jax
import numpy as np

from ..common import checks
from ..common.types import Array, Float, Int, PyTree
from .batches import batched

Cases: TypeAlias = "PyTree[Float[Array, 'n_case ...']]"

_STUDY = "study.json"
_AT_ONCE = 256  # cases: their data stay in cache


@dataclasses.dataclass(frozen=True)
class Study:
    """Cases whose results are files in a folder; made by `streamed`.

    Attributes:
        folder: where the files are: ``chunk-000000.npz`` and so on.
        n_case: number of cases.
        chunk: number of cases in a file; the last may have fewer.

    Example:
        What an earlier process has left in a folder:

        >>> import tempfile
        >>> folder = tempfile.mkdtemp()
        >>> study = jc.streamed(lambda x: {"double": 2 * x}, np.arange(3.0), folder, chunk=2)
        >>> for numbers, results in jc.results.Study(study.folder, n_case=3, chunk=2).chunks():
        ...     print(numbers.tolist(), results["double"].tolist())
        [0, 1] [0.0, 2.0]
        [2] [4.0]
    """

    folder: Path
    n_case: int
    chunk: int

    @property
    def n_chunk(self) -> int:
        """Number of chunks."""
        return -(-self.n_case // self.chunk)

    @property
    def missing(self) -> list[int]:
        """Numbers of the chunks that have no results yet."""
        return [k for k in range(self.n_chunk) if not self.file(k).exists()]

    def file(self, k: int) -> Path:
        """The file of chunk `k`."""
        return self.folder / f"chunk-{k:06}.npz"

    def numbers(self, k: int) -> Int[np.ndarray, " n"]:
        """Numbers of the cases of chunk `k`, [n]."""
        return np.arange(k * self.chunk, min((k + 1) * self.chunk, self.n_case))

    def chunks(self) -> Iterator[tuple[Int[np.ndarray, " n"], dict[str, np.ndarray]]]:
        """Numbers of cases, [n], and their results by name, [n, ...], chunk by chunk."""
        for k in range(self.n_chunk):
            if self.file(k).exists():
                with np.load(self.file(k)) as results:
                    yield self.numbers(k), {name: results[name] for name in results.files}

    def load(self, *names: str) -> dict[str, np.ndarray]:
        """Results of all cases by name, [n_case, ...]: those of `names`, or all.

        Raises:
            ValueError: cases are missing.
        """
        missing = self.missing
        if missing:
            raise ValueError(
                f"{self.folder}: {len(missing)} of {self.n_chunk} chunks are missing, the first is "
                f"{missing[0]}; run the study again, it goes on where it was"
            )
        parts = [results for _, results in self.chunks()]
        return {name: np.concatenate([part[name] for part in parts]) for name in names or parts[0]}


def streamed(
    function: Callable[[Any], dict[str, Array]],
    cases: Cases | Callable[[Int[np.ndarray, " n"]], Cases],
    folder: str | os.PathLike[str],
    chunk: int = 1000,
    *,
    n_case: int | None = None,
    share: Sequence[int] = (0, 1),
) -> Study:
    """Map a function of one case over many, with results in files.

    Every chunk of cases is a file, written as a whole or not at all. What is there already is not
    computed again: a study whose process was killed goes on where it was, by the same call.
    Processes, of one machine or of several with a common folder, share the chunks out. Within a
    process a chunk is solved by `batched`.

    Args:
        function: of one case, to a dict of arrays.
        cases: pytree of arrays [n_case, ...]; or a function from numbers of cases, [n], NumPy, to
            those of these cases, [n, ...], where all of them would not fit into memory.
        folder: where the results go; made if it is not there.
        chunk: number of cases in a file, and in memory.

    Options:
        n_case: number of cases, if `cases` is a function.
        share: (number of this process, from 0; number of processes): chunks are dealt in turn.

    Returns:
        `Study`; `missing` names the chunks of other processes that are not there yet.

    Raises:
        ValueError: the folder holds another study (of other cases, or in chunks of another size);
            no positive number of cases; no such share.

    Example:
        >>> import tempfile
        >>> def sag(force):
        ...     return {"sag": 10.0 / 8 * force}  # any analysis
        >>> study = jc.streamed(sag, np.linspace(0.0, 8.0, 5), tempfile.mkdtemp(), chunk=2)
        >>> study.missing, study.load("sag")["sag"].tolist()
        ([], [0.0, 2.5, 5.0, 7.5, 10.0])
    """
    checks.whole(chunk, "chunk")
    some, count, digest = _cases(cases, n_case)
    rank, processes = _share(share)
    study = Study(Path(folder), count, chunk)
    _begin(study, digest)
    compute = batched(function, min(_AT_ONCE, chunk, count))
    for k in range(rank, study.n_chunk, processes):
        if study.file(k).exists():
            continue
        numbers = study.numbers(k)
        # the last chunk is filled up with its last case: one program serves for all
        filled = np.minimum(np.arange(k * chunk, k * chunk + min(chunk, count)), count - 1)
        results = compute(some(filled))
        if not isinstance(results, dict):
            raise ValueError(
                f"function: expected a dict of arrays by name, got {type(results).__name__}"
            )
        _write(study.file(k), {n: np.asarray(a)[: len(numbers)] for n, a in results.items()})
    return study


def _cases(cases, n_case):
    """A function from numbers to cases, the number of cases, and a digest of arrays or None."""
    if callable(cases):
        if n_case is None:
            raise ValueError("n_case: missing; a function of cases does not tell their number")
        checks.whole(n_case, "n_case")
        return cases, n_case, None
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(cases)]
    counts = {len(leaf) if leaf.ndim else None for leaf in leaves}
    if len(counts) != 1 or None in counts or 0 in counts:
        raise ValueError("cases: expected arrays with one common leading axis, [n_case, ...]")
    (count,) = counts
    if n_case not in (None, count):
        raise ValueError(f"n_case = {n_case}: there are {count} cases")
    digest = hashlib.blake2b(digest_size=16)
    for leaf in leaves:
        digest.update(repr((leaf.shape, leaf.dtype.str)).encode() + leaf.tobytes())

    def some(numbers):
        return jax.tree.map(lambda leaf: np.asarray(leaf)[numbers], cases)

    return some, count, digest.hexdigest()


def _share(share):
    """Number of this process and number of processes, checked."""
    rank, processes = share
    checks.whole(rank, "share[0]", least=0)
    checks.whole(processes, "share[1]")
    if rank >= processes:
        raise ValueError(f"share = {tuple(share)}: processes are numbered from 0 to share[1] - 1")
    return rank, processes


def _begin(study, digest):
    """Make the folder of a study, or see that it holds this one."""
    study.folder.mkdir(parents=True, exist_ok=True)
    told = {"n_case": study.n_case, "chunk": study.chunk, "cases": digest}
    path = study.folder / _STUDY
    if not path.exists():
        _replace(path, lambda file: file.write(json.dumps(told).encode()))
    known = json.loads(path.read_text())
    for name, value in told.items():
        if known.get(name) != value:
            raise ValueError(
                f"folder: {study.folder} holds a study with {name} = {known.get(name)}, not {value}"
            )


def _write(path, results):
    """Write results as a whole or not at all."""
    _replace(path, lambda file: np.savez(file, **results))


def _replace(path, write):
    """Put a file in its place when it has been written."""
    name = None
    try:
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".new", delete=False) as file:
            name = file.name
            write(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(name, path)
    except BaseException:
        if name is not None:
            with contextlib.suppress(OSError):
                os.unlink(name)
        raise
