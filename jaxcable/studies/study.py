"""`jc.study`: a function of one case mapped over many named cases, with results in a Zarr store."""

from __future__ import annotations

import dataclasses
import importlib.util
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import jax
import numpy as np

from ..common import checks, digest
from ..common.progress import as_listener
from ..common.types import Array, ArrayLike, PyTree
from .cases import Cases, require_numbers, table
from .grid import divide_into_chunks
from .running import compute_missing_chunks
from .store import CAUSE, ResultStore, create_store, describe_arrays
from .task import ChunkTask, Settings, chunk_input_shapes


@dataclasses.dataclass(frozen=True)
class Study:
    """Results of a study in a Zarr store; made by `jaxcable.study`.

    Attributes:
        store: folder of the store.

    Example:
        What an earlier process has left in a folder:

        >>> import tempfile, pathlib
        >>> store = pathlib.Path(tempfile.mkdtemp()) / "sags.zarr"
        >>> cases = jc.studies.product(force=[1.0, 2.0], span=[8.0, 16.0, 24.0])
        >>> _ = jc.study(lambda case: {"sag": case["force"] * case["span"]}, cases, store)
        >>> study = jc.studies.Study(store)
        >>> study.n_case, study.missing, study.load("sag")["sag"].tolist()
        (6, [], [[8.0, 16.0, 24.0], [16.0, 32.0, 48.0]])
    """

    store: Path

    @property
    def n_case(self) -> int:
        """Number of cases."""
        return int(np.prod(self._opened.grid.shape))

    @property
    def missing(self) -> list[int]:
        """Indices of the chunks of cases that are not computed yet, a list."""
        return self._opened.missing()

    @property
    def failures(self) -> dict[int, str]:
        """Why cases have failed: a text by index of each failed case."""
        causes = self._opened.read(CAUSE).ravel()
        return {int(k): str(causes[k]) for k in np.flatnonzero(causes != "")}

    @property
    def _opened(self):
        """The store, opened as a `ResultStore`; ValueError if there is none."""
        return ResultStore(Path(self.store))

    def load(self, *names: str) -> dict[str, np.ndarray]:
        """Load the results of all cases into memory: those of `names`, or all.

        Returns:
            Arrays by name, whose first axes are the dimensions of the cases.

        Raises:
            ValueError: cases are missing, or there is no such result.
        """
        opened = self._opened
        missing = opened.missing()
        if missing:
            raise ValueError(
                f"{self.store}: {len(missing)} of {opened.grid.n_chunk} chunks are missing, the "
                f"first is {missing[0]}; run the study again to compute them"
            )
        for name in names:
            if name not in opened.names:
                raise ValueError(f"no result {name!r}{checks.suggest_names(name, opened.names)}")
        return {name: opened.read(name) for name in names or opened.names}

    def open(self) -> Any:
        """Open the store as an `xarray.Dataset`, which loads what is used of it."""
        _require_package("xarray", "studies", "opening a study as a dataset")
        import xarray

        return xarray.open_zarr(self.store, chunks=None)


def study(
    function: Callable[[Any], dict[str, Array]],
    cases: Cases | PyTree[ArrayLike],
    store: str | PathLike[str],
    client: Any = None,
    *,
    chunk: int = 1000,
    dims: Mapping[str, Sequence[str]] | None = None,
    units: Mapping[str, str] | None = None,
    coords: Mapping[str, ArrayLike] | None = None,
    progress: bool | Callable[[Any], object] | None = None,
    patience: float = 600.0,
) -> Study:
    """Map a function of one case over many named cases, with results in a Zarr store.

    Cases are computed in chunks. A chunk is marked as completed when all of it is written, and is
    not computed again then: the same call completes a study that was interrupted. With a client of
    Dask (`distributed.Client`) the chunks are tasks of its cluster; without one, threads of this
    process compute them. xarray opens the store, with names, units and coordinates.

    The store knows what is computed: the traced function with the values of all that it uses (the
    model, random keys), the cases, the versions of jaxcable and jax, the backend, and whether loops
    are fused. A call that computes something else is refused. Of cases that a function draws,
    sixteen are compared, and the function: its code, with all globals, functions and objects that
    it uses. So are functions that the model calls on the host.

    A case that fails does not disturb the others: ``cause`` has the text of its status. If the
    function raises an exception for a case, its results are NaN, and ``cause`` has the message.

    Ctrl-C (and SIGTERM) ends the study when the chunks in progress are written; on a cluster it
    leaves these to the workers.

    Args:
        function: of one case, to a dict of arrays; the result ``status`` should be among them.
        cases: `jaxcable.studies.product`, `table` or `samples`; or a pytree of arrays [n_case, ...]
            for `table`.
        store: folder, usually with a name that ends with ``.zarr``; made if it is not there. All
            workers of a cluster have to see it.
        client: `distributed.Client`, or None.

    Options:
        chunk: largest number of cases in a chunk.
        dims: names of the axes of results, by name of the result: ``{"tension": ["element"]}``.
        units: units, by name of a result or coordinate: ``{"sag": "m"}``.
        coords: values or names along dimensions of results: ``{"element": names}``.
        progress: True prints a line every half second: chunks, failed cases, speed, time left; a
            function gets the reports.
        patience: seconds that a study waits while a cluster has no workers; ``math.inf`` where they
            may stand in a queue for any time.

    Returns:
        `jaxcable.studies.Study`.

    Raises:
        ValueError: the store holds another study, or something else; wrong names, dims, units,
            coords or cases.
        StudyError: chunks could not be computed (the function raises for nearly all of their cases,
            a worker died several times) or written (the disk is full). All others are there.
        ClusterLostError: the scheduler is gone, or there were no workers for too long.
        ModuleNotFoundError: zarr is missing: ``pip install "jaxcable[studies]"``.

    Example:
        >>> import tempfile, pathlib
        >>> store = pathlib.Path(tempfile.mkdtemp()) / "sags.zarr"
        >>> def sag(case):  # any analysis
        ...     return {"sag": case["load"] * case["span"] ** 2 / (8 * case["force"])}
        >>> cases = jc.studies.product(load=[1e3, 2e3], span=[40.0], force=[2e5, 3e5, 4e5])
        >>> found = jc.study(sag, cases, store, units={"sag": "m", "force": "N"}).open()
        >>> found.sag.sel(load=2e3, force=2e5).item(), found.sag.units
        (2.0, 'm')
    """
    checks.require_whole_number(chunk, "chunk")
    as_listener(progress)
    settings = Settings.of_current_process()
    if not patience > 0:
        raise ValueError(f"patience = {patience!r}: expected a positive number of seconds")
    _require_package("zarr", "studies", "a study")
    _require_client(client)
    cases = cases if isinstance(cases, Cases) else table(cases)
    grid, path = divide_into_chunks(cases.shape, chunk), Path(store).absolute()
    shapes = chunk_input_shapes(cases.block(np.array([0])), grid)
    task = ChunkTask(function, cases, grid, shapes, path, settings)
    try:
        results = _results_of_one_case(task.traced.result)
    except TypeError as error:
        raise ValueError(f"function: {error}") from error
    named = {name: np.asarray(values) for name, values in _as_dict(coords, "coords").items()}
    units = _as_dict(units, "units")
    arrays = describe_arrays(results, cases, grid, _as_dict(dims, "dims"), units, named)
    about = {
        "shape": list(grid.shape),
        "chunks": list(grid.chunks),
        "dims": {name: list(arrays[name]["dimension_names"]) for name in results},
        "coords": {name: _digest_of_values(values) for name, values in named.items()},
        "cases": cases.digest(),
        "cases_function": cases.digest_of_code(),
        "function": task.digest(),
        **dict(zip(("jaxcable", "jax", "backend"), settings.versions, strict=True)),
        "fuse_loops": settings.fused,
    }
    _require_no_file_above(path)
    if not path.exists() or (path.is_dir() and not any(path.iterdir())):
        coordinates = dict(cases.coordinates) | {
            name: ((name,), values) for name, values in named.items()
        }
        create_store(path, arrays, coordinates, units, about)
    opened = ResultStore(path)
    _require_same_study(opened, about)
    opened.set_units(units)
    compute_missing_chunks(opened, task, cases, client, progress, patience)
    return Study(path)


def _require_package(name, extra, purpose):
    """Raise ModuleNotFoundError unless the package `name` is installed.

    The message says what needs it (`purpose`), and which `extra` of jaxcable installs it.
    """
    if importlib.util.find_spec(name) is None:
        raise ModuleNotFoundError(
            f"{purpose} needs the package {name}, which is not installed: "
            f'pip install "jaxcable[{extra}]"',
            name=name,
        )


def _require_client(client):
    """Raise ValueError unless a client is None, or a connected, synchronous one of Dask."""
    if client is None:
        return
    state = getattr(client, "status", type(client).__name__)
    if state != "running" or client.asynchronous:
        raise ValueError(
            "client: expected None, or a distributed.Client that is connected and not asynchronous "
            f'(pip install "jaxcable[cluster]"), got {state!r}'
        )


def _as_dict(stated, argument):
    """Return `stated`, a mapping by name, as a dict, {} for None; ValueError for others."""
    if stated is not None and not isinstance(stated, Mapping):
        raise ValueError(f"{argument} = {stated!r:.60}: expected a dict, by name of the result")
    return dict(stated or {})


def _results_of_one_case(results):
    """Return shape and dtype of each result of one case, by name, from those of a chunk.

    Raises ValueError unless they are a dict of arrays of numbers.
    """
    if not isinstance(results, dict) or not results:
        got = "an empty one" if results == {} else type(results).__name__
        raise ValueError(f"function: expected a dict of arrays by name, got {got}")
    for name, value in results.items():
        kind = getattr(value, "dtype", f"a {type(value).__name__}, no array")
        if getattr(kind, "kind", "V") not in "biufc":
            raise ValueError(f"function: the result {name!r} is {kind}; expected numbers")
    return {
        name: jax.ShapeDtypeStruct(value.shape[1:], value.dtype) for name, value in results.items()
    }


def _digest_of_values(values):
    """Return a digest of an array of numbers or texts; ValueError for others."""
    if values.dtype.kind != "U":
        require_numbers(values, "coords")
    return digest.arrays_digest(values)


_HINTS = {
    "function": "digest of what is computed, with the model and all arrays in it",
    "cases": "digest of the cases",
    "cases_function": "digest of the code that draws the cases, with the globals, functions and "
    "objects that it uses, also those that it changes itself",
}


def _require_no_file_above(path):
    """Raise ValueError if one of the folders in which the store `path` would be is a file."""
    for above in path.parents:
        if above.exists() and not above.is_dir():
            raise ValueError(f"store: {path}: {above} is a file, not a folder")


def _require_same_study(opened, about):
    """Raise ValueError if an opened `ResultStore` is of another study than `about` says."""
    other = [
        f"{key} = {opened.about.get(key)}, not {value}"
        + (f" ({_HINTS[key]})" if key in _HINTS else "")
        for key, value in about.items()
        if opened.about.get(key) != value
    ]
    if other:
        raise ValueError(
            f"store: {opened.path} holds a study with {'; '.join(other)}; take another folder, or "
            "delete this one"
        )
