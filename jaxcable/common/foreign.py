"""NumPy functions inside of compiled programs, called by name.

jax keeps compiled programs on disk, but none with a callback: a callback is an address, which
another process does not know. XLA's interface for foreign functions calls by name, and Python
functions are registered there. They get the buffers of the program: nothing is copied, and no
array of jax is made, for which a busy program can wait for ever.

XLA's interface is one of C (``xla/ffi/api/c_api.h`` in `jax.ffi.include_dir`), stable for programs
that state the version they were written for. The structures below are its beginning.
"""

from __future__ import annotations

import _thread
import ctypes
import functools
import traceback
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from .keeping import host_function, names_host_functions
from .types import Array

Function = Callable[..., Sequence[np.ndarray]]

_VERSION = 0, 3  # of the interface
_METADATA = 1  # kind of the extension that asks for the version
_FAILED = 13  # XLA_FFI_Error_Code_INTERNAL
_DTYPES = {
    number: np.dtype(name)
    for number, name in {
        **{1: "bool", 2: "int8", 3: "int16", 4: "int32", 5: "int64"},
        **{6: "uint8", 7: "uint16", 8: "uint32", 9: "uint64", 11: "float32", 12: "float64"},
    }.items()
}
_Address = ctypes.c_void_p


class _Head(ctypes.Structure):
    _fields_ = [("struct_size", ctypes.c_size_t), ("extensions", _Address)]


class _Version(_Head):
    _fields_ = [("major", ctypes.c_int), ("minor", ctypes.c_int)]


class _Metadata(ctypes.Structure):
    _fields_ = [("struct_size", ctypes.c_size_t), ("version", _Version)]


class _Extension(ctypes.Structure):
    _fields_ = [
        ("struct_size", ctypes.c_size_t),
        ("kind", ctypes.c_int),
        ("next", _Address),
        ("metadata", ctypes.POINTER(_Metadata)),
    ]


class _Failure(_Head):
    _fields_ = [("message", ctypes.c_char_p), ("code", ctypes.c_int)]


class _Interface(_Head):
    _fields_ = [
        ("version", _Version),
        ("internal", _Address),
        ("fail", ctypes.CFUNCTYPE(_Address, ctypes.POINTER(_Failure))),
    ]


class _Buffer(_Head):
    _fields_ = [
        ("dtype", ctypes.c_int),
        ("data", _Address),
        ("rank", ctypes.c_int64),
        ("shape", ctypes.POINTER(ctypes.c_int64)),
    ]


class _Buffers(_Head):
    _fields_ = [
        ("count", ctypes.c_int64),
        ("kinds", _Address),
        ("each", ctypes.POINTER(ctypes.POINTER(_Buffer))),
    ]


class _Frame(ctypes.Structure):
    _fields_ = [
        ("struct_size", ctypes.c_size_t),
        ("extension", ctypes.POINTER(_Extension)),
        ("interface", ctypes.POINTER(_Interface)),
        ("context", _Address),
        ("stage", ctypes.c_int),
        ("arguments", _Buffers),
        ("results", _Buffers),
    ]


_Handler = ctypes.CFUNCTYPE(_Address, ctypes.POINTER(_Frame))


_FAMILIES: dict[str, Callable[..., Function]] = {}


def family(make: Callable[..., Function]) -> Callable[..., Function]:
    """Register a function that makes a host function from words, and keeps it.

    A program that is kept on disk knows the words only.
    """
    _FAMILIES[make.__name__] = functools.cache(make)
    return _FAMILIES[make.__name__]


def tell(words: Sequence[str], *arguments: Array) -> None:
    """Call a NumPy function of arrays without results; under `jax.vmap` for every case.

    Args:
        words, arguments: as for `call`.
    """
    name = ", ".join(words)
    if jax.default_backend() == "cpu" and _known(name):
        target = host_function(name)
        none = jax.ffi.ffi_call(target, (), has_side_effect=True, vmap_method="sequential")
        none(*arguments)
    else:
        jax.debug.callback(_made(name), *arguments)


def call(
    words: Sequence[str], shapes: Sequence[jax.ShapeDtypeStruct], *arguments: Array
) -> tuple[Array, ...]:
    """Results of a NumPy function of arrays, called by a compiled program.

    Under `jax.vmap` arguments and results have further leading axes; those of an argument that does
    not change in the batch have length 1.

    Args:
        words: name of a `family`, and what it makes the function from. The function returns a
            sequence of arrays; it must not call jax.
        shapes: `jax.ShapeDtypeStruct` of every result.
        arguments: arrays.
    """
    name = ", ".join(words)
    if jax.default_backend() == "cpu" and _known(name):
        target = host_function(name)
        found = jax.ffi.ffi_call(target, tuple(shapes), vmap_method="expand_dims")(*arguments)
        return tuple(found)
    function = _made(name)

    def converted(*arrays):
        results = function(*(np.asarray(array) for array in arrays))
        pairs = zip(results, shapes, strict=True)
        return tuple(np.asarray(result, shape.dtype) for result, shape in pairs)

    return jax.pure_callback(converted, tuple(shapes), *arguments, vmap_method="expand_dims")


def _made(name):
    """The function of a name."""
    family, *words = name.split(", ")
    return _FAMILIES[family](*words)


@functools.cache
def _known(name):
    """Make the function of a name known to XLA; False if XLA's interface is too new."""
    handler = _Handler(functools.partial(_handle, _made(name)))
    _ALIVE.append(handler)
    capsule = jax.ffi.pycapsule(ctypes.cast(handler, ctypes.c_void_p).value)
    try:
        jax.ffi.register_ffi_target(host_function(name), capsule, platform="cpu")
    except jax.errors.JaxRuntimeError:
        return False
    return True


names_host_functions(_known)
_ALIVE: list[Any] = []  # handlers, which XLA calls as long as the process lives


def _handle(function, frame):
    """Answer a call of XLA: compute the results in place. Returns an error of XLA, or None."""
    frame = frame.contents
    if frame.extension and frame.extension.contents.kind == _METADATA:
        version = frame.extension.contents.metadata.contents.version
        version.major, version.minor = _VERSION
        return None
    try:
        results = function(*_arrays(frame.arguments))
        for place, result in zip(_arrays(frame.results), results, strict=True):
            place[...] = result
    except KeyboardInterrupt:
        _thread.interrupt_main()
        return _failure(frame, "interrupted")
    except BaseException:  # nothing may be raised through C
        return _failure(frame, traceback.format_exc())
    return None


def _arrays(buffers):
    """The arrays of the program, as NumPy sees them."""
    return [_array(buffers.each[k].contents) for k in range(buffers.count)]


def _array(buffer):
    shape, dtype = tuple(buffer.shape[: buffer.rank]), _DTYPES[buffer.dtype]
    size = dtype.itemsize
    for length in shape:
        size *= length
    if size == 0:
        return np.zeros(shape, dtype)
    return np.ndarray(shape, dtype, (ctypes.c_char * size).from_address(buffer.data))


def _failure(frame, text):
    """An error of XLA, which it frees."""
    given = _Failure(ctypes.sizeof(_Failure), None, text.encode(), _FAILED)
    return frame.interface.contents.fail(given)
