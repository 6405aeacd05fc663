"""A digest of what a function computes: its traced program, with the values of its constants.

Functions are compared by what they do, not by name or text: a function that closes over another
model, another array or another random key has another digest. Processes agree on it.
"""

from __future__ import annotations

import dataclasses
import hashlib
import re
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from . import host_functions
from .jax_internals import is_literal, is_program

_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")
_SIZE = 16  # bytes of a digest
_PLAIN = {bool, int, float, complex, str, bytes, type(None), type(...)}
_PLAIN |= {tuple, list, dict, set, frozenset, range, slice}


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
    return _Digests().of([traced, names]).hex()


def of_host_function(function: Callable[..., Any]) -> str:
    """Digest of a function of NumPy arrays, which cannot be traced: a text of 32 characters.

    It is that of the function's code and of all values that the code can reach: globals, functions
    and classes that it uses, defaults, what it closes over (`host_functions`). Those of libraries
    and of this package count by their names and versions.
    """
    digests = _Digests()
    digests.host = True
    try:
        return digests.of(function).hex()
    except RecursionError:
        raise ValueError(
            "the function uses objects that are nested too deeply for a digest of all that decides "
            "what it returns; keep them out of its globals"
        ) from None


def of_arrays(tree: Any) -> str:
    """Digest of a pytree of arrays: names, shapes, dtypes and values; a text of 32 characters."""
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return _Digests().of([(jax.tree_util.keystr(path), leaf) for path, leaf in leaves]).hex()


def _hash(*parts: bytes) -> bytes:
    """The digest of some bytes in their order."""
    found = hashlib.blake2b(digest_size=_SIZE)
    for part in parts:
        found.update(len(part).to_bytes(8, "little") + part)
    return found.digest()


class _Digests:
    """Digests of what can stand in a jaxpr, `bytes`; what stands there often is read once."""

    def __init__(self):
        self.known = {}  # by the address of an object: the object, so that it stays, and its digest
        self.host = False  # whether functions are read that a program calls on the host

    def of(self, value: Any) -> bytes:
        """The digest of any object; of unknown ones that of their text without addresses."""
        if is_program(value):
            return self._once(value, self._jaxpr)
        if isinstance(value, jax.Array | np.ndarray):
            if self.host and isinstance(value, np.memmap):
                return self._once(value, self._parts)
            return self.of(value.tolist()) if value.dtype == object else self._once(value, _array)
        if isinstance(value, np.generic):
            return _array(value)
        if self.host and type(value) not in _PLAIN:
            return self._once(value, self._parts)
        if isinstance(value, tuple):
            return _hash(type(value).__name__.encode(), *map(self.of, value))
        if isinstance(value, list | dict | set | frozenset):
            return self._once(value, self._collection)
        if callable(value) and not isinstance(value, type):
            return self._function(value)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return self._once(value, self._fields)
        return _hash(type(value).__name__.encode(), _ADDRESS.sub("", repr(value)).encode())

    def _once(self, value, read):
        """``read(value)``, computed once for an object."""
        if id(value) not in self.known:
            self.known[id(value)] = value, b"again"  # for one that is in itself
            self.known[id(value)] = value, read(value)
        return self.known[id(value)][1]

    def _jaxpr(self, jaxpr):
        """The digest of a jaxpr: its equations, with variables by the order in which they occur."""
        constants = getattr(jaxpr, "consts", ())
        jaxpr = getattr(jaxpr, "jaxpr", jaxpr)  # of one with constants; later in jax, itself
        numbers: dict[Any, int] = {}

        def atom(x):
            if is_literal(x):
                return self.of(x.val) + repr(x.aval).encode()
            return numbers.setdefault(x, len(numbers)).to_bytes(4, "little")

        def new(x):
            return atom(x) + repr(x.aval).encode()

        parts = [*map(new, jaxpr.constvars), b"|", *map(new, jaxpr.invars)]
        for equation in jaxpr.eqns:
            parts.append(equation.primitive.name.encode())
            parts += map(atom, equation.invars)
            host, self.host = self.host, "callback" in equation.primitive.name
            for name, value in sorted(equation.params.items()):
                if name != "name":  # of a function
                    parts += [name.encode(), self.of(value)]
            self.host = host
            parts += map(new, equation.outvars)
        return _hash(*map(self.of, constants), *parts, b"|", *map(atom, jaxpr.outvars))

    def _collection(self, value):
        """The digest of a list, a dictionary or a set."""
        if isinstance(value, list):
            return _hash(type(value).__name__.encode(), *map(self.of, value))
        if isinstance(value, dict):
            pairs = sorted((self.of(key), self.of(item)) for key, item in value.items())
            return _hash(b"dict", *(part for pair in pairs for part in pair))
        return _hash(b"set", *sorted(map(self.of, value)))

    def _parts(self, value):
        """The digest of anything on the host."""
        return _hash(*map(self.of, host_functions.parts(value)))

    def _function(self, function):
        """The digest of a function that the program does not call on the host: by its name."""
        name = f"{getattr(function, '__module__', '')}.{getattr(function, '__qualname__', '')}"
        return _hash(f"{type(function).__name__} {name}".encode())

    def _fields(self, value):
        """The digest of a dataclass."""
        fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        return _hash(type(value).__qualname__.encode(), self.of(fields))


def _array(value):
    """The digest of an array: dtype, shape and bytes."""
    told = repr((str(value.dtype), value.shape)).encode()
    if jax.dtypes.issubdtype(value.dtype, jax.dtypes.prng_key):
        value = jax.random.key_data(value)
    return _hash(told, np.ascontiguousarray(value).tobytes())
