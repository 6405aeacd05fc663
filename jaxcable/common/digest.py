"""A digest of what a function computes: its traced program, with the values of its constants.

Functions are compared by what they do, not by name or text: a function that closes over another
model, another array or another random key has another digest. Processes agree on it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import re
import types
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from .jax_internals import is_literal, is_program

_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")
_SIZE = 16  # bytes of a digest


def of_function(function: Callable[..., Any], *arguments: Any) -> str:
    """Digest of what a function computes for arguments of these shapes: a text of 32 characters.

    It is that of the function's jaxpr with all of its constants. Functions that a program calls on
    the host count by their code and by what they close over; those of this package by their names.

    Args:
        function: of pytrees of arrays, to a pytree of arrays.
        arguments: pytrees of arrays, or of `jax.ShapeDtypeStruct`.
    """
    traced, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
    names = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(shapes)]
    return _Digests().of([traced, names]).hex()


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
            return self.of(value.tolist()) if value.dtype == object else self._once(value, _array)
        if isinstance(value, np.generic):
            return _array(value)
        if isinstance(value, tuple | list):
            return _hash(type(value).__name__.encode(), *map(self.of, value))
        if isinstance(value, dict):
            pairs = sorted((self.of(key), self.of(item)) for key, item in value.items())
            return _hash(b"dict", *(part for pair in pairs for part in pair))
        if isinstance(value, set | frozenset):
            return _hash(b"set", *sorted(map(self.of, value)))
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
            self.host = "callback" in equation.primitive.name
            for name, value in sorted(equation.params.items()):
                if name != "name":  # of a function
                    parts += [name.encode(), self.of(value)]
            self.host = False
            parts += map(new, equation.outvars)
        return _hash(*map(self.of, constants), *parts, b"|", *map(atom, jaxpr.outvars))

    def _function(self, function):
        """The digest of a function by its name; on the host by its code and what belongs to it."""
        name = f"{getattr(function, '__module__', '')}.{getattr(function, '__qualname__', '')}"
        told = f"{type(function).__name__} {name}".encode()
        if not self.host:
            return _hash(told)
        return self._once(function, lambda f: _hash(told, *map(self.of, _inside(f))))

    def _fields(self, value):
        """The digest of a dataclass."""
        fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        return _hash(type(value).__qualname__.encode(), self.of(fields))


def _inside(function):
    """What a function on the host computes with: code, constants, values that it closes over."""
    if isinstance(function, types.MethodType):
        yield from (function.__func__, vars(function.__self__) if _has_own(function) else None)
    elif isinstance(function, types.FunctionType):
        yield from _code(function.__code__)
        yield from (function.__defaults__, function.__kwdefaults__)
        for cell in function.__closure__ or ():
            with contextlib.suppress(ValueError):  # a variable that has no value yet
                yield cell.cell_contents
    elif dataclasses.is_dataclass(function):
        yield from (getattr(function, f.name) for f in dataclasses.fields(function))
    elif hasattr(function, "func"):  # `functools.partial`
        yield from (function.func, function.args, function.keywords)
    elif hasattr(function, "__dict__"):  # an object that can be called
        yield vars(function)


def _has_own(method):
    return hasattr(method.__self__, "__dict__")


def _code(code):
    """Bytes, names and constants of code, and of the code of functions in it."""
    yield from (code.co_code, code.co_names)
    for constant in code.co_consts:
        yield from _code(constant) if isinstance(constant, types.CodeType) else [constant]


def _array(value):
    """The digest of an array: dtype, shape and bytes."""
    told = repr((str(value.dtype), value.shape)).encode()
    if jax.dtypes.issubdtype(value.dtype, jax.dtypes.prng_key):
        value = jax.random.key_data(value)
    return _hash(told, np.ascontiguousarray(value).tobytes())
