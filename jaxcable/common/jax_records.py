"""What jax records of operations, and what its records keep alive."""

from __future__ import annotations

import contextlib
from typing import TypeVar

_T = TypeVar("_T")


def held_weakly(cls: type[_T]) -> type[_T]:
    """Have jax's records of operations hold parameters of a class weakly (a decorator).

    jax records the shapes of results of its last 2048 operations, with their parameters. A program
    among these, and a user's function in it, would not be given back. Where jax lacks the name,
    `forget_programs` gives them back.
    """
    with contextlib.suppress(ImportError, AttributeError):
        from jax._src.util import weakref_cache_key_types

        weakref_cache_key_types.add(cls)
    return cls
