"""Compiled programs kept on disk, for the next process.

Of what a first call takes, jax keeps the compilation; a program is still traced and lowered. The
programs of this package that are called by themselves are kept whole, with a key that is known
before they are traced: versions, settings, the code of the package, shapes and dtypes, and what
is static. A file is what jax makes of a program, with a checksum (`program_folder`).
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import io
import os
import pickle
import platform
import re
import sys
import warnings
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import jaxlib
import numpy as np
import optax
import scipy

from . import digest, host_calls
from . import jax_internals as internals
from .checks import require_whole_number
from .program_folder import DamagedFileError, ProgramFolder, UnsafeFolderError, open_program_folder
from .python_objects import ForeignCodeError, is_program_module

_VARIABLE = "JAXCABLE_PROGRAMS"
LIMIT = 1 << 30
"""Bytes that kept programs take at most, if nothing else is said."""

_KNOWN_PACKAGES = "jaxcable", "jax", "jaxlib", "numpy", "builtins", "collections", "copyreg"
_SHORTEST_COMPILATION = 0.05  # seconds: jax does not keep what compiles faster
_SHORTEST_SETTING = "jax_persistent_cache_min_compile_time_secs"

_open_place: list[ProgramFolder] = []  # one, or none
# what jax's setting of the shortest compilation to keep was before ours; empty if ours is not set
_jax_settings_before: list[float] = []
_jax_cache_hits: list[str] = []  # programs that jax has found in its own cache


def keep_programs(folder: str | os.PathLike[str] | None = None, limit: int = LIMIT) -> Path:
    """Keep compiled programs on disk, so that the next process need not compile them.

    Analyses that are called from Python start without being traced or compiled; those called inside
    of `jax.jit` are traced, and not compiled again (jax's persistent compilation cache, which is
    put beside them unless it has a folder). Processes can share a folder. A damaged, full or
    read-only folder costs no more than to compile. The command line keeps its programs by itself;
    importing the package changes nothing.

    Programs lie in two folders that are made for them in `folder`, ``programs`` and ``xla``, and
    only files that were written there are ever removed. A program is found again as long as the
    code of the package, versions and settings are the same. Elements, laws and solvers defined
    outside of the package are compiled anew in every process, since nothing tells whether their
    source has changed.

    Args:
        folder: a folder of yours to which nobody else can write, because programs are run from it;
            default: that of the environment variable JAXCABLE_PROGRAMS (none is kept where it is
            empty), or ``jaxcable`` in the user's folder for caches.
        limit: bytes to keep at most; what was not used for longest is removed. With 0 programs are
            neither kept nor looked for from now on.

    Returns:
        The folder.

    Raises:
        ValueError: `limit` is negative or no integer; `folder` is a file, or belongs to another
            user; other users can write to it, or to a folder on the way to it (other than such as
            ``/tmp``), also by symbolic links; its ``programs`` or ``xla`` hold other files.

    Warns:
        RuntimeWarning: the default folder, or that of the environment, is such a one, or jax cannot
            store programs; none is kept. A file is damaged; its program is compiled anew.

    Example:
        The first lines of a script:

        >>> import tempfile  # for this example: a script gives no folder
        >>> folder = jc.keep_programs(tempfile.mkdtemp())
        >>> folder.is_dir()
        True
        >>> folder = jc.keep_programs(limit=0)  # no more
    """
    require_whole_number(limit, "limit", least=0)
    named = folder is not None
    path = _parse_folder_argument(
        os.environ.get(_VARIABLE, _default_program_folder()) if folder is None else folder
    )
    if path is None and named:
        raise ValueError(f"folder = {folder!r}: expected the path of a folder")
    if path is None or limit == 0:
        _stop_keeping_programs()
        return path or Path()
    try:
        place = open_program_folder(path, int(limit))
    except UnsafeFolderError as error:
        if named:
            raise ValueError(f"folder: {error}") from None
        _stop_keeping_programs()
        warnings.warn(f"{error}; no programs are kept", RuntimeWarning, stacklevel=2)
        return path
    for feature, is_there in (
        ("executables", internals.program_serializer),
        ("settings", internals.jax_settings),
    ):
        if is_there() is None:
            internals.warn_missing_feature(feature)
    if _may_set_jax_cache_folder():
        _set_jax_cache_folder(str(place.jax_cache_folder))
    _record_jax_cache_hits()
    _open_place[:] = [place]
    place.remove_oldest_files()
    return path


def bytes_of_kept_programs() -> int | None:
    """Return the size of all kept programs, bytes; None where none are kept."""
    return _open_place[0].n_bytes() if _open_place else None


def are_programs_kept() -> bool:
    """Tell whether compiled programs are kept on disk now, for the next process."""
    return bool(_open_place)


def kept_programs_folder() -> Path | None:
    """Return the folder in which programs are kept, None if they are not."""
    return _open_place[0].folder if _open_place else None


def _parse_folder_argument(folder):
    """Return a user's argument as a path; None if it is empty or no path."""
    try:
        return Path(folder).expanduser() if os.fspath(folder) else None
    except TypeError:
        return None


def _may_set_jax_cache_folder():
    """Tell whether we may set jax's cache folder: it has none, or the one that was set here."""
    folder = jax.config.jax_compilation_cache_dir
    return folder is None or folder in [str(place.jax_cache_folder) for place in _open_place]


def _stop_keeping_programs():
    """Stop keeping programs and looking for them, and restore jax's own settings."""
    if _may_set_jax_cache_folder():
        _set_jax_cache_folder(None)
    _open_place.clear()


def _set_jax_cache_folder(folder):
    """Set the folder of jax's own compilation cache; None ends it and restores jax's settings."""
    if folder is None and _jax_settings_before:
        jax.config.update(_SHORTEST_SETTING, _jax_settings_before.pop())
    if folder is not None and not _jax_settings_before:
        _jax_settings_before.append(jax.config.jax_persistent_cache_min_compile_time_secs)
        jax.config.update(_SHORTEST_SETTING, _SHORTEST_COMPILATION)
        # a file that another process is just writing, or a damaged one
        for verb in ("reading", "writing"):
            warnings.filterwarnings("ignore", f"Error {verb} persistent compilation cache entry")
    jax.config.update("jax_compilation_cache_dir", folder)
    if not internals.reset_jax_cache() and folder is not None:
        internals.warn_missing_feature("cache")


@contextlib.contextmanager
def preserve_program_settings() -> Iterator[None]:
    """Restore, when a ``with`` block ends, the folder of kept programs and jax's cache settings.

    For tests and commands that call `keep_programs` in the block.
    """
    place, before = list(_open_place), list(_jax_settings_before)
    jaxs = {
        name: getattr(jax.config, name) for name in ("jax_compilation_cache_dir", _SHORTEST_SETTING)
    }
    try:
        yield
    finally:
        _open_place[:], _jax_settings_before[:] = place, before
        changed = [name for name, value in jaxs.items() if getattr(jax.config, name) != value]
        for name in changed:
            jax.config.update(name, jaxs[name])
        if changed:
            internals.reset_jax_cache()


def _default_program_folder():
    """Return the path of the folder ``jaxcable`` in the user's folder for caches."""
    home = Path.home()
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or home / ".cache"
    return Path(base) / "jaxcable"


def load_or_compile(
    compile_program: Callable[[], jax.stages.Compiled],
    words: tuple[Any, ...],
    arguments: Any,
    options: dict[str, Any],
) -> jax.stages.Compiled:
    """Return a compiled program, loaded from disk or else compiled now and stored there.

    Without `keep_programs` it is compiled and not stored.

    Args:
        compile_program: function that compiles it.
        words: module and name of the function, and how it is compiled.
        arguments: pytree of arrays, whose leaves are the arguments of the program.
        options: static arguments.
    """
    described = words, arguments, options
    place = _open_place[0] if _open_place else None  # another thread may stop keeping meanwhile
    key = None if place is None else _program_key_or_none(*described)
    if place is None or key is None:
        return compile_program()
    found = _load_program(place, key, jax.tree.leaves(arguments))
    if found is not None:
        return found
    hits = len(_jax_cache_hits)
    with internals.without_jax_cache():
        program = compile_program()
    # a program that jax has loaded from its own cache cannot be written once more (jax 0.10); one
    # that was traced while the code or a setting has changed is of neither
    if len(_jax_cache_hits) == hits and _program_key_or_none(*described) == key:
        _store_program(place, key, program)
        place.remove_oldest_files()
    return program


def _program_key_or_none(*described):
    """Return the `_program_key` of these arguments; None if it depends on code of the user."""
    try:
        return _program_key(*described)
    except ForeignCodeError:
        return None


@functools.cache
def _record_jax_cache_hits():
    """Have jax note in `_jax_cache_hits`, from now on, each program that its own cache returns."""

    def heard(event, **_):
        if event == "/jax/compilation_cache/cache_hits":
            _jax_cache_hits.append(event)

    jax.monitoring.register_event_listener(heard)


def _load_program(place, key, leaves):
    """Load a compiled program from disk; None if it is not there or, with a warning, is damaged."""
    try:
        text = place.read_program(key)
        if text is None:
            return None
        targets, executable, tree = _unpack_program(text, place.program_path(key))
    except (DamagedFileError, UnsafeFolderError) as error:
        why = f"{error}: the file is damaged" if isinstance(error, DamagedFileError) else str(error)
        text = f"keep_programs: {why}; the program is compiled again"
        warnings.warn(text, RuntimeWarning, stacklevel=2)
        return None
    functions = internals.program_serializer()
    try:
        for name in targets:
            host_calls.register_call(name)
        internals.preload_lapack()
        return functions[1](executable, jax.tree.structure((tuple(leaves), {})), tree)
    except Exception:  # a solver that is not there, another machine, another jax: not damaged
        return None


def _unpack_program(text, path):
    """Return the content of a program's file, `text` (bytes); raise DamagedFileError if that fails.

    The result has the names of NumPy functions that the program calls, the serialized executable,
    and the tree structure of its results.
    """
    try:
        targets, executable, results = pickle.loads(zlib.decompress(text))
    except Exception as error:  # whatever pickle makes of it
        raise DamagedFileError(str(path)) from error
    return targets, executable, jax.tree.structure(results)


def _store_program(place, key, program):
    """Write a program to a `ProgramFolder`, unless jax cannot serialize it or it has callbacks."""
    targets = set(re.findall('custom_call_target="([^"]*)"', program.as_text()))
    if any("callback" in name for name in targets):  # by its address: a listener of the user
        return
    targets = {name for name in targets if name.startswith(host_calls.PREFIX)}
    try:
        executable, _, tree = internals.program_serializer()[0](program)
        results = tree.unflatten([0] * tree.num_leaves)
        text = zlib.compress(pickle.dumps((sorted(targets), executable, results)), 1)
    except Exception as error:  # of jax, which may have no way to describe this program
        text = f"keep_programs: a program could not be saved: {type(error).__name__}: {error}"
        warnings.warn(text, RuntimeWarning, stacklevel=2)
        return
    place.write_program(key, text)


class _PackageOnlyPickler(pickle.Pickler):
    """Pickle objects of this package and of the libraries that it uses; refuse all others."""

    def reducer_override(self, obj):
        """Raise ForeignCodeError if `obj`, or its type, is of no package in `_KNOWN_PACKAGES`.

        Called by pickle for each object; NotImplemented makes it go on in the usual way.
        """
        found = obj if isinstance(obj, type) or callable(obj) else type(obj)
        if (found.__module__ or "").partition(".")[0] not in _KNOWN_PACKAGES:
            raise ForeignCodeError(found)
        return NotImplemented


def _program_key(words, arguments, options):
    """Return the key of a program on disk: a digest, 32 characters, of all that it depends on.

    `words` name the function and how it is compiled; it must belong to the package and capture no
    variables. Raises `ForeignCodeError` if the program depends on other code.
    """
    module, name, *_ = words
    if not is_program_module(module) or "<" in name or internals.program_serializer() is None:
        raise ForeignCodeError(f"{module}.{name}")
    leaves, tree = jax.tree.flatten(arguments)
    described = io.BytesIO()
    pickler = _PackageOnlyPickler(described)
    pickler.fast = True  # equal objects are described alike, whether they are one object or two
    try:
        pickler.dump((tree.unflatten(range(len(leaves))), options))
    except (pickle.PicklingError, AttributeError, TypeError, ValueError, RecursionError) as error:
        raise ForeignCodeError(str(error)) from error
    text = repr((words, list(map(argument_signature, leaves)), _describe_process())).encode()
    return hashlib.blake2b(described.getvalue() + text, digest_size=16).hexdigest()


def argument_signature(x: Any) -> Any:
    """Return what a program depends on of an argument: shape, dtype and device; hashable.

    Arrays of NumPy, and those of jax that are bound to no device, are the same to a program.
    """
    if isinstance(x, jax.Array):
        free = not (x.weak_type or getattr(x, "committed", True))
        return (x.shape, x.dtype) if free else (x.shape, x.dtype, x.weak_type, x.sharding)
    plain = np.ndarray | np.generic | jax.ShapeDtypeStruct
    return (x.shape, x.dtype) if isinstance(x, plain) else type(x)


def _describe_process():
    """Return the part of every program's key that is the same in a process, a tuple.

    It has machine, versions, XLA flags, settings of jax, and a digest of this package's code.
    """
    values = internals.jax_settings()
    if values is None:
        raise ForeignCodeError("jax.config")
    about = "cache", "log", "dump", "traceback"  # settings that do not matter to a program
    settings = {n: str(v) for n, v in values.items() if not any(word in n for word in about)}
    return (
        *_describe_machine(),
        internals.xla_flags_in_effect(),
        sorted(settings.items()),
        digest.of_package(),
    )


@functools.cache
def _describe_machine():
    """Return a tuple of library versions, devices, operating system and processor features."""
    devices = [(device.platform, device.device_kind) for device in jax.devices()]
    processor = platform.processor() or platform.machine()
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as file:
        lines = [line for line in file if line.startswith(("flags", "Features", "model name"))]
        processor += "".join(sorted(set(lines)))
    libraries = jax, jaxlib, np, scipy, optax
    versions = [library.__version__ for library in libraries]
    return (*versions, sys.version, devices, platform.platform(), processor)
