"""Files of chunks of a study: results of some cases, and of which study and which chunk they are.

A file is a NumPy archive, with its identity in the comment of the archive: a digest of what
``study.json`` says of the study, and the number of the chunk. A file of another study, or of
another chunk under this name, is no answer, though it has results of the right names and shapes.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..common.writing import atomic_write, write_npz

RECOMPUTE_HINT = "delete this file and run the study again, which computes these cases anew"

_COMMENT_PATTERN = re.compile(rb"jaxcable study ([0-9a-f]{32}) chunk (\d{1,18})")


@dataclasses.dataclass(frozen=True)
class ChunkIdentity:
    """Which study (see `streamed`), and which chunk of its cases, the results in a file belong to.

    Attributes:
        study: `study_digest` of the study; None for one that nothing describes, or one of an
            earlier version, whose files have no identity.
        chunk: number of the chunk.
    """

    study: str | None
    chunk: int


def study_digest(description: Mapping[str, Any]) -> str:
    """Return the digest (32 characters) of a study's description, the content of ``study.json``."""
    text = json.dumps(description, sort_keys=True).encode()
    return hashlib.blake2b(text, digest_size=16).hexdigest()


def write_chunk(path: Path, arrays: Mapping[str, np.ndarray], identity: ChunkIdentity) -> None:
    """Write the results of a chunk of cases to a file, as a whole or not at all."""
    comment = f"jaxcable study {identity.study} chunk {identity.chunk}".encode()
    with atomic_write(path, "wb") as stream:
        write_npz(stream, arrays, comment=comment)


def describe_results(results: Mapping[str, np.ndarray]) -> dict[str, tuple[tuple[int, ...], str]]:
    """Return (shape of one case, dtype) of every result of a chunk, a dict by name."""
    return {name: (value.shape[1:], value.dtype.name) for name, value in results.items()}


def require_chunk(
    path: Path,
    identity: ChunkIdentity,
    count: int,
    expected: Mapping[str, tuple[tuple[int, ...], str]],
) -> None:
    """Raise ValueError if a file does not hold the expected results of `count` cases.

    `expected` is what `describe_results` returns; the file must have this `identity`.
    """
    found = _require_case_count(
        path, _read_archive(path, identity, _read_header), count, lambda header: header[0]
    )
    kinds = {name: (shape[1:], dtype) for name, (shape, dtype) in found.items()}
    if kinds != expected:
        raise ValueError(
            f"{path}: holds results {kinds}, but the function returns {dict(expected)}; "
            f"{RECOMPUTE_HINT}"
        )


def read_chunk(path: Path, identity: ChunkIdentity, count: int) -> dict[str, np.ndarray]:
    """Read the results of a chunk of `count` cases, a dict by name.

    Raises:
        ValueError: the file is damaged, of another study or chunk, or of another number of cases.
    """
    return _require_case_count(path, _read_archive(path, identity, _read_array), count, np.shape)


def read_study_digest(path: Path) -> str | None:
    """Read the digest of the study that a file belongs to; None if it has none, or is damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            found = _COMMENT_PATTERN.fullmatch(archive.comment)
    except (OSError, zipfile.BadZipFile):
        return None
    return found[1].decode() if found else None


def _read_archive(path, identity, reader):
    """Apply `reader` to every array of a file with this `identity`; return a dict by name."""
    found = {}
    try:
        with zipfile.ZipFile(path) as archive:
            comment = archive.comment
            for name in archive.namelist():
                if not name.endswith(".npy"):
                    raise ValueError(f"holds {name!r}, which is no array")
                with archive.open(name) as stream:
                    found[name[:-4]] = reader(stream)
    except (PermissionError, FileNotFoundError):
        raise
    except Exception as error:  # of zipfile, zlib and NumPy there are many kinds
        raise ValueError(
            f"{path}: damaged, or no file of a study ({error}); {RECOMPUTE_HINT}"
        ) from None
    _require_identity(path, comment, identity)
    return found


def _require_identity(path, comment, identity):
    """Raise ValueError if the comment of an archive names another study or chunk."""
    if identity.study is None and not comment:  # of an earlier version
        return
    own = _COMMENT_PATTERN.fullmatch(comment)
    if own is None:
        raise ValueError(f"{path}: does not say of which study its results are; {RECOMPUTE_HINT}")
    if identity.study is not None and own[1].decode() != identity.study:
        raise ValueError(
            f"{path}: holds results of another study (digest {own[1].decode()}, not "
            f"{identity.study}); move it there, or {RECOMPUTE_HINT}"
        )
    if int(own[2]) != identity.chunk:
        raise ValueError(
            f"{path}: holds the results of chunk {int(own[2])}, not of chunk {identity.chunk}; "
            f"{RECOMPUTE_HINT}"
        )


def _require_case_count(path, found, count, shape_of):
    """Return the contents of a file; ValueError unless each result has `count` cases.

    `found` are its contents by name, `shape_of` returns the shape of one of them.
    """
    for name, value in found.items():
        shape = shape_of(value)
        if shape[:1] != (count,):
            raise ValueError(
                f"{path}: {name} has shape {shape}, not of {count} cases; {RECOMPUTE_HINT}"
            )
    if not found:
        raise ValueError(f"{path}: holds no results; {RECOMPUTE_HINT}")
    return found


def _read_array(stream):
    """Read an array from a stream in the format of ``.npy`` files."""
    return np.lib.format.read_array(stream, allow_pickle=False)


def _read_header(stream):
    """Read (shape, name of the dtype) of an array in a ``.npy`` stream, without its numbers."""
    version = np.lib.format.read_magic(stream)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    shape, _, dtype = read_header[version](stream)
    return shape, dtype.name
