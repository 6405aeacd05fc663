"""The folder of kept programs: which files in it are ours, who may write there, and how much.

A folder may be one of the user's, with other things in it. Everything of ours lies in two folders
of its own there, which are made and marked by `CACHEDIR.TAG`: nothing outside of them is looked at,
and in them nothing but regular files with our names. Whoever can write a program can have it run,
and so can whoever can put another folder in its place: neither folders nor files of other users, or
that others may write, are used, nor folders on the way to which there is one of these (POSIX).
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import os
import re
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

with contextlib.suppress(ImportError):  # of POSIX
    import grp
    import pwd

PROGRAMS, COMPILED = "programs", "xla"
"""Folders of our own: of whole programs, and for what jax keeps of others."""

_TAG = "CACHEDIR.TAG"
_MARK = """Signature: 8a477f597d28d172789f06886806bc55
# This folder belongs to jaxcable, which makes what is in it anew if it is removed.
# For backup programs, see https://bford.info/cachedir/
"""
_KEY, _DIGEST = 32, 32  # hexadecimal digits of a key, bytes of a digest
_OWN_NAMES = {
    PROGRAMS: re.compile(rf"[0-9a-f]{{{_KEY}}}\.(program|\w+\.new)"),
    COMPILED: re.compile(r"[\w<>.-]+-[0-9a-f]{64}-(cache|atime)"),  # as jax 0.10 to 0.12 names them
}
_MOST_LINKS = 40  # symbolic links in a path, as Linux allows
_KEPT_SHARE = 0.8  # of the limit stays when old programs are removed, so that it is done rarely
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_SAFE_FLAGS = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))


class UnsafeFolderError(ValueError):
    """A folder or file may not be used because others can write to it; the text says what to do."""


class DamagedFileError(Exception):
    """A file does not contain what was written to it."""


@dataclasses.dataclass(frozen=True)
class ProgramFolder:
    """A folder on disk in which compiled programs are kept.

    Attributes:
        folder: real path of the folder given to `keep_programs`.
        limit: bytes that all kept files may take together.
    """

    folder: Path
    limit: int

    @property
    def programs_folder(self) -> Path:
        """Path of the subfolder for programs that this package writes."""
        return self.folder / PROGRAMS

    @property
    def jax_cache_folder(self) -> Path:
        """Path of the subfolder for jax's own compilation cache."""
        return self.folder / COMPILED

    def program_path(self, key: str) -> Path:
        """Return the path of the file for the program with this key."""
        return self.programs_folder / f"{key}.program"

    def read_program(self, key: str) -> bytes | None:
        """Return the bytes that `write_program` has stored under a key; None if there are none.

        Raises:
            UnsafeFolderError: the file is another user's, or others may write to it.
            DamagedFileError: the checksum of the content and the key is wrong.
        """
        path = self.program_path(key)
        try:
            with open(os.open(path, os.O_RDONLY | _SAFE_FLAGS), "rb") as file:
                about = os.fstat(file.fileno())
                if not stat.S_ISREG(about.st_mode):
                    raise UnsafeFolderError(f"{path}: is not a regular file")
                _refuse_unsafe_owner(path, about)
                text = file.read()
        except OSError:  # a symbolic link, too
            return None
        digest, text = text[:_DIGEST], text[_DIGEST:]
        if _program_checksum(key, text) != digest:
            raise DamagedFileError(str(path))
        with contextlib.suppress(OSError):
            os.utime(path)  # used now
        return text

    def write_program(self, key: str, text: bytes) -> None:
        """Store a program's bytes, `text`, under a key: a whole file, or none if the disk is full.

        It does not use `writing.atomic_write`: only the user may read the file, and nothing waits
        for the disk, because a file that is lost when the power fails is compiled anew.
        """
        name = None
        try:
            if not _has_own_tag(self.programs_folder):
                return
            with tempfile.NamedTemporaryFile(
                dir=self.programs_folder, prefix=f"{key}.", suffix=".new", delete=False
            ) as file:
                name = file.name
                file.write(_program_checksum(key, text) + text)
            os.replace(name, self.program_path(key))
        except OSError:
            if name is not None:
                with contextlib.suppress(OSError):
                    os.unlink(name)

    def n_bytes(self) -> int:
        """Return the size of all kept files, bytes."""
        folders = self.programs_folder, self.jax_cache_folder
        with contextlib.suppress(OSError):
            return sum(size for folder in folders for _, size, _ in _list_own_files(folder))
        return 0

    def remove_oldest_files(self) -> None:
        """Remove the least recently used files if all files together exceed the limit."""
        with contextlib.suppress(OSError):
            files = [
                *_list_own_files(self.programs_folder),
                *_list_own_files(self.jax_cache_folder),
            ]
            total = sum(size for _, size, _ in files)
            if total <= self.limit:
                return
            for _, size, file in sorted(files):
                with contextlib.suppress(OSError):
                    os.unlink(file)
                    total -= size
                if total <= _KEPT_SHARE * self.limit:
                    return


def open_program_folder(folder: Path, limit: int) -> ProgramFolder:
    """Create the folders for kept programs where they are missing, and return the `ProgramFolder`.

    If a folder cannot be created (a read-only disk), this is no error: no program is found or kept.

    Args:
        folder: path from the user.
        limit: bytes that all kept files may take together.

    Raises:
        UnsafeFolderError: the folder or one above it can be changed by others or belongs to another
            user; it is a file; or one of our subfolders contains other files.
    """
    place = ProgramFolder(Path(os.path.realpath(folder)), limit)
    require_safe_path(folder)
    with contextlib.suppress(OSError):
        place.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        require_safe_path(folder)  # what has been made
    for path in (place.folder, place.programs_folder, place.jax_cache_folder):
        with contextlib.suppress(OSError):
            if path != place.folder:
                _make_tagged_folder(path)
            if path.is_dir():
                _refuse_unsafe_owner(path, os.lstat(path))
    return place


def require_safe_path(folder: str | os.PathLike[str]) -> None:
    """Raise UnsafeFolderError if a path leads through a file, or a folder that others can change.

    Whoever can write to a folder can replace the folders in it by others; one such as ``/tmp``, in
    which everybody changes only what he owns, is safe.
    """
    path = Path(folder)
    *above, last = _folders_along_path(
        path if path.is_absolute() else Path(os.path.join(os.getcwd(), path))
    )
    for path, about in (*above, last):
        if not stat.S_ISDIR(about.st_mode):
            raise UnsafeFolderError(f"{path}: is a file, not a folder; name another folder")
    if not hasattr(os, "geteuid"):
        return
    for path, about in above if last[0] == Path(os.path.realpath(folder)) else (*above, last):
        if about.st_uid not in (0, os.geteuid()):
            raise UnsafeFolderError(
                f"{path}: belongs to another user, who could replace the programs in {folder}; "
                "name a folder of your own"
            )
        if _others_can_write(about) and not about.st_mode & stat.S_ISVTX:
            raise UnsafeFolderError(
                f"{path}: other users can write to it and could replace the programs in {folder}; "
                f"run `chmod go-w {path}`, or name another folder"
            )


def _folders_along_path(path) -> Iterator[tuple[Path, os.stat_result]]:
    """Yield path and `os.stat_result` of all folders through which an absolute path leads.

    It begins at the root and ends with the path itself, or where the next folder does not exist.
    Symbolic links are followed; the folders in which they lie are yielded, too.
    """
    here, names, links = Path(path.anchor), list(reversed(path.parts[1:])), 0
    yield here, os.lstat(here)
    while names:
        name = names.pop()
        try:
            about = os.lstat(here / name)
        except OSError:  # not there yet, or not to be seen
            return
        if not stat.S_ISLNK(about.st_mode):
            here = here.parent if name == ".." else here / name
            yield here, os.lstat(here)
            continue
        links += 1
        if links > _MOST_LINKS:
            raise UnsafeFolderError(f"{path}: leads through more than {_MOST_LINKS} symbolic links")
        target = Path(os.readlink(here / name))
        here = Path(target.anchor) if target.is_absolute() else here
        names += reversed(target.parts[1:] if target.is_absolute() else target.parts)


def _others_can_write(file_stat):
    """Tell from a folder's `os.stat_result` whether users other than this one can write to it.

    The user's private group does not count as others.
    """
    if file_stat.st_mode & stat.S_IWOTH:
        return True
    return bool(file_stat.st_mode & stat.S_IWGRP) and not _is_private_group(file_stat.st_gid)


def _is_private_group(group_id):
    """Tell whether a group is the user's private one: of the user's name, without other members."""
    try:
        known, user = grp.getgrgid(group_id), pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    own = group_id == user.pw_gid and known.gr_name == user.pw_name
    return own and set(known.gr_mem) <= {user.pw_name}


def _make_tagged_folder(path):
    """Create one of our subfolders with its tag file; refuse a folder with other contents."""
    if path.is_symlink():
        raise UnsafeFolderError(f"{path}: is a symbolic link; remove it, or name another folder")
    path.mkdir(mode=0o700, exist_ok=True)
    said = _read_folder_tag(path)
    if said == _MARK:
        return
    incomplete = said is not None and _MARK.startswith(said)  # or not there
    if any(entry.name != _TAG for entry in path.iterdir()) or not incomplete:
        raise UnsafeFolderError(
            f"{path}: contains files that jaxcable has not written (it has no {_TAG} of jaxcable); "
            "name another folder"
        )
    (path / _TAG).write_text(_MARK, encoding="utf-8")


def _read_folder_tag(path):
    """Return the text of a folder's tag file, "" without one; None if it is a link or no text."""
    try:
        with open(os.open(path / _TAG, os.O_RDONLY | _SAFE_FLAGS), encoding="utf-8") as file:
            return file.read(len(_MARK))
    except FileNotFoundError:
        return ""
    except (OSError, UnicodeDecodeError):
        return None


def _has_own_tag(path):
    """Tell whether a folder has our tag file, so that it is ours; False for a symbolic link."""
    return not path.is_symlink() and _read_folder_tag(path) == _MARK


def _list_own_files(path) -> Iterator[tuple[float, int, str]]:
    """Yield (time of last use, bytes, path) of the files that we have written in our folder."""
    if not _has_own_tag(path):
        return
    with os.scandir(path) as entries:
        for entry in entries:
            if _OWN_NAMES[path.name].fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                file_stat = entry.stat(follow_symlinks=False)
                yield file_stat.st_mtime, file_stat.st_size, entry.path


def _refuse_unsafe_owner(path, file_stat):
    """Raise UnsafeFolderError if another user owns a file or folder, or others may write to it.

    `path` is named in the message, and `file_stat` is the `os.stat_result` that is judged.
    """
    if not hasattr(os, "geteuid"):
        return
    if file_stat.st_uid != os.geteuid():
        raise UnsafeFolderError(
            f"{path}: belongs to another user, and programs in it would be run; "
            "name a folder of your own"
        )
    if file_stat.st_mode & _OTHERS_WRITE:
        raise UnsafeFolderError(
            f"{path}: other users can write to it, and programs in it would be run; "
            f"run `chmod go-w {path}`, or name another folder"
        )


def _program_checksum(key, text):
    """Return the checksum of a program's key and its bytes, 32 bytes."""
    return hashlib.blake2b(key.encode() + text, digest_size=_DIGEST).digest()
