"""NumPy functions inside of compiled programs, called by name.

jax keeps compiled programs on disk, but none with a callback: a callback is an address, which
another process does not know. XLA's interface for foreign functions calls by name, and Python
functions are registered there. They get the buffers of the program: nothing is copied, and no
array of jax is made, for which a busy program can wait for ever.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from .types import Array
from .xla_calls import register_host_function

HostFunction = Callable[..., Sequence[np.ndarray]]
HostFunctionFamily = Callable[..., HostFunction]

PREFIX = "jaxcable: "
"""Names by which programs call host functions begin so."""
_FAMILIES: dict[str, Any] = {}  # by module and qualified name


def register_host_function_family(make: HostFunctionFamily) -> HostFunctionFamily:
    """Register a function `make` that returns a NumPy function for some words (a decorator).

    Compiled programs refer to the NumPy function by the module and name of `make` and these words,
    so that a program on disk finds it in another process. Each NumPy function is made once.

    Raises:
        ValueError: the module has another family of this name.
    """
    name = _family_name(make)
    known = _FAMILIES.get(name)
    if known is None:
        _FAMILIES[name] = functools.cache(make)
    elif known.__wrapped__.__code__ != make.__code__:  # the same one if its module is reloaded
        raise ValueError(
            f"register_host_function_family: {name} is registered already, and compiled programs "
            "may call it; give the new one another name, or restart Python"
        )
    return _FAMILIES[name]


def _family_name(make):
    """Return the name under which a function family is registered: module and qualified name."""
    return f"{make.__module__}.{make.__qualname__}"


def _make_call_name(words):
    """Return the name by which compiled programs call a NumPy function.

    `words` are the registered function family, then the texts from which it makes the function.
    Raise ValueError if the family is not registered, or a text has a comma.
    """
    family, *words = words
    if not callable(family) or _family_name(family) not in _FAMILIES:
        raise ValueError(f"words[0] = {family!r}: expected a host function family")
    if any("," in word for word in words):
        raise ValueError(f"words = {words}: a word must not contain a comma")
    return PREFIX + ", ".join((_family_name(family), *words))


def call_without_results(words: Sequence[HostFunctionFamily | str], *arguments: Array) -> None:
    """Call a NumPy function for its side effects from a compiled program.

    Under `jax.vmap` it is called once for every case.

    Args:
        words: a `register_host_function_family`, and the words from which it makes the function.
        arguments: arrays for the function.
    """
    name = _make_call_name(words)
    if jax.default_backend() == "cpu" and register_call(name):
        none = jax.ffi.ffi_call(name, (), has_side_effect=True, vmap_method="sequential")
        none(*arguments)
    else:
        jax.debug.callback(function_of_call_name(name), *arguments)


def call_on_host(
    words: Sequence[HostFunctionFamily | str],
    shapes: Sequence[jax.ShapeDtypeStruct],
    *arguments: Array,
) -> tuple[Array, ...]:
    """Call a NumPy function from a compiled program, and return its results, a tuple of arrays.

    Under `jax.vmap` arguments and results have further leading axes; those of an argument that does
    not change in the batch have length 1.

    Args:
        words: a `register_host_function_family`, and the words from which it makes the function.
            The function returns a sequence of arrays; it must not call jax.
        shapes: `jax.ShapeDtypeStruct` of every result.
        arguments: arrays for the function.
    """
    name = _make_call_name(words)
    if jax.default_backend() == "cpu" and register_call(name):
        return tuple(jax.ffi.ffi_call(name, tuple(shapes), vmap_method="expand_dims")(*arguments))
    function = function_of_call_name(name)

    def converted(*arrays):
        results = function(*(np.asarray(array) for array in arrays))
        pairs = zip(results, shapes, strict=True)
        return tuple(np.asarray(result, shape.dtype) for result, shape in pairs)

    return jax.pure_callback(converted, tuple(shapes), *arguments, vmap_method="expand_dims")


def function_of_call_name(name):
    """Return the NumPy function that programs call by a name, as `_make_call_name` returns it."""
    family, *words = name.removeprefix(PREFIX).split(", ")
    return _FAMILIES[family](*words)


@functools.cache
def register_call(name: str) -> bool:
    """Register with XLA the NumPy function that programs call by this name, once in a process.

    Returns False if this version of jax has no such interface.
    """
    return register_host_function(name, function_of_call_name(name))
