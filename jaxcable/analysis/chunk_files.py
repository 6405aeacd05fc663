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

ANEW = "delete this file and run the study again, which computes these cases anew"

_COMMENT = re.compile(rb"jaxcable study ([0-9a-f]{32}) chunk (\d{1,18})")


@dataclasses.dataclass(frozen=True)
class Identity:
    """Of which study results are, and of which of its chunks.

    Attributes:
        study: `digest_of` the study; None for one that nothing describes, or one of an earlier
            version, whose files have no identity.
        chunk: number of the chunk.
    """

    study: str | None
    chunk: int


def digest_of(description: Mapping[str, Any]) -> str:
    """The digest of what ``study.json`` says, a text of 32 characters."""
    text = json.dumps(description, sort_keys=True).encode()
    return hashlib.blake2b(text, digest_size=16).hexdigest()


def write(path: Path, arrays: Mapping[str, np.ndarray], identity: Identity) -> None:
    """Write the results of a chunk, as a whole or not at all."""
    comment = f"jaxcable study {identity.study} chunk {identity.chunk}".encode()
    with atomic_write(path, "wb") as stream:
        write_npz(stream, arrays, comment=comment)


def told(results: Mapping[str, np.ndarray]) -> dict[str, tuple[tuple[int, ...], str]]:
    """Shape of a case and dtype of results, by name."""
    return {name: (value.shape[1:], value.dtype.name) for name, value in results.items()}


def require(
    path: Path, identity: Identity, count: int, expected: Mapping[str, tuple[tuple[int, ...], str]]
) -> None:
    """Raise ValueError if a file does not hold `expected` results of a chunk of `count` cases."""
    found = _of_cases(path, _opened(path, identity, _header), count, lambda header: header[0])
    kinds = {name: (shape[1:], dtype) for name, (shape, dtype) in found.items()}
    if kinds != expected:
        raise ValueError(f"{path}: holds {kinds}, expected {dict(expected)}; {ANEW}")


def read(path: Path, identity: Identity, count: int) -> dict[str, np.ndarray]:
    """The results of a chunk of `count` cases by name.

    Raises:
        ValueError: the file is damaged, of another study or chunk, or of another number of cases.
    """
    return _of_cases(path, _opened(path, identity, _array), count, np.shape)


def study_of(path: Path) -> str | None:
    """The digest of the study that a file names; None if it names none, or is no archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            found = _COMMENT.fullmatch(archive.comment)
    except (OSError, zipfile.BadZipFile):
        return None
    return found[1].decode() if found else None


def _opened(path, identity, reader):
    """What `reader` makes of every array of a file, by name; the file is that of `identity`."""
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
        raise ValueError(f"{path}: damaged, or no file of a study ({error}); {ANEW}") from None
    _require_identity(path, comment, identity)
    return found


def _require_identity(path, comment, identity):
    """Raise ValueError if the comment of a file says that it is of another study or chunk."""
    if identity.study is None and not comment:  # of an earlier version
        return
    own = _COMMENT.fullmatch(comment)
    if own is None:
        raise ValueError(f"{path}: does not say of which study its results are; {ANEW}")
    if identity.study is not None and own[1].decode() != identity.study:
        raise ValueError(
            f"{path}: holds results of another study (digest {own[1].decode()}, not "
            f"{identity.study}), where they may be missed; {ANEW}"
        )
    if int(own[2]) != identity.chunk:
        raise ValueError(
            f"{path}: holds the results of chunk {int(own[2])}, not of chunk {identity.chunk}; "
            f"{ANEW}"
        )


def _of_cases(path, found, count, shape_of):
    """The contents of a file, if they are results of `count` cases."""
    for name, value in found.items():
        shape = shape_of(value)
        if shape[:1] != (count,):
            raise ValueError(f"{path}: {name} has shape {shape}, not of {count} cases; {ANEW}")
    if not found:
        raise ValueError(f"{path}: holds no results; {ANEW}")
    return found


def _array(stream):
    """The array in a stream, which is that of a ``.npy`` file."""
    return np.lib.format.read_array(stream, allow_pickle=False)


def _header(stream):
    """Shape, and name of the dtype, of the array in a stream."""
    version = np.lib.format.read_magic(stream)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    shape, _, dtype = read_header[version](stream)
    return shape, dtype.name
