"""Compiled programs kept on disk, for the next process.

Of what a first call takes, jax keeps the compilation; a program is still traced and lowered. The
programs of this package that are called by themselves are kept whole, with a key that is known
before they are traced: versions, settings, the source of the package, shapes and dtypes, and what
is static. A file is a checksum and what `jax.experimental.serialize_executable` makes of a program.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import io
import os
import pickle
import platform
import re
import sys
import tempfile
import warnings
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import jaxlib
import numpy as np
from jax.experimental import serialize_executable
from jax.experimental.compilation_cache import compilation_cache

from .checks import whole

_VARIABLE = "JAXCABLE_PROGRAMS"
LIMIT = 1 << 30
"""Bytes that kept programs take at most, if nothing else is said."""

_OURS = "jaxcable", "jax", "jaxlib", "numpy", "builtins", "collections", "copyreg"
_FULL = 0.8  # of the limit: what is left when old programs are removed
_DIGEST = 32  # bytes
_SHORT = 0.05  # seconds: jax does not keep what compiles faster


@dataclasses.dataclass(frozen=True)
class Place:
    """Where programs are kept.

    Attributes:
        folder: as given to `keep_programs`.
        limit: bytes.
    """

    folder: Path
    limit: int


_place: list[Place] = []  # one, or none
_PREFIX = "jaxcable: "
_hits: list[str] = []  # programs that jax has found in its own cache
_targets: list[Callable[[str], object]] = []  # makes a host function known to XLA, by its name


def keep_programs(folder: str | os.PathLike[str] | None = None, limit: int = LIMIT) -> Path:
    """Keep compiled programs on disk, so that the next process need not compile them.

    Analyses that are called by themselves start without being traced or compiled; what is compiled
    inside of `jax.jit` is traced, and not compiled again (jax's persistent compilation cache, which
    is put into the same folder unless it has one). Processes can share a folder. A damaged, full or
    read-only folder costs no more than to compile. The command line keeps its programs by itself;
    importing the package changes nothing.

    Elements, laws and solvers defined outside of the package are compiled anew in every process,
    since nothing tells whether their source has changed.

    Args:
        folder: the folder, which should belong to the user alone, because programs are run from
            it; default: that of the environment variable JAXCABLE_PROGRAMS (none is kept where it
            is empty), or ``jaxcable`` in the user's folder for caches.
        limit: bytes to keep at most; what was not used for longest is removed. With 0 programs are
            neither kept nor looked for from now on.

    Returns:
        The folder.

    Raises:
        ValueError: `limit` is negative or no integer.

    Example:
        The first lines of a script:

        >>> import tempfile  # for this example: a script gives no folder
        >>> folder = jc.keep_programs(tempfile.mkdtemp())
        >>> folder.is_dir()
        True
        >>> folder = jc.keep_programs(limit=0)  # no more
    """
    whole(limit, "limit", least=0)
    if folder is None:
        folder = os.environ.get(_VARIABLE, _usual())
        limit = limit if folder else 0
    place = Place(Path(folder).expanduser(), int(limit))
    before = jax.config.values["jax_compilation_cache_dir"]
    own = before is None or [before] == [str(known.folder) for known in _place]
    if limit == 0:
        _place.clear()
        if own:
            _jax_keeps(None)
        return place.folder
    with contextlib.suppress(OSError):
        place.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if own:
        _jax_keeps(str(place.folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", _SHORT)
        # a file that another process is just writing, or a damaged one
        for verb in ("reading", "writing"):
            warnings.filterwarnings("ignore", f"Error {verb} persistent compilation cache entry")
    _listens()
    _place[:] = [place]
    _bounded(place)
    return place.folder


def _jax_keeps(folder):
    """Have jax keep programs in a folder, or in none."""
    jax.config.update("jax_compilation_cache_dir", folder)
    compilation_cache.reset_cache()


def _usual():
    """The folder of programs in the user's folder for caches."""
    home = Path.home()
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or home / ".cache"
    return Path(base) / "jaxcable"


@dataclasses.dataclass
class Found:
    """A program from disk, or None; then one that has been compiled is to be put here."""

    program: jax.stages.Compiled | None = None


@contextlib.contextmanager
def kept(
    words: tuple[Any, ...], arguments: Any, leaves: list[Any], options: dict[str, Any]
) -> Iterator[Found]:
    """Look a program up on disk; if it is compiled meanwhile, it is kept.

    Args:
        words: name of the function, and how it is compiled.
        arguments, leaves: pytree of arrays, and its leaves, which the program takes.
        options: static arguments.

    Yields:
        `Found`.
    """
    path = None
    if _place:
        with contextlib.suppress(_ForeignError, OSError):
            key = _key(words, arguments, options)
            path = _place[0].folder / f"{key}.program"
    if path is None:
        yield Found()
        return
    found = Found(_load(path, leaves))
    if found.program is not None:
        yield found
        return
    hits = len(_hits)
    with _unknown_to_jax():
        yield found
    # a program that jax has loaded from its own cache cannot be written once more (jax 0.10)
    if found.program is not None and len(_hits) == hits:
        _store(path, found.program)
        _bounded(_place[0])


@contextlib.contextmanager
def _unknown_to_jax():
    """What is compiled meanwhile is not put into jax's own cache."""
    name = "jax_persistent_cache_min_compile_time_secs"
    before = jax.config.values[name]
    jax.config.update(name, float("inf"))
    try:
        yield
    finally:
        jax.config.update(name, before)


@functools.cache
def _listens():
    """Listen to what jax does with its cache."""

    def heard(event, **_):
        if event == "/jax/compilation_cache/cache_hits":
            _hits.append(event)

    jax.monitoring.register_event_listener(heard)


def _load(path, leaves):
    """The program in a file; None if there is none, or it is damaged."""
    try:
        text = path.read_bytes()
    except OSError:
        return None
    digest, text = text[:_DIGEST], text[_DIGEST:]
    if hashlib.blake2b(text, digest_size=_DIGEST).digest() != digest:
        return None
    targets, executable, results = pickle.loads(zlib.decompress(text))
    trees = jax.tree.structure((tuple(leaves), {})), jax.tree.structure(results)
    try:
        for name in targets:
            _targets[0](name)
        _lapack()
        program = serialize_executable.deserialize_and_load(executable, *trees)
    except (KeyError, jax.errors.JaxRuntimeError):  # a solver that is not there, another machine
        return None
    with contextlib.suppress(OSError):
        os.utime(path)  # used now
    return program


def _store(path, program):
    """Write a file, as a whole or not at all: the folder may be full, or read-only."""
    targets = set(re.findall('custom_call_target="([^"]*)"', program.as_text()))
    if any("callback" in name for name in targets):  # by its address: a listener of the user
        return
    targets = {name for name in targets if name.startswith(_PREFIX)}
    executable, _, tree = serialize_executable.serialize(program)
    results = tree.unflatten([0] * tree.num_leaves)
    text = zlib.compress(pickle.dumps((sorted(targets), executable, results)), 1)
    name = None
    try:
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".new", delete=False) as file:
            name = file.name
            file.write(hashlib.blake2b(text, digest_size=_DIGEST).digest() + text)
        os.replace(name, path)
    except OSError:
        if name is not None:
            with contextlib.suppress(OSError):
                os.unlink(name)


def _bounded(place):
    """Remove the files that were not used for longest, if there are too many bytes."""
    with contextlib.suppress(OSError):
        files = [(f.stat().st_mtime, f.stat().st_size, f) for f in place.folder.iterdir()]
        total = sum(size for _, size, _ in files)
        if total <= place.limit:
            return
        for _, size, file in sorted(files):
            with contextlib.suppress(OSError):
                file.unlink()
                total -= size
            if total <= _FULL * place.limit:
                return


def host_function(name: str) -> str:
    """The name by which kept programs call a host function, see `names_host_functions`."""
    return _PREFIX + name


def names_host_functions(function: Callable[[str], object]) -> None:
    """Have a function make host functions known to XLA, by their names in `host_function`."""
    _targets.append(lambda name: function(name.removeprefix(_PREFIX)))


@functools.cache
def _lapack():
    """Have jaxlib look LAPACK up, which it does where a program with it is lowered."""
    from jaxlib import lapack

    lapack.prepare_lapack_call("potrf", np.float64)


class _ForeignError(Exception):
    """Something of a program is defined outside of the package."""


class _Pickler(pickle.Pickler):
    """Describes objects of this package and of those that it uses, and no others."""

    def reducer_override(self, obj):
        found = obj if isinstance(obj, type) or callable(obj) else type(obj)
        if found.__module__.partition(".")[0] not in _OURS:
            raise _ForeignError(found)
        return NotImplemented


def _key(words, arguments, options):
    """Digest of all that a program depends on; `_ForeignError` if that is not known."""
    leaves, tree = jax.tree.flatten(arguments)
    described = io.BytesIO()
    pickler = _Pickler(described)
    pickler.fast = True  # equal objects are described alike, whether they are one object or two
    try:
        pickler.dump((tree.unflatten(range(len(leaves))), options))
    except (pickle.PicklingError, AttributeError, TypeError, ValueError, RecursionError) as error:
        raise _ForeignError(str(error)) from error
    kinds = [_words(x) for x in leaves]
    text = repr((words, kinds, _surroundings())).encode()
    return hashlib.blake2b(described.getvalue() + text, digest_size=16).hexdigest()


def _words(x):
    """Shape, dtype and place of an argument, in words."""
    if isinstance(x, jax.Array):
        return str(x.aval), x.weak_type, str(x.sharding)
    return (x.shape, str(x.dtype)) if isinstance(x, np.ndarray | np.generic) else type(x).__name__


def _surroundings():
    """What all programs of a process depend on, in words."""
    about = "cache", "log", "dump", "traceback"
    settings = {
        name: str(value)
        for name, value in jax.config.values.items()
        if not any(word in name for word in about)
    }
    settings["jax_enable_x64"] = str(jax.config.jax_enable_x64)  # may differ in a block of code
    return (*_versions(), os.environ.get("XLA_FLAGS"), sorted(settings.items()))


@functools.cache
def _versions():
    """Versions, the machine, and a digest of the source of the package."""
    source = hashlib.blake2b(digest_size=16)
    for file in sorted(Path(__file__).parent.parent.rglob("*.py")):
        source.update(str(file.name).encode() + file.read_bytes())
    devices = [(device.platform, device.device_kind) for device in jax.devices()]
    processor = platform.processor() or platform.machine()
    with contextlib.suppress(OSError), open("/proc/cpuinfo") as file:
        lines = [line for line in file if line.startswith(("flags", "Features", "model name"))]
        processor += "".join(sorted(set(lines)))
    versions = jax.__version__, jaxlib.__version__, np.__version__, sys.version
    return (*versions, source.hexdigest(), devices, platform.platform(), processor)
