"""More cases than memory or patience: results in files, chunk by chunk, shared by processes.

Cases do not need each other. So processes that share a study share a folder and nothing else: no
process waits for another, any of them can be killed, and any launcher can start them.

A folder belongs to one study, which ``study.json`` describes: the cases, and what is computed of
them, by their digests. Every file says of which study and which chunk it is (`chunk_files`). No
file is deleted, and none is replaced.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, TypeAlias

import jax
import numpy as np

from ..common import checks, digest
from ..common.fusion import are_loops_fused
from ..common.types import Array, Float, Int, PyTree
from ..common.writing import create_if_absent
from . import chunk_files
from .batches import batched
from .chunk_files import RECOMPUTE_HINT, ChunkIdentity

Cases: TypeAlias = "PyTree[Float[Array, 'n_case ...']]"

_STUDY_FILE = "study.json"
_CHUNK_IN_CACHE = 256  # cases: their data stay in cache
_N_COMPARED = 16  # cases that are compared where a function makes them


@dataclasses.dataclass(frozen=True)
class Study:
    """Cases whose results are files in a folder, a chunk of cases in each; made by `streamed`.

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
        """Number of chunks, which is the number of files."""
        return -(-self.n_case // self.chunk)

    @property
    def missing(self) -> list[int]:
        """Numbers of the chunks that have no file yet, a list."""
        return [k for k in range(self.n_chunk) if not self.file(k).exists()]

    def file(self, k: int) -> Path:
        """Return the path of the file of chunk `k`."""
        return self.folder / f"chunk-{k:06}.npz"

    def numbers(self, k: int) -> Int[np.ndarray, " n"]:
        """Return the numbers of the cases of chunk `k`, [n]."""
        return np.arange(k * self.chunk, min((k + 1) * self.chunk, self.n_case))

    def chunks(self) -> Iterator[tuple[Int[np.ndarray, " n"], dict[str, np.ndarray]]]:
        """Iterate over the chunks: numbers of cases, [n], and their results by name, [n, ...].

        Raises:
            ValueError: the folder holds another study; the file of a chunk is damaged, or it is of
                another study, or of another chunk.
        """
        there = [k for k in range(self.n_chunk) if self.file(k).exists()]
        study = self._study_digest(there)
        for k in there:
            numbers = self.numbers(k)
            yield (
                numbers,
                chunk_files.read_chunk(self.file(k), ChunkIdentity(study, k), len(numbers)),
            )

    def _study_digest(self, there):
        """Return the digest of this study that its files name; None for files of earlier versions.

        Where no ``study.json`` describes the study, it is the one in the first of the files
        `there`.
        """
        known = self._read_description()
        if known is None:
            return chunk_files.read_study_digest(self.file(there[0])) if there else None
        return chunk_files.study_digest(known) if "function" in known else None

    def _read_description(self):
        """Read ``study.json``, and check that it is of this study; None without such a file."""
        path = self.folder / _STUDY_FILE
        if not path.exists():
            return None
        known = _read_study_file(path)
        if (known["n_case"], known["chunk"]) != (self.n_case, self.chunk):
            raise ValueError(
                f"{self.folder}: holds a study of {known['n_case']} cases in chunks of "
                f"{known['chunk']}, not of {self.n_case} in chunks of {self.chunk}"
            )
        return known

    def load(self, *names: str) -> dict[str, np.ndarray]:
        """Load the results of all cases, a dict of arrays [n_case, ...]: those of `names`, or all.

        Raises:
            ValueError: cases are missing, there is no such result, the file of a chunk is damaged
                or of another study or chunk.
        """
        self._read_description()
        missing = self.missing
        if missing:
            raise ValueError(
                f"{self.folder}: {len(missing)} of {self.n_chunk} chunks are missing, the first is "
                f"{missing[0]}; run the study again to compute them"
            )
        parts = []
        for k, (_, results) in enumerate(self.chunks()):
            if parts and chunk_files.describe_results(results) != chunk_files.describe_results(
                parts[0]
            ):
                held, others = (
                    chunk_files.describe_results(results),
                    chunk_files.describe_results(parts[0]),
                )
                raise ValueError(
                    f"{self.file(k)}: holds {held}, other chunks {others}; {RECOMPUTE_HINT}"
                )
            parts.append(results)
        for name in names:
            if name not in parts[0]:
                raise ValueError(f"no result {name!r}{checks.suggest_names(name, parts[0])}")
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

    The folder of a study knows what is computed: the traced function with the values of all that it
    uses (the model, random keys), the backend of jax, whether loops are fused, and the cases. Of
    cases by a function it compares 16, and if there are more the function: its code, and all
    globals, functions and objects that the code uses. So do functions that the model calls on the
    host. A call with something else is refused, also one with another version of jaxcable or jax.
    Functions of libraries that run on the host count by name and version, and arrays in files
    (`np.memmap`) by name, size and time of writing.

    Args:
        function: of one case, to a dict of arrays, whose names may be any printable texts.
        cases: pytree of arrays [n_case, ...]; or a function from numbers of cases, [n], NumPy, to
            those of these cases, [n, ...], where all of them would not fit into memory. It has to
            return the same whenever it is called, and to change nothing that it uses.
        folder: where the results go; made if it is not there.
        chunk: number of cases in a file, and in memory.

    Options:
        n_case: number of cases, if `cases` is a function.
        share: (number of this process, from 0; number of processes): chunks are dealt in turn.

    Returns:
        `Study`; `missing` names the chunks of other processes that are not there yet.

    Raises:
        ValueError: the folder holds another study (of another function or model, of other cases, in
            chunks of another size, of another version), or files that are no study's, of another
            study or chunk, or damaged; no positive number of cases; no such share.

    Example:
        >>> import tempfile
        >>> def sag(force):
        ...     return {"sag": 10.0 / 8 * force}  # any analysis
        >>> study = jc.streamed(sag, np.linspace(0.0, 8.0, 5), tempfile.mkdtemp(), chunk=2)
        >>> study.missing, study.load("sag")["sag"].tolist()
        ([], [0.0, 2.5, 5.0, 7.5, 10.0])
    """
    checks.require_whole_number(chunk, "chunk")
    some, count, known_cases = _as_case_function(cases, n_case)
    rank, processes = _check_share(share)
    study = Study(Path(folder), count, chunk)
    compute = batched(function, min(_CHUNK_IN_CACHE, chunk, count))
    size = min(chunk, count)
    shapes = jax.tree.map(
        lambda leaf: jax.ShapeDtypeStruct((size, *leaf.shape[1:]), _jax_dtype(leaf)), known_cases
    )
    expected = _expected_results(compute, shapes)
    made_by = cases if callable(cases) and count > _N_COMPARED else None
    own = chunk_files.study_digest(_begin_study(study, compute, shapes, known_cases, made_by))
    mine = range(rank, study.n_chunk, processes)
    done = {k for k in mine if study.file(k).exists()}
    for k in sorted(done):
        chunk_files.require_chunk(
            study.file(k), ChunkIdentity(own, k), len(study.numbers(k)), expected
        )
    for k in mine:
        if k in done or study.file(k).exists():  # another process may have written it
            continue
        numbers = study.numbers(k)
        # the last chunk is filled up with its last case: one program serves for all
        filled = np.minimum(np.arange(k * chunk, k * chunk + size), count - 1)
        results = compute(some(filled))
        arrays = {name: np.asarray(value)[: len(numbers)] for name, value in results.items()}
        chunk_files.write_chunk(study.file(k), arrays, ChunkIdentity(own, k))
    return study


def _as_case_function(cases, n_case):
    """Return a function from numbers [n] to cases, the number of cases, and cases to compare."""
    if callable(cases):
        if n_case is None:
            raise ValueError(
                "n_case: missing; give the number of cases where `cases` is a function"
            )
        checks.require_whole_number(n_case, "n_case")
        numbers = np.unique(np.linspace(0, n_case - 1, min(n_case, _N_COMPARED)).astype(int))
        probed = jax.tree.map(np.asarray, cases(numbers))
        if _axis_lengths(probed) != {len(numbers)}:
            raise ValueError(
                f"cases: expected arrays [{len(numbers)}, ...] for {len(numbers)} numbers, got "
                f"{[leaf.shape for leaf in jax.tree.leaves(probed)]}"
            )
        return cases, n_case, probed
    cases = jax.tree.map(np.asarray, cases)
    counts = _axis_lengths(cases)
    if len(counts) != 1 or None in counts or 0 in counts:
        raise ValueError("cases: expected arrays with one common leading axis, [n_case, ...]")
    (count,) = counts
    if n_case not in (None, count):
        raise ValueError(f"n_case = {n_case}: there are {count} cases")
    return (lambda numbers: jax.tree.map(lambda leaf: leaf[numbers], cases)), count, cases


def _axis_lengths(cases):
    """Return the set of lengths of the leading axes of all arrays; None for one without axes."""
    return {len(leaf) if leaf.ndim else None for leaf in jax.tree.leaves(cases)}


def _jax_dtype(leaf):
    """Return the dtype that jax gives an array (float32 for float64 without x64)."""
    return jax.dtypes.canonicalize_dtype(leaf.dtype)


def _check_share(share):
    """Return (number of this process, number of processes); ValueError if they do not fit."""
    rank, processes = share
    checks.require_whole_number(rank, "share[0]", least=0)
    checks.require_whole_number(processes, "share[1]")
    if rank >= processes:
        raise ValueError(f"share = {tuple(share)}: processes are numbered from 0 to share[1] - 1")
    return rank, processes


def _expected_results(compute, shapes):
    """Return (shape, dtype) of the results of one case by name, without computing; check names."""
    results = jax.eval_shape(compute, shapes)
    if not isinstance(results, dict):
        raise ValueError(
            f"function: expected a dict of arrays by name, got {type(results).__name__}"
        )
    for name, value in results.items():
        if not isinstance(name, str) or not name or not name.isprintable():
            raise ValueError(f"function: the result {name!r} has no name of printable characters")
        if not isinstance(value, jax.ShapeDtypeStruct):
            raise ValueError(f"function: the result {name!r} is a {type(value).__name__}, no array")
        if getattr(value.dtype, "kind", "V") == "V":
            raise ValueError(
                f"function: the result {name!r} is of {value.dtype}, unknown to files of NumPy"
            )
    if not results:
        raise ValueError("function: expected a dict of arrays by name, got an empty one")
    return {name: (value.shape[1:], value.dtype.name) for name, value in results.items()}


def _begin_study(study, compute, shapes, cases, made_by):
    """Make the folder of a study, or check that it holds this one; return its description.

    Args:
        study: `Study`.
        compute: the function that solves a chunk of cases.
        shapes: shapes and dtypes of its argument.
        cases: cases by which the study is recognized.
        made_by: function that makes the cases, if not all of them are compared; None otherwise.
    """
    told = {
        "n_case": study.n_case,
        "chunk": study.chunk,
        "cases": digest.of_arrays(cases),
        "cases_function": None if made_by is None else digest.of_host_function(made_by),
        "jaxcable": _package_version("jaxcable"),
        "jax": jax.__version__,
        "backend": jax.default_backend(),
        "fuse_loops": are_loops_fused(),
        "function": digest.of_function(compute, shapes),
    }
    path = study.folder / _STUDY_FILE
    if study.folder.exists() and not study.folder.is_dir():
        raise ValueError(f"folder: {study.folder} is a file")
    if not path.exists():
        for k in range(study.n_chunk):
            if study.file(k).exists() and not path.exists():  # no other process has begun it
                raise ValueError(
                    f"folder: {study.folder} holds {study.file(k).name} but no {_STUDY_FILE} that "
                    "says what it is; take another folder, or move that file away"
                )
        study.folder.mkdir(parents=True, exist_ok=True)
        create_if_absent(path, json.dumps(told, indent=1).encode() + b"\n")
    known = _read_study_file(path)
    if "function" not in known:
        raise ValueError(
            f"folder: {study.folder} holds a study of an earlier version of jaxcable, which did "
            "not note what it computes; take another folder (results.Study still reads that one)"
        )
    other = [f"{k} = {known.get(k)}, not {v}" for k, v in told.items() if known.get(k) != v]
    if other:
        hint = ""
        if any(text.startswith("function") for text in other):
            hint = " (function: digest of what is computed, with the model and all arrays in it)"
        if any(text.startswith("cases_function") for text in other):
            hint += (
                " (cases_function: digest of the code of `cases`, with the globals, functions and "
                "objects that it uses, also those that it changes itself)"
            )
        raise ValueError(
            f"folder: {study.folder} holds a study with {'; '.join(other)}{hint}; take another "
            "folder, or delete this one"
        )
    return known


def _package_version(name):
    """Return the version of an installed package, "unknown" if it is not installed."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "unknown"


def _read_study_file(path):
    """Read ``study.json`` as a dict; ValueError if it is damaged, or not of jaxcable."""
    try:
        found = json.loads(path.read_text("utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(
            f"{path}: damaged, or not of jaxcable ({error}); take another folder, or move it away: "
            "without it nobody knows what the chunks beside it are"
        ) from None
    if not isinstance(found, dict) or not {"n_case", "chunk"} <= found.keys():
        raise ValueError(f"{path}: describes no study of jaxcable; take another folder")
    return found
