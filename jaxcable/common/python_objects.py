"""What decides how functions, classes and objects of Python compute: their code, and its values.

A function is more than its text: globals, functions that it calls, attributes of modules and of
objects, defaults, and values that it closes over decide what it returns. `definition_parts` takes
any of these apart, one level deep. Functions and classes of libraries are known by name and
version.

Functions are described by their bytecode and constants, as they are bound to names at this moment:
files say what the next process will import, not what this one has.
"""

from __future__ import annotations

import contextlib
import dataclasses
import dis
import functools
import hashlib
import os
import sys
import sysconfig
import types
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

PACKAGE = "jaxcable"
# rooms above all programs: none of these is ever called by one
_ROOMS_APART = {"__main__", "cli", "files", "plots", "reporting", "scenes", "studies"}
_RELIED_ON = {"jax", "jaxlib", "jaxtyping", "numpy", "optax", "scipy"}
_RELIED_ON |= (sys.stdlib_module_names | {"builtins"}) - {"unittest", "__main__"}
_GENERATED = "_cython", "namedtuple_"  # modules that are none
_GLOBAL_READS = "LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS"
_METHODS = types.FunctionType, staticmethod, classmethod, property, functools.cached_property
_known_digests: dict[
    int, tuple[types.CodeType, str]
] = {}  # by address, which the code keeps occupied

PLAIN_TYPES = {bool, int, float, complex, str, bytes, type(None), type(...)}
"""Types of values whose text is all that they are."""


class ForeignCodeError(Exception):
    """A program depends on code outside of the package, whose source is not known."""


def is_program_module(module: str) -> bool:
    """Tell whether a module, given by its name, has code that compiled programs can depend on.

    These are the modules of this package, but not those of plots, files, reports, scenes, studies
    and cli.
    """
    package, *rooms = module.split(".")
    return package == PACKAGE and bool(rooms) and rooms[0] not in _ROOMS_APART


def digest_of_bytes(*parts: bytes) -> str:
    """Return a digest of all these bytes together, a text of 32 characters."""
    return hashlib.blake2b(b"|".join(parts), digest_size=16).hexdigest()


def definition_parts(value: Any, of_package: bool = False) -> Iterator[Any]:
    """Yield the parts that decide what a function, class or object computes, one level deep.

    Parts are, for example, a function's bytecode, defaults, captured values and the globals it
    reads. They are described further in the same way.

    Args:
        value: the function, class or object.
        of_package: True for code of this package, all of whose modules are described: globals are
            left out, and contents of caches and registries, which change while the package works.
            False for code of the user, to whom this package is a library.

    Raises:
        ForeignCodeError: in the package, a function or class that is defined elsewhere.
    """
    yield type(value).__name__
    if isinstance(value, types.ModuleType):
        yield from (value.__name__, _package_version(value.__name__))
    elif isinstance(value, np.memmap):
        yield from _parts_of_memmap(value)
    elif isinstance(value, types.FunctionType | type) and _is_library_definition(value, of_package):
        yield from (value.__module__, value.__qualname__, _package_version(value.__module__))
    elif isinstance(value, types.FunctionType):
        yield from _parts_of_function(value, of_package)
    elif isinstance(value, type):
        yield from _parts_of_class(value)
    elif isinstance(value, staticmethod | classmethod | types.MethodType):
        yield from (value.__func__, getattr(value, "__self__", None))
    elif isinstance(value, property):
        yield from (value.fget, value.fset, value.fdel)
    elif isinstance(value, functools.cached_property):
        yield value.func
    elif isinstance(value, functools.partial):
        yield from (value.func, value.args, tuple(sorted(value.keywords.items())))
    elif isinstance(value, types.MappingProxyType):
        yield dict(value)
    elif isinstance(value, types.BuiltinFunctionType):
        owner = value.__self__
        yield value.__qualname__
        yield owner if not isinstance(owner, types.ModuleType) else owner.__name__
    elif hasattr(value, "__wrapped__") or of_package:  # `jax.jit`, `functools.lru_cache`
        yield from _parts_of_package_object(value)
    else:
        yield from _parts_of_object(value)


def _is_library_definition(value, of_package):
    """Tell whether a function or class is of a library, so that name and version describe it.

    With `of_package`, raises ForeignCodeError for one that neither this package nor a library that
    it uses has defined.
    """
    package = (value.__module__ or "builtins").partition(".")[0]
    if of_package:
        relied_on = package in _RELIED_ON or package.startswith(_GENERATED)
        if package != PACKAGE and not relied_on:
            raise ForeignCodeError(f"{value.__module__}.{value.__qualname__}")
        return package != PACKAGE
    return _is_library_package(package)


def _is_library_package(package):
    """Tell whether a package, given by its name, is Python's, this one, or an installed library."""
    if package == PACKAGE or package in _RELIED_ON:
        return True
    file = getattr(sys.modules.get(package), "__file__", None)
    return file is not None and os.path.realpath(file).startswith(_library_folders())


@functools.cache
def _library_folders():
    """Return the paths of the folders of installed libraries, each ending with a separator."""
    names = "purelib", "platlib"
    return tuple(os.path.join(os.path.realpath(sysconfig.get_path(name)), "") for name in names)


def _package_version(module):
    """Return the version of the package that a module, given by its name, belongs to, or ""."""
    package = sys.modules.get((module or "builtins").partition(".")[0])
    return str(getattr(package, "__version__", ""))


def _parts_of_function(function, of_package):
    """Yield digest of bytecode, defaults, captured values and, for a user's function, its globals.

    Globals are those that its code reads; `of_package` is as in `definition_parts`.
    """
    yield digest_of_code(function.__code__)
    yield from (function.__defaults__, tuple((function.__kwdefaults__ or {}).items()))
    for cell in function.__closure__ or ():
        with contextlib.suppress(ValueError):  # a variable that has no value yet
            yield cell.cell_contents
    if of_package:
        return
    yield vars(function)
    names, space = _CodeNames(set(), set(), set()), function.__globals__
    _collect_code_names(function.__code__, names)
    found = {name: space[name] for name in names.read & space.keys()}
    found |= {name: sys.modules[name] for name in names.imported & sys.modules.keys()}
    yield from _module_attributes_read(found, names.any, set())


def _module_attributes_read(found, names, seen):
    """Yield names and values of globals, and the attributes that code can read from modules.

    `found` are globals by name; attributes of the user's modules are yielded if `names` has them;
    modules in `seen` are not searched again.
    """
    for name, value in sorted(found.items()):
        yield from (name, value)
        if not isinstance(value, types.ModuleType) or value.__name__ in seen:
            continue
        if not _is_library_package(value.__name__.partition(".")[0]):
            own, inside = vars(value), {*seen, value.__name__}
            yield from _module_attributes_read(
                {n: own[n] for n in names & own.keys()}, names, inside
            )


class _CodeNames(NamedTuple):
    """Names in bytecode, as sets: globals that it reads, modules that it imports, and all names."""

    read: set[str]
    imported: set[str]
    any: set[str]


def _collect_code_names(code, names):
    """Add the names in a code object, and in functions defined in it, to `names` (`_CodeNames`)."""
    names.any.update(code.co_names)
    for operation in dis.get_instructions(code):
        if operation.opname in _GLOBAL_READS:
            names.read.add(operation.argval)
        elif operation.opname == "IMPORT_NAME":
            names.imported.add(operation.argval)
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            _collect_code_names(constant, names)


def digest_of_code(code: types.CodeType) -> str:
    """Return a digest of bytecode and the functions in it, 32 characters; comments do not count."""
    if id(code) not in _known_digests:
        constants = [_describe_constant(constant) for constant in code.co_consts]
        words = (
            *(code.co_name, code.co_argcount, code.co_kwonlyargcount, code.co_flags, constants),
            *(code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars),
        )
        found = digest_of_bytes(code.co_code, code.co_exceptiontable, repr(words).encode())
        _known_digests[id(code)] = code, found
    return _known_digests[id(code)][1]


def _describe_constant(constant):
    """Return a text or list that describes a bytecode constant alike in all processes."""
    if isinstance(constant, types.CodeType):
        return digest_of_code(constant)
    if isinstance(constant, frozenset | tuple):
        words = [_describe_constant(part) for part in constant]
        return words if isinstance(constant, tuple) else {"set": sorted(map(repr, words))}
    return repr(constant)


def _parts_of_class(cls):
    """Yield name, bases, methods and attributes of a class, except Python's own attributes."""
    yield cls.__qualname__
    yield cls.__bases__
    for name, value in sorted(vars(cls).items()):
        if name[:2] != "__" or isinstance(value, _METHODS):
            yield from (name, value)


def _parts_of_package_object(value):
    """Yield the parts of an object in the package, or of a wrapped function (as by `jax.jit`).

    They are its type, the entries of a tuple, or of other containers if they are plain, attributes
    (all of a frozen dataclass, else those that are functions), and the function that it wraps.
    """
    kind = type(value)
    yield from (kind.__module__, kind.__qualname__)
    if isinstance(value, tuple):
        yield from value
    elif isinstance(value, dict | set | frozenset):
        yield sorted_plain_values(value)
    elif isinstance(value, np.dtype):
        yield str(value)
    held = dict(getattr(value, "__dict__", {}))
    if not (dataclasses.is_dataclass(value) and kind.__dataclass_params__.frozen):
        held = {n: v for n, v in held.items() if isinstance(v, types.FunctionType)}
    held["__wrapped__"] = getattr(value, "__wrapped__", None)
    yield from (part for name in sorted(held) for part in (name, held[name]))


def sorted_plain_values(values: Any) -> list[str] | None:
    """Return the sorted texts of the entries of a set or dictionary of numbers and texts.

    None if it is empty, contains other objects, or is not a set or dictionary.
    """
    if not isinstance(values, dict | set | frozenset):
        return None
    inner = [*values, *values.values()] if isinstance(values, dict) else values
    if not all(
        type(part) in PLAIN_TYPES or isinstance(part, np.generic | np.dtype) for part in inner
    ):
        return None
    return sorted(map(repr, values.items() if isinstance(values, dict) else values)) or None


def _parts_of_object(value):
    """Yield the class of a user's object and what pickling would write of it, or its text."""
    yield type(value)
    try:
        found = value.__reduce_ex__(4)  # what `pickle` would write
    except Exception:  # whatever a class raises that cannot be pickled
        yield getattr(value, "__dict__", None) or repr(value)
        return
    for part in [found] if isinstance(found, str) else found:
        yield list(part) if isinstance(part, Iterator) else part


def _parts_of_memmap(array):
    """Yield what identifies a memory-mapped array: dtype, shape, path, size and time of last write.

    Its values are not read: it may be larger than memory.
    """
    yield from (str(array.dtype), array.shape, array.offset, array.filename)
    if array.filename is not None:
        with contextlib.suppress(OSError):
            about = os.stat(array.filename)
            yield from (about.st_size, about.st_mtime_ns)
