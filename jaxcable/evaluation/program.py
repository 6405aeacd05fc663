"""`Program`: a function of arrays, traced once, which NumPy evaluates or XLA compiles."""

from __future__ import annotations

import functools
import math
import threading
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import jax

from ..common import jax_internals as internals
from ..common.compilation import without_garbage_collection
from ..common.types import Array
from . import decision
from .evaluator import count_equations, write_program
from .writing import LimitReached

# Entries of the largest array of floats up to which a program is compiled with
# `quick_compile_options`: it is as fast for some hundred unknowns, and up to half as slow again
# for thousands.
_QUICK_ENTRIES = 2000


class Program:
    """A function of arrays of certain shapes. It is traced when it is first needed.

    Args:
        function: function of arrays to a pytree of arrays.
        leaves: arrays in the shapes and dtypes of its arguments; their values do not matter.

    Attributes:
        tree: tree of what the function returns, known after it has been traced.
        work: work that NumPy has done with it, see `decision`.
    """

    def __init__(self, function: Callable[..., Any], leaves: Sequence[Any]):
        self._function, self._avals = function, [internals.abstract_argument(x) for x in leaves]
        self.tree: Any = None
        self.work = 0.0
        self._n_equation = 0
        self._has_rules = True
        self._numpy: Callable[..., Any] | None = None
        self._xla: Callable[..., Any] | None = None
        self._derived: dict[Hashable, Any] = {}
        self._lock = threading.RLock()

    def function(self, *leaves: Array) -> list[Array]:
        """Return the leaves of what the function returns, and note its tree."""
        found, self.tree = jax.tree.flatten(self._function(*leaves))
        return found

    @functools.cached_property
    def traced(self) -> Any:
        """The function as jax has traced it (`jax.stages.Traced`)."""
        with self._lock, without_garbage_collection():
            sizes = [math.prod(x.shape) for x in self._avals if x.dtype.kind == "f"]
            quick = max(sizes, default=0) <= _QUICK_ENTRIES
            options = internals.quick_compile_options() if quick else None
            function = self.function  # a new object: jax forgets the trace together with it
            return jax.jit(function, compiler_options=options).trace(*self._avals)

    @property
    def avals(self) -> list[Any]:
        """Shapes and dtypes of the results."""
        return list(self.traced.jaxpr.out_avals)

    def derived(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return what has been made of this program under a key, such as its derivative."""
        with self._lock:
            if key not in self._derived:
                self._derived[key] = make()
            return self._derived[key]

    def run(self, leaves: Sequence[Any]) -> list[Array]:
        """Return the leaves of the results for known arrays."""
        way = decision.way_now()
        if way == "numpy" or (way == "auto" and self._xla is None):
            found = self._evaluate(way, leaves)
            if found is not None:
                return internals.arrays_on_default_device(found)
        with self._lock:
            if self._xla is None:
                with without_garbage_collection():
                    self._xla = self.traced.lower().compile()
        return self._xla(*leaves)

    def _evaluate(self, way, leaves):
        """Return the results by NumPy; None if the program is to be compiled."""
        if not self._has_rules:
            return None
        try:
            with self._lock:
                if self._numpy is None:
                    with without_garbage_collection():
                        self._n_equation = count_equations(self.traced.jaxpr)
                        self._numpy = write_program(self.traced.jaxpr)
            if decision.is_compiled(way, self.work, self._n_equation):
                return None
            work = [0.0, decision.most_work(way, self._n_equation)]
            try:
                return self._numpy(leaves, work)
            finally:
                self.work += work[0]
        except LimitReached:
            return None
        except NotImplementedError:  # a primitive without a rule
            self._has_rules = False
            return None
