"""What a function on the host computes with: its code, and every value that the code can reach.

A function of a user is more than its text: globals, functions that it calls, attributes of modules
and of objects, defaults, and values that it closes over decide what it returns. `parts` takes any
of these apart, one level deep; functions and classes of libraries are known by name and version.
"""

from __future__ import annotations

import contextlib
import dis
import functools
import os
import sys
import sysconfig
import types
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from .code_digest import PACKAGE, RELIED_ON

_READS = "LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS"
_METHODS = types.FunctionType, staticmethod, classmethod, property, functools.cached_property


def parts(value: Any) -> Iterator[Any]:
    """What decides how a function, class or other object of the host computes, one level deep."""
    yield type(value).__name__
    if isinstance(value, types.ModuleType):
        yield from (value.__name__, _version(value.__name__))
    elif isinstance(value, np.memmap):
        yield from _mapped(value)
    elif isinstance(value, types.FunctionType | type) and _is_of_library(value.__module__):
        yield from (value.__module__, value.__qualname__, _version(value.__module__))
    elif isinstance(value, types.FunctionType):
        yield from _of_function(value)
    elif isinstance(value, type):
        yield from _of_class(value)
    elif isinstance(value, staticmethod | classmethod | types.MethodType):
        yield from (value.__func__, getattr(value, "__self__", None))
    elif isinstance(value, property):
        yield from (value.fget, value.fset, value.fdel)
    elif isinstance(value, functools.cached_property):
        yield value.func
    elif isinstance(value, functools.partial):
        yield from (value.func, value.args, value.keywords)
    elif isinstance(value, types.MappingProxyType):
        yield dict(value)
    elif isinstance(value, types.BuiltinFunctionType):
        owner = value.__self__
        yield value.__qualname__
        yield owner if not isinstance(owner, types.ModuleType) else owner.__name__
    elif hasattr(value, "__wrapped__"):  # `jax.jit`, `functools.lru_cache`
        yield value.__wrapped__
    else:
        yield from _of_object(value)


def _is_of_library(module):
    """Whether a module, given by its name, is of Python, of this package or of another library."""
    package = (module or "builtins").partition(".")[0]
    if package == PACKAGE or package in RELIED_ON:
        return True
    file = getattr(sys.modules.get(package), "__file__", None)
    return file is not None and os.path.realpath(file).startswith(_libraries())


@functools.cache
def _libraries():
    """Folders of installed libraries, each with a separator at its end."""
    names = "purelib", "platlib"
    return tuple(os.path.join(os.path.realpath(sysconfig.get_path(name)), "") for name in names)


def _version(module):
    """The version of the package of a module, given by its name; empty if it has none."""
    package = sys.modules.get((module or "builtins").partition(".")[0])
    return str(getattr(package, "__version__", ""))


def _of_function(function):
    """A function of the user: code, defaults, values from around it, and globals that it names."""
    names = _Names(set(), set(), set())
    yield from _of_code(function.__code__, names)
    yield from (function.__defaults__, function.__kwdefaults__, vars(function))
    for cell in function.__closure__ or ():
        with contextlib.suppress(ValueError):  # a variable that has no value yet
            yield cell.cell_contents
    space = function.__globals__
    found = {name: space[name] for name in names.read & space.keys()}
    found |= {name: sys.modules[name] for name in names.imported & sys.modules.keys()}
    yield from _with_modules(found, names.any, set())


def _with_modules(found, names, seen):
    """Names and values in their order, and what code with these `names` can read in modules."""
    for name, value in sorted(found.items()):
        yield from (name, value)
        if not isinstance(value, types.ModuleType) or value.__name__ in seen:
            continue
        if not _is_of_library(value.__name__):
            own, inside = vars(value), {*seen, value.__name__}
            yield from _with_modules({n: own[n] for n in names & own.keys()}, names, inside)


class _Names(NamedTuple):
    """Names in code: those that it reads as globals, modules that it imports, and all of them."""

    read: set[str]
    imported: set[str]
    any: set[str]


def _of_code(code, names):
    """Bytes and constants of code, and of the code of functions in it; adds to `names` theirs."""
    names.any.update(code.co_names)
    for operation in dis.get_instructions(code):
        if operation.opname in _READS:
            names.read.add(operation.argval)
        elif operation.opname == "IMPORT_NAME":
            names.imported.add(operation.argval)
    yield from (code.co_code, code.co_names, code.co_exceptiontable)
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _of_code(constant, names)
        else:
            yield constant


def _of_class(cls):
    """A class of the user: bases, methods, and attributes that are no names of Python's own."""
    yield cls.__bases__
    for name, value in sorted(vars(cls).items()):
        if name[:2] != "__" or isinstance(value, _METHODS):
            yield from (name, value)


def _of_object(value):
    """An object: its class, and what it holds; of one that Python cannot take apart its text."""
    yield type(value)
    try:
        found = value.__reduce_ex__(4)  # what `pickle` would write
    except Exception:  # whatever a class raises that cannot be pickled
        yield getattr(value, "__dict__", None) or repr(value)
        return
    for part in [found] if isinstance(found, str) else found:
        yield list(part) if isinstance(part, Iterator) else part


def _mapped(array):
    """An array in a file, perhaps larger than memory: the file, and when it was last written."""
    yield from (str(array.dtype), array.shape, array.offset, array.filename)
    if array.filename is not None:
        with contextlib.suppress(OSError):
            about = os.stat(array.filename)
            yield from (about.st_size, about.st_mtime_ns)
