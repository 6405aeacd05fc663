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

from .jax_internals import register_host_function
from .types import Array

Function = Callable[..., Sequence[np.ndarray]]
Family = Callable[..., Function]

PREFIX = "jaxcable: "
"""Names by which programs call host functions begin so."""
_FAMILIES: dict[str, Any] = {}  # by module and qualified name


def family(make: Family) -> Family:
    """Register a function that makes a host function from words, and keeps it.

    A program that is kept on disk knows the words only, and the family by its module and name.

    Raises:
        ValueError: the module has another family of this name.
    """
    name = _name(make)
    known = _FAMILIES.get(name)
    if known is None:
        _FAMILIES[name] = functools.cache(make)
    elif known.__wrapped__.__code__ != make.__code__:  # the same one if its module is reloaded
        raise ValueError(
            f"family: {name} is registered already, and compiled programs may call it; "
            "give the new one another name, or start Python anew"
        )
    return _FAMILIES[name]


def _name(make):
    """The name of a family."""
    return f"{make.__module__}.{make.__qualname__}"


def _named(words):
    """A family and its words, as one text, by which programs call it; `_made` reads it."""
    family, *words = words
    if not callable(family) or _name(family) not in _FAMILIES:
        raise ValueError(f"words[0] = {family!r}: expected a function registered by `family`")
    if any("," in word for word in words):
        raise ValueError(f"words = {words}: a word has no comma")
    return PREFIX + ", ".join((_name(family), *words))


def tell(words: Sequence[Family | str], *arguments: Array) -> None:
    """Call a NumPy function of arrays without results; under `jax.vmap` for every case.

    Args:
        words, arguments: as for `call`.
    """
    name = _named(words)
    if jax.default_backend() == "cpu" and is_known(name):
        none = jax.ffi.ffi_call(name, (), has_side_effect=True, vmap_method="sequential")
        none(*arguments)
    else:
        jax.debug.callback(_made(name), *arguments)


def call(
    words: Sequence[Family | str], shapes: Sequence[jax.ShapeDtypeStruct], *arguments: Array
) -> tuple[Array, ...]:
    """Results of a NumPy function of arrays, called by a compiled program.

    Under `jax.vmap` arguments and results have further leading axes; those of an argument that does
    not change in the batch have length 1.

    Args:
        words: a `family`, and what it makes the function from. The function returns a
            sequence of arrays; it must not call jax.
        shapes: `jax.ShapeDtypeStruct` of every result.
        arguments: arrays.
    """
    name = _named(words)
    if jax.default_backend() == "cpu" and is_known(name):
        return tuple(jax.ffi.ffi_call(name, tuple(shapes), vmap_method="expand_dims")(*arguments))
    function = _made(name)

    def converted(*arrays):
        results = function(*(np.asarray(array) for array in arrays))
        pairs = zip(results, shapes, strict=True)
        return tuple(np.asarray(result, shape.dtype) for result, shape in pairs)

    return jax.pure_callback(converted, tuple(shapes), *arguments, vmap_method="expand_dims")


def _made(name):
    """The function of a name."""
    family, *words = name.removeprefix(PREFIX).split(", ")
    return _FAMILIES[family](*words)


@functools.cache
def is_known(name: str) -> bool:
    """Make the function of a name known to XLA; False if XLA's interface is another one."""
    return register_host_function(name, _made(name))
