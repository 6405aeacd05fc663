"""`as_program`: a function of jax that runs as a program of its own where numbers are known."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from ..common.compilation import jit_program


def as_program(function: Callable[..., Any], static: tuple[str, ...] = ()) -> Callable[..., Any]:
    """Return a function that runs as one program where it is called with known numbers.

    Where it is called inside of another jax program, it becomes part of that program as with
    `jax.jit`.

    Args:
        function: its arguments are pytrees of arrays.
        static: names of static arguments, which are hashable and given by keyword.

    Returns:
        Function of the same arguments. By keyword it also takes ``axes``, for a batch: the axis of
        every leaf of the arguments, or None for leaves that all cases share.
    """
    program = jit_program(function, static)

    @functools.wraps(function)
    def run(*arguments, axes=None, **options):
        return program(*arguments, size=0, axes=axes, **options)

    return run
