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
from ..common.fusion import are_loops_fused
from ..common.progress import as_listener
from ..common.types import Array, ArrayLike, PyTree
from .cases import Cases, digest_of_values, table
from .grid import divide
from .running import compute_missing
from .store import CAUSE, ResultStore, create_store, describe_variables
from .task import ChunkTask, Settings, chunk_shapes, versions_in_use


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
        """Numbers of the chunks of cases that are not computed yet, a list."""
        return self._opened.missing()

    @property
    def failures(self) -> dict[int, str]:
        """Why cases have failed: texts, by number of the case."""
        causes = self._opened.read(CAUSE).ravel()
        return {int(k): str(causes[k]) for k in np.flatnonzero(causes != "")}

    @property
    def _opened(self):
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
    programs: str | PathLike[str] | None = None,
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
        programs: folder in which the workers of a cluster keep compiled programs, so that those
            that start later compile little; the default is that of `keep_programs`, if this
            process has called it.
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
    settings = Settings.of_this_process(programs)
    if not patience > 0:
        raise ValueError(f"patience = {patience!r}: expected a positive number of seconds")
    _require_package("zarr", "studies", "a study")
    _require_client(client)
    cases = cases if isinstance(cases, Cases) else table(cases)
    grid = divide(cases.shape, chunk)
    path = Path(store).absolute()
    own_cases = cases if client is None else cases.for_workers()
    task = ChunkTask(function, own_cases, grid, path, settings.x64)
    first = cases.block(np.array([0]))
    try:
        traced = task.trace(first)
    except TypeError as error:
        raise ValueError(f"function: {error}") from error
    named = {name: np.asarray(values) for name, values in _as_dict(coords, "coords").items()}
    units = _as_dict(units, "units")
    variables = describe_variables(
        _results_of_one_case(traced.result), cases, _as_dict(dims, "dims"), units, named
    )
    about = _describe_study(cases, grid, variables, named)
    about["function"] = digest.of_function(traced, chunk_shapes(first, grid))
    opened = _open_or_create(path, cases, variables, about, named, units)
    compute_missing(opened, task, cases, client, settings, progress, patience)
    return Study(path)


def _require_package(name, extra, purpose):
    """Raise ModuleNotFoundError, with what to install, unless a package is there."""
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
    if not all(hasattr(client, name) for name in ("submit", "cancel", "nthreads", "asynchronous")):
        raise ValueError(
            "client: expected None, or a distributed.Client "
            f'(pip install "jaxcable[cluster]"), got {type(client).__name__}'
        )
    if client.asynchronous:
        raise ValueError("client: is asynchronous; expected Client(..., asynchronous=False)")
    if client.status != "running":
        raise ValueError(f"client: is {client.status}, expected one that is connected to a cluster")


def _as_dict(stated, argument):
    """Return what is stated by name, {} for None; ValueError if it is no mapping."""
    if stated is not None and not isinstance(stated, Mapping):
        raise ValueError(f"{argument} = {stated!r:.60}: expected a dict, by name of the result")
    return dict(stated or {})


def _results_of_one_case(results):
    """Return shape and dtype of the results of one case by name, from those of a chunk of cases."""
    if not isinstance(results, dict):
        raise ValueError(
            f"function: expected a dict of arrays by name, got {type(results).__name__}"
        )
    if not results:
        raise ValueError("function: expected a dict of arrays by name, got an empty one")
    for name, value in results.items():
        if not isinstance(value, jax.ShapeDtypeStruct):
            raise ValueError(f"function: the result {name!r} is a {type(value).__name__}, no array")
        if getattr(value.dtype, "kind", "V") not in "biufc":
            raise ValueError(f"function: the result {name!r} is of {value.dtype}, expected numbers")
    return {
        name: jax.ShapeDtypeStruct(value.shape[1:], value.dtype) for name, value in results.items()
    }


def _describe_study(cases, grid, variables, coords):
    """Return what a study computes, as a dict of texts, numbers and lists."""
    return {
        "shape": list(grid.shape),
        "chunks": list(grid.chunks),
        "dims": {"cases": list(cases.dims)}
        | {name: list(variable.dims) for name, variable in variables.items()},
        "coords": {name: digest_of_values(values) for name, values in coords.items()},
        "results": list(variables),
        **cases.digests(),
        **dict(zip(("jaxcable", "jax", "backend"), versions_in_use(), strict=True)),
        "fuse_loops": are_loops_fused(),
    }


_HINTS = {
    "function": "digest of what is computed, with the model and all arrays in it",
    "cases": "digest of the cases",
    "cases_function": "digest of the code that draws the cases, with the globals, functions and "
    "objects that it uses, also those that it changes itself",
}


def _open_or_create(path, cases, variables, about, coords, units):
    """Open a store, or create it; ValueError if it is of another study."""
    for above in path.parents:
        if above.exists() and not above.is_dir():
            raise ValueError(f"store: {path}: {above} is a file, not a folder")
    if not path.exists() or (path.is_dir() and not any(path.iterdir())):
        create_store(path, cases, variables, about, coords, units)
    opened = ResultStore(path)
    other = [
        f"{key} = {opened.about.get(key)}, not {value}"
        + (f" ({_HINTS[key]})" if key in _HINTS else "")
        for key, value in about.items()
        if opened.about.get(key) != value
    ]
    if other:
        raise ValueError(
            f"store: {path} holds a study with {'; '.join(other)}; take another folder, or delete "
            "this one"
        )
    opened.set_units(units)
    return opened
