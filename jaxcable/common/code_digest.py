"""A digest of the code of the package as it is in memory, for programs that are kept on disk.

The files of the package say what the next process will import, not what this one has: they may have
been edited since, functions may have been replaced, modules reloaded, and Python itself may have
taken an outdated file of bytecode. So the functions are described by their bytecode and constants,
as they are bound to names at this moment. Nothing is read, and importing the package takes no
longer. What `import jaxcable` does not import (the command line) cannot be part of a program.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import sys
import types
from collections.abc import Iterator
from typing import Any

import numpy as np

PACKAGE = "jaxcable"
# rooms above all programs: none of these is ever called by one
_APART = {"__main__", "cli", "files", "plots", "reporting", "scenes"}
RELIED_ON = {"jax", "jaxlib", "jaxtyping", "numpy", "optax", "scipy"}
RELIED_ON |= (sys.stdlib_module_names | {"builtins"}) - {"unittest", "__main__"}
_GENERATED = "_cython", "namedtuple_"  # modules that are none
_PLAIN = {bool, int, float, complex, str, bytes, type(None)}
_SCALARS = np.generic, np.dtype
_DEFINED = types.FunctionType, type
_METHODS = types.FunctionType, staticmethod, classmethod, property
_known: dict[int, tuple[types.CodeType, str]] = {}  # by address, which the code keeps occupied


class ForeignError(Exception):
    """Something of a program is defined outside of the package, where its source is not known."""


def code_digest() -> str:
    """Return a digest of all functions, classes and constants that modules of the package name.

    Contents of lists, and of dictionaries that hold objects, are left out: they are registries,
    and caches, and change while the package works.

    Raises:
        ForeignError: a function or class in the package is replaced by one defined elsewhere.
    """
    words: list[Any] = []
    once: dict[int, Any] = {}  # what many modules import
    for module in filter(is_described, sorted(sys.modules)):
        names = dict(vars(sys.modules[module]))  # another thread may import meanwhile
        for name in sorted(name for name in names if name[:2] != "__"):  # those are Python's
            value = names[name]
            at_home = isinstance(value, _DEFINED) and value.__module__ == module
            if at_home:
                words += name, _defined(value, [])
                continue
            if id(value) not in once:
                once[id(value)] = _described(value, [])
            words += name, once[id(value)]
    return _hashed(repr(words).encode())


def is_described(module: str) -> bool:
    """Whether the digest has what is in a module, given by its name."""
    package, *rooms = module.split(".")
    return package == PACKAGE and bool(rooms) and rooms[0] not in _APART


def _hashed(*parts):
    """Digest of bytes."""
    return hashlib.blake2b(b"|".join(parts), digest_size=16).hexdigest()


def _described(value: Any, above: list[int]) -> Any:
    """What a value is, in words; `above` has the addresses of what it is found in."""
    if type(value) in _PLAIN or isinstance(value, _SCALARS):
        return repr(value)  # tells 1, 1.0 and True apart
    if isinstance(value, types.ModuleType):
        return value.__name__
    if isinstance(value, _DEFINED) and _is_at_home(value):  # there it is described in full
        return value.__module__, value.__qualname__
    if isinstance(value, np.ndarray):
        return str(value.dtype), value.shape, value.tobytes()
    if id(value) in above:
        return "itself"
    above.append(id(value))
    if isinstance(value, tuple):
        words = type(value).__name__, [_described(part, above) for part in value]
    elif isinstance(value, dict | set | frozenset):
        words = type(value).__name__, _collected(value)
    else:
        words = _defined(value, above) if isinstance(value, _DEFINED) else _held(value, above)
    above.pop()
    return words


def _is_at_home(value):
    """Whether a function or class of the package is what its module has under its name.

    Those in a class are described with it.
    """
    module = value.__module__ or ""
    if not is_described(module) or module not in sys.modules:
        return False
    return vars(sys.modules[module]).get(value.__qualname__) is value


def _collected(values):
    """Sorted contents of a set or dictionary of constants; None if there is anything else."""
    parts = [*values, *values.values()] if isinstance(values, dict) else values
    if all(type(part) in _PLAIN or isinstance(part, _SCALARS) for part in parts):
        return sorted(map(repr, values.items() if isinstance(values, dict) else values)) or None
    return None


def _defined(value, above):
    """A function or class: by its code if the package defines it, else by its name."""
    module = value.__module__ or "builtins"
    package, name = module.partition(".")[0], value.__qualname__
    if package != PACKAGE:
        if package not in RELIED_ON and not package.startswith(_GENERATED):
            raise ForeignError(f"{module}.{name}")
        return module, name
    if isinstance(value, type):
        # of Python's own names the methods: it adds and orders others as it likes
        own = {n: v for n, v in vars(value).items() if n[:2] != "__" or isinstance(v, _METHODS)}
        bases = [_described(base, above) for base in value.__bases__]
        return (
            name,
            bases,
            [(n, _described(own[n], above)) for n in sorted(own)],
        )
    words = [name, _of_code(value.__code__)]
    given = value.__defaults__, value.__kwdefaults__
    if given != (None, None):
        words += [_described(given[0], above), _described(tuple((given[1] or {}).items()), above)]
    if value.__closure__:
        words += [_described(content, above) for content in _contents(value.__closure__)]
    return words


def _contents(cells) -> Iterator[Any]:
    """What a function has taken from around it."""
    for cell in cells:
        try:
            yield cell.cell_contents
        except ValueError:  # nothing yet
            yield None


def _held(value, above):
    """Any other object: its type, and the functions that it holds, such as those it wraps."""
    kind = type(value)
    words = [kind.__module__, kind.__qualname__]
    if kind.__module__ in ("typing", "__future__"):
        return words
    if isinstance(value, staticmethod | classmethod | types.MethodType):
        return [*words, _described(value.__func__, above)]
    if isinstance(value, property | functools.partial):
        inner = (
            (value.fget, value.fset)
            if isinstance(value, property)
            else (value.func, value.args, tuple(sorted(value.keywords.items())))
        )
        return [*words, _described(inner, above)]
    held = dict(getattr(value, "__dict__", {}))
    if not (dataclasses.is_dataclass(value) and kind.__dataclass_params__.frozen):
        held = {n: v for n, v in held.items() if isinstance(v, types.FunctionType)}
    wrapped = getattr(value, "__wrapped__", None)
    if isinstance(wrapped, types.FunctionType):
        held["__wrapped__"] = wrapped
    return words + [(n, _described(held[n], above)) for n in sorted(held)]


def _of_code(code):
    """Digest of bytecode, with that of the functions in it; lines and comments do not count."""
    if id(code) not in _known:
        constants = [_of_constant(constant) for constant in code.co_consts]
        words = (
            *(code.co_name, code.co_argcount, code.co_kwonlyargcount, code.co_flags, constants),
            *(code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars),
        )
        parts = code.co_code, code.co_exceptiontable, repr(words).encode()
        _known[id(code)] = code, _hashed(*parts)
    return _known[id(code)][1]


def _of_constant(constant):
    """A constant of bytecode; the elements of a set have another order in every process."""
    if isinstance(constant, types.CodeType):
        return _of_code(constant)
    if isinstance(constant, frozenset | tuple):
        words = [_of_constant(part) for part in constant]
        return words if isinstance(constant, tuple) else {"set": sorted(map(repr, words))}
    return repr(constant)
