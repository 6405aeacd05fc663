"""Compiled programs kept on disk for the next process, by jax's own compilation cache."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from pathlib import Path
from typing import Any

import jax

from .checks import require_whole_number
from .jax_internals import reset_jax_cache

_VARIABLE = "JAXCABLE_PROGRAMS"
LIMIT = 1 << 30
"""Bytes that kept programs take at most, if nothing else is said."""

_FOLDER = "jax_compilation_cache_dir"
_SHORTEST = "jax_persistent_cache_min_compile_time_secs"
_OWN_FILE = re.compile(r".+-[0-9a-f]{64}-(cache|atime)")  # as jax names the files of its cache
_settings_before: dict[str, Any] = {}  # those of jax; empty while no programs are kept


def keep_programs(folder: str | os.PathLike[str] | None = None, limit: int = LIMIT) -> Path:
    """Keep compiled programs on disk, so that the next process need not compile them.

    It switches on jax's persistent compilation cache, for all programs of this process: they are
    traced, and those that are in the folder are not compiled. Processes can share a folder. A
    damaged or read-only file costs no more than to compile. Importing the package changes nothing.

    Args:
        folder: a folder of yours to which nobody else can write, because programs are run from it;
            default: that of the environment variable JAXCABLE_PROGRAMS (none is kept where it is
            empty), or ``jaxcable`` in the user's folder for caches.
        limit: bytes that programs of earlier processes take at most; those that were not used for
            longest are removed now. With 0 programs are neither kept nor looked for from now on,
            and the settings of jax are as they were before the first call.

    Returns:
        The folder.

    Raises:
        ValueError: `limit` is negative or no integer; `folder` is a file, or cannot be made.

    Example:
        The first lines of a script:

        >>> import tempfile  # for this example: a script gives no folder
        >>> folder = jc.keep_programs(tempfile.mkdtemp())
        >>> folder.is_dir()
        True
        >>> folder = jc.keep_programs(limit=0)  # no more
    """
    require_whole_number(limit, "limit", least=0)
    named = os.environ.get(_VARIABLE, _user_folder()) if folder is None else folder
    if not isinstance(named, str | os.PathLike) or (folder is not None and not os.fspath(named)):
        raise ValueError(f"folder = {folder!r}: expected the path of a folder")
    path = Path(named).expanduser().absolute() if os.fspath(named) else Path()
    if limit == 0 or path == Path():
        _change_settings(_settings_before)
        _settings_before.clear()
        return path
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"folder: {path}: expected a folder ({error.strerror})") from None
    settings = {_FOLDER: str(path), _SHORTEST: 0.0}
    if not _settings_before:
        _settings_before.update({name: getattr(jax.config, name) for name in settings})
    _change_settings(settings)
    _remove_oldest_files(path, limit)
    return path


def kept_programs_folder() -> Path | None:
    """Return the folder in which programs are kept, None if `keep_programs` keeps none."""
    return Path(getattr(jax.config, _FOLDER)) if _settings_before else None


def _change_settings(settings):
    """Change settings of jax, by name, and have it read that of its cache folder again."""
    for name, value in settings.items():
        jax.config.update(name, value)
    if settings:
        reset_jax_cache()


def _remove_oldest_files(path, limit):
    """Remove the files of jax's cache that were not used for longest, but for `limit` bytes."""
    used = []
    for name in filter(_OWN_FILE.fullmatch, os.listdir(path)):
        with contextlib.suppress(OSError):  # another process has removed it
            about = os.lstat(path / name)
            used.append((max(about.st_atime, about.st_mtime), about.st_size, name))
    left = sum(size for _, size, _ in used)
    for _, size, name in sorted(used):
        if left <= limit:
            return
        with contextlib.suppress(OSError):
            os.unlink(path / name)
        left -= size


def _user_folder():
    """Return the path of the folder ``jaxcable`` in the user's folder for caches."""
    home = Path.home()
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or home / ".cache"
    return Path(base) / "jaxcable"
