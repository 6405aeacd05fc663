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

MADE_BY = "jaxcable (matplotlib)"
"""What pictures say of themselves in their metadata."""


@contextlib.contextmanager
def atomic_write(path: str | PathLike[str], mode: str = "w") -> Iterator[IO[Any]]:
    """Open a file for writing in a ``with`` block; it appears at `path` when the block succeeds.

    If the block fails, a file that was there before stays as it was.

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
    """Write several files in a ``with`` block: all appear when it succeeds, none if it fails.

    The block gets a function ``begin(path, mode)`` that opens the next file and returns its stream;
    it closes the stream before. At the end the files are renamed one after the other: a process
    that is stopped in between leaves the first ones new, and the others as they were.
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
        stack.callback(_close_ignoring_errors, streams[0])
        return streams[0]

    with contextlib.ExitStack() as stack:
        yield begin
        finish()
        for name, target in staged:
            if target.exists():
                os.chmod(name, _file_permissions(target))
            os.replace(name, target)


def _close_ignoring_errors(stream):
    """Close a stream, and ignore errors: it may be closed already, or its disk may be full."""
    with contextlib.suppress(OSError):
        stream.close()


def resolve_write_target(path: str | PathLike[str]) -> Path:
    """Return the path of the file to write for `path`: the target of a symbolic link, not the link.

    Raises:
        OSError: `path` is a folder or another thing that is no regular file, or a file without
            permission to write (also for a user such as root, who could).
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
    """Raise OSError if `atomic_write` could not write to `path`; the disk stays unchanged."""
    with _temporary_file(resolve_write_target(path), path) as (handle, _):
        os.close(handle)


def create_if_absent(path: str | PathLike[str], content: bytes) -> bool:
    """Write bytes to a new file; return False, and write nothing, if the file exists already.

    Of several processes that create the same file at once, only one gets True.
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
    """Write arrays by name to a binary stream in the format of ``.npz``.

    Unlike with `np.savez`, any text can be a name. `comment` is stored in the archive, where
    `np.load` ignores it.
    """
    kind = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(stream, "w", kind) as archive:
        archive.comment = comment
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, np.asanyarray(array), allow_pickle=False)


@contextlib.contextmanager
def _temporary_file(target, path):
    """Create a temporary file in the folder of `target`; the end of the ``with`` block removes it.

    The block gets its descriptor and its name; errors name `path`, the file that the user has
    named. It has the permissions of any new file. (Those of `tempfile` allow the user alone to read
    it, and to ask for the usual ones changes them for all threads for a moment.)
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
    """Return the permission bits of an existing file."""
    return stat.S_IMODE(target.stat().st_mode)
