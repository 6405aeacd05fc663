"""The store of a study: a Zarr group that xarray opens, and in which chunks appear as a whole.

Every result is an array whose first axes are the dimensions of the cases, divided into the chunks
of the study. A chunk is written array by array, and ``completed`` last: where that is true, all
else is there. Cases that nobody has computed are NaN, and -1 in ``status``. The attribute
``jaxcable_study`` of the group says what is computed, by digests.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import itertools
import json
import os
import secrets
import shutil
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..common import checks, status
from ..common.digest import digest_of_bytes
from .cases import Cases, require_name
from .grid import ChunkGrid

COMPLETED, CAUSE, STATUS = "completed", "cause", "status"
DESCRIPTION = "jaxcable_study"

_UNITS = {  # of results of an analysis, where a study does not state others
    **dict.fromkeys(("tension", "peak_tension", "reactions"), "N"),
    **dict.fromkeys(("displacement", "displacement_in_phase", "positions", "rest_length"), "m"),
    "reaction_moments": "N m",
}


@dataclasses.dataclass(frozen=True)
class Variable:
    """A result of a study.

    Attributes:
        shape, dtype: of one case.
        dims: names of the axes of one case.
        units: unit, "" if none is known.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    dims: tuple[str, ...]
    units: str


def describe_variables(
    results: Mapping[str, Any],
    cases: Cases,
    dims: Mapping[str, Sequence[str]],
    units: Mapping[str, str],
    coords: Mapping[str, np.ndarray],
) -> dict[str, Variable]:
    """Return the variables of a store by name, and check their names, dimensions and coordinates.

    Args:
        results: shapes and dtypes of all results of one case, by name.
        cases: the cases.
        dims, units: what the user states of results, by name.
        coords: what the user states of dimensions, by name.
    """
    known = cases.coordinates()
    for argument, stated in (("dims", dims), ("units", units)):
        for name in stated:
            has_units = argument == "units" and (name in known or name in coords)
            if name not in results and not has_units:
                raise ValueError(
                    f"{argument}: {name!r} is no result{checks.suggest_names(name, results)}"
                )
    sizes: dict[str, int] = dict(zip(cases.dims, cases.shape, strict=True))
    variables = {}
    for name, one in results.items():
        require_name(name, "function: the result")
        if 0 in one.shape:
            raise ValueError(f"function: the result {name!r} has shape {one.shape}, no numbers")
        if name == STATUS and (one.shape or np.dtype(one.dtype).kind != "i"):
            raise ValueError(
                f"function: the result 'status' is {one.dtype}{list(one.shape)}, expected one code"
            )
        if name in (*cases.dims, *known, *coords):
            raise ValueError(f"function: the result {name!r} has the name of something else")
        own = dims.get(name, [f"{name}_{axis}" for axis in range(len(one.shape))])
        if isinstance(own, str) or not isinstance(own, Sequence):
            raise ValueError(
                f"dims[{name!r}] = {own!r}: expected a list of names, one for each axis"
            )
        named_twice = set(own) & {*cases.dims, *known, *results} or len(set(own)) < len(own)
        if len(own) != len(one.shape) or named_twice:
            raise ValueError(
                f"dims[{name!r}] = {own!r}: expected {len(one.shape)} different names, other than "
                f"those of dimensions of the cases, {cases.dims}, and of results"
            )
        for dim, size in zip(own, one.shape, strict=True):
            require_name(dim, f"dims[{name!r}]")
            if sizes.setdefault(dim, size) != size:
                raise ValueError(
                    f"dims[{name!r}]: {dim!r} has length {size} here and {sizes[dim]} elsewhere"
                )
        unit = units.get(name, _UNITS.get(name, ""))
        variables[name] = Variable(one.shape, np.dtype(one.dtype), tuple(own), unit)
    for dim, values in coords.items():
        if dim not in sizes or dim in known:
            raise ValueError(f"coords: {dim!r} is no dimension without values; {sorted(sizes)} are")
        if values.shape != (sizes[dim],):
            raise ValueError(
                f"coords[{dim!r}] has shape {values.shape}, the dimension has length {sizes[dim]}"
            )
    return variables


class ResultStore:
    """A store on disk, opened for writing and reading.

    Args:
        path: its folder.
    """

    def __init__(self, path: Path):
        import zarr

        self.path = path
        try:
            self.root: Any = zarr.open_group(path, mode="r+", zarr_format=3, use_consolidated=False)
            about = json.loads(str(self.root.attrs[DESCRIPTION]))
            self.grid = ChunkGrid(tuple(about["shape"]), tuple(about["chunks"]))
            self.names = tuple(about["results"])
            self._arrays = {
                name: self.root[name].with_config({"write_empty_chunks": True})
                for name in (*self.names, CAUSE, COMPLETED)
            }
        except (OSError, KeyError, ValueError, TypeError) as error:
            raise ValueError(
                f"store: {path} holds no study of jaxcable, or is damaged ({error}); take another "
                "folder"
            ) from None
        self.about: dict[str, Any] = about
        self._ends_of_files = [self._file_around(name) for name in self._arrays]

    @property
    def digest(self) -> str:
        """Digest of the description of the study and the place of its store, 16 characters."""
        return digest_of_bytes(repr((sorted(self.about.items()), self.path)).encode())[:16]

    def write(self, k: int, results: Mapping[str, np.ndarray], causes: np.ndarray) -> None:
        """Write the results of chunk `k`, arrays [n, ...] by name, and causes of failure, [n]."""
        where, lengths = self.grid.slices(k), [s.stop - s.start for s in self.grid.slices(k)]
        for name, values in results.items():
            expected = self._arrays[name]
            if values.dtype != expected.dtype or values.shape[1:] != expected.shape[len(where) :]:
                here, there = values.shape[1:], expected.shape[len(where) :]
                raise ValueError(
                    f"function: the result {name!r} is {values.dtype}{list(here)} for these cases, "
                    f"and {expected.dtype}{list(there)} for others"
                )
        for name, values in (*results.items(), (CAUSE, causes)):
            self._arrays[name][where] = values.reshape(*lengths, *values.shape[1:])
            _wait_for_disk(self._chunk_file(name, k))
        self._arrays[COMPLETED][where] = True

    def set_units(self, units: Mapping[str, str]) -> None:
        """State units of results and coordinates, by name."""
        if any(self.root[name].attrs.get("units") != unit for name, unit in units.items()):
            for name, unit in units.items():
                self.root[name].attrs["units"] = unit
            _collect_metadata(self.path)

    def missing(self) -> list[int]:
        """Return the numbers of the chunks of which not all is there."""
        places = itertools.product(*map(range, self.grid.counts))  # in the order of the numbers
        return [k for k, place in enumerate(places) if not self._is_there(place)]

    def is_complete(self, k: int) -> bool:
        """Tell whether all of chunk `k` is there."""
        return self._is_there(self.grid.index(k))

    def _is_there(self, place):
        """Return whether the files of the chunk at a place of the grid are there."""
        inside = "/".join(map(str, place))
        return all(os.path.exists(f"{head}{inside}{tail}") for head, tail in self._ends_of_files)

    def read(self, name: str) -> np.ndarray:
        """Return a result of all cases, with their dimensions first.

        Raises:
            ValueError: the file of a chunk is damaged.
        """
        array = self._arrays[name]
        found = np.empty(array.shape, array.dtype)
        for k in range(self.grid.n_chunk):
            found[self.grid.slices(k)] = self.read_chunk(name, k)
        return found

    def read_chunk(self, name: str, k: int) -> np.ndarray:
        """Return a result of the cases of chunk `k`; errors are those of `read`."""
        try:
            return np.asarray(self._arrays[name][self.grid.slices(k)])
        except Exception as error:  # of zarr, its codecs and NumPy there are many kinds
            raise ValueError(
                f"{self._chunk_file(name, k)}: is damaged ({error}); delete this file and run the "
                "study again, which computes these cases anew"
            ) from None

    def _chunk_file(self, name, k):
        """Return the path of the file with chunk `k` of an array."""
        head, tail = self._file_around(name)
        return Path(head + "/".join(map(str, self.grid.index(k))) + tail)

    def _file_around(self, name):
        """Return what comes before and after the place of a chunk in the path of its file."""
        inner = self._arrays[name].ndim - len(self.grid.shape)
        return f"{self.path}/{name}/c/", "/0" * inner


def create_store(
    path: Path,
    cases: Cases,
    variables: Mapping[str, Variable],
    about: Mapping[str, Any],
    coords: Mapping[str, np.ndarray],
    units: Mapping[str, str],
) -> None:
    """Create an empty store, which appears as a whole; another process may have been faster.

    Args:
        path: where it shall be; there is nothing.
        cases: the cases.
        variables: results, by name.
        about: what is computed, the attribute `DESCRIPTION`.
        coords, units: what the user states of dimensions, and of coordinates, by name.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}-{secrets.token_hex(8)}.part")
    try:
        _fill_store(part, cases, variables, about, coords, units)
        with contextlib.suppress(OSError):  # an empty one is replaced, on Windows not by itself
            path.rmdir()
        os.rename(part, path)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _fill_store(path, cases, variables, about, coords, units):
    """Write the metadata of all arrays, and the coordinates."""
    import zarr

    grid = ChunkGrid(tuple(about["shape"]), tuple(about["chunks"]))
    attributes = {
        "Conventions": "CF-1.11",
        "coordinates": f"{CAUSE} {COMPLETED}",  # masks and sums over all results leave these out
        DESCRIPTION: json.dumps(about),  # as a text, which other formats can hold, too
    }
    root = zarr.create_group(path, zarr_format=3, attributes=attributes)
    compressors = [zarr.codecs.ZstdCodec(level=1, checksum=True)]
    for name, variable in variables.items():
        root.create_array(
            name,
            shape=(*grid.shape, *variable.shape),
            chunks=(*grid.chunks, *variable.shape),
            dtype=variable.dtype,
            fill_value=fill_value(variable.dtype),
            dimension_names=(*cases.dims, *variable.dims),
            attributes=_attributes(name, variable),
            compressors=compressors,
        )
    for name, dtype, fill, text in (
        (CAUSE, str, "", "why a case has failed; empty if it has not"),
        (COMPLETED, bool, False, "whether a case is computed"),
    ):
        root.create_array(
            name,
            shape=grid.shape,
            chunks=grid.chunks,
            dtype=dtype,
            fill_value=fill,
            dimension_names=cases.dims,
            attributes={"long_name": text},
            compressors=compressors,
        )
    stated = {name: ((name,), values) for name, values in coords.items()}
    for name, (dims, values) in (cases.coordinates() | stated).items():
        texts = values.dtype.kind in "US"
        array = root.create_array(
            name,
            shape=values.shape,
            dtype=str if texts else values.dtype,
            dimension_names=dims,
            attributes={"units": units[name]} if name in units else {},
        )
        array[...] = values.astype(object) if texts else values
    _collect_metadata(path)


def _collect_metadata(path):
    """Write the metadata of all arrays into one file, from which xarray opens a store quickly."""
    import zarr

    with warnings.catch_warnings():  # it is an extension of the format, which all readers may skip
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        zarr.consolidate_metadata(path)


def fill_value(dtype):
    """Return what stands for a case that is not computed."""
    if dtype.kind in "fc":
        return np.nan
    return {"b": False, "i": -1}.get(dtype.kind, 0)


def _attributes(name, variable):
    """Return the attributes of the array of a result, as the CF conventions name them."""
    attributes: dict[str, Any] = {"units": variable.units} if variable.units else {}
    if name == STATUS and variable.dtype.kind == "i":
        attributes |= {
            "flag_values": list(status.NAMES),
            "flag_meanings": " ".join(name.lower() for name in status.NAMES.values()),
        }
    return attributes


def _wait_for_disk(path):
    """Wait until the content of a file is on the disk, so that it is there before its mark is."""
    handle = os.open(path, os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
