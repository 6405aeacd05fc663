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
_OURS = {
    PROGRAMS: re.compile(rf"[0-9a-f]{{{_KEY}}}\.(program|\w+\.new)"),
    COMPILED: re.compile(r"[\w<>.-]+-[0-9a-f]{64}-(cache|atime)"),  # as jax 0.10 to 0.12 names them
}
_LINKS = 40  # symbolic links in a path, as Linux allows
_FULL = 0.8  # of the limit: what is left when old programs are removed
_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_CAREFULLY = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))


class UnsafeError(ValueError):
    """A folder that shall not be used, or a file; the text says why, and what to do."""


class DamagedError(Exception):
    """A file that is not what was written."""


@dataclasses.dataclass(frozen=True)
class Place:
    """Where programs are kept.

    Attributes:
        folder: real path of the folder given to `keep_programs`.
        limit: bytes.
    """

    folder: Path
    limit: int

    @property
    def programs(self) -> Path:
        """Folder of whole programs."""
        return self.folder / PROGRAMS

    @property
    def compiled(self) -> Path:
        """Folder for jax's own cache."""
        return self.folder / COMPILED

    def file_of(self, key: str) -> Path:
        """Return the path of the program with a key."""
        return self.programs / f"{key}.program"

    def read(self, key: str) -> bytes | None:
        """Return what was written under a key; None if there is nothing.

        Raises:
            UnsafeError: another user has written it, or could have done so.
            DamagedError: it is not what was written, or not under this key.
        """
        path = self.file_of(key)
        try:
            with open(os.open(path, os.O_RDONLY | _CAREFULLY), "rb") as file:
                about = os.fstat(file.fileno())
                if not stat.S_ISREG(about.st_mode):
                    raise UnsafeError(f"{path}: is no regular file")
                _refuse_others(path, about)
                text = file.read()
        except OSError:  # a symbolic link, too
            return None
        digest, text = text[:_DIGEST], text[_DIGEST:]
        if _digest(key, text) != digest:
            raise DamagedError(str(path))
        with contextlib.suppress(OSError):
            os.utime(path)  # used now
        return text

    def write(self, key: str, text: bytes) -> None:
        """Write a file, as a whole or not at all: the folder may be full, or read-only.

        Not by `writing.written`: only the user may read it, and a file that is lost when the power
        fails is compiled anew, so that nothing waits for the disk.
        """
        name = None
        try:
            if not _is_marked(self.programs):
                return
            with tempfile.NamedTemporaryFile(
                dir=self.programs, prefix=f"{key}.", suffix=".new", delete=False
            ) as file:
                name = file.name
                file.write(_digest(key, text) + text)
            os.replace(name, self.file_of(key))
        except OSError:
            if name is not None:
                with contextlib.suppress(OSError):
                    os.unlink(name)

    def make_room(self) -> None:
        """Remove our files that were not used for longest, if there are too many bytes."""
        with contextlib.suppress(OSError):
            files = [*_own_files(self.programs), *_own_files(self.compiled)]
            total = sum(size for _, size, _ in files)
            if total <= self.limit:
                return
            for _, size, file in sorted(files):
                with contextlib.suppress(OSError):
                    os.unlink(file)
                    total -= size
                if total <= _FULL * self.limit:
                    return


def opened(folder: Path, limit: int) -> Place:
    """Make the folders in which programs are kept, or find them, and mark them.

    A folder that cannot be made (a read-only disk) is no error: nothing is found there, and nothing
    kept.

    Raises:
        UnsafeError: others can write to a folder or to one on the way there, or it belongs to
            another user, or it is a file, or a folder with one of our names has other things in it.
    """
    place = Place(Path(os.path.realpath(folder)), limit)
    require_own_way(folder)
    with contextlib.suppress(OSError):
        place.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        require_own_way(folder)  # what has been made
    for path in (place.folder, place.programs, place.compiled):
        with contextlib.suppress(OSError):
            if path != place.folder:
                _make(path)
            if path.is_dir():
                _refuse_others(path, os.lstat(path))
    return place


def require_own_way(folder: str | os.PathLike[str]) -> None:
    """Raise UnsafeError if a path leads through a file, or a folder where others can change it.

    Others can put another folder in the place of one if they can write to the folder in which it
    is, unless that is one such as ``/tmp``, in which everybody changes only what he owns.
    """
    path = Path(folder)
    *above, last = _way(path if path.is_absolute() else Path(os.path.join(os.getcwd(), path)))
    for path, about in (*above, last):
        if not stat.S_ISDIR(about.st_mode):
            raise UnsafeError(f"{path}: is a file, and no folder; name another folder")
    if not hasattr(os, "geteuid"):
        return
    for path, about in above if last[0] == Path(os.path.realpath(folder)) else (*above, last):
        if about.st_uid not in (0, os.geteuid()):
            raise UnsafeError(
                f"{path}: belongs to another user, who could put other programs in the place of "
                f"those in {folder}; name a folder of your own"
            )
        if _others_can_write(about) and not about.st_mode & stat.S_ISVTX:
            raise UnsafeError(
                f"{path}: other users can write there, and so could put other programs in the "
                f"place of those in {folder}; `chmod go-w {path}`, or name another folder"
            )


def _way(path) -> Iterator[tuple[Path, os.stat_result]]:
    """Folders through which an absolute path leads, and what is at its end, as far as it is there.

    Symbolic links are followed, so that the folders in which they are come, too.
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
        if links > _LINKS:
            raise UnsafeError(f"{path}: leads through more than {_LINKS} symbolic links")
        target = Path(os.readlink(here / name))
        here = Path(target.anchor) if target.is_absolute() else here
        names += reversed(target.parts[1:] if target.is_absolute() else target.parts)


def _others_can_write(about):
    """Whether a folder is open to others: not to a group in which there is nobody but the user."""
    if about.st_mode & stat.S_IWOTH:
        return True
    return bool(about.st_mode & stat.S_IWGRP) and not _is_own_group(about.st_gid)


def _is_own_group(number):
    """Whether a group is the private one of the user: called as the user, and without members."""
    try:
        known, user = grp.getgrgid(number), pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    own = number == user.pw_gid and known.gr_name == user.pw_name
    return own and set(known.gr_mem) <= {user.pw_name}


def _make(path):
    """Make a folder of our own, and mark it, unless it is one already."""
    if path.is_symlink():
        raise UnsafeError(f"{path}: is a symbolic link; remove it, or name another folder")
    path.mkdir(mode=0o700, exist_ok=True)
    said = _tag_of(path)
    if said == _MARK:
        return
    incomplete = said is not None and _MARK.startswith(said)  # or not there
    if any(entry.name != _TAG for entry in path.iterdir()) or not incomplete:
        raise UnsafeError(
            f"{path}: holds files that jaxcable has not written (it has no {_TAG} of jaxcable); "
            "name another folder"
        )
    (path / _TAG).write_text(_MARK, encoding="utf-8")


def _tag_of(path):
    """The beginning of the tag in a folder, "" without one; None if it is a link, or no text."""
    try:
        with open(os.open(path / _TAG, os.O_RDONLY | _CAREFULLY), encoding="utf-8") as file:
            return file.read(len(_MARK))
    except FileNotFoundError:
        return ""
    except (OSError, UnicodeDecodeError):
        return None


def _is_marked(path):
    """Whether a folder is one of our own; links are not followed."""
    return not path.is_symlink() and _tag_of(path) == _MARK


def _own_files(path) -> Iterator[tuple[float, int, str]]:
    """Time of use, bytes and path of our files in a folder of our own."""
    if not _is_marked(path):
        return
    with os.scandir(path) as entries:
        for entry in entries:
            if _OURS[path.name].fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                about = entry.stat(follow_symlinks=False)
                yield about.st_mtime, about.st_size, entry.path


def _refuse_others(path, about):
    """Raise UnsafeError if a file or folder is another user's, or one that others may write."""
    if not hasattr(os, "geteuid"):
        return
    if about.st_uid != os.geteuid():
        raise UnsafeError(
            f"{path}: belongs to another user, who could have put programs there that are run; "
            "name a folder of your own"
        )
    if about.st_mode & _OTHERS:
        raise UnsafeError(
            f"{path}: other users can write there, and so could put programs there that are run; "
            f"`chmod go-w {path}`, or name another folder"
        )


def _digest(key, text):
    return hashlib.blake2b(key.encode() + text, digest_size=_DIGEST).digest()
