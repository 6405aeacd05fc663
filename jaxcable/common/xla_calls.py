"""Python functions that compiled programs call: XLA's foreign function interface.

XLA's interface is one of C (``xla/ffi/api/c_api.h`` in `jax.ffi.include_dir`), stable for programs
that state the version they were written for. The structures below are its beginning.
"""

from __future__ import annotations

import ctypes
import functools
import math
import traceback
from _thread import interrupt_main
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

_VERSION = 0, 3  # of the interface
_METADATA = 1  # kind of the extension that asks for the version
_FAILED = 13  # XLA_FFI_Error_Code_INTERNAL
_NAMES = (  # of dtypes, by XLA_FFI_DataType from 1 on
    *("bool", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"),
    *("float16", "float32", "float64"),
)
_DTYPES = dict(enumerate(map(np.dtype, _NAMES), start=1))
_Address, _Int, _Long = ctypes.c_void_p, ctypes.c_int, ctypes.c_int64
_to = ctypes.POINTER


def _c_struct(name, **fields):
    """Return a class of C structures (ctypes) with a first field ``struct_size`` and these fields.

    `fields` has ctypes types by name, in order.
    """
    fields = {"struct_size": ctypes.c_size_t, **fields}
    return type(name, (ctypes.Structure,), {"_fields_": list(fields.items())})


_HEAD = {"extension": _Address}
_Version: Any = _c_struct("_Version", **_HEAD, major=_Int, minor=_Int)
_Metadata: Any = _c_struct("_Metadata", version=_Version)
_Extension: Any = _c_struct("_Extension", kind=_Int, next=_Address, metadata=_to(_Metadata))
_Failure: Any = _c_struct("_Failure", **_HEAD, message=ctypes.c_char_p, code=_Int)
_Fail = ctypes.CFUNCTYPE(_Address, _to(_Failure))
_Interface: Any = _c_struct("_Interface", **_HEAD, version=_Version, internal=_Address, fail=_Fail)
_Buffer: Any = _c_struct(
    "_Buffer", **_HEAD, dtype=_Int, data=_Address, rank=_Long, shape=_to(_Long)
)
_Buffers: Any = _c_struct("_Buffers", **_HEAD, count=_Long, kinds=_Address, each=_to(_to(_Buffer)))
_Frame: Any = _c_struct(
    "_Frame",
    extension=_to(_Extension),
    interface=_to(_Interface),
    context=_Address,
    stage=_Int,
    arguments=_Buffers,
    results=_Buffers,
)
_Handler = ctypes.CFUNCTYPE(_Address, _to(_Frame))
_ALIVE: list[Any] = []  # handlers, which XLA calls as long as the process lives


def register_host_function(name: str, function: Callable[..., Sequence[np.ndarray]]) -> bool:
    """Register a NumPy function that compiled programs call by name; return False if XLA cannot."""
    handler = _Handler(functools.partial(_answer_xla_call, function))
    try:
        capsule = jax.ffi.pycapsule(ctypes.cast(handler, ctypes.c_void_p).value)
        _ALIVE.append(handler)
        jax.ffi.register_ffi_target(name, capsule, platform="cpu")
    except (AttributeError, jax.errors.JaxRuntimeError):
        return False
    return True


def _answer_xla_call(function, frame):
    """Call a NumPy function for XLA, and copy its results into XLA's buffers.

    Arguments and results are the buffers that XLA's `frame` (a pointer to `_Frame`) refers to.
    Returns None, or an error of XLA if the function raises an exception.
    """
    frame = frame.contents
    if frame.extension and frame.extension.contents.kind == _METADATA:
        version = frame.extension.contents.metadata.contents.version
        version.major, version.minor = _VERSION
        return None
    try:
        results = function(*_views_of_buffers(frame.arguments))
        for place, result in zip(_views_of_buffers(frame.results), results, strict=True):
            place[...] = result
    except KeyboardInterrupt:
        interrupt_main()
        return _make_xla_error(frame, "interrupted")
    except BaseException:  # nothing may be raised through C
        return _make_xla_error(frame, traceback.format_exc())
    return None


def _views_of_buffers(buffers):
    """Return XLA's buffers as a list of NumPy arrays on the same memory."""
    return [_view_of_buffer(buffers.each[k].contents) for k in range(buffers.count)]


def _view_of_buffer(buffer):
    """Return one buffer of XLA as a NumPy array on the same memory."""
    shape, dtype = tuple(buffer.shape[: buffer.rank]), _DTYPES[buffer.dtype]
    size = dtype.itemsize * math.prod(shape)
    if size == 0:
        return np.zeros(shape, dtype)
    return np.ndarray(shape, dtype, (ctypes.c_char * size).from_address(buffer.data))


def _make_xla_error(frame, text):
    """Return a pointer to a new error of XLA with the message `text`, which XLA frees."""
    given = _Failure(ctypes.sizeof(_Failure), None, text.encode(), _FAILED)
    return frame.interface.contents.fail(given)
