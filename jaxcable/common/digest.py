"""Digests of what functions compute, and of the code of the package.

A traced function is known by its program, with the values of its constants: functions are compared
by what they do, not by name or text, and one that closes over another model, another array or
another random key has another digest. Functions that cannot be traced, and the code of the package,
are read as `python_objects` takes them apart. Processes agree on all digests.
"""

from __future__ import annotations

import dataclasses
import enum
import re
import sys
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from .jax_internals import is_literal, is_program
from .python_objects import PLAIN, constants, hashed, is_described, parts

_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")
_COLLECTIONS = {tuple, list, dict, set, frozenset, range, slice}


def of_function(function: Callable[..., Any], *arguments: Any) -> str:
    """Digest of what a function computes for arguments of these shapes: a text of 32 characters.

    It is that of the function's jaxpr with all of its constants. Functions that a program calls on
    the host count as in `of_host_function`.

    Args:
        function: of pytrees of arrays, to a pytree of arrays.
        arguments: pytrees of arrays, or of `jax.ShapeDtypeStruct`.
    """
    traced, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
    names = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(shapes)]
    return _hash(_Reader().of([traced, names]))


def of_host_function(function: Callable[..., Any]) -> str:
    """Digest of a function of NumPy arrays, which cannot be traced: a text of 32 characters.

    It is that of the function's code and of all values that the code can reach: globals, functions
    and classes that it uses, defaults, what it closes over. Those of libraries and of this package
    count by their names and versions.
    """
    try:
        return _hash(_Reader(_Read.USER).of(function))
    except RecursionError:
        raise ValueError(
            "the function uses objects that are nested too deeply for a digest of all that decides "
            "what it returns; keep them out of its globals"
        ) from None


def of_arrays(tree: Any) -> str:
    """Digest of a pytree of arrays: names, shapes, dtypes and values; a text of 32 characters."""
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return _hash(_Reader().of([(jax.tree_util.keystr(path), leaf) for path, leaf in leaves]))


def of_package() -> str:
    """Digest of all functions, classes and constants that modules of the package name.

    It is that of the code in memory, for programs that are kept on disk. Contents of lists, and of
    dictionaries that hold objects, are left out: they are registries, and caches. What
    `import jaxcable` does not import (the command line) cannot be part of a program.

    Raises:
        ForeignError: a function or class in the package is replaced by one defined elsewhere.
    """
    reader, words = _Reader(_Read.PACKAGE), []
    for module in filter(is_described, sorted(sys.modules)):
        names = dict(vars(sys.modules[module]))  # another thread may import meanwhile
        words += [  # names with underscores at both ends are Python's
            (name, reader.of(names[name])) for name in sorted(names) if name[:2] != "__"
        ]
    return _hash(words)


def _hash(words):
    """The digest of words, nested lists and tuples."""
    return hashed(repr(words).encode())


class _Read(enum.Enum):
    """Whose functions are read, and not known by their names."""

    USER = 1
    PACKAGE = 2


class _Reader:
    """Words for what can stand in a jaxpr or be reached by code; objects are read once."""

    def __init__(self, read=None):
        self.known = {}  # by the address of an object: the object, so that it stays, and its digest
        self.read = read

    def of(self, value: Any) -> Any:
        """The words for any object; for unknown ones their text without addresses."""
        kind = type(value)
        if kind in PLAIN:
            return repr(value)  # tells 1, 1.0 and True apart
        if isinstance(value, jax.Array | np.ndarray):
            if self.read and isinstance(value, np.memmap):
                return self._once(value, self._parts)
            return self.of(value.tolist()) if value.dtype == object else self._once(value, _array)
        if isinstance(value, np.generic):
            return _array(value)
        if is_program(value):
            return self._once(value, self._jaxpr)
        if self.read and kind not in _COLLECTIONS:
            return self._once(value, self._parts)
        if isinstance(value, tuple):
            return kind.__name__, [self.of(part) for part in value]
        if isinstance(value, list | dict | set | frozenset):
            return self._once(value, self._collection)
        if callable(value) and not isinstance(value, type):  # not called on the host: by its name
            names = getattr(value, "__module__", ""), getattr(value, "__qualname__", "")
            return kind.__name__, *names
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
            return kind.__qualname__, self._once(value, lambda _: self._collection(fields))
        return kind.__name__, _ADDRESS.sub("", repr(value))

    def _once(self, value, read):
        """The digest of ``read(value)``, computed once for an object."""
        if id(value) not in self.known:
            self.known[id(value)] = value, "again"  # for one that is in itself
            self.known[id(value)] = value, _hash(read(value))
        return self.known[id(value)][1]

    def _parts(self, value):
        """The words for anything that is read."""
        return [self.of(part) for part in parts(value, self.read is _Read.PACKAGE)]

    def _collection(self, value):
        """The words for a list, a dictionary or a set."""
        if self.read is _Read.PACKAGE:
            return type(value).__name__, constants(value)
        if isinstance(value, list):
            return type(value).__name__, [self.of(part) for part in value]
        if isinstance(value, dict):
            pairs = ((self.of(key), self.of(item)) for key, item in value.items())
            return "dict", sorted(map(repr, pairs))
        return "set", sorted(repr(self.of(part)) for part in value)

    def _jaxpr(self, jaxpr):
        """The words for a jaxpr: its equations, with variables by the order in which they occur."""
        consts = getattr(jaxpr, "consts", ())
        jaxpr = getattr(jaxpr, "jaxpr", jaxpr)  # of one with constants; later in jax, itself
        numbers: dict[Any, int] = {}

        def atom(x):
            if is_literal(x):
                return self.of(x.val), repr(x.aval)
            return numbers.setdefault(x, len(numbers))

        def new(x):
            return atom(x), repr(x.aval)

        words = [*map(self.of, consts), *map(new, jaxpr.constvars), *map(new, jaxpr.invars)]
        for equation in jaxpr.eqns:
            words += equation.primitive.name, *map(atom, equation.invars)
            read, self.read = self.read, None
            if "callback" in equation.primitive.name:
                self.read = _Read.USER
            for name, value in sorted(equation.params.items()):
                if name != "name":  # of a function
                    words += name, self.of(value)
            self.read = read
            words += map(new, equation.outvars)
        return [*words, *map(atom, jaxpr.outvars)]


def _array(value):
    """The digest of an array: dtype, shape and bytes."""
    told = repr((str(value.dtype), value.shape)).encode()
    if jax.dtypes.issubdtype(value.dtype, jax.dtypes.prng_key):
        value = jax.random.key_data(value)
    return hashed(told, np.ascontiguousarray(value).tobytes())
