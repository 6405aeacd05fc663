"""What is known at the same time: programs of a function, derivatives and batches of a program."""

from __future__ import annotations

import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, ClassVar

from ..common.compilation import on_forget_programs

MOST_PROGRAMS = 32
"""Programs of a function that are known at the same time, so that a process does not grow."""


class KnownPrograms:
    """The last 32 programs of a function, or made of a program, by key; thread-safe.

    Attributes:
        every: all objects of this class, so that `forget_programs` empties them.
        programs: the programs by key, the last used one last.
    """

    every: ClassVar[weakref.WeakSet[KnownPrograms]] = weakref.WeakSet()

    def __init__(self) -> None:
        self.programs: OrderedDict[Any, Any] = OrderedDict()
        self._lock = threading.RLock()
        with _of_all:
            self.every.add(self)

    def find(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return the program of a key; if it is not known, make it by `make` and store it."""
        with self._lock:
            program = self.programs.pop(key, None) or make()
            self.programs[key] = program  # as the last one
            while len(self.programs) > MOST_PROGRAMS:
                self.programs.popitem(last=False)
        return program

    def forget(self) -> None:
        """Forget all programs."""
        with self._lock:
            self.programs.clear()


_of_all = threading.Lock()  # for `KnownPrograms.every`


@on_forget_programs
def _forget():
    """Empty all `KnownPrograms`: later calls are traced and compiled anew."""
    with _of_all:
        every = list(KnownPrograms.every)
    for known in every:
        known.forget()
