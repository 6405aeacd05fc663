"""Compiled programs of the functions that users optimize."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable
from typing import Any

import jax

from ..common.types import PyTree


class Programs:
    """Programs by function object, so that a second call does not compile again.

    Nothing is kept alive: the programs of a function are forgotten with it.

    Args:
        make: function (reference, *options) to a program; it calls `reference()` for the function.
    """

    def __init__(self, make: Callable[..., Callable[..., Any]]):
        self.make, self.kept = make, weakref.WeakKeyDictionary()

    def __call__(self, function: Callable[..., Any], *options: Hashable) -> Any:
        """The program of a function, made if there is none yet."""
        try:
            programs = self.kept.setdefault(function, {})
        except TypeError:  # no weak references to it, or no hash
            return self.make(lambda: function, *options)
        if options not in programs:
            programs[options] = self.make(weakref.ref(function), *options)
        return programs[options]


@jax.custom_jvp
def underivable(tree: PyTree[Any]) -> PyTree[Any]:
    """The identity; to differentiate it is an error, and not a silent NaN or zero."""
    return tree


@underivable.defjvp
def _underivable_jvp(primals, tangents):
    raise ValueError(
        "a result of minimize or fit has no derivative; pass lax.stop_gradient of what it depends "
        "on, or differentiate its optimality conditions"
    )
