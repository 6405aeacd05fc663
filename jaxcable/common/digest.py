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

from .jax_internals import is_jaxpr, is_jaxpr_literal
from .python_objects import (
    PLAIN_TYPES,
    definition_parts,
    digest_of_bytes,
    is_program_module,
    sorted_plain_values,
)

_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")
_COLLECTIONS = {tuple, list, dict, set, frozenset, range, slice}


def of_function(function: Callable[..., Any], *arguments: Any) -> str:
    """Return a digest of what a function computes for such arguments, a text of 32 characters.

    It covers the function's jaxpr and the constants in it, so that a change of either changes the
    digest. NumPy functions that the program calls on the host count as in `of_host_function`.

    Args:
        function: of pytrees of arrays, to a pytree of arrays.
        arguments: pytrees of arrays, or of `jax.ShapeDtypeStruct`.
    """
    traced, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
    names = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(shapes)]
    return _digest_of_words(_ObjectDescriber().describe([traced, names]))


def of_host_function(function: Callable[..., Any]) -> str:
    """Return a digest of a NumPy function, which jax cannot trace, a text of 32 characters.

    It covers the function's code and all values that the code can reach: globals, functions and
    classes that it uses, defaults, captured variables. Of libraries and of this package only names
    and versions count.
    """
    try:
        return _digest_of_words(_ObjectDescriber(_CodeOwner.USER).describe(function))
    except RecursionError:
        raise ValueError(
            "the function uses objects that are nested too deeply for a digest of all that decides "
            "what it returns; keep them out of its globals"
        ) from None


def of_arrays(tree: Any) -> str:
    """Return a digest of a pytree of arrays: paths, shapes, dtypes and values; 32 characters."""
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return _digest_of_words(
        _ObjectDescriber().describe([(jax.tree_util.keystr(path), leaf) for path, leaf in leaves])
    )


def of_package() -> str:
    """Return a digest of the code of this package as it is in memory, a text of 32 characters.

    It covers functions, classes and constants of all loaded modules, and is part of the keys of
    programs that are kept on disk. Contents of lists, and of dictionaries that hold objects, are
    left out: they are registries and caches. Modules that `import jaxcable` does not load (the
    command line) cannot be part of a program.

    Raises:
        ForeignCodeError: a function or class in the package is replaced by one defined elsewhere.
    """
    reader, words = _ObjectDescriber(_CodeOwner.PACKAGE), []
    for module in filter(is_program_module, sorted(sys.modules)):
        names = dict(vars(sys.modules[module]))  # another thread may import meanwhile
        words += [  # names with underscores at both ends are Python's
            (name, reader.describe(names[name])) for name in sorted(names) if name[:2] != "__"
        ]
    return _digest_of_words(words)


def _digest_of_words(words):
    """Return the digest, 32 characters, of nested lists and tuples of texts and numbers."""
    return digest_of_bytes(repr(words).encode())


class _CodeOwner(enum.Enum):
    """Whose functions a digest describes by their code: those of the user, or of this package.

    All other functions count by name and version.
    """

    USER = 1
    PACKAGE = 2


class _ObjectDescriber:
    """Describe objects as nested lists of words, from which a digest is made.

    The objects are values in a jaxpr, or values that Python code can reach. Each object is
    described once. `code_owner` says whose functions are described by their code; None: nobody's.
    """

    def __init__(self, code_owner=None):
        self.known = {}  # by the address of an object: the object, so that it stays, and its digest
        self.code_owner = code_owner

    def describe(self, value: Any) -> Any:
        """Return words (nested lists of texts and numbers) that describe any object.

        An object of unknown type is described by its `repr`, without memory addresses.
        """
        kind = type(value)
        if kind in PLAIN_TYPES:
            return repr(value)  # tells 1, 1.0 and True apart
        if isinstance(value, jax.Array | np.ndarray):
            if self.code_owner and isinstance(value, np.memmap):
                return self._memoized_digest(value, self._describe_definition)
            return (
                self.describe(value.tolist())
                if value.dtype == object
                else self._memoized_digest(value, _digest_of_array)
            )
        if isinstance(value, np.generic):
            return _digest_of_array(value)
        if is_jaxpr(value):
            return self._memoized_digest(value, self._describe_jaxpr)
        if self.code_owner and kind not in _COLLECTIONS:
            return self._memoized_digest(value, self._describe_definition)
        if isinstance(value, tuple):
            return kind.__name__, [self.describe(part) for part in value]
        if isinstance(value, list | dict | set | frozenset):
            return self._memoized_digest(value, self._describe_collection)
        if callable(value) and not isinstance(value, type):  # not called on the host: by its name
            names = getattr(value, "__module__", ""), getattr(value, "__qualname__", "")
            return kind.__name__, *names
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
            return kind.__qualname__, self._memoized_digest(
                value, lambda _: self._describe_collection(fields)
            )
        return kind.__name__, _ADDRESS.sub("", repr(value))

    def _memoized_digest(self, value, describe):
        """Return the digest of ``describe(value)``, computed once for every object `value`."""
        if id(value) not in self.known:
            self.known[id(value)] = value, "again"  # for one that is in itself
            self.known[id(value)] = value, _digest_of_words(describe(value))
        return self.known[id(value)][1]

    def _describe_definition(self, value):
        """Return the words for a function, class or object, from its `definition_parts`."""
        return [
            self.describe(part)
            for part in definition_parts(value, self.code_owner is _CodeOwner.PACKAGE)
        ]

    def _describe_collection(self, value):
        """Return the words for a list, or those of a dictionary or set in sorted order."""
        if self.code_owner is _CodeOwner.PACKAGE:
            return type(value).__name__, sorted_plain_values(value)
        if isinstance(value, list):
            return type(value).__name__, [self.describe(part) for part in value]
        if isinstance(value, dict):
            pairs = ((self.describe(key), self.describe(item)) for key, item in value.items())
            return "dict", sorted(map(repr, pairs))
        return "set", sorted(repr(self.describe(part)) for part in value)

    def _describe_jaxpr(self, jaxpr):
        """Return the words for a jaxpr: its equations, with variables numbered as they occur."""
        consts = getattr(jaxpr, "consts", ())
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
            owner_before, self.code_owner = self.code_owner, None
            if "callback" in equation.primitive.name:
                self.code_owner = _CodeOwner.USER
            for name, value in sorted(equation.params.items()):
                if name != "name":  # of a function
                    words += name, self.describe(value)
            self.code_owner = owner_before
            words += map(new, equation.outvars)
        return [*words, *map(atom, jaxpr.outvars)]


def _digest_of_array(value):
    """Return the digest of an array: of its dtype, shape and bytes."""
    told = repr((str(value.dtype), value.shape)).encode()
    if jax.dtypes.issubdtype(value.dtype, jax.dtypes.prng_key):
        value = jax.random.key_data(value)
    return digest_of_bytes(told, np.ascontiguousarray(value).tobytes())
