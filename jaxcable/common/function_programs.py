"""Compiled programs of users' functions, known by the function object and forgotten with it."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable
from typing import Any


class ProgramCache:
    """Compiled programs of users' functions, so that a second call does not compile again.

    A call ``cache(function, *options)`` returns the program of this function object. The cache does
    not keep the function alive: its programs are dropped when the function is deleted.

    Args:
        make: function ``make(reference, *options)`` that compiles and returns a program; within it
            `reference()` returns the user's function.
    """

    def __init__(self, make: Callable[..., Callable[..., Any]]):
        self.make, self.programs_of = make, weakref.WeakKeyDictionary()

    def __call__(self, function: Callable[..., Any], *options: Hashable) -> Any:
        """Return the program of a function with some options; make it at the first call."""
        try:
            programs = self.programs_of.setdefault(function, {})
        except TypeError:  # the function has no hash, or allows no weak references: keep nothing
            return self.make(lambda: function, *options)
        if options not in programs:
            programs[options] = self.make(weakref.ref(function), *options)
        return programs[options]
