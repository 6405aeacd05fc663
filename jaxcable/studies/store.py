"""The store of a study: a Zarr group that xarray opens, and in which chunks appear as a whole.

Every result is an array whose first axes are the dimensions of the cases, divided into the chunks
of the study. A chunk is written array by array, and ``completed`` last: where that is true, all
else is there. Cases that nobody has computed are NaN, and -1 in ``status``. The attribute
``jaxcable_study`` of the group says what is computed, by digests.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import secrets
import shutil
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ..common import checks, status
from .cases import Cases, require_name
from .grid import ChunkGrid

COMPLETED, CAUSE, STATUS = "completed", "cause", "status"
DESCRIPTION = "jaxcable_study"

Arrays: TypeAlias = dict[str, dict[str, Any]]
"""What ``zarr.Group.create_array`` gets for each array of a store, by name."""

_TEXTS = np.dtypes.StringDType()
_UNITS = {  # of results of an analysis, where a study does not state others
    **dict.fromkeys(("tension", "peak_tension", "reactions"), "N"),
    **dict.fromkeys(("displacement", "displacement_in_phase", "positions", "rest_length"), "m"),
    "reaction_moments": "N m",
}


def describe_arrays(
    results: Mapping[str, Any],
    cases: Cases,
    grid: ChunkGrid,
    dims: Mapping[str, Sequence[str]],
    units: Mapping[str, str],
    coords: Mapping[str, np.ndarray],
) -> Arrays:
    """Return what zarr is told to create every array of a store but coordinates, by name.

    Names, dimensions and coordinates are checked: ValueError for those that do not fit.

    Args:
        results: shapes and dtypes of all results of one case, by name.
        cases, grid: the cases, and their chunks.
        dims, units: what the user states of results, by name.
        coords: what the user states of dimensions, by name.
    """
    known = {*cases.coordinates, *coords}
    for argument, unknown in (
        ("dims", {*dims} - {*results}),
        ("units", {*units} - {*results} - known),
    ):
        for name in unknown:
            raise ValueError(
                f"{argument}: {name!r} is no result{checks.suggest_names(name, results)}"
            )
    arrays, sizes = {}, dict(zip(cases.dims, cases.shape, strict=True))
    for name, one in results.items():
        require_name(name, "function: the result")
        for is_wrong, text in (
            (0 in one.shape, f"has shape {one.shape}, no numbers"),
            (
                name == STATUS and (one.shape or one.dtype.kind != "i"),
                f"is {one.dtype}{list(one.shape)}, expected one code",
            ),
            (name in known | {*cases.dims}, "has the name of something else"),
        ):
            if is_wrong:
                raise ValueError(f"function: the result {name!r} {text}")
        own = dims.get(name, [f"{name}_{axis}" for axis in range(len(one.shape))])
        is_list = isinstance(own, list | tuple)
        different = {*own} - {*cases.dims, *cases.coordinates, *results} if is_list else ()
        if not len(different) == len(own) == one.ndim:
            raise ValueError(
                f"dims[{name!r}] = {own!r}: expected a list of {one.ndim} different names, other "
                f"than those of dimensions of the cases, {cases.dims}, and of results"
            )
        for dim, size in zip(own, one.shape, strict=True):
            require_name(dim, f"dims[{name!r}]")
            if sizes.setdefault(dim, size) != size:
                raise ValueError(
                    f"dims[{name!r}]: {dim!r} has length {size} here and {sizes[dim]} elsewhere"
                )
        unit = units.get(name, _UNITS.get(name))
        arrays[name] = {
            "shape": (*grid.shape, *one.shape),
            "chunks": (*grid.chunks, *one.shape),
            "dtype": one.dtype,
            "fill_value": fill_value(one.dtype),
            "dimension_names": (*cases.dims, *own),
            "attributes": ({} if unit is None else {"units": unit})
            | (_status_flags() if name == STATUS else {}),
        }
    for dim, values in coords.items():
        if dim not in sizes or dim in cases.coordinates:
            raise ValueError(f"coords: {dim!r} is no dimension without values; {sorted(sizes)} are")
        if values.shape != (sizes[dim],):
            raise ValueError(
                f"coords[{dim!r}] has shape {values.shape}, the dimension has length {sizes[dim]}"
            )
    for name, dtype, fill, text in (
        (CAUSE, str, "", "why a case has failed; empty if it has not"),
        (COMPLETED, bool, False, "whether a case is computed"),
    ):
        arrays[name] = {
            "shape": grid.shape,
            "chunks": grid.chunks,
            "dtype": dtype,
            "fill_value": fill,
            "dimension_names": cases.dims,
            "attributes": {"long_name": text},
        }
    return arrays


def fill_value(dtype: np.dtype[Any]) -> float | int:
    """Return the value of cases that are not computed: NaN, False, -1 of integers, else 0."""
    return np.nan if dtype.kind in "fc" else {"b": False, "i": -1}.get(dtype.kind, 0)


def _status_flags():
    """Return attributes that explain status codes (CF conventions): values and meanings."""
    meanings = " ".join(name.lower() for name in status.NAMES.values())
    return {"flag_values": list(status.NAMES), "flag_meanings": meanings}


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
            self.about: dict[str, Any] = json.loads(str(self.root.attrs[DESCRIPTION]))
            self.grid = ChunkGrid(tuple(self.about["shape"]), tuple(self.about["chunks"]))
            self.names = tuple(self.about["dims"])
            self._arrays = {
                name: self.root[name].with_config({"write_empty_chunks": True})
                for name in (*self.names, CAUSE, COMPLETED)
            }
        except (OSError, KeyError, ValueError, TypeError) as error:
            raise ValueError(
                f"store: {path} holds no study of jaxcable, or is damaged ({error}); take another "
                "folder"
            ) from None

    def write(self, k: int, results: Mapping[str, np.ndarray], causes: np.ndarray) -> None:
        """Write the results of chunk `k`, arrays [n, ...] by name, and causes of failure, [n]."""
        where = self.grid.slices(k)
        lengths = [s.stop - s.start for s in where]
        for name, values in (*results.items(), (CAUSE, causes)):
            self._arrays[name][where] = values.reshape(*lengths, *values.shape[1:])
            with open(self._chunk_file(name, k), "rb+") as file:
                os.fsync(file.fileno())  # it is on the disk before its mark is
        self._arrays[COMPLETED][where] = True

    def set_units(self, units: Mapping[str, str]) -> None:
        """Write units of results and coordinates, by name, into the store if they have changed."""
        if any(self.root[name].attrs.get("units") != unit for name, unit in units.items()):
            for name, unit in units.items():
                self.root[name].attrs["units"] = unit
            _consolidate_metadata(self.path)

    def missing(self) -> list[int]:
        """Return the indices of the chunks of which not all files are there."""
        return [
            k
            for k in range(self.grid.n_chunk)
            if not all(os.path.exists(self._chunk_file(name, k)) for name in self._arrays)
        ]

    def read(self, name: str) -> np.ndarray:
        """Return a result of all cases, with their dimensions first.

        Raises:
            ValueError: the file of a chunk is damaged.
        """
        found = np.empty(self._arrays[name].shape, self._arrays[name].dtype)
        for k in range(self.grid.n_chunk):
            found[self.grid.slices(k)] = self.read_chunk(name, k)
        return found

    def read_chunk(self, name: str, k: int) -> np.ndarray:
        """Return the result `name` of the cases of chunk `k`; errors are those of `read`."""
        try:
            return np.asarray(self._arrays[name][self.grid.slices(k)])
        except Exception as error:  # of zarr, its codecs and NumPy there are many kinds
            raise ValueError(
                f"{self._chunk_file(name, k)}: is damaged ({error}); delete this file and run the "
                "study again, which computes these cases anew"
            ) from None

    def _chunk_file(self, name, k):
        """Return the path of the file with chunk `k` of the array `name`."""
        place = np.unravel_index(k, self.grid.counts)
        inner = self._arrays[name].ndim - len(place)
        return os.path.join(self.path, name, "c", *map(str, place), *"0" * inner)


def create_store(
    path: Path,
    arrays: Arrays,
    coordinates: Mapping[str, tuple[Iterable[str], np.ndarray]],
    units: Mapping[str, str],
    about: Mapping[str, Any],
) -> None:
    """Create an empty store, which appears as a whole; another process may have been faster.

    Args:
        path: where it shall be; there is nothing, or an empty folder.
        arrays: arrays of results, by name.
        coordinates: names of dimensions, and values, by name.
        units: of coordinates, by name.
        about: what is computed, the attribute `DESCRIPTION`.
    """
    import zarr
    from zarr.codecs import ZstdCodec

    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}-{secrets.token_hex(8)}.part")
    attributes = {
        "Conventions": "CF-1.11",
        "coordinates": f"{CAUSE} {COMPLETED}",  # masks and sums over all results leave these out
        DESCRIPTION: json.dumps(about),  # as a text, which other formats can hold, too
    }
    try:
        root = zarr.create_group(part, zarr_format=3, attributes=attributes)
        compressors = [ZstdCodec(level=1, checksum=True)]
        for name, array in arrays.items():
            root.create_array(name, compressors=compressors, **array)
        for name, (dims, values) in coordinates.items():
            root.create_array(
                name,
                data=values.astype(_TEXTS) if values.dtype.kind == "U" else values,
                dimension_names=dims,
                attributes={"units": units[name]} if name in units else {},
            )
        _consolidate_metadata(part)
        with contextlib.suppress(OSError):  # an empty one is replaced, on Windows not by itself
            path.rmdir()
        os.rename(part, path)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _consolidate_metadata(path):
    """Write the metadata of all arrays into one file, by which xarray opens a store quickly."""
    import zarr

    with warnings.catch_warnings():  # it is an extension of the format, which all readers may skip
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        zarr.consolidate_metadata(path)
