"""Writing of files: each appears when it is written completely, or not at all.

What was there before stays whole until then. Everything in this package that writes a file does so
here, and nothing in it deletes a file that it has not made.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import stat
import zipfile
from collections.abc import Callable, Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import IO, Any

import numpy as np

from .interrupt import UNFINISHED_FILES


@contextlib.contextmanager
def atomic_write(path: str | PathLike[str], mode: str = "w") -> Iterator[IO[Any]]:
    """Open a file for writing that appears at `path` when the block ends, and not if it fails.

    Args:
        path: path of the file.
        mode: "w" for text in UTF-8, "wb" for bytes.

    Raises:
        OSError: the folder is missing, or the file cannot be written.
    """
    with atomic_write_together() as begin:
        yield begin(path, mode)


@contextlib.contextmanager
def atomic_write_together() -> Iterator[Callable[..., IO[Any]]]:
    """Write several files, which appear when the block ends; none of them if the block fails.

    Each appears as a whole. They are renamed one after the other when all are complete: a process
    that is stopped between two renames leaves the first of them new, and the others as they were.
    The block gets a function of the arguments of `atomic_write` that opens the stream of the next
    file; the stream before it is complete then.
    """
    staged: list[tuple[str, Path]] = []
    streams: list[IO[Any]] = []

    def finish():
        for stream in streams:
            stream.flush()
            os.fsync(stream.fileno())
            stream.close()
        streams.clear()

    def begin(path, mode="w"):
        finish()
        target = resolve_write_target(path)
        handle, name = stack.enter_context(_temporary_file(target, path))
        staged.append((name, target))
        text: dict[str, Any] = {} if "b" in mode else {"encoding": "utf-8", "newline": "\n"}
        streams.append(open(handle, mode, **text))
        stack.callback(_close_quietly, streams[0])
        return streams[0]

    with contextlib.ExitStack() as stack:
        yield begin
        finish()
        for name, target in staged:
            if target.exists():
                os.chmod(name, _file_permissions(target))
            os.replace(name, target)


def _close_quietly(stream):
    """Close a stream that may be closed already, or whose disk may be full."""
    with contextlib.suppress(OSError):
        stream.close()


def resolve_write_target(path: str | PathLike[str]) -> Path:
    """Return the file to write for `path`: the target of a symbolic link, not the link.

    Raises:
        OSError: something else than a file is there, or a file that may not be changed (also where
            the user could change everything).
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, "Is a folder, not a file", str(path))
    if target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, "Is not a regular file", str(path))
    if target.exists() and not (os.access(target, os.W_OK) and _file_permissions(target) & 0o222):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))
    return target


def require_writable(path: str | PathLike[str]) -> None:
    """Raise OSError if `atomic_write` could not write this file; leave nothing behind."""
    with _temporary_file(resolve_write_target(path), path) as (handle, _):
        os.close(handle)


def create_if_absent(path: str | PathLike[str], content: bytes) -> bool:
    """Write a file unless it exists already; return whether it was written.

    Of several processes that create the same file, one does.
    """
    target = Path(path)
    with _temporary_file(target, path) as (handle, name):
        with open(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        try:
            os.link(name, target)
        except FileExistsError:
            return False
        except OSError:  # a file system without links
            if target.exists():
                return False
            os.replace(name, target)
        return True


def write_npz(
    stream: IO[bytes],
    arrays: Mapping[str, np.ndarray],
    compressed: bool = False,
    comment: bytes = b"",
) -> None:
    """Write arrays to a stream as ``.npz``; unlike `np.savez`, with any names.

    The archive has a comment, which `np.load` does not look at.
    """
    kind = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(stream, "w", kind) as archive:
        archive.comment = comment
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, np.asanyarray(array), allow_pickle=False)


@contextlib.contextmanager
def _temporary_file(target, path):
    """Create a temporary file in the folder of `target`, and remove it at the end of the block.

    The block gets its descriptor and its name; errors name `path`. It has the permissions of any
    new file. (Those of `tempfile` allow the user alone to read it, and to ask for the usual ones
    changes them for all threads for a moment.)
    """
    name = str(target.parent / f".jaxcable-{secrets.token_hex(8)}.part")
    binary = getattr(os, "O_BINARY", 0)
    try:
        handle = os.open(name, os.O_RDWR | os.O_CREAT | os.O_EXCL | binary, 0o666)
    except OSError as error:
        raise type(error)(error.errno, error.strerror, str(path)) from None
    UNFINISHED_FILES.append(name)
    try:
        yield handle, name
    finally:
        with contextlib.suppress(OSError):
            os.unlink(name)
        UNFINISHED_FILES.remove(name)


def _file_permissions(target):
    """Return the permissions of an existing file."""
    return stat.S_IMODE(target.stat().st_mode)
