"""Digests of what functions compute, by which a study finds out whether it is another one.

A traced function is known by its program, with the values of its constants: functions are compared
by what they do, not by name or text, and one that closes over another model, another array or
another random key has another digest. NumPy functions, which cannot be traced, are known by their
bytecode, and by all values that it can reach. Processes agree on all digests.
"""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import functools
import hashlib
import os
import re
import sys
import types
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import jax
import numpy as np

from .jaxprs import is_jaxpr, is_jaxpr_literal

_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")
_COLLECTIONS = {tuple, list, dict, set, frozenset, range, slice}
_PLAIN_TYPES = {bool, int, float, complex, str, bytes, type(None), type(...)}
_METHODS = types.FunctionType, staticmethod, classmethod, property, functools.cached_property
_WRAPPERS = *_METHODS[1:], types.MethodType, types.BuiltinFunctionType
_WRAPPED = "__wrapped__", "__func__", "__self__", "fget", "fset", "func"


def function_digest(function: Callable[..., Any], *arguments: Any) -> str:
    """Return a digest, 32 characters, of the program that jax traces of a function.

    It covers the function's jaxpr and the constants in it, so that a change of either changes the
    digest. NumPy functions that the program calls on the host count as in `host_function_digest`.

    Args:
        function: of pytrees of arrays, to a pytree of arrays.
        arguments: pytrees of arrays, or of `jax.ShapeDtypeStruct`.
    """
    traced, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
    names = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(shapes)]
    return _digest_of_words(_ObjectDescriber().describe([traced, names]))


def equations_digest(jaxpr: Any) -> str:
    """Return a digest of a jaxpr in this process, a text of 32 characters.

    It covers literals, shapes and parameters of all equations. Functions that jax calls later, such
    as the rules of `jax.custom_jvp`, count by identity. Constants that the jaxpr itself holds in
    later jax, which may be traced, are not looked at.
    """
    describer = _ObjectDescriber(of_process=True)
    return _digest_of_words(describer._describe_jaxpr(jaxpr, consts=()))


def host_function_digest(function: Callable[..., Any]) -> str:
    """Return a digest of a NumPy function, which jax cannot trace, a text of 32 characters.

    It covers the function's code and all values that the code can reach: globals, functions and
    classes that it uses, defaults, captured variables. Of libraries and of this package only names
    and versions count.
    """
    try:
        return _digest_of_words(_ObjectDescriber(reads_code=True).describe(function))
    except RecursionError:
        raise ValueError(
            "the function uses objects that are nested too deeply for a digest of all that decides "
            "what it returns; keep them out of its globals"
        ) from None


def arrays_digest(tree: Any) -> str:
    """Return a digest of a pytree of arrays: paths, shapes, dtypes and values; 32 characters."""
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return _digest_of_words(
        _ObjectDescriber().describe([(jax.tree_util.keystr(path), leaf) for path, leaf in leaves])
    )


def digest_of_bytes(*parts: bytes) -> str:
    """Return a digest of all these bytes together, a text of 32 characters."""
    return hashlib.blake2b(b"|".join(parts), digest_size=16).hexdigest()


def _digest_of_words(words):
    """Return a digest, 32 characters, of nested lists and tuples of texts and numbers."""
    return digest_of_bytes(repr(words).encode())


_known_jaxprs: weakref.WeakKeyDictionary[Any, str] = weakref.WeakKeyDictionary()


class _ObjectDescriber:
    """Describes objects as nested lists of words, from which a digest is made; each object once.

    Args:
        reads_code: whether functions and objects are described by their bytecode and all values
            that it can reach; otherwise they are values in a jaxpr.
        of_process: whether functions are described by their addresses, which hold in this process
            only; jaxprs are then described once in a process.
    """

    def __init__(self, reads_code=False, of_process=False):
        self.known = {}  # by the address of an object: the object, so that it stays, and its digest
        self.reads_code, self.of_process = reads_code, of_process

    def describe(self, value: Any) -> Any:
        """Return words (nested lists of texts and numbers) that describe any object.

        An object of unknown type is described by its `repr`, without memory addresses.
        """
        kind = type(value)
        if kind in _PLAIN_TYPES:
            return repr(value)  # tells 1, 1.0 and True apart
        if isinstance(value, jax.Array | np.ndarray):
            if self.reads_code and isinstance(value, np.memmap):
                return self._memoized_digest(value, self._describe_definition)
            return (
                self.describe(value.tolist())
                if value.dtype == object
                else self._memoized_digest(value, _digest_of_array)
            )
        if isinstance(value, np.generic):
            return _digest_of_array(value)
        jaxpr = is_jaxpr(value) and not isinstance(value, type)  # its class has the same attributes
        if jaxpr and self.of_process:
            if value not in _known_jaxprs:
                _known_jaxprs[value] = _digest_of_words(self._describe_jaxpr(value))
            return _known_jaxprs[value]
        if jaxpr:
            return self._memoized_digest(value, self._describe_jaxpr)
        if self.reads_code and kind not in _COLLECTIONS:
            return self._memoized_digest(value, self._describe_definition)
        if isinstance(value, tuple):
            return kind.__name__, [self.describe(part) for part in value]
        if isinstance(value, list | dict | set | frozenset):
            return self._memoized_digest(value, self._describe_collection)
        if self.of_process and (kind.__eq__ is object.__eq__ or hasattr(value, "call_wrapped")):
            return kind.__name__, id(value)  # functions, also as jax wraps them
        is_record = dataclasses.is_dataclass(value) and not isinstance(value, type)
        if is_record and (self.of_process or not callable(value)):
            fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
            return kind.__qualname__, self._memoized_digest(
                value, lambda _: self._describe_collection(fields)
            )
        if self.of_process and isinstance(value, types.MethodType):  # one for each access
            return kind.__name__, id(value.__func__), id(value.__self__)
        if callable(value) and not isinstance(value, type):  # not called on the host: by its name
            names = getattr(value, "__module__", ""), getattr(value, "__qualname__", "")
            return kind.__name__, *names, id(value) if self.of_process else ""
        return kind.__name__, repr(value) if self.of_process else _ADDRESS.sub("", repr(value))

    def _memoized_digest(self, value, describe):
        """Return the digest of ``describe(value)`` (words), computed once for each object."""
        if id(value) not in self.known:
            self.known[id(value)] = value, "again"  # for one that is in itself
            self.known[id(value)] = value, _digest_of_words(describe(value))
        return self.known[id(value)][1]

    def _describe_definition(self, value):
        """Return the words for a function, class or object, from its `_definition_parts`."""
        return type(value).__name__, [self.describe(part) for part in _definition_parts(value)]

    def _describe_collection(self, value):
        """Return words that describe a list, or a dict or set in sorted order."""
        if isinstance(value, list):
            return type(value).__name__, [self.describe(part) for part in value]
        if isinstance(value, dict):
            pairs = ((self.describe(key), self.describe(item)) for key, item in value.items())
            return "dict", sorted(map(repr, pairs))
        return "set", sorted(repr(self.describe(part)) for part in value)

    def _describe_jaxpr(self, jaxpr, consts=None):
        """Return the words for a jaxpr: its equations, with variables numbered as they occur.

        `consts` are the constants of its variables; None: those that it holds.
        """
        consts = getattr(jaxpr, "consts", ()) if consts is None else consts
        jaxpr = getattr(jaxpr, "jaxpr", jaxpr)  # of one with constants; later in jax, itself
        numbers: dict[Any, int] = {}

        def atom(x):
            if is_jaxpr_literal(x):
                return self.describe(x.val), repr(x.aval)
            return numbers.setdefault(x, len(numbers))

        def new(x):
            return atom(x), repr(x.aval)

        words = [*map(self.describe, consts), *map(new, jaxpr.constvars), *map(new, jaxpr.invars)]
        for equation in jaxpr.eqns:
            words += equation.primitive.name, *map(atom, equation.invars)
            before = self.reads_code
            self.reads_code = "callback" in equation.primitive.name and not self.of_process
            for name, value in sorted(equation.params.items()):
                if name != "name":  # of a function
                    words += name, self.describe(value)
            self.reads_code = before
            words += map(new, equation.outvars)
        return [*words, *map(atom, jaxpr.outvars)]


def _definition_parts(value) -> Iterator[Any]:
    """Yield the objects that decide what a function, class or object computes, one level deep.

    For a function these are its bytecode, defaults, captured variables and globals; for a class its
    bases and attributes. Functions and classes of libraries, and of this package, yield their name
    and version only.
    """
    if isinstance(value, types.ModuleType):
        yield value.__name__  # attributes are parts of the functions that read them
    elif isinstance(value, types.FunctionType | type) and is_library_module(value.__module__):
        package = sys.modules.get((value.__module__ or "").partition(".")[0])
        yield from (value.__module__, value.__qualname__, getattr(package, "__version__", ""))
    elif isinstance(value, types.FunctionType):
        yield from (value.__code__, value.__defaults__, value.__kwdefaults__, vars(value))
        for cell in value.__closure__ or ():
            with contextlib.suppress(ValueError):  # a variable that has no value yet
                yield cell.cell_contents
        names = _names_in_code(value.__code__)
        space = collections.ChainMap(value.__globals__, sys.modules)
        yield from _global_names_and_values(names, space, frozenset())
    elif isinstance(value, types.CodeType):
        yield from (value.co_code, value.co_exceptiontable, value.co_consts, value.co_names)
        yield from (value.co_argcount, value.co_flags, value.co_varnames, value.co_freevars)
    elif isinstance(value, type):
        yield from (value.__qualname__, value.__bases__)
        for name, own in sorted(vars(value).items()):
            if name[:2] != "__" or isinstance(own, _METHODS):
                yield from (name, own)
    elif isinstance(value, functools.partial):
        yield from (value.func, value.args, value.keywords)
    elif isinstance(value, _WRAPPERS) or hasattr(value, "__wrapped__"):  # also `jax.jit`
        yield getattr(value, "__qualname__", "")
        yield from (getattr(value, name, None) for name in _WRAPPED)
    elif isinstance(value, types.MappingProxyType):
        yield dict(value)
    elif isinstance(value, np.memmap) and value.filename:  # larger than memory, perhaps
        yield from (str(value.dtype), value.shape, value.offset, value.filename)
        with contextlib.suppress(OSError):
            about = os.stat(value.filename)
            yield from (about.st_size, about.st_mtime_ns)
    else:
        yield from _parts_of_object(value)


def _parts_of_object(value):
    """Yield the class of an object, then what pickling would write of it.

    If it cannot be pickled, its `__dict__` follows instead; if that is empty, its `repr` without
    memory addresses.
    """
    yield type(value)
    try:
        found = value.__reduce_ex__(4)
    except Exception:  # whatever a class raises that cannot be pickled
        yield getattr(value, "__dict__", None) or _ADDRESS.sub("", repr(value))
        return
    for part in [found] if isinstance(found, str) else found:
        yield list(part) if isinstance(part, Iterator) else part


def _names_in_code(code):
    """Return the set of names of globals, attributes and modules in bytecode.

    Those in functions that are defined in it are included.
    """
    inner = (part for part in code.co_consts if isinstance(part, types.CodeType))
    return set(code.co_names).union(*map(_names_in_code, inner))


def _global_names_and_values(names, space, seen):
    """Yield name and value, one after the other, of each of `names` that a namespace has.

    Of modules of the user the values of these names follow, too; modules with names in `seen` are
    not searched again. `space` is the namespace, a mapping.
    """
    for name in sorted(names & space.keys()):
        value = space[name]
        yield from (name, value)
        if isinstance(value, types.ModuleType) and value.__name__ not in seen:
            if not is_library_module(value.__name__):
                yield from _global_names_and_values(names, vars(value), seen | {value.__name__})


def is_library_module(module: str | None) -> bool:
    """Tell whether a module is Python's, of this package, or of an installed library.

    Libraries may be installed in several places: by Debian, or on a cluster by `PYTHONPATH`.
    """
    package = (module or "builtins").partition(".")[0]
    if package in sys.stdlib_module_names or package in ("builtins", "jaxcable"):
        return True
    folders = os.path.realpath(getattr(sys.modules.get(package), "__file__", None) or "").split(
        os.sep
    )
    return not {"site-packages", "dist-packages"}.isdisjoint(folders)


def _digest_of_array(value):
    """Return a digest, 32 characters, of an array: of its dtype, shape and bytes."""
    told = repr((str(value.dtype), value.shape)).encode()
    if jax.dtypes.issubdtype(value.dtype, jax.dtypes.prng_key):
        value = jax.random.key_data(value)
    return digest_of_bytes(told, np.ascontiguousarray(value).tobytes())
